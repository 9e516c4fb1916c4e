//! Which rule an estimator's evidence follows.

/// How the covariance follows from what held-out windows showed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Rule {
    /// No evidence is asked for.
    #[default]
    Off,
    /// That of the head of this module.
    Curved,
    /// The same with stated noise beyond the recording's: s is 1 at least.
    Louder,
    /// An exact recording, and nothing known of the noise of later outputs: what V shows of it is
    /// all there is. V₀ and Q₀ are those of noise of one unit, s is the mean of v over the last M
    /// steps, forgotten exponentially, and Σ = A + Q.
    Exact,
    /// An exact recording and stated noise: s = 1 as long as V is what that noise explains, and
    /// Σ = A + Q.
    Stated,
    /// The weights of the recording: Σ is the covariance of the Kalman filter and of what the
    /// recording leaves open of its model, see [`model`](crate::evidence::model), and V = Σ‖ν‖²
    /// over the window (its NIS).
    Filter,
}

impl Rule {
    const ALL: [Rule; 6] =
        [Rule::Off, Rule::Curved, Rule::Louder, Rule::Exact, Rule::Stated, Rule::Filter];

    /// Whether it is that of a noisy recording in weights of its own choice.
    pub fn is_curved(self) -> bool {
        matches!(self, Rule::Curved | Rule::Louder)
    }

    /// A number for what is saved.
    pub fn code(self) -> u32 {
        self as u32
    }

    /// The rule of a [`code`](Self::code).
    pub fn from_code(code: u32) -> Option<Self> {
        Self::ALL.get(code as usize).copied()
    }
}
