//! Which recursion an observer runs, and how much it keeps.

use crate::reduce::Reduction;

/// Which recursion. See [`observer`](crate::observer).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Method {
    /// (45)-(50) and (59) as printed (with the sound V₀).
    Paper,
    /// One interval matrix, and a box contracted with the measurements.
    #[default]
    Tight,
}

impl Method {
    /// All of them.
    pub const ALL: [Method; 2] = [Method::Tight, Method::Paper];

    /// The method as the word that users write.
    pub fn as_str(self) -> &'static str {
        match self {
            Method::Tight => "tight",
            Method::Paper => "paper",
        }
    }
}

/// What is carried along, and how. The default serves every language.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Options {
    /// Number q ≥ n of generators kept.
    pub order: usize,
    /// Recursion.
    pub method: Method,
    /// Reduction of `Tight`; `Paper` has its own.
    pub reduction: Reduction,
}

impl Default for Options {
    fn default() -> Self {
        Options { order: 20, method: Method::default(), reduction: Reduction::Pca }
    }
}
