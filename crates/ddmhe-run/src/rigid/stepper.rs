//! The estimator of a rigid body, sample by sample: the filter, and fits anew beside it.

use crate::rigid::anchoring::{Anchoring, OPTIMA, Optima};
use crate::rigid::body::Body;
use crate::rigid::filter::{Filter, Innovation, Limits};
use crate::rigid::pass::Data;
use crate::rigid::posterior::Posterior;

/// After how many lengths of the recording all data are fitted anew.
pub const SCHEDULE: [f64; 12] = [0.25, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 8.0, 16.0, 32.0];
/// The optima of the recording other than the best are fitted anew up to so many of its lengths.
const ALTERNATIVES: usize = 4;
/// Rows of outputs that a step of [`Refit::Sliced`] takes in, and samples that it replays.
const SLICE: (usize, usize) = (30, 8);

/// Number of the sample, of `outputs` recorded ones, at which fit `k` anew is due.
pub fn due(k: usize, outputs: usize) -> Option<usize> {
    SCHEDULE.get(k).map(|lengths| libm::rint(lengths * outputs as f64) as usize)
}

/// Number of the sample at which the last of them is due.
pub fn last_fit(outputs: usize) -> usize {
    due(SCHEDULE.len() - 1, outputs).unwrap_or(0)
}

/// Samples of a fit that one step takes in, with p outputs.
pub const fn slice(p: usize) -> usize {
    SLICE.0.div_ceil(p)
}

/// When all data are fitted anew.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Refit {
    /// When they are due, a slice with each step: the filter goes on meanwhile, and at the end goes
    /// on from the fit, with what came since. What becomes due meanwhile is one fit after it.
    #[default]
    Sliced,
    /// When they are due, in the step that they are due in.
    Now,
    /// When [`Stepper::fit_anew`] is called.
    Manual,
}

/// What goes on beside the filter.
#[derive(Debug, Clone, PartialEq)]
#[allow(clippy::large_enum_variant)] // there is no memory but this
pub enum Work<const P: usize, const N: usize> {
    /// Fits, and how often they were advanced.
    Fits(Anchoring<P, N>, usize),
    /// Another filter, on its way from the end of a fit's data to the newest output.
    Replay(Optima<P, N>, Filter<P, N>, usize),
}

/// Where the estimator stands.
#[derive(Debug, Clone, PartialEq)]
pub struct Stepper<const P: usize, const N: usize> {
    /// The filter.
    pub filter: Filter<P, N>,
    /// What is believed to have made the recording, the best first.
    pub optima: Optima<P, N>,
    /// Samples consumed.
    pub t: usize,
    /// Fits anew so far.
    pub fits: usize,
    /// What goes on beside the filter.
    pub work: Option<Work<P, N>>,
    /// Whether optima are fitted anew, and when.
    pub refit: Option<Refit>,
    /// Root-mean-square size of the recorded outputs.
    pub size: f64,
    /// Whether the noise was stated, not read off the recording.
    pub known: bool,
}

impl<const P: usize, const N: usize> Stepper<P, N> {
    /// From the end of the recording, with the optima that its fit found, the best first, and the
    /// noise of later outputs; None without an optimum.
    pub fn new(
        optima: Optima<P, N>,
        noise: &[f64; P],
        refit: Option<Refit>,
        (size, known): (f64, bool),
    ) -> Option<Self> {
        let filter = Filter::new(optima[0].as_ref()?, noise);
        Some(Stepper { filter, optima, t: 0, fits: 0, work: None, refit, size, known })
    }

    /// The motion that is believed.
    pub fn best(&self) -> Option<&Posterior<Body<P, N>, N>> {
        self.optima[0].as_ref()
    }

    /// Consumes y(t-1), whose wild entries become NaN: what it said, and whether ω(t) could be
    /// foretold.
    #[inline(always)]
    pub fn advance(&mut self, y: &mut [f64; P]) -> (Innovation<P>, bool) {
        self.t += 1;
        let Some(best) = &self.optima[0] else { return (Innovation::NONE, false) };
        let said = self.filter.update(&best.motion, y);
        (said, self.filter.predict(&best.motion))
    }

