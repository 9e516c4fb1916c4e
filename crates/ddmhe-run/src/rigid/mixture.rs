//! Up to four motions that may have made the data, each with a filter of its own: their mean, and
//! how far they are apart.

use crate::rigid::anchoring::{OPTIMA, Optima};
use crate::rigid::data::Data;
use crate::rigid::filter::{DISAGREE, Filter, Limits};
use crate::rigid::motion::Family;
use crate::rigid::posterior::Posterior;
use crate::rigid::small::{Matrix, Vector};
use crate::rigid::start::Start;

/// One that is less probable than this does not count for the mean.
const COUNTED: f64 = 1e-3;

/// One of them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Member<M, const P: usize, const N: usize> {
    /// Its latest fit.
    pub found: Posterior<M, N>,
    /// What goes on from there.
    pub filter: Filter<P, N>,
}

/// All of them, the first is always there; and how probable each is as of its fit, 0 where that is
/// next to nothing: it is then where a later fit may begin, and its filter rests.
#[derive(Debug, Clone, PartialEq)]
pub struct Mixture<M, const P: usize, const N: usize> {
    members: [Option<Member<M, P, N>>; OPTIMA],
    probabilities: [f64; OPTIMA],
    /// How many later outputs its fits are of.
    pub of: usize,
}

impl<M: Family<P, N>, const P: usize, const N: usize> Mixture<M, P, N> {
    /// Of at most so many optima, from the end of their fits to so many later outputs on; None
    /// without one. Those that are the same count once, and those of Euler's rule only where the
    /// best is: it is a way to simulate, not a body.
    pub fn new(
        optima: &Optima<M, N>,
        noise: &[f64; P],
        (most, outputs): (usize, usize),
    ) -> Option<Self> {
        let euler = |found: &Posterior<M, N>| found.motion.is_simulated();
        let first = euler(optima[0].as_ref()?);
        let mut members = [const { None }; OPTIMA];
        let mut free = 0;
        for found in optima.iter().flatten().filter(|found| euler(found) == first) {
            let same = |other: &Member<M, P, N>| other.found.is_near(found);
            if free < most && !members.iter().flatten().any(same) {
                members[free] = Some(Member::new(found, noise));
                free += 1;
            }
        }
        Mixture::of(members.into_iter().flatten(), outputs)
    }

    /// Of these, whose fits are of so many later outputs; None without one.
    pub fn of(given: impl Iterator<Item = Member<M, P, N>>, outputs: usize) -> Option<Self> {
        let mut members = [const { None }; OPTIMA];
        members.iter_mut().zip(given).for_each(|(own, member)| *own = Some(member));
        let mut mixture = Mixture { members, probabilities: [0.0; OPTIMA], of: outputs };
        mixture.weigh().then_some(mixture)
    }

    /// Whether its filters are linear about their fits, from now on.
    pub fn hold(&mut self, held: bool) {
        for (_, member) in self.counted_mut() {
            match held {
                true => member.filter.hold(),
                false => member.filter.nominal = None,
            }
        }
    }

    /// Probabilities anew, from the evidence of the fits; whether there is a member.
    fn weigh(&mut self) -> bool {
        let weights = self.members.map(|m| m.map_or(f64::NEG_INFINITY, |m| m.found.weight()));
        let most = weights.into_iter().fold(f64::NEG_INFINITY, f64::max);
        let mut p = weights
            .map(|weight| if weight > f64::NEG_INFINITY { libm::exp(weight - most) } else { 0.0 });
        for _ in 0..2 {
            let sum: f64 = p.iter().sum();
            p = p.map(|v| if v < COUNTED * sum { 0.0 } else { v / sum });
        }
        self.probabilities = p;
        self.members[0].is_some()
    }

    /// The members.
    pub fn members(&self) -> impl Iterator<Item = &Member<M, P, N>> {
        self.members.iter().flatten()
    }

    /// Those that count, with their places.
    pub fn counted_mut(&mut self) -> impl Iterator<Item = (usize, &mut Member<M, P, N>)> {
        let counted = self.members.iter_mut().enumerate().zip(self.probabilities);
        counted.filter_map(|((k, member), p)| Some((k, member.as_mut().filter(|_| p > 0.0)?)))
    }

    /// Place of the most probable one.
    pub fn leading(&self) -> usize {
        let p = self.probabilities();
        (1..OPTIMA).fold(0, |best, k| if p[k] > p[best] { k } else { best })
    }

    /// That at a place.
    pub fn at(&self, place: usize) -> Option<&Member<M, P, N>> {
        self.members.get(place)?.as_ref()
    }

