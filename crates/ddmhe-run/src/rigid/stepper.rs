//! The estimator of a rigid body, sample by sample: the filters, and fits anew beside them.

use crate::rigid::anchoring::{Anchoring, Manner, Optima};
use crate::rigid::data::Data;
use crate::rigid::filter::{Innovation, Limits};
use crate::rigid::layout::outputs;
use crate::rigid::mixture::{Member, Mixture};
use crate::rigid::motion::Family;
use crate::rigid::pass::Units;
use crate::rigid::small::Vector;

/// After how many lengths of the recordings all data are fitted anew; then each time that so many
/// times as much has passed, up to the last.
const SCHEDULE: ([f64; 7], f64, f64) = ([0.25, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0], 1.15, 32.0);
/// Filters are linear about fits from so many lengths of the recording on, until what came since is
/// such a share of what the fit is of: before, fits follow each other so closely that the extended
/// filter does.
const HELD: (f64, f64) = (2.0, 0.5);
/// The same where fits are made in slices, and come later.
const HELD_IN_SLICES: (f64, f64) = (0.0, 2.0);
/// The latest optimum of the leading motion is a start, too, up to so many of its lengths.
const ALTERNATIVES: usize = 4;
/// Samples of a fit, or means, that a step of [`Refit::Sliced`] takes in, with 1 to 6 outputs, 2 of
/// them in room for 3, 4 and 5 in room for 6: some 25 µs on a PC.
const SLICE: [usize; 6] = [64, 43, 30, 15, 12, 10];
/// Samples that such a step replays: of all motions together, and of each at least.
const REPLAYED: (usize, usize) = (15, 4);
/// Lengths of the recording after which its first round of fits begins, and by what factor more
/// time is to have passed at the next. Each is followed by as long a rest: most steps are the
/// filters' alone.
const SLICED: (f64, f64) = (0.12, 1.2);
/// So many of the first rounds of fits, and then each time twice as many, one is thorough.
const THOROUGH: usize = 3;

/// Number of the sample, of `outputs` recorded ones, at which fit `k` anew is due.
pub fn due(k: usize, outputs: usize) -> Option<usize> {
    let (first, factor, last) = SCHEDULE;
    let beyond =
        |k: usize| first[first.len() - 1] * libm::pow(factor, (k + 1 - first.len()) as f64);
    let lengths = first.get(k).copied().unwrap_or_else(|| beyond(k));
    (lengths <= last).then(|| libm::rint(lengths * outputs as f64) as usize)
}

/// Number of the sample at which the last of them is due.
pub fn last_fit(outputs: usize) -> usize {
    (SCHEDULE.2 * outputs as f64) as usize
}

/// Samples of a fit that one step takes in, with p outputs.
pub const fn slice(p: usize) -> usize {
    SLICE[p - 1]
}

/// When all data are fitted anew.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Refit {
    /// One round after the other, a slice with each step: the filters go on meanwhile, and at the
    /// end others go on from the fits, with what came since. The third round, the sixth, the
    /// twelfth, … are thorough: they also try the other prior on offsets. What hardly counts is not
    /// fitted. Fits are of means where there are such.
    #[default]
    Sliced,
    /// When they are due, in the step that they are due in.
    Now,
    /// When [`Stepper::fit_anew`] is called.
    Manual,
}

/// What goes on beside the filters.
#[derive(Debug, Clone, PartialEq)]
#[allow(clippy::large_enum_variant)] // there is no memory but this
pub enum Work<M, const P: usize, const N: usize> {
    /// Fits, and how often they were advanced.
    Fits(Anchoring<M, P, N>, usize),
    /// Members on their way from the end of their fits' data to the newest output, and the next
    /// output.
    Replay(Mixture<M, P, N>, usize),
}

/// Where the estimator stands.
#[derive(Debug, Clone, PartialEq)]
pub struct Stepper<M, const P: usize, const N: usize> {
    /// What may have made the data.
    pub mixture: Mixture<M, P, N>,
    /// Samples consumed.
    pub t: usize,
    /// Fits anew so far.
    pub fits: usize,
    /// Sample at which the last of them began.
    pub begun: usize,
    /// Sample at which the last round of fits ended.
    pub ended: usize,
    /// What goes on beside the filters.
    pub work: Option<Work<M, P, N>>,
    /// Whether motions are fitted anew, and when.
    pub refit: Option<Refit>,
    /// Root-mean-square size of the recorded outputs.
    pub size: f64,
    /// Whether the noise was stated, not read off the recording.
    pub known: bool,
    /// Members at most.
    pub most: usize,
    /// Whether no body explains the data of the latest fits.
    pub unexplained: bool,
}

