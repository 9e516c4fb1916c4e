//! Estimators and recordings as bytes, and back: every blob is laid out as
//! [`ddmhe_interval::blob`] says.
//!
//! The snapshot of an estimator holds the recording, the configuration and the window; everything
//! computed from them is computed again on [`DdMhe::restore`], so that a restored estimator
//! continues with the same numbers.

use crate::config::Config;
use crate::error::Error;
use crate::estimate::{Estimate, Evidence};
use crate::history::History;
use crate::mhe::DdMhe;
use crate::saved::Saved;
use serde::{Deserialize, Serialize};

pub use ddmhe_interval::blob::{Kind, from_bytes, to_bytes};

#[derive(Serialize, Deserialize)]
struct Snapshot {
    history: History,
    config: Config,
    run: Saved,
}

impl DdMhe {
    /// The estimator as bytes, for [`restore`](Self::restore).
    pub fn snapshot(&self) -> Vec<u8> {
        let (history, config) = (self.history().clone(), self.config().clone());
        let snapshot = Snapshot { history, config, run: self.saved() };
        to_bytes(Kind::Estimator, &snapshot)
    }

    /// The estimator that [`snapshot`](Self::snapshot) saved; its next steps give the same numbers.
    ///
    /// # Errors
    /// As [`from_bytes`], and for content that no estimator has.
    ///
    /// # Example
    /// ```
    /// # use ddmhe_core::*;
    /// # // x(t+1) = 0.9 x(t) + 1, y = 2 x
    /// # let x: Vec<f64> =
    /// #     std::iter::successors(Some(0.0), |x| Some(0.9 * x + 1.0)).take(61).collect();
    /// # let y: Vec<f64> = x[..60].iter().map(|x| 2.0 * x).collect();
    /// # let history = History::new(1, 1, &x[..31], &y[..30], 0.1)?;
    /// let mut estimator = DdMhe::new(&history, Config::default())?;
    /// estimator.step(&y[30..31])?;
    /// let mut other = DdMhe::restore(&estimator.snapshot())?;
    /// assert_eq!(estimator.step(&y[31..32])?.x, other.step(&y[31..32])?.x); // bit for bit
    /// # Ok::<(), Error>(())
    /// ```
    pub fn restore(blob: &[u8]) -> Result<Self, Error> {
        let snapshot: Snapshot = from_bytes(Kind::Estimator, blob)?;
        let mut mhe = DdMhe::new(&snapshot.history, snapshot.config)?;
        mhe.resume(snapshot.run)?;
        Ok(mhe)
    }
}

impl History {
    /// The recordings as bytes, for [`from_bytes`](Self::from_bytes).
    pub fn to_bytes(&self) -> Vec<u8> {
        to_bytes(Kind::History, self)
    }

    /// The recordings that [`to_bytes`](Self::to_bytes) saved.
    ///
    /// # Errors
    /// As [`from_bytes`], and for content that no history has.
    pub fn from_bytes(blob: &[u8]) -> Result<Self, Error> {
        from_bytes(Kind::History, blob)
    }
}

impl Estimate {
    /// Whether the sizes are those of a window of n states and p outputs; empty before the first
    /// step.
    pub fn fits(&self, n: usize, p: usize) -> bool {
        let (rows, samples) = (self.window.len() / n, self.v.len() / p);
        let whole = self.window.len() == rows * n
            && self.v.len() == samples * p
            && (self.w.is_empty() || self.w.len() == samples * n);
        let empty = self.x.is_empty() && self.window.is_empty() && self.v.is_empty();
        let judged = self.evidence.as_ref().is_none_or(|own| own.fits(n, p));
        judged && (empty || (whole && self.x.len() == n && rows == samples + 1))
    }
}

impl Evidence {
    /// Whether the sizes are those of n states and p outputs.
    fn fits(&self, n: usize, p: usize) -> bool {
        let of_outputs = [self.innovation.len(), self.innovation_variance.len()];
        let flags = [self.stuck.len(), self.gated.len()];
        self.covariance.len() == n * n && of_outputs == [p; 2] && flags == [p; 2]
    }
}