    /// Probabilities of the members, by place, as of their fits; 0 of those that do not count, and
    /// of those that outputs since have contradicted while others go on well.
    pub fn probabilities(&self) -> [f64; OPTIMA] {
        let mut p = self.probabilities;
        if p[0] == 1.0 {
            return p;
        }
        let score = |k: usize| self.members[k].as_ref().map_or(f64::INFINITY, |m| m.filter.score);
        let counted = (0..OPTIMA).filter(|&k| p[k] > 0.0);
        let least = counted.map(score).fold(f64::INFINITY, f64::min);
        let limit = DISAGREE.max(least);
        (0..OPTIMA).filter(|&k| !(score(k) <= limit)).for_each(|k| p[k] = 0.0);
        let sum: f64 = p.iter().sum();
        p.map(|v| v / sum)
    }

    /// Leaves out motions that ran away; whether any is left.
    pub fn drop_runaways(&mut self) -> bool {
        for own in &mut self.members {
            own.take_if(|member| member.filter.ran_away());
        }
        let mut free = 0;
        for k in 0..OPTIMA {
            if self.members[k].is_some() {
                self.members.swap(free, k);
                free += 1;
            }
        }
        self.weigh()
    }

    /// All filters of driven motions to the next sample, and into their box; whether one is left
    /// that did not run away.
    pub fn arrive(&mut self, known: (&M::Known, &M::Known), limits: Option<&Limits>) -> bool {
        let mut ran_away = false;
        for (_, member) in self.counted_mut() {
            ran_away |= !member.filter.predict(&member.found.motion, known);
            limits.into_iter().for_each(|limits| member.filter.confine(limits));
        }
        !ran_away || self.drop_runaways()
    }

    /// All filters over later outputs, which `data` has; whether one is left that did not run away.
    pub fn replay(
        &mut self,
        data: &Data<'_, P, M::Known>,
        range: core::ops::Range<usize>,
        limits: Option<&Limits>,
    ) -> bool {
        let mut ran_away = false;
        for k in range {
            let at = data.y.len() + k;
            let Some(now) = data.known.get(at) else { return false };
            if M::DRIVEN && !self.arrive((&data.known[at - 1], now), limits) {
                return false;
            }
            for (_, member) in self.counted_mut() {
                let (mut y, motion) = (data.later[k], &member.found.motion);
                if let Some(mut x) = data.rates.get(k).copied() {
                    member.filter.see(&mut x, &data.of_rates);
                }
                member.filter.update(motion, now, &mut y);
                if !M::DRIVEN {
                    ran_away |= !member.filter.predict(motion, (now, now));
                    limits.into_iter().for_each(|limits| member.filter.confine(limits));
                }
            }
        }
        !ran_away || self.drop_runaways()
    }

    /// Mean of ω, and the covariance of its error.
    pub fn mean(&self) -> (Vector, Matrix) {
        self.mean_of(|member| (member.filter.w(), member.filter.of_w()))
    }

    /// The same of driven motions at the sample after the last that is known, of which no more is
    /// known than how it would go on.
    pub fn mean_ahead(
        &self,
        known: (&M::Known, &M::Known),
        limits: Option<&Limits>,
    ) -> (Vector, Matrix) {
        self.mean_of(|member| {
            let mut filter = member.filter;
            filter.predict(&member.found.motion, known);
            limits.into_iter().for_each(|limits| filter.confine(limits));
            (filter.w(), filter.of_w())
        })
    }

    fn mean_of(&self, of: impl Fn(&Member<M, P, N>) -> (Vector, Matrix)) -> (Vector, Matrix) {
        let p = self.probabilities();
        let mut counted = [const { None }; OPTIMA];
        for (own, (p, member)) in counted.iter_mut().zip(p.iter().zip(&self.members)) {
            *own = member.as_ref().filter(|_| *p > 0.0).map(|member| (*p, of(member)));
        }
        let mut all = counted.iter().flatten();
        if let (Some((_, only)), None) = (all.next(), all.next()) {
            return *only;
        }
        let (mut w, mut covariance) = ([0.0; 3], [[0.0; 3]; 3]);
        for (p, (own, _)) in counted.iter().flatten() {
            w.iter_mut().zip(own).for_each(|(sum, own)| *sum += p * own);
        }
        for (p, (own, within)) in counted.iter().flatten() {
            for i in 0..3 {
                for k in 0..3 {
                    covariance[i][k] += p * (within[i][k] + (own[i] - w[i]) * (own[k] - w[k]));
                }
            }
        }
        (w, covariance)
    }
}

impl<M: Family<P, N>, const P: usize, const N: usize> Member<M, P, N> {
    /// From the end of a fit's data on.
    pub fn new(found: &Posterior<M, N>, noise: &[f64; P]) -> Self {
        Member { found: *found, filter: Filter::new(found, noise) }
    }

    /// Where a fit from its latest optimum would begin.
    pub fn from_optimum(&self) -> Start<M, N> {
        self.found.start().rebased()
    }

    /// Where a fit from its filter would begin.
    pub fn from_filter(&self) -> Start<M, N> {
        let mut start = self.found.start();
        start.z[3..].copy_from_slice(&self.filter.z[3..]);
        start.rebased()
    }
}
