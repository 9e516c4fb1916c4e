//! The evidence on the estimates of a window: see [`evidence`](crate::evidence).

use crate::evidence::formulas::{
    WIDE, anywhere, form, growth, inflation, join, limited, sandwich, wide,
};
use crate::evidence::{Evidence, OfDepth, OfPlan, Reasons, Rule};
use crate::memory::considered::{FilterStep, OfFilter};
use crate::memory::stretches::samples;
use crate::panels::padded;
use crate::plan::common::Sizes;
use crate::sensitivity::Sensitivity;
use crate::sliding::SlidingBuffer;
use core::ops::Range;

/// What a window told of itself.
#[derive(Debug, Clone)]
pub struct Told<'a> {
    /// The numbers of all depths, and of this one.
    pub known: (&'a OfPlan<'a>, &'a OfDepth<'a>),
    /// V and J, in the units of the cost.
    pub sizes: [f64; 2],
    /// Outputs in the window that were measured.
    pub measured: usize,
    /// Whether the maps of its own problem are in the room.
    pub reweighted: bool,
    /// Whether there is a minimiser; without, nothing is known of the state.
    pub minimised: bool,
    /// Fitted noise of the newest output (p), NaN where not measured.
    pub newest: &'a [f64],
    /// x̂(t) (n).
    pub x: &'a [f64],
    /// Mean of the recorded states (n).
    pub mean: &'a [f64],
    /// Where u(t-1) (m) is in the block, in scaled units.
    pub u: Range<usize>,
}

/// Where what is kept of it is; nothing where no evidence is asked for.
#[derive(Debug, Clone)]
pub(crate) struct Witness {
    covariances: SlidingBuffer, // Σ of each state that is kept
    last: usize,                // of each output the newest that was measured (p)
    repeats: usize,             // how often in a row (p)
    innovation: usize,          // (p)
    variance: usize,            // its (p)
    prior: usize,               // Σ(t-m) (n × n)
    work: usize,                // n × n
    filter: OfFilter,           // with the weights of the recording
    pub end: usize,
    horizon: usize,
    judged: Judged,
}

/// What is kept beside numbers of the block, and saved.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Judged {
    /// Steps since a window was novel, up to the horizon.
    pub since: usize,
    /// s of the step before.
    pub inflation: f64,
    /// Steps that s is the mean of, up to the horizon, where it is one.
    pub steps: f64,
    /// Samples since the recording's end.
    pub samples: f64,
    /// Of the newest estimate.
    pub reasons: Reasons,
    /// V / V₀ of its window.
    pub value: f64,
    /// What that is novel above.
    pub limit: f64,
}

impl Judged {
    fn new(horizon: usize) -> Self {
        let (reasons, value, limit) = (Reasons::default(), 0.0, 0.0);
        let (steps, samples) = (0.0, 0.0);
        Judged { since: horizon, inflation: 1.0, steps, samples, reasons, value, limit }
    }
}

impl Witness {
    pub fn new(sizes: Sizes, at: usize) -> Self {
        let Sizes { n, p, horizon, rule, .. } = sizes;
        let mut next = at;
        let mut take = |len: usize| {
            let start = next;
            next += if rule == Rule::Off { 0 } else { padded(len) };
            start
        };
        let width = if rule == Rule::Off { 0 } else { n * n };
        let stretch = take(samples(horizon) * n * n);
        let (last, repeats, innovation, variance) = (take(p), take(p), take(p), take(p));
        let (prior, work) = (take(n * n), take(n * n));
        let filter = OfFilter::new(sizes, next);
        Witness {
            covariances: SlidingBuffer::new(stretch, width, samples(horizon)),
            last,
            repeats,
            innovation,
            variance,
            prior,
            work,
            end: filter.end,
            filter,
            horizon,
            judged: Judged::new(horizon),
        }
    }

    #[inline(always)]
    pub fn is_used(&self) -> bool {
        self.covariances.width > 0
    }

