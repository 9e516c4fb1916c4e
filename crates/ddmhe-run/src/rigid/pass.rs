//! One pass over the data: the cost of z, and the triangular factor of its whitened Jacobian.

use crate::panels::Root;
use crate::rigid::data::Data;
use crate::rigid::earlier::{Eliminated, Firsts};
use crate::rigid::factor::Factor;
use crate::rigid::means::MeanRate;
use crate::rigid::motion::{MOVING, Motion, Moved, Slopes, flow, flow_with_slopes};
use crate::rigid::posterior::Misfit;
use crate::rigid::small::Vector;

/// Rows that are folded into the factor at once, at most.
const ROWS: usize = 24;
/// The most rows that a sample has: a recorded and a later rate, and six outputs.
const OF_SAMPLE: usize = 12;
/// Samples whose time one with a recorded rate takes.
const RECORDED: usize = 2;
/// Samples of a block whose mean residual is looked at.
const BLOCK: usize = 10;

/// How the work of a pass is done: with which of the machine's vector units. The numbers are the
/// same.
pub trait Units {
    /// Does it.
    fn run<R>(&self, work: impl FnOnce() -> R) -> R;
}

/// Those that the code is compiled for.
#[derive(Debug, Clone, Copy)]
pub struct Compiled;

impl Units for Compiled {
    #[inline(always)]
    fn run<R>(&self, work: impl FnOnce() -> R) -> R {
        work()
    }
}

/// A pass as far as it has come.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pass<const P: usize, const N: usize> {
    /// Where the cost is taken.
    pub z: [f64; N],
    /// And where earlier recordings begin.
    pub firsts: Firsts,
    /// Cost of the samples so far; infinite where the motion runs away.
    pub cost: f64,
    /// Factor of their rows.
    pub factor: Factor<N>,
    /// And of earlier recordings' first rates.
    pub earlier: Eliminated<N>,
    /// ω at the next sample.
    pub w: Vector,
    /// dω(next sample)/dz.
    pub S: [[f64; N]; 3],
    part: usize, // number of the recording
    next: usize,
    rows: [[f64; N]; ROWS],
    right: [f64; ROWS],
    filled: usize,
    of_x: Squares<3>,
    of_y: Squares<P>,
    seen: f64, // outputs that were measured
}

/// Sums of squared residuals, of single ones and of block means.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Squares<const K: usize> {
    single: f64,
    blocks: f64,
    sum: [f64; K],
    samples: usize,
    begun: usize, // samples of the block that is not whole yet
    whole: usize, // blocks
    lost: usize,  // samples at ends of earlier recordings that are of no whole block
}

impl<const K: usize> Squares<K> {
    const NONE: Self = Squares {
        single: 0.0,
        blocks: 0.0,
        sum: [0.0; K],
        samples: 0,
        begun: 0,
        whole: 0,
        lost: 0,
    };

    fn take(&mut self, residuals: &[f64; K]) {
        self.single += residuals.iter().map(|e| e * e).sum::<f64>();
        self.sum.iter_mut().zip(residuals).for_each(|(sum, e)| *sum += e);
        (self.samples, self.begun) = (self.samples + 1, self.begun + 1);
        if self.begun == BLOCK {
            let block = BLOCK as f64;
            self.blocks += self.sum.iter().map(|sum| (sum / block) * (sum / block)).sum::<f64>();
            (self.sum, self.begun, self.whole) = ([0.0; K], 0, self.whole + 1);
        }
    }

    /// No block goes on in the next recording.
    fn cut(&mut self) {
        self.lost += self.begun;
        (self.sum, self.begun) = ([0.0; K], 0);
    }

    /// The share of samples that a block may be of.
    fn in_blocks(&self) -> f64 {
        1.0 - self.lost as f64 / self.samples.max(1) as f64
    }

    /// Mean square of whole blocks' means, times the block.
    fn of_blocks(&self) -> f64 {
        let count = (self.whole * K) as f64;
        BLOCK as f64 * self.blocks / count
    }
}

