//! Where an interval observer stands, as bytes: what its arguments do not say.

use super::contractor::{BACK, Past};
use super::{Dynamics, IntervalEstimate, IntervalObserver};
use crate::error::Error;
use crate::interval::Interval;
use crate::snapshot::{Kind, from_bytes, to_bytes};
use serde::{Deserialize, Serialize};

#[derive(Serialize, Deserialize)]
struct Present {
    step: usize,
    center: Vec<f64>,
    generators: Vec<f64>,
    distance: f64,
    decay: f64,
    box_: Vec<Interval>,
    past: Vec<Past>,
    estimate: IntervalEstimate,
}

impl<D: Dynamics> IntervalObserver<D> {
    /// Where it stands, for [`resume`](Self::resume).
    pub fn present(&self) -> Vec<u8> {
        let present = Present {
            step: self.step,
            center: self.center.clone(),
            generators: self.generators.clone(),
            distance: self.distance,
            decay: self.decay,
            box_: self.box_.clone(),
            past: self.past.clone(),
            estimate: self.estimate.clone(),
        };
        to_bytes(Kind::Observer, &present)
    }

    /// Continues from where an observer with the same arguments stood.
    ///
    /// # Errors
    /// As [`from_bytes`], and for the sets of another observer.
    pub fn resume(&mut self, blob: &[u8]) -> Result<(), Error> {
        let present: Present = from_bytes(Kind::Observer, blob)?;
        if !present.fits(self.n, self.p) {
            return Err(Error::value(
                "blob",
                "the state of an observer with the same arguments",
                "that of another",
            ));
        }
        let Present { step, center, generators, distance, decay, box_, past, estimate } = present;
        (self.step, self.distance, self.decay) = (step, distance, decay);
        (self.center, self.generators, self.box_) = (center, generators, box_);
        (self.past, self.estimate) = (past, estimate);
        Ok(())
    }
}

impl Present {
    fn fits(&self, n: usize, p: usize) -> bool {
        let proper = |x: &[Interval], len: usize| x.len() == len && x.iter().all(|x| x.lo <= x.hi);
        let past =
            |past: &Past| proper(&past.x, n) && proper(&past.input, n) && proper(&past.output, p);
        self.step < usize::MAX / 2
            && self.center.len() == n
            && self.generators.len().is_multiple_of(n)
            && self.distance >= 0.0
            && self.decay >= 0.0
            && proper(&self.box_, n)
            && self.past.len() <= BACK
            && self.past.iter().all(past)
            && self.estimate.fits(n)
    }
}

impl IntervalEstimate {
    /// Whether the sizes are those of n states: all, or before the first step `predicted` alone.
    pub fn fits(&self, n: usize) -> bool {
        let proper = |x: &[Interval], len: usize| x.len() == len && x.iter().all(|x| x.lo <= x.hi);
        let rest = if self.center.is_empty() { 0 } else { n };
        n > 0
            && proper(&self.predicted, n)
            && [&self.filtered, &self.ball, &self.ellipsoid].iter().all(|x| proper(x, rest))
            && self.center.len() == rest
            && self.generators.len().is_multiple_of(n)
    }
}