    /// As at the beginning of a run, with so many states in the window; of an unknown one P₀ is as
    /// wide as the recorded states.
    pub fn start(
        &mut self,
        block: &mut [f64],
        known: &OfPlan<'_>,
        (states, unknown): (usize, bool),
        (s_x, samples): (&[f64], f64),
    ) {
        self.covariances.clear();
        for _ in 0..states {
            let at = self.covariances.next(block);
            block[at.clone()].copy_from_slice(known.start);
            if unknown {
                wide(&mut block[at], known.per_spread, WIDE);
            }
        }
        let p = known.patience.len();
        block[self.last..self.last + p].fill(f64::NAN);
        block[self.repeats..self.repeats + p].fill(0.0);
        self.judged = Judged { samples, ..Judged::new(known.horizon) };
        if known.rule == Rule::Filter {
            let first = self.covariances.last(1).start;
            self.filter.start(block, &known.model, first, s_x);
        }
    }

    pub fn clear(&mut self) {
        self.covariances.clear();
    }

    pub fn forget(&mut self) {
        if self.is_used() {
            self.covariances.forget();
        }
    }

    /// How often output i has repeated its value, if that is too often.
    pub fn stuck(&self, block: &[f64], known: &OfPlan<'_>, i: usize) -> Option<usize> {
        let repeats = block[self.repeats + i];
        (repeats >= known.patience[i]).then_some(repeats as usize)
    }

    /// Whether an output will be stuck with y(t-1).
    pub fn will_stick(&self, block: &[f64], known: &OfPlan<'_>, y: &[f64]) -> bool {
        let (last, repeats) = (&block[self.last..], &block[self.repeats..]);
        let again = |i: usize| y[i] == last[i] && repeats[i] + 1.0 >= known.patience[i];
        (0..y.len()).any(again)
    }