impl<const P: usize, const N: usize> Pass<P, N> {
    /// At z, with the prior's rows.
    pub fn begin<M: Motion<P, N>>(&mut self, motion: &M, z: &[f64; N], firsts: &Firsts) {
        *self = Self::at(z, firsts);
        let spread = &motion.given().spread;
        for i in 3..N {
            let (unit, e) = (1.0 / spread[i], -z[i] / spread[i]);
            self.cost += e * e;
            self.factor.R[i][i] = unit;
            self.factor.q[i] = e;
        }
    }

    /// At z, of nothing.
    pub fn at(z: &[f64; N], firsts: &Firsts) -> Self {
        let first = firsts.rates().first();
        Pass {
            z: *z,
            firsts: *firsts,
            cost: 0.0,
            factor: Factor::EMPTY,
            earlier: Eliminated::NONE,
            w: first.copied().unwrap_or([z[0], z[1], z[2]]),
            S: by_itself(),
            part: 0,
            next: 0,
            rows: [[0.0; N]; ROWS],
            right: [0.0; ROWS],
            filled: 0,
            of_x: Squares::NONE,
            of_y: Squares::NONE,
            seen: 0.0,
        }
    }

    /// Up to so many samples further towards that of number `end`, whose output is not part of it;
    /// whether the pass has ended. It ends early where the cost exceeds `most`.
    #[inline(always)]
    pub fn advance<M: Motion<P, N>>(
        &mut self,
        motion: &M,
        data: &Data<'_, P, M::Known>,
        (end, samples): (usize, usize),
        most: f64,
    ) -> bool {
        let (parts, dt) = (motion.parts(&self.z), motion.given().steps.dt);
        let (mut own, mut until) = data.part(self.part, end);
        let mut left = samples;
        while left > 0 {
            let recorded = own.recorded_rate(self.next);
            let is_mean = own.mean_at(self.next).is_some();
            left = left.saturating_sub(if recorded.is_some() { RECORDED } else { 1 });
            if let Some((x, noise)) = recorded.filter(|_| !is_mean) {
                let w = self.w;
                self.state(&w, x, noise);
            }
            let ended = self.next >= until;
            if ended || self.filled + OF_SAMPLE > ROWS {
                let (rows, right) = (&mut self.rows, &mut self.right);
                self.factor.fold(&mut rows[..self.filled], &mut right[..self.filled]);
                self.filled = 0;
            }
            if ended {
                if !self.turns() {
                    return true;
                }
                (own, until) = data.part(self.part, end);
                continue;
            }
            if let Some(x) = own.rate(self.next) {
                self.rate(x, &own.of_rates);
            }
            let (known, span) =
                (own.known_from(self.next, until, M::DRIVEN), own.span(self.next, until));
            let mut F = [[0.0; MOVING]; 3];
            let moved = match known {
                [from, to, ..] => {
                    flow_with_slopes(motion, &parts, (from, to), span, self.w, &mut F)
                }
                _ => Some(Moved::still(self.w)),
            };
            if let (Some(now), Some(moved)) = (known.first(), &moved) {
                let w = own.seen(self.next, (dt, span), &self.w, moved);
                if let Some((x, noise)) = recorded.filter(|_| is_mean) {
                    self.state(&w, x, noise);
                }
                if let Some(rates) = own.mean_rate(self.next) {
                    self.mean_rate(rates, (moved, &F), (dt, span), &own.of_rates);
                }
                if let Some(measured) = own.output(self.next) {
                    self.output(motion, (&parts, now), &w, measured);
                }
            }
            if !self.goes_on(moved, most) {
                return true;
            }
            if known.len() < 2 {
                continue;
            }
            self.carry(&F);
        }
        false
    }

