//! The most probable motion given all data, by Levenberg's and Marquardt's method in slices.

use crate::rigid::data::Data;
use crate::rigid::motion::Motion;
use crate::rigid::pass::{Pass, Units};
use crate::rigid::posterior::Posterior;
use crate::rigid::start::Start;

/// λ at the beginning, and its least.
const DAMPING: (f64, f64) = (1e-3, 1e-12);
/// What λ is multiplied by after a step that does not lower the cost, and divided by after one that
/// does.
const FACTORS: (f64, f64) = (8.0, 10.0);
/// Steps in a row that may fail.
const FAILURES: usize = 12;
/// A fit has ended when a step gains less than the first, with λ below the second: the gain alone
/// stops half of the hard cases too early.
const ENDED: (f64, f64) = (1e-2, 1e-3);

/// A fit has not ended where its linearisation still has more than this to gain: it creeps along a
/// valley in which damped steps are short.
const DECREMENT: f64 = 1.0;

/// λ at the beginning of a fit that is near its end; it has ended when its linearisation has less
/// than the second to gain, which is then taken as it is, or when a step gains less.
const NEAR: (f64, f64) = (1e-5, 0.5);

/// Samples whose cost alone takes the time of one with derivatives.
const LIGHT: usize = 3;

/// What is next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// A pass at what is tried.
    Pass,
    /// Its cost, before that.
    Weighing,
    /// A step from the best so far.
    Step,
    /// The covariance.
    Inverse,
    /// Nothing: the best is found.
    Found,
    /// Nothing: the motion of the start runs away.
    Lost,
}

/// A fit as far as it has come. It may be advanced a few samples at a time, with the same data but
/// for later outputs that come in meanwhile: those from `end` on are not looked at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fit<M, const P: usize, const N: usize> {
    motion: M,
    best: Pass<P, N>,
    tried: Pass<P, N>,
    lambda: f64,
    /// Whether it is of the kind that is near its end.
    near: bool,
    steps: usize,
    failures: usize,
    most: usize,
    end: usize,
    phase: Phase,
    inverse: [[f64; N]; N],
}

impl<M: Motion<P, N> + Clone, const P: usize, const N: usize> Fit<M, P, N> {
    /// From a start, of the outputs before `end`, in at most so many steps.
    pub fn new(start: &Start<M, N>, end: usize, most: usize) -> Self {
        let Start { motion, z, firsts } = start;
        let mut best = Pass::at(z, firsts);
        best.cost = f64::INFINITY;
        let mut tried = best;
        tried.begin(motion, z, firsts);
        Fit {
            motion: motion.clone(),
            best,
            tried,
            lambda: DAMPING.0,
            near: false,
            steps: 0,
            failures: 0,
            most,
            end,
            phase: Phase::Pass,
            inverse: [[0.0; N]; N],
        }
    }

    /// The same from where little is left to do, and where there is little time for it.
    #[must_use]
    pub fn near(mut self) -> Self {
        (self.near, self.lambda) = (true, NEAR.0);
        self
    }

    /// How many outputs it is of.
    pub fn end(&self) -> usize {
        self.end
    }

    /// As much work as a pass has with so many samples; whether the fit has ended.
    pub fn advance(
        &mut self,
        data: &Data<'_, P, M::Known>,
        samples: usize,
        units: &impl Units,
    ) -> bool {
        let (most, tried, motion) = (self.best.cost, &mut self.tried, &self.motion);
        match self.phase {
            Phase::Pass => {
                let part = (self.end, samples);
                let ended = units.run(
                    #[inline(always)]
                    || tried.advance(motion, data, part, most),
                );
                if ended {
                    self.judge();
                }
            }
            Phase::Weighing => {
                let part = (self.end, samples.saturating_mul(LIGHT));
                if tried.weigh(motion, data, part, most) {
                    self.weighed();
                }
            }
            Phase::Step => {
                let best = &self.best;
                let (d, of_firsts) = best.earlier.damped_step(&best.factor, self.lambda);
                let (mut z, firsts) = (best.z, best.firsts.moved(&of_firsts));
                z.iter_mut().zip(d).for_each(|(z, d)| *z += d);
                self.tried.begin(&self.motion, &z, &firsts);
                self.phase = Phase::Weighing;
            }
            Phase::Inverse => {
                self.inverse = self.best.factor.inverse();
                self.phase = Phase::Found;
            }
            Phase::Found | Phase::Lost => {}
        }
        matches!(self.phase, Phase::Found | Phase::Lost)
    }

