//! Saving a running estimator and bringing it back.
//!
//! A snapshot holds the recording, the configuration and the window; everything computed from them is computed
//! again on [`DdMhe::restore`], so that a restored estimator continues with the same numbers.

use crate::active_set::Side;
use crate::config::Config;
use crate::error::Error;
use crate::history::History;
use crate::mhe::DdMhe;
use serde::{Deserialize, Serialize};

/// First bytes of every snapshot: name and format version.
const MAGIC: &[u8; 8] = b"ddmhe\0\0\x03";

#[derive(Serialize, Deserialize)]
struct Snapshot {
    history: History,
    config: Config,
    outputs: Vec<f64>,
    states: Vec<f64>,
    bounds: Vec<f64>,
    active: Vec<Side>,
    moves: bool,
    t: usize,
}

impl DdMhe {
    /// The estimator as bytes, for [`restore`](Self::restore).
    pub fn snapshot(&self) -> Vec<u8> {
        let (outputs, states) = self.window();
        let (active, moves) = self.active_bounds();
        let snapshot = Snapshot {
            history: self.history().clone(),
            config: self.config().clone(),
            outputs: outputs.to_vec(),
            states: states.to_vec(),
            bounds: self.bounds().to_vec(),
            active: active.to_vec(),
            moves,
            t: self.t(),
        };
        // Writing plain numbers to memory cannot fail.
        postcard::to_extend(&snapshot, MAGIC.to_vec()).unwrap_or_default()
    }

    /// The estimator that [`snapshot`](Self::snapshot) saved; its next steps give the same numbers.
    ///
    /// # Errors
    /// [`Error::Value`] when the bytes are not a snapshot of this version or are damaged.
    pub fn restore(blob: &[u8]) -> Result<Self, Error> {
        let expected = "the bytes of a snapshot made by this version";
        let found = || format!("{} bytes that are not", blob.len());
        let body = blob.strip_prefix(MAGIC).ok_or_else(|| Error::value("blob", expected, found()))?;
        let snapshot: Snapshot = postcard::from_bytes(body).map_err(|_| Error::value("blob", expected, found()))?;
        let history = snapshot.history.revalidated()?;
        let mut mhe = DdMhe::new(&history, snapshot.config)?;
        mhe.resume(
            (&snapshot.outputs, &snapshot.states),
            snapshot.bounds,
            (snapshot.active, snapshot.moves),
            snapshot.t,
        )?;
        Ok(mhe)
    }
}