    /// The same for the cost alone.
    #[inline(always)]
    pub fn weigh<M: Motion<P, N>>(
        &mut self,
        motion: &M,
        data: &Data<'_, P, M::Known>,
        (end, samples): (usize, usize),
        most: f64,
    ) -> bool {
        let (parts, dt) = (motion.parts(&self.z), motion.given().steps.dt);
        let square = |v: f64, by: f64| if v.is_finite() { (v / by) * (v / by) } else { 0.0 };
        let (mut own, mut until) = data.part(self.part, end);
        for _ in 0..samples {
            let w = self.w;
            let recorded = own.recorded_rate(self.next);
            let is_mean = own.mean_at(self.next).is_some();
            let weighed = |w: &Vector, (x, noise): (&Vector, &Vector)| {
                (0..3).map(|i| square(x[i] - w[i], noise[i])).sum::<f64>()
            };
            self.cost += recorded.filter(|_| !is_mean).map_or(0.0, |own| weighed(&w, own));
            if self.next >= until {
                if !self.turns() {
                    return true;
                }
                (own, until) = data.part(self.part, end);
                continue;
            }
            self.cost += own.rate(self.next).map_or(0.0, |x| weighed(&w, (x, &own.of_rates)));
            let (known, span) =
                (own.known_from(self.next, until, M::DRIVEN), own.span(self.next, until));
            let next = match known {
                [from, to, ..] => flow(motion, &parts, (from, to), span, w),
                _ => Some(Moved::still(w)),
            };
            if let (Some(now), Some(moved)) = (known.first(), &next) {
                let seen = own.seen(self.next, (dt, span), &w, moved);
                self.cost += recorded.filter(|_| is_mean).map_or(0.0, |own| weighed(&seen, own));
                if let Some(rates) = own.mean_rate(self.next) {
                    let off = |i: usize| rates.x[i] - rates.expected(i, &w, moved, (dt, span));
                    let noise = |i: usize| own.of_rates[i] / rates.count[i].root();
                    self.cost += (0..3).map(|i| square(off(i), noise(i))).sum::<f64>();
                }
                if let Some((y, noise)) = own.output(self.next) {
                    let expected = motion.output(&parts, now, &seen);
                    self.cost += (0..P).map(|i| square(y[i] - expected[i], noise[i])).sum::<f64>();
                }
            }
            if !self.goes_on(next, most) {
                return true;
            }
        }
        false
    }

    /// On to the next sample, where ω is w; false where that runs away or the cost exceeds `most`:
    /// it is then infinite.
    #[inline(always)]
    fn goes_on(&mut self, moved: Option<Moved>, most: f64) -> bool {
        let Some(moved) = moved.filter(|_| self.cost <= most && self.cost < f64::INFINITY) else {
            self.cost = f64::INFINITY;
            return false;
        };
        (self.w, self.next) = (moved.w, self.next + 1);
        true
    }

    /// On to the beginning of the next recording; false where the last has ended.
    fn turns(&mut self) -> bool {
        if self.part >= self.firsts.rates().len() {
            return false;
        }
        self.earlier.take(&mut self.factor);
        self.of_x.cut();
        self.of_y.cut();
        (self.part, self.next) = (self.part + 1, 0);
        let own = self.firsts.rates().get(self.part);
        self.w = own.copied().unwrap_or([self.z[0], self.z[1], self.z[2]]);
        self.S = by_itself();
        true
    }

    /// Rows of a recorded rate where it is w.
    #[inline(always)]
    fn state(&mut self, w: &Vector, x: &Vector, noise: &Vector) {
        let e = [0, 1, 2].map(|i| (x[i] - w[i]) / noise[i]);
        for i in 0..3 {
            let by = 1.0 / noise[i];
            let row = self.S[i].map(|v| v * by);
            self.push(&row, e[i]);
        }
        self.cost += e.iter().map(|e| e * e).sum::<f64>();
        self.of_x.take(&e);
    }

    /// Rows of a later rate.
    #[inline(always)]
    fn rate(&mut self, x: &Vector, noise: &Vector) {
        for i in (0..3).filter(|&i| x[i].is_finite()) {
            let by = 1.0 / noise[i];
            let (row, e) = (self.S[i].map(|v| v * by), (x[i] - self.w[i]) * by);
            self.cost += e * e;
            self.push(&row, e);
        }
    }

