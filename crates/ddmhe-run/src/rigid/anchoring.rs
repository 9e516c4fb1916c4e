//! The motion fitted anew to recording and all outputs since, from several starts, in slices.

use crate::rigid::data::Data;
use crate::rigid::fit::Fit;
use crate::rigid::layout::outputs;
use crate::rigid::motion::Family;
use crate::rigid::pass::Units;
use crate::rigid::posterior::{EULER, Posterior};
use crate::rigid::start::Start;

/// Optima that are kept.
pub const OPTIMA: usize = 4;
/// Steps of a fit online that goes to its end.
const STEPS: usize = 40;
/// Of one from another optimum than the leading one's, where fits are near their ends: one that
/// takes more is hardly as probable.
const ALTERNATIVE: usize = 4;
/// An optimum is kept whose cost exceeds the least by less than this.
const KEPT: f64 = 30.0;
/// An offset that is free, relative to the size of the outputs; one that is not, to their noise.
pub const OFFSET: f64 = 0.1;

/// Optima, the best first.
pub type Optima<M, const N: usize> = [Option<Posterior<M, N>>; OPTIMA];

/// What is being fitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    /// Starts one after the other.
    Starts(usize),
    /// The best with a cubic part.
    Cubic,
    /// The best with the other prior on offsets.
    Offset,
    /// Nothing.
    Ended,
}

/// Fits as far as they have come.
#[derive(Debug, Clone, PartialEq)]
pub struct Anchoring<M, const P: usize, const N: usize> {
    starts: [Option<Start<M, N>>; OPTIMA + 1],
    found: [Option<Posterior<M, N>>; OPTIMA + 1],
    fit: Fit<M, P, N>,
    stage: Stage,
    /// Root-mean-square size of the recorded outputs.
    size: f64,
    /// Whether the noise was stated, not read off the recording.
    known: bool,
    /// How they are made.
    manner: Manner,
}

/// How fits are made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Manner {
    /// Whether the other prior on offsets is tried.
    pub settles: bool,
    /// Whether they are taken to be near their ends: see [`Fit::near`].
    pub near: bool,
    /// Whether they are of means.
    pub of_means: bool,
}

impl<M: Family<P, N>, const P: usize, const N: usize> Anchoring<M, P, N> {
    /// Of the outputs before number `end`, from up to five starts.
    pub fn new(
        starts: impl Iterator<Item = Start<M, N>>,
        end: usize,
        (size, known): (f64, bool),
        manner: Manner,
    ) -> Option<Self> {
        let mut own = [const { None }; OPTIMA + 1];
        own.iter_mut().zip(starts).for_each(|(own, start)| *own = Some(start));
        Some(Anchoring {
            fit: fit_of(own[0].as_ref()?, end, (STEPS, &manner)),
            starts: own,
            found: [const { None }; OPTIMA + 1],
            stage: Stage::Starts(0),
            size,
            known,
            manner,
        })
    }

    /// Where the fits begin.
    pub fn starts(&self) -> impl Iterator<Item = &Start<M, N>> {
        self.starts.iter().flatten()
    }

    /// How they are made.
    pub fn manner(&self) -> &Manner {
        &self.manner
    }

    /// How many outputs the fits are of.
    pub fn end(&self) -> usize {
        self.fit.end()
    }

    /// As much work as a pass has with so many samples; whether all fits have ended.
    pub fn advance(
        &mut self,
        data: &Data<'_, P, M::Known>,
        samples: usize,
        units: &impl Units,
    ) -> bool {
        if self.stage != Stage::Ended && self.fit.advance(data, samples, units) {
            self.take(data);
        }
        self.stage == Stage::Ended
    }

    /// The optima, if the best of them explains all data.
    pub fn optima(&self) -> Option<Optima<M, N>> {
        let best = self.found[0].as_ref().filter(|best| best.misfit.explained(self.known))?;
        let mut kept = [const { None }; OPTIMA];
        let near = self.found.iter().flatten().filter(|f| f.cost < best.cost + KEPT);
        kept.iter_mut().zip(near).for_each(|(kept, found)| *kept = Some(*found));
        Some(kept)
    }