    /// Σ of the filter, before what V adds (n × n, scaled).
    pub fn filter_covariance<'b>(&self, block: &'b [f64], n: usize) -> &'b [f64] {
        self.filter.covariance(block, n)
    }

    /// As after a restart with so many outputs: Σ as wide as of an unknown state.
    pub fn restart(&mut self, block: &mut [f64], known: &OfPlan<'_>, (kept, s_x): (usize, &[f64])) {
        self.covariances.keep(kept);
        let all = self.covariances.window();
        for sigma in block[all].chunks_exact_mut(s_x.len() * s_x.len()) {
            wide(sigma, known.per_spread, WIDE);
        }
        (self.judged.samples, self.judged.inflation) = (known.growth[2], 1.0);
        if known.rule == Rule::Filter {
            let first = self.covariances.window().start;
            self.filter.start(block, &known.model, first, s_x);
        }
    }

    /// Σ of the filter over one instant more, of a run from an unknown state.
    pub fn follow(&self, block: &mut [f64], known: &OfPlan<'_>, step: &FilterStep<'_>) {
        self.filter.advance(block, &known.model, step);
    }

    /// Takes note of y(t-1) (p, NaN where not measured) as it came.
    #[inline(always)]
    pub fn note(&self, block: &mut [f64], y: &[f64]) {
        let (last, repeats) = block[self.last..].split_at_mut(self.repeats - self.last);
        for ((y, last), repeats) in y.iter().zip(last).zip(repeats) {
            if !y.is_nan() {
                *repeats = if y == last { *repeats + 1.0 } else { 1.0 };
                *last = *y;
            }
        }
    }

    /// Σ(t), the innovation and what speaks against trust, from what a window of this depth told.
    #[inline(always)]
    pub fn judge(
        &mut self,
        block: &mut [f64],
        (depth, maps): (usize, Range<usize>),
        told: &Told<'_>,
    ) {
        let (plan, full) = told.known;
        let (n, p) = (told.x.len(), told.newest.len());
        let of_V = self.weigh(depth, told);
        let s = of_V.max(self.leaving(block, told)).max(self.growing(plan));
        self.covariances.next(block);
        let kept = self.covariances.last(depth + 1);
        block.copy_within(kept.start..kept.start + n * n, self.prior);
        let (known, room) = block.split_at_mut(self.end);
        let maps = &mut room[maps.start - self.end..maps.end - self.end];
        let unit = full.levels[0] / (depth * p) as f64;
        let own = match told.reweighted {
            true => &Sensitivity::new([n, p], maps).into_depth(full, unit),
            false => full,
        };
        let (known, work) = known.split_at_mut(self.work);
        let (known, prior) = known.split_at_mut(self.prior);
        let (known, variance) = known.split_at_mut(self.variance);
        let (known, innovation) = known.split_at_mut(self.innovation);
        let now = &mut known[kept.end - n * n..kept.end];
        let prior = &prior[..n * n];
        sandwich(own.carry, prior, n, work, now);
        join(now, own.error, s, plan.per_spread, !plan.rule.is_curved());
        if let Some(drift) = plan.drift {
            now.iter_mut().zip(drift).for_each(|(sum, drift)| *sum += depth as f64 * drift);
        }
        let own_part = self.judged.inflation.max(1.0);
        for i in 0..p {
            let row = &own.of_prior[i * n..(i + 1) * n];
            variance[i] = own.innovation[i] * own_part + form(row, prior);
            let mut sum = 0.0;
            for (d, v) in own.deleted[i * p..(i + 1) * p].iter().zip(told.newest) {
                sum += if v.is_nan() { 0.0 } else { d * v };
            }
            innovation[i] = if told.newest[i].is_nan() { f64::NAN } else { sum };
        }
        self.judged.inflation = s;
        self.conclude(block, told);
    }

    /// The same with the weights of the recording.
    #[inline(always)]
    pub fn judge_filter(&mut self, block: &mut [f64], told: &Told<'_>, step: &FilterStep<'_>) {
        let model = &told.known.0.model;
        self.filter.innovate(block, model, step, [self.innovation, self.variance]);
        self.filter.advance(block, model, step);
        let [value, limit, large] = self.filter.score(block);
        self.judged = Judged { value, limit, inflation: large, ..self.judged };
        let now = self.covariances.next(block);
        self.filter.write(block, now, large, step.scales[0]);
        self.conclude(block, told);
    }

    /// s of V.
    #[inline(always)]
    fn weigh(&mut self, depth: usize, told: &Told<'_>) -> f64 {
        let (plan, own) = told.known;
        let all = depth * told.newest.len();
        let share = if told.measured == all { 1.0 } else { told.measured as f64 / all as f64 };
        let [V_0, V_most, ..] = own.levels;
        // a minimum below 0 is rounding; what was not measured is taken to be as it is in held-out
        // windows
        let least = told.sizes[0] / V_0;
        self.judged.value = if least < 0.0 { 0.0 } else { least } + (1.0 - share);
        self.judged.limit = V_most / V_0;
        if plan.rule == Rule::Exact {
            return self.noise_level();
        }
        inflation(plan.rule, self.judged.value, self.judged.limit)
    }

    /// The mean of v, a step later. What is told is v in units of the mean before, once that is one
    /// of M steps.
    fn noise_level(&mut self) -> f64 {
        let before = self.judged;
        let M = self.horizon as f64;
        self.judged.steps = (before.steps + 1.0).min(M);
        let v = self.judged.value;
        let told = if before.steps == M { v / before.inflation } else { 1.0 };
        self.judged.value = if told.is_nan() { 0.0 } else { told };
        if before.steps == 0.0 {
            v
        } else {
            before.inflation + (v - before.inflation) / self.judged.steps
        }
    }

    /// G v, one sample later.
    #[inline(always)]
    fn growing(&mut self, plan: &OfPlan<'_>) -> f64 {
        self.judged.samples += 1.0;
        if plan.growth[0] == 0.0 {
            return 0.0;
        }
        growth(plan.growth, self.judged.samples) * self.judged.value
    }

    /// u² where the estimate has left the recorded states.
    #[inline(always)]
    fn leaving(&self, block: &mut [f64], told: &Told<'_>) -> f64 {
        let plan = told.known.0;
        if !plan.rule.is_curved() {
            return 0.0;
        }
        let deviation = &mut block[self.work..self.work + told.x.len()];
        let entries = told.x.iter().zip(told.mean);
        deviation.iter_mut().zip(entries).for_each(|(to, (x, mean))| *to = x - mean);
        let far = form(deviation, plan.away);
        if far > 1.0 { far * far } else { 0.0 }
    }

    /// What speaks against trust.
    #[inline(always)]
    fn conclude(&mut self, block: &mut [f64], told: &Told<'_>) {
        let (plan, own) = told.known;
        let n = told.x.len();
        let at = self.covariances.last(1);
        if !told.minimised {
            anywhere(&mut block[at.clone()], plan.per_spread);
        }
        limited(&mut block[at.clone()], plan.per_spread);
        let sigma = &block[at];
        let [J, J_most] = [told.sizes[1], own.levels[2]];
        let unlike = !(self.judged.value <= self.judged.limit) || J > J_most;
        let novel = unlike && told.measured > 0 || !told.minimised;
        self.judged.since = if novel { 0 } else { self.judged.since.saturating_add(1) };
        let doubtful = |(i, most): (usize, &f64)| sigma[i * n + i] > *most;
        let beyond = |values: &[f64], [lo, hi]: [&[f64]; 2]| {
            values.iter().zip(lo).zip(hi).any(|((v, lo), hi)| v < lo || v > hi)
        };
        let uncertain = plan.uncertain.iter().enumerate().any(doubtful);
        let outside = beyond(told.x, plan.x_range) || beyond(&block[told.u.clone()], plan.u_range);
        let repeats = &block[self.repeats..self.repeats + plan.patience.len()];
        let stuck = repeats.iter().zip(plan.patience).any(|(count, most)| count >= most);
        self.judged.reasons = Reasons::default()
            .with(Reasons::NOVEL, self.judged.since < plan.horizon)
            .with(Reasons::UNCERTAIN, uncertain)
            .with(Reasons::STUCK, stuck)
            .with(Reasons::OUTSIDE, outside);
    }

    /// The evidence on the newest estimate.
    #[inline(always)]
    pub fn evidence<'b>(&self, block: &'b [f64], known: &OfPlan<'b>) -> Evidence<'b> {
        let p = known.patience.len();
        let Judged { reasons, value, limit, .. } = self.judged;
        Evidence {
            covariance: &block[self.covariances.last(1)],
            reasons,
            value,
            limit,
            innovation: &block[self.innovation..self.innovation + p],
            innovation_variance: &block[self.variance..self.variance + p],
            repeats: &block[self.repeats..self.repeats + p],
            patience: known.patience,
            gated: &[],
            restarted: false,
        }
    }

    /// What is saved of it: what is kept, Σ of the states that are kept, scores, and the rest.
    pub fn saved<'b>(&self, block: &'b [f64]) -> ([&'b [f64]; 3], Judged) {
        let scores = self.filter.scores.window();
        let parts = [self.kept(), self.covariances.window(), scores];
        (parts.map(|part| &block[part]), self.judged)
    }

    /// Where what is kept is, beside what slides.
    fn kept(&self) -> Range<usize> {
        self.last..self.filter.kept
    }

    /// How many numbers that is, and of how many outputs there are scores at most.
    pub fn saved_len(&self) -> [usize; 2] {
        [self.kept().len(), if self.filter.scores.width > 0 { self.horizon } else { 0 }]
    }

    /// Takes it up again; as many covariances as states are kept.
    pub fn resume(&mut self, block: &mut [f64], parts: [&[f64]; 3], judged: Judged) {
        let [kept, covariances, scores] = parts;
        block[self.kept()].copy_from_slice(kept);
        self.filter.scores.clear();
        for score in scores.chunks_exact(2) {
            let at = self.filter.scores.next(block);
            block[at].copy_from_slice(score);
        }
        self.covariances.clear();
        for sigma in covariances.chunks_exact(self.covariances.width.max(1)) {
            let at = self.covariances.next(block);
            block[at].copy_from_slice(sigma);
        }
        self.judged = judged;
    }
}
