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