    /// Takes up an ended fit, and begins the next.
    fn take(&mut self, data: &Data<'_, P, M::Known>) {
        let found = self.fit.posterior();
        match self.stage {
            Stage::Starts(i) => {
                self.keep(found);
                let next = i + 1;
                if let Some(start) = self.starts.get(next).copied().flatten() {
                    let steps = if self.manner.near { ALTERNATIVE } else { STEPS };
                    (self.stage, self.fit) = (Stage::Starts(next), self.of(&start, steps));
                    return;
                }
                self.found.sort_unstable_by(|a, b| rank(a).total_cmp(&rank(b)));
                self.judge(data);
            }
            Stage::Cubic => {
                self.found = [const { None }; OPTIMA + 1];
                self.found[0] = found;
                self.settle(data);
            }
            Stage::Offset => {
                if let (Some(best), Some(other)) = (&mut self.found[0], found)
                    && other.evidence > best.evidence
                {
                    *best = other;
                }
                self.stage = Stage::Ended;
            }
            Stage::Ended => {}
        }
    }

    /// Keeps an optimum that is not there yet.
    fn keep(&mut self, found: Option<Posterior<M, N>>) {
        let Some(found) = found else { return };
        if !self.found.iter().flatten().any(|other| other.is(&found))
            && let Some(room) = self.found.iter_mut().find(|f| f.is_none())
        {
            *room = Some(found);
        }
    }

    /// Another model where the best does not explain the data.
    fn judge(&mut self, data: &Data<'_, P, M::Known>) {
        match &self.found[0] {
            Some(best)
                if M::MAY_BE_CUBIC
                    && !best.misfit.explained(self.known)
                    && !best.motion.given().cubic =>
            {
                let mut start = best.start();
                start.motion.given_mut().cubic = true;
                (self.stage, self.fit) = (Stage::Cubic, self.of(&start, STEPS));
            }
            _ => self.settle(data),
        }
    }

    /// The other prior on offsets.
    fn settle(&mut self, data: &Data<'_, P, M::Known>) {
        match &self.found[0] {
            Some(best) if self.manner.settles && best.misfit.explained(self.known) => {
                let start = other_offset(best, &data.of_later, OFFSET * self.size);
                (self.stage, self.fit) = (Stage::Offset, self.of(&start, STEPS));
            }
            _ => self.stage = Stage::Ended,
        }
    }

    fn of(&self, start: &Start<M, N>, steps: usize) -> Fit<M, P, N> {
        fit_of(start, self.fit.end(), (steps, &self.manner))
    }
}

/// A fit to so many outputs.
fn fit_of<M: Family<P, N>, const P: usize, const N: usize>(
    start: &Start<M, N>,
    end: usize,
    (steps, manner): (usize, &Manner),
) -> Fit<M, P, N> {
    let fit = Fit::new(start, end, steps);
    if manner.near { fit.near() } else { fit }
}

/// -2 log of the probability at the optimum, but for what all have; nothing comes last.
fn rank<M: Family<P, N>, const P: usize, const N: usize>(found: &Option<Posterior<M, N>>) -> f64 {
    let Some(f) = found else { return f64::INFINITY };
    let priors: f64 = f.motion.given().spread[3..].iter().map(|sd| libm::log(*sd)).sum();
    let euler = if f.motion.is_simulated() { EULER } else { 0.0 };
    f.cost + 2.0 * priors + euler
}

/// Where a fit with the other prior on offsets begins: free to `wide`, or none.
pub fn other_offset<M: Family<P, N>, const P: usize, const N: usize>(
    found: &Posterior<M, N>,
    noise: &[f64; P],
    wide: f64,
) -> Start<M, N> {
    let (mut start, p) = (found.start(), outputs(noise));
    let free = start.motion.has_offset(noise);
    let spread = &mut start.motion.given_mut().spread[M::OFFSETS..];
    for (own, noise) in spread.iter_mut().zip(&noise[..p]) {
        *own = if free { OFFSET * noise } else { wide };
    }
    if free {
        start.z[M::OFFSETS..M::OFFSETS + p].fill(0.0);
    }
    start
}