impl<M: Family<P, N>, const P: usize, const N: usize> Stepper<M, P, N> {
    /// From the end of the recording, with the optima that its fit found, the best first, and the
    /// noise of later outputs; None without an optimum. At most so many are followed.
    pub fn new(
        optima: &Optima<M, N>,
        noise: &[f64; P],
        refit: Option<Refit>,
        (size, known, most): (f64, bool, usize),
    ) -> Option<Self> {
        let unexplained = !optima[0].as_ref()?.misfit.explained(known);
        let mixture = Mixture::new(optima, noise, (most, 0))?;
        let (t, fits, begun) = (0, 0, 0);
        let work = None;
        Some(Stepper {
            mixture,
            t,
            fits,
            begun,
            ended: 0,
            work,
            refit,
            size,
            known,
            most,
            unexplained,
        })
    }

    /// The motion that is believed most.
    pub fn leading(&self) -> Option<&Member<M, P, N>> {
        self.mixture.at(self.mixture.leading())
    }

    /// Consumes y(t-1), with what is known of that instant, and, where they were measured, rates of
    /// it and their noise: what y said to the leading motion, and whether ω(t) could be foretold.
    /// What was too wild for that motion becomes NaN. A driven motion stays where it is.
    #[inline(always)]
    pub fn advance(
        &mut self,
        y: &mut [f64; P],
        known: &M::Known,
        rates: Option<(&mut Vector, &Vector)>,
    ) -> (Innovation<P>, bool) {
        self.t += 1;
        let leading = self.mixture.leading();
        let (given, given_rates) = (*y, rates.as_ref().map(|(x, noise)| (**x, **noise)));
        let (mut said, mut foretold, mut seen) = (Innovation::NONE, true, [f64::NAN; 3]);
        for (k, member) in self.mixture.counted_mut() {
            let (mut own, motion) = (given, &member.found.motion);
            if let Some((mut x, noise)) = given_rates {
                member.filter.see(&mut x, &noise);
                if k == leading {
                    seen = x;
                }
            }
            let own_said = member.filter.update(motion, known, &mut own);
            if !M::DRIVEN {
                foretold &= member.filter.predict(motion, (known, known));
            }
            if k == leading {
                (said, *y) = (own_said, own);
            }
        }
        rates.into_iter().for_each(|(x, _)| *x = seen);
        if !foretold {
            foretold = self.mixture.drop_runaways();
        }
        (said, foretold)
    }

    /// What is due beside the filters, and ω into its box. `data` ends with y(t-1).
    pub fn anchor(
        &mut self,
        data: &Data<'_, P, M::Known>,
        limits: Option<&Limits>,
        units: &impl Units,
    ) {
        match self.refit {
            Some(Refit::Now) => {
                if self.is_due(data) {
                    self.fit_anew(data, units);
                }
            }
            Some(Refit::Sliced) => self.slice(data, limits, units),
            Some(Refit::Manual) | None => {}
        }
        let of = self.mixture.of;
        if self.t.saturating_sub(of) as f64 > self.held().1 * (data.recorded() + of) as f64 {
            self.mixture.hold(false);
        }
        let Some(limits) = limits.filter(|_| !M::DRIVEN) else { return };
        self.mixture.counted_mut().for_each(|(_, member)| member.filter.confine(limits));
    }

    /// When filters are linear about their fits.
    fn held(&self) -> (f64, f64) {
        if self.refit == Some(Refit::Sliced) { HELD_IN_SLICES } else { HELD }
    }

    /// Whether a fit is due, or was since the last one: it is then no more.
    fn is_due(&mut self, data: &Data<'_, P, M::Known>) -> bool {
        let before = self.fits;
        while due(self.fits, data.recorded()).is_some_and(|due| due <= self.t) {
            self.fits += 1;
        }
        self.fits > before
    }

    /// Fits all data anew, to the end, from the leading filter and from the latest optimum of each
    /// motion; whether a rigid body explains them. `data` ends with y(t-1).
    pub fn fit_anew(&mut self, data: &Data<'_, P, M::Known>, units: &impl Units) -> bool {
        self.work = None;
        let Some(mut fits) = self.starts(data, true) else { return false };
        while !fits.advance(data, usize::MAX, units) {}
        self.begun = self.t;
        let Some(mixture) = self.following(&fits, data) else { return false };
        self.mixture = mixture;
        true
    }

    /// Goes on with what goes on beside the filters, or begins fits of all data as [`fit_anew`]
    /// does, a slice after the other as long as there is time, asked after each: whether a rigid
    /// body explains the data of the fits; None where they have not come to an end, or the filters
    /// that go on from them not to the newest output. Without steps in between the end is that of
    /// [`fit_anew`].
    ///
    /// [`fit_anew`]: Self::fit_anew
    pub fn fit_while(
        &mut self,
        data: &Data<'_, P, M::Known>,
        limits: Option<&Limits>,
        units: &impl Units,
        mut time_left: impl FnMut() -> bool,
    ) -> Option<bool> {
        if self.work.is_none() {
            let Some(fits) = self.starts(data, true) else { return Some(false) };
            (self.work, self.begun) = (Some(Work::Fits(fits, 0)), self.t);
        }
        while self.work.is_some() {
            self.go_on(data, limits, units);
            if self.work.is_some() && !time_left() {
                return None;
            }
        }
        Some(!self.unexplained)
    }