    /// All of it at once.
    pub fn finish(
        mut self,
        data: &Data<'_, P, M::Known>,
        units: &impl Units,
    ) -> Option<Posterior<M, N>> {
        while !self.advance(data, usize::MAX, units) {}
        self.posterior()
    }

    /// A pass where the cost is less, another step where it is not.
    fn weighed(&mut self) {
        if self.tried.cost <= self.best.cost {
            let (z, firsts) = (self.tried.z, self.tried.firsts);
            self.tried.begin(&self.motion, &z, &firsts);
            self.phase = Phase::Pass;
        } else {
            self.judge();
        }
    }

    /// Takes up what was tried, or not.
    fn judge(&mut self) {
        let gain = self.best.cost - self.tried.cost;
        let first = self.best.cost == f64::INFINITY;
        if self.tried.cost == f64::INFINITY || !(gain >= 0.0) {
            self.failures += 1;
            self.lambda *= FACTORS.0;
            self.phase = match (first, self.failures < FAILURES) {
                (true, _) => Phase::Lost,
                (false, true) => Phase::Step,
                (false, false) => Phase::Inverse,
            };
            return;
        }
        core::mem::swap(&mut self.best, &mut self.tried);
        self.phase = Phase::Step;
        if !first {
            self.failures = 0;
            self.steps += 1;
            self.lambda = (self.lambda / FACTORS.1).max(DAMPING.1);
            let ended = match self.near {
                true => gain < NEAR.1 || !self.may_gain(NEAR.1),
                false => gain < ENDED.0 && self.lambda < ENDED.1 && !self.may_gain(DECREMENT),
            };
            if ended || self.steps == self.most {
                self.phase = Phase::Inverse;
            }
        }
    }

    /// Whether an undamped step would lower the cost by more than so much, were all linear.
    fn may_gain(&self, more: f64) -> bool {
        self.best.gain() > more
    }

    /// What an ended fit found; None where the motion of its start runs away.
    pub fn posterior(&self) -> Option<Posterior<M, N>> {
        if self.phase != Phase::Found {
            return None;
        }
        let Pass { mut z, mut firsts, mut cost, factor, earlier, mut w, S, .. } = self.best;
        if self.near && !self.may_gain(NEAR.1) {
            let (d, of_firsts) = earlier.damped_step(&factor, 0.0);
            z.iter_mut().zip(d).for_each(|(z, d)| *z += d);
            for (w, S) in w.iter_mut().zip(&S) {
                *w += S.iter().zip(&d).map(|(S, d)| S * d).sum::<f64>();
            }
            firsts = firsts.moved(&of_firsts);
            cost -= self.best.gain();
        }
        let determinant = factor.log_determinant() + earlier.log_determinant();
        let spread = &self.motion.given().spread;
        let priors: f64 = spread[3..].iter().map(|sd| libm::log(*sd)).sum();
        Some(Posterior {
            motion: self.motion.clone(),
            z,
            firsts,
            w,
            P: covariance(&self.inverse, &S),
            cost,
            evidence: -0.5 * cost - determinant - priors,
            misfit: self.best.misfit(),
        })
    }
}

/// M Mᵀ, M = [S; 0 I] R⁻¹: of ω at the end of the data and θ.
fn covariance<const N: usize>(inverse: &[[f64; N]; N], S: &[[f64; N]; 3]) -> [[f64; N]; N] {
    let mut M = *inverse;
    for (row, S) in M.iter_mut().zip(S) {
        *row = [0.0; N];
        for (by, inverse) in S.iter().zip(inverse) {
            row.iter_mut().zip(inverse).for_each(|(sum, v)| *sum += by * v);
        }
    }
    let mut P = [[0.0; N]; N];
    for i in 0..N {
        for k in 0..=i {
            P[i][k] = (0..N).map(|j| M[i][j] * M[k][j]).sum();
            P[k][i] = P[i][k];
        }
    }
    P
}
