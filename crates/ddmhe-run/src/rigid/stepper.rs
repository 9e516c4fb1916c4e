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
/// Samples of a fit that a step of [`Refit::Sliced`] takes in, with 1 to 6 outputs: some 30 µs on a
/// PC.
const SLICE: [usize; 6] = [43, 29, 20, 14, 10, 7];
/// Samples that such a step replays.
const REPLAYED: usize = 8;
/// Lengths of the recording after which its first fit begins, and by what factor more time is to
/// have passed at the next.
const SLICED: (f64, f64) = (0.12, 1.15);
/// One fit in so many is thorough.
const THOROUGH: usize = 3;

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
    SLICE[p - 1]
}

/// When all data are fitted anew.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Refit {
    /// One after the other, a slice with each step: the filter goes on meanwhile, and at the end
    /// goes on from the fit, with what came since. Most are from the filter's parameters alone; one
    /// in three is thorough: it also begins at another optimum, and tries the other prior on offsets.
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
    /// Fits, how often they were advanced, and the optimum other than the best that they begin at,
    /// too; 0: none.
    Fits(Anchoring<P, N>, usize, usize),
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
    /// Sample at which the last of them began.
    pub begun: usize,
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
        Some(Stepper { filter, optima, t: 0, fits: 0, begun: 0, work: None, refit, size, known })
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

    /// Fits all data anew, to the end, from the filter and from each optimum; whether a rigid body
    /// explains them. `data` ends with y(t-1).
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
                let outputs = data.y.len();
                let next = (SLICED.0 * outputs as f64).max(SLICED.1 * self.begun as f64);
                if self.t as f64 >= next && self.t <= last_fit(outputs) {
                    self.begin(outputs);
                }
            }
            Some(Work::Fits(fits, calls, other)) => {
                *calls += 1;
                if fits.advance(data, slice(P)) {
                    let (found, end) = (fits.optima(), fits.end() - data.y.len());
                    let other = *other;
                    self.follow(found, end, other);
                }
            }
            Some(Work::Replay(optima, filter, next)) => {
                let Some(best) = &optima[0] else { return };
                let mut foretold = true;
                for k in *next..self.t.min(*next + REPLAYED) {
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

    /// Begins fits in slices.
    fn begin(&mut self, outputs: usize) {
        let thorough = self.fits % THOROUGH == THOROUGH - 1;
        let kept = self.optima.iter().flatten().count();
        let other = match thorough && kept > 1 {
            true => 1 + self.fits / THOROUGH % (kept - 1),
            false => 0,
        };
        let Some(own) = self.own() else { return };
        let more = self.optima[other].filter(|_| other > 0).map(|f| f.motion.rebased(&f.z));
        let settings = (self.size, self.known, thorough);
        let starts = core::iter::once(own).chain(more);
        let fits = Anchoring::new(starts, outputs + self.t, settings);
        self.work = fits.map(|fits| Work::Fits(fits, 0, other));
        (self.fits, self.begun) = (self.fits + 1, self.t);
    }

    /// Sends a filter after the newest output, from the end of a fit's data on, or doubts where no
    /// optimum explains them. The optima that were not tried stay.
    fn follow(&mut self, found: Option<Optima<P, N>>, end: usize, other: usize) {
        let next = found.and_then(|found| self.from(found));
        if next.is_none() {
            self.filter.doubt();
        }
        self.work = next.map(|(mut optima, filter)| {
            let untried = (1..OPTIMA).filter(|&k| k != other).filter_map(|k| self.optima[k]);
            let room = optima.iter_mut().filter(|f| f.is_none());
            room.zip(untried).for_each(|(room, f)| *room = Some(f));
            Work::Replay(optima, filter, end)
        });
    }

    /// Where the filter's parameters would begin.
    fn own(&self) -> Option<(Body<P, N>, [f64; N])> {
        let best = self.best()?;
        let mut own = self.filter.z;
        own[..3].copy_from_slice(&best.z[..3]);
        Some(best.motion.rebased(&own))
    }

    /// Fits from the filter's parameters and from each optimum that was kept.
    fn starts(&self, outputs: usize, end: usize) -> Option<Anchoring<P, N>> {
        let from = usize::from(self.t > ALTERNATIVES * outputs);
        let kept = self.optima.iter().skip(from).flatten().map(|f| f.motion.rebased(&f.z));
        let starts = core::iter::once(self.own()?).chain(kept).take(OPTIMA + 1);
        Anchoring::new(starts, end, (self.size, self.known, true))
    }

    /// The filter that goes on from the best of these.
    fn from(&self, found: Optima<P, N>) -> Option<(Optima<P, N>, Filter<P, N>)> {
        let mut filter = Filter::new(found[0].as_ref()?, &self.filter.noise);
        (filter.score, filter.wild) = (self.filter.score.min(1.0), self.filter.wild);
        Some((found, filter))
    }
}