    /// Rows of the mean of later rates.
    #[inline(always)]
    fn mean_rate(
        &mut self,
        rates: &MeanRate,
        (moved, F): (&Moved, &Slopes),
        (dt, span): (f64, f64),
        noise: &Vector,
    ) {
        let w = self.w;
        for i in (0..3).filter(|&i| rates.x[i].is_finite()) {
            let (by, share) = (rates.count[i].root() / noise[i], rates.at[0][i] / span);
            let mut row = self.carried(&F[i]);
            for (row, S) in row.iter_mut().zip(&self.S[i]) {
                *row = by * (S + share * (*row - S));
            }
            let e = (rates.x[i] - rates.expected(i, &w, moved, (dt, span))) * by;
            self.cost += e * e;
            self.push(&row, e);
        }
    }

    /// Rows of an output where ω is w.
    #[inline(always)]
    fn output<M: Motion<P, N>>(
        &mut self,
        motion: &M,
        (parts, known): (&M::Parts, &M::Known),
        w: &Vector,
        (y, noise): (&[f64; P], &[f64; P]),
    ) {
        let (expected, rows) = (motion.output(parts, known, w), motion.rows(parts, known, w));
        let mut residuals = [0.0; P];
        for i in 0..P {
            if !y[i].is_finite() {
                continue;
            }
            let (by, own) = (1.0 / noise[i], rows[i].as_ref());
            let h = [0, 1, 2].map(|k| by * own[k].1);
            let mut row = [0.0; N];
            for (k, entry) in row.iter_mut().enumerate() {
                *entry = h[0] * self.S[0][k] + h[1] * self.S[1][k] + h[2] * self.S[2][k];
            }
            own[3..].iter().for_each(|(at, v)| row[*at] += by * v);
            residuals[i] = (y[i] - expected[i]) * by;
            self.cost += residuals[i] * residuals[i];
            self.seen += 1.0;
            self.push(&row, residuals[i]);
        }
        self.of_y.take(&residuals);
    }

    /// S a sample later.
    #[inline(always)]
    fn carry(&mut self, F: &Slopes) {
        self.S = [0, 1, 2].map(|i| self.carried(&F[i]));
    }

    /// One row of it.
    #[inline(always)]
    fn carried(&self, F: &[f64; MOVING]) -> [f64; N] {
        let mut row = [0.0; N];
        for (k, entry) in row.iter_mut().enumerate() {
            *entry = F[0] * self.S[0][k] + F[1] * self.S[1][k] + F[2] * self.S[2][k];
        }
        row[3..].iter_mut().zip(&F[3..]).for_each(|(entry, own)| *entry += own);
        row
    }

    #[inline(always)]
    fn push(&mut self, row: &[f64; N], e: f64) {
        (self.rows[self.filled], self.right[self.filled]) = (*row, e);
        self.filled += 1;
    }

    /// By how much an undamped step would lower the cost, were all linear: ‖q‖².
    pub fn gain(&self) -> f64 {
        self.factor.q.iter().map(|q| q * q).sum::<f64>() + self.earlier.squares()
    }

    /// How the residuals of an ended pass compare with their noise.
    pub fn misfit(&self) -> Misfit {
        let (states, seen) = ((3 * self.of_x.samples) as f64, self.seen.max(1.0));
        let outputs = (P * self.of_y.samples) as f64;
        let chi = [
            self.of_x.single / states,
            self.of_y.single / seen,
            self.of_x.of_blocks(),
            self.of_y.of_blocks() * outputs / seen,
        ];
        let of_blocks = [states * self.of_x.in_blocks(), seen * self.of_y.in_blocks()];
        Misfit { chi, terms: [states, seen, of_blocks[0] / 10.0, of_blocks[1] / 10.0] }
    }
}

/// dω/dz of the rate that is the first of z.
fn by_itself<const N: usize>() -> [[f64; N]; 3] {
    let mut S = [[0.0; N]; 3];
    (0..3).for_each(|i| S[i][i] = 1.0);
    S
}