    /// Fits of all data, from the leading filter and from the latest optimum of each motion; in
    /// slices from the latter alone, and of what counts: there is no time for more.
    fn starts(&self, data: &Data<'_, P, M::Known>, settles: bool) -> Option<Anchoring<M, P, N>> {
        if data.later.len() < self.t {
            return None; // not all are kept any more
        }
        let (leading, place) = (self.leading()?, self.mixture.leading());
        let (counted, all) = (self.mixture.probabilities(), self.refit != Some(Refit::Sliced));
        let stale = all && self.t <= ALTERNATIVES * data.recorded();
        let others = self.mixture.members().enumerate();
        let others = others.filter(|(k, _)| *k != place && (all || counted[*k] > 0.0));
        let others = others.map(|(_, member)| member.from_optimum());
        let held = leading.filter.nominal.is_some();
        let first = if all || held { leading.from_filter() } else { leading.from_optimum() };
        let starts =
            core::iter::once(first).chain(stale.then(|| leading.from_optimum())).chain(others);
        let (later, near) = (self.t, !all);
        let means = data
            .means
            .filter(|means| near && !leading.found.motion.is_simulated() && means.are_whole(later));
        let end = data.y.len() + means.map_or(later, |means| means.reach(later));
        let manner = Manner { settles, near, of_means: means.is_some() };
        Anchoring::new(starts, end, (self.size, self.known), manner)
    }

    /// What goes on from ended fits; where no body explains the data all filters doubt.
    fn following(
        &mut self,
        fits: &Anchoring<M, P, N>,
        data: &Data<'_, P, M::Known>,
    ) -> Option<Mixture<M, P, N>> {
        let leading = self.leading()?.filter;
        let since = fits.end() - data.y.len();
        let settings = (self.most, since);
        let found = fits.optima().and_then(|found| Mixture::new(&found, &leading.noise, settings));
        self.unexplained = found.is_none();
        let Some(mut mixture) = found else {
            self.mixture.counted_mut().for_each(|(_, member)| member.filter.doubt());
            return None;
        };
        mixture.counted_mut().for_each(|(_, member)| member.filter.inherit(&leading));
        mixture.hold(since as f64 >= self.held().0 * data.recorded() as f64);
        Some(mixture)
    }

    /// One slice of what goes on beside the filters.
    fn slice(&mut self, data: &Data<'_, P, M::Known>, limits: Option<&Limits>, units: &impl Units) {
        match self.work {
            None => self.begin(data),
            Some(_) => self.go_on(data, limits, units),
        }
    }

    /// The same of what has begun.
    fn go_on(&mut self, data: &Data<'_, P, M::Known>, limits: Option<&Limits>, units: &impl Units) {
        match &mut self.work {
            None => {}
            Some(Work::Fits(fits, calls)) => {
                let in_means = data.in_means();
                let of = if fits.manner().of_means { &in_means } else { data };
                *calls += 1;
                if fits.advance(of, slice(outputs(&data.of_later)), units)
                    && let Some(Work::Fits(fits, _)) = self.work.take()
                {
                    let next = fits.end() - data.y.len();
                    self.ended = self.t;
                    self.work =
                        self.following(&fits, data).map(|mixture| Work::Replay(mixture, next));
                }
            }
            Some(Work::Replay(mixture, next)) => {
                let count = (REPLAYED.0 / mixture.counted_mut().count().max(1)).max(REPLAYED.1);
                let until = self.t.min(*next + count);
                let foretold = mixture.replay(data, *next..until, limits);
                *next = until;
                if (!foretold || until == self.t)
                    && let Some(Work::Replay(mixture, _)) = self.work.take()
                {
                    self.ended = self.t;
                    if foretold {
                        self.mixture = mixture;
                    }
                }
            }
        }
    }

    /// Begins a round of fits when it is time.
    fn begin(&mut self, data: &Data<'_, P, M::Known>) {
        let outputs = data.recorded();
        let next = (SLICED.0 * outputs as f64).max(SLICED.1 * self.begun as f64);
        let rested = self.ended + self.ended.saturating_sub(self.begun);
        if self.t < rested || (self.t as f64) < next || self.t > last_fit(outputs) {
            return;
        }
        let rounds = self.fits + 1;
        let thorough = rounds.is_multiple_of(THOROUGH) && (rounds / THOROUGH).is_power_of_two();
        let fits = self.starts(data, thorough);
        self.work = fits.map(|fits| Work::Fits(fits, 0));
        (self.fits, self.begun) = (self.fits + 1, self.t);
    }
}