    /// What is due beside the filter, and ω into its box. `data` ends with y(t-1).
    pub fn anchor(&mut self, data: &Data<'_, P>, limits: Option<&Limits>) {
        match self.refit {
            Some(Refit::Now) => {
                if self.is_due(data) {
                    self.fit_anew(data);
                }
            }
            Some(Refit::Sliced) => self.slice(data, limits),
            Some(Refit::Manual) | None => {}
        }
        limits.into_iter().for_each(|limits| self.filter.confine(limits));
    }

    /// Whether a fit is due, or was since the last one: it is then no more.
    fn is_due(&mut self, data: &Data<'_, P>) -> bool {
        let before = self.fits;
        while due(self.fits, data.y.len()).is_some_and(|due| due <= self.t) {
            self.fits += 1;
        }
        self.fits > before
    }

    /// Fits all data anew, to the end; whether a rigid body explains them. `data` ends with y(t-1).
    pub fn fit_anew(&mut self, data: &Data<'_, P>) -> bool {
        self.work = None;
        let end = data.y.len() + self.t;
        let Some(mut fits) = self.starts(data.y.len(), end) else { return false };
        while !fits.advance(data, usize::MAX) {}
        let Some((optima, filter)) = fits.optima().and_then(|found| self.from(found)) else {
            self.filter.doubt();
            return false;
        };
        (self.optima, self.filter) = (optima, filter);
        true
    }

    /// One slice of what goes on beside the filter.
    fn slice(&mut self, data: &Data<'_, P>, limits: Option<&Limits>) {
        match &mut self.work {
            None => {
                if self.is_due(data) {
                    let end = data.y.len() + self.t;
                    self.work = self.starts(data.y.len(), end).map(|fits| Work::Fits(fits, 0));
                }
            }
            Some(Work::Fits(fits, calls)) => {
                *calls += 1;
                if fits.advance(data, slice(P)) {
                    let (found, end) = (fits.optima(), fits.end() - data.y.len());
                    self.follow(found, end);
                }
            }
            Some(Work::Replay(optima, filter, next)) => {
                let Some(best) = &optima[0] else { return };
                let mut foretold = true;
                for k in *next..self.t.min(*next + SLICE.1) {
                    let mut y = data.later[k];
                    filter.update(&best.motion, &mut y);
                    foretold &= filter.predict(&best.motion);
                    limits.into_iter().for_each(|limits| filter.confine(limits));
                    *next = k + 1;
                }
                if !foretold {
                    self.work = None;
                } else if *next == self.t {
                    (self.optima, self.filter) = (*optima, *filter);
                    self.work = None;
                }
            }
        }
    }

    /// Sends a filter after the newest output, from the end of a fit's data on, or doubts where no
    /// optimum explains them.
    fn follow(&mut self, found: Option<Optima<P, N>>, end: usize) {
        let next = found.and_then(|found| self.from(found));
        if next.is_none() {
            self.filter.doubt();
        }
        self.work = next.map(|(optima, filter)| Work::Replay(optima, filter, end));
    }

    /// Fits from the filter's parameters and from each optimum that was kept.
    fn starts(&self, outputs: usize, end: usize) -> Option<Anchoring<P, N>> {
        let best = self.best()?;
        let mut own = self.filter.z;
        own[..3].copy_from_slice(&best.z[..3]);
        let from = usize::from(self.t > ALTERNATIVES * outputs);
        let kept = self.optima.iter().skip(from).flatten().map(|f| (f.motion, f.z));
        let starts = core::iter::once((best.motion, own)).chain(kept).take(OPTIMA + 1);
        let starts = starts.map(|(body, z)| body.rebased(&z));
        Anchoring::new(starts, end, (self.size, self.known))
    }

    /// The filter that goes on from the best of these.
    fn from(&self, found: Optima<P, N>) -> Option<(Optima<P, N>, Filter<P, N>)> {
        let mut filter = Filter::new(found[0].as_ref()?, &self.filter.noise);
        (filter.score, filter.wild) = (self.filter.score.min(1.0), self.filter.wild);
        Some((found, filter))
    }
}
