//! The evidence with the weights of the recording: see [`model`](crate::evidence::model).

use crate::active_set::factor::{cholesky, solve_lower};
use crate::evidence::formulas::{RARE, chi_square};
use crate::evidence::{OfModel, Rule};
use crate::kalman::Model;
use crate::memory::stretches::samples;
use crate::panels::{dot, padded};
use crate::plan::common::Sizes;
use crate::sliding::SlidingBuffer;
use core::ops::Range;

/// Where the parts of the filter's covariance are, all in scaled units; nothing under other rules.
#[derive(Debug, Clone)]
pub(crate) struct OfFilter {
    K: usize,     // (q+1 n × n)
    b: usize,     // (n)
    P: usize,     // of x̂(t) (n × n)
    sigma: usize, // Σ without what V adds (n × n)
    pub kept: usize,
    nu: usize,   // (p)
    S: usize,    // (p × p)
    work: usize, // n × n + n + 2 q
    /// νᵀS⁻¹ν of each step of the last M, and how many outputs it is of.
    pub scores: SlidingBuffer,
    horizon: usize,
    pub end: usize,
}

/// What a step of the filter is given, by where it is in the block.
#[derive(Debug, Clone)]
pub(crate) struct FilterStep<'a> {
    pub model: &'a Model<'a>,
    /// Scales of the states and of the outputs.
    pub scales: [&'a [f64]; 2],
    /// x̂(t-1) (n), y(t-1) (p, NaN where not measured) and u(t-1) (m), as scaled deviations.
    pub at: [Range<usize>; 3],
    /// P of x̂(t), where it is not the stationary one.
    pub losses: Option<Range<usize>>,
    /// Whether the run is from an unknown state and its window not full yet.
    pub opening: bool,
}

impl OfFilter {
    pub fn new(sizes: Sizes, at: usize) -> Self {
        let Sizes { n, p, m, horizon, .. } = sizes;
        let (q, used) = (n + m, sizes.rule == Rule::Filter);
        let mut next = at;
        let mut take = |len: usize| {
            let start = next;
            next += if used { padded(len) } else { 0 };
            start
        };
        let (K, b) = (take((q + 1) * n * n), take(n));
        let (P, sigma) = (take(n * n), take(n * n));
        let (nu, S) = (take(p), take(p * p));
        let work = take(n * n + n + 2 * q);
        let stretch = take(samples(horizon) * 2);
        let width = if used { 2 } else { 0 };
        let scores = SlidingBuffer::new(stretch, width, samples(horizon));
        OfFilter { K, b, P, sigma, kept: nu, nu, S, work, scores, horizon, end: next }
    }
}

impl OfFilter {
    /// As at the beginning of a run, P being the covariance in the user's units at `first`.
    pub fn start(&mut self, block: &mut [f64], model: &OfModel<'_>, first: usize, s_x: &[f64]) {
        let OfFilter { K, P, sigma, kept, .. } = *self;
        let n = s_x.len();
        block[K..kept].fill(0.0);
        for k in 0..n * n {
            let start = block[first + k] / (s_x[k / n] * s_x[k % n]);
            block[P + k] = start;
            block[sigma + k] = model.few() * start;
            block[first + k] *= model.few();
        }
        self.scores.clear();
    }

    /// Σ without what V adds (n × n, scaled).
    #[inline(always)]
    pub fn covariance<'b>(&self, block: &'b [f64], n: usize) -> &'b [f64] {
        &block[self.sigma..self.sigma + n * n]
    }

    /// Σ(t), before what V adds.
    #[inline(always)]
    pub fn advance(&self, block: &mut [f64], model: &OfModel<'_>, step: &FilterStep<'_>) {
        let OfFilter { K, b, P, sigma, nu, work, .. } = *self;
        let [x, y, u] = step.at.clone();
        let (n, q) = (x.len(), x.len() + u.len());
        let (known, room) = block.split_at_mut(K);
        let (of_K, room) = room.split_at_mut(b - K);
        let (of_b, room) = room.split_at_mut(P - b);
        let (of_P, room) = room.split_at_mut(sigma - P);
        let (of_sigma, room) = room.split_at_mut(nu - sigma);
        let work = &mut room[work - nu..];
        let (of_K, of_b) = (&mut of_K[..(q + 1) * n * n], &mut of_b[..n]);
        let (of_P, of_sigma) = (&mut of_P[..n * n], &mut of_sigma[..n * n]);
        model.move_on(&known[x], &known[u], (of_K, of_b), work);
        match &step.losses {
            _ if step.opening => step.model.follow(&known[y], of_P, work),
            Some(at) => of_P.copy_from_slice(&known[at.clone()]),
            None => of_P.copy_from_slice(step.model.P),
        }
        model.covariance(of_P, (of_K, of_b), of_sigma, work);
    }

    /// Σ(t), `times` as large, in the user's units.
    #[inline(always)]
    pub fn write(&self, block: &mut [f64], to: Range<usize>, times: f64, s_x: &[f64]) {
        let n = s_x.len();
        let (known, room) = block.split_at_mut(self.sigma);
        for (k, (to, entry)) in known[to].iter_mut().zip(&room[..n * n]).enumerate() {
            *to = entry * times * s_x[k / n] * s_x[k % n];
        }
    }

    /// ν, its variances and νᵀS⁻¹ν of what was measured.
    #[inline(always)]
    pub fn innovate(
        &mut self,
        block: &mut [f64],
        of: &OfModel<'_>,
        step: &FilterStep<'_>,
        [innovation, variance]: [usize; 2],
    ) {
        let OfFilter { sigma, nu, S, .. } = *self;
        let [x, y, u] = step.at.clone();
        let (n, p, few) = (x.len(), y.len(), of.few());
        let s_y = step.scales[1];
        let mut measured = 0;
        for i in 0..p {
            let known = step.model.expected_output(i, &block[x.clone()], &block[u.clone()]);
            let value = block[y.start + i] - known;
            for j in 0..=i {
                let entry = step.model.output_covariance([i, j], &block[sigma..sigma + n * n]);
                let own = if i == j { few * step.model.R[i] } else { 0.0 };
                block[S + i * p + j] = entry + own;
            }
            block[innovation + i] = value * s_y[i];
            block[variance + i] = block[S + i * p + i] * s_y[i] * s_y[i];
            block[nu + i] = value;
            measured += usize::from(!value.is_nan());
        }
        // what was not measured has no part: a row of the identity, and nothing to explain
        for i in (0..p).filter(|_| measured < p) {
            if block[nu + i].is_nan() {
                block[nu + i] = 0.0;
                (0..p).for_each(|j| block[S + i.max(j) * p + i.min(j)] = 0.0);
                block[S + i * p + i] = 1.0;
            }
        }
        let (room, square) = block.split_at_mut(S);
        let (square, whitened) = (&mut square[..p * p], &mut room[nu..nu + p]);
        let score = match cholesky(square, p, p, 0.0) {
            Some(()) => {
                solve_lower(square, whitened, p);
                dot(whitened, whitened)
            }
            None => f64::INFINITY,
        };
        let at = self.scores.next(block);
        block[at].copy_from_slice(&[score, measured as f64]);
    }

    /// NIS of an output over the last M steps, what it is novel above, and what Σ is multiplied
    /// with.
    #[inline(always)]
    pub fn score(&mut self, block: &[f64]) -> [f64; 3] {
        while self.scores.len > self.horizon {
            self.scores.forget();
        }
        let (mut score, mut outputs) = (0.0, 0.0);
        for pair in block[self.scores.window()].chunks_exact(2) {
            (score, outputs) = (score + pair[0], outputs + pair[1]);
        }
        if outputs == 0.0 {
            return [0.0, f64::INFINITY, 1.0];
        }
        let value = score / outputs;
        let large = if self.scores.len == self.horizon { value.max(1.0) } else { 1.0 };
        [value, chi_square(outputs, RARE) / outputs, large]
    }
}
