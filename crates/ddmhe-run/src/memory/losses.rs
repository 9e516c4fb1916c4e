//! Windows in which outputs were lost, or whose prior has lost some, with the weights of the
//! recording: the filter and the smoother of [`kalman`](crate::kalman) with a covariance of their
//! own at every instant.
//!
//! R is diagonal, so that the outputs of an instant are taken in one by one, and what was not
//! measured is passed over.

use crate::kalman::Model;
use crate::memory::stretches::Stretches;
use crate::panels::{axpy, dot, padded};
use crate::plan::common::Sizes;
use crate::tol;
use core::ops::Range;

/// Where the covariances are, and room for a pass.
#[derive(Debug, Clone)]
pub(crate) struct Losses {
    /// Whether P of the oldest estimate is the stationary one.
    settled: bool,
    /// Whether P(t-m) of the window is.
    pub usual: bool,
    /// (17) of the window.
    pub cost: f64,
    tail: usize,         // P of the oldest estimate that is kept (n × n)
    prior: usize,        // P(t-m) of the window (n × n)
    loss: usize,         // what its inverse lacks of the stationary one's (n × n)
    work: usize,         // two n × n, and n
    predicted: usize,    // P of each instant (M+1 n × n)
    gains: usize,        // of each output (M p × n)
    errors: usize,       // ν/s of each output (M p), NaN where not measured
    states: usize,       // x̂, then smoothed ((M+1) n)
    disturbances: usize, // (M n)
    pub end: usize,
}

impl Losses {
    pub fn new(sizes: Sizes, at: usize) -> Self {
        let Sizes { n, p, horizon: M, .. } = sizes;
        let mut next = at;
        let mut take = |len: usize| {
            let start = next;
            next += if sizes.recorded { padded(len) } else { 0 };
            start
        };
        Losses {
            settled: true,
            usual: true,
            cost: 0.0,
            tail: take(n * n),
            prior: take(n * n),
            loss: take(n * n),
            work: take(2 * n * n + n),
            predicted: take((M + 1) * n * n),
            gains: take(M * p * n),
            errors: take(M * p),
            states: take((M + 1) * n),
            disturbances: take(M * n),
            end: next,
        }
    }

    /// A window whose prior is another problem's.
    pub fn clear_prior(&mut self) {
        self.usual = true;
    }

    pub fn clear(&mut self) {
        (self.settled, self.usual) = (true, true);
    }

    /// Smoothed states and disturbances of a window of this depth.
    pub fn window(&self, depth: usize, n: usize) -> [Range<usize>; 2] {
        let Losses { states, disturbances, .. } = *self;
        [states..states + (depth + 1) * n, disturbances..disturbances + depth * n]
    }

    /// Where P after a window of this depth is (n × n).
    pub fn covariance(&self, depth: usize, n: usize) -> Range<usize> {
        self.predicted + depth * n * n..self.predicted + (depth + 1) * n * n
    }

    /// Where what the prior's weight lacks is, unless P(t-m) is the stationary one.
    pub fn loss(&self, n: usize) -> Option<Range<usize>> {
        (!self.usual).then_some(self.loss..self.loss + n * n)
    }

    /// The arrays of the room that begins at the tail.
    fn arrays<'a>(&self, n: usize, room: &'a mut [f64]) -> Arrays<'a> {
        let first = self.tail;
        let (tail, room) = room.split_at_mut(self.prior - first);
        let (prior, room) = room.split_at_mut(self.loss - self.prior);
        let (loss, room) = room.split_at_mut(self.work - self.loss);
        let (work, room) = room.split_at_mut(self.predicted - self.work);
        let (predicted, room) = room.split_at_mut(self.gains - self.predicted);
        let (gains, room) = room.split_at_mut(self.errors - self.gains);
        let (errors, room) = room.split_at_mut(self.states - self.errors);
        let (states, disturbances) = room.split_at_mut(self.disturbances - self.states);
        let square = |M: &'a mut [f64]| &mut M[..n * n];
        let (tail, prior, loss) = (square(tail), square(prior), square(loss));
        Arrays { tail, prior, loss, work, predicted, gains, errors, states, disturbances }
    }
}

struct Arrays<'a> {
    tail: &'a mut [f64],
    prior: &'a mut [f64],
    loss: &'a mut [f64],
    work: &'a mut [f64],
    predicted: &'a mut [f64],
    gains: &'a mut [f64],
    errors: &'a mut [f64],
    states: &'a mut [f64],
    disturbances: &'a mut [f64],
}

impl Losses {
    /// The covariance of the oldest estimate (n × n), unless it is the stationary one: to be saved.
    pub fn tail<'b>(&self, block: &'b [f64], n: usize) -> Option<&'b [f64]> {
        (!self.settled).then(|| &block[self.tail..][..n * n])
    }

    /// A saved one.
    pub fn set_tail(&mut self, block: &mut [f64], covariance: &[f64]) {
        block[self.tail..self.tail + covariance.len()].copy_from_slice(covariance);
        self.settled = false;
    }

    /// The covariance of the oldest estimate once its output is forgotten.
    #[inline]
    pub fn forget(&mut self, block: &mut [f64], at: Stretches, model: &Model<'_>) {
        let oldest = at.outputs.window().start;
        let lost = || block[oldest..][..at.outputs.width].iter().any(|y| y.is_nan());
        if !self.settled || at.missing > 0 && lost() {
            self.follow_tail(block, at, model);
        }
    }

    #[cold]
    fn follow_tail(&mut self, block: &mut [f64], at: Stretches, model: &Model<'_>) {
        let oldest = at.outputs.window().start;
        let n = at.states.width;
        let (known, room) = block.split_at_mut(self.tail);
        let Arrays { tail, work, .. } = self.arrays(n, room);
        if self.settled {
            tail.copy_from_slice(model.P);
        }
        let y = &known[oldest..oldest + at.outputs.width];
        model.follow(y, tail, work);
        let size = model.P.iter().fold(0.0_f64, |size, P| size.max(P.abs()));
        let near = |(a, b): (&f64, &f64)| (a - b).abs() <= tol::SETTLED * size;
        self.settled = y.iter().all(|y| !y.is_nan()) && tail.iter().zip(model.P).all(near);
    }

    /// P(t-m) of the window: whether it is the stationary one; else what its inverse lacks of that
    /// one's.
    #[inline]
    pub fn settle_prior(&mut self, block: &mut [f64], at: Stretches, model: &Model<'_>) -> bool {
        let before = at.outputs.window().start..at.outputs.last(at.depth).start;
        let lost = at.missing > 0 && block[before.clone()].iter().any(|y| y.is_nan());
        self.usual = self.settled && !lost;
        if !self.usual {
            self.follow_prior((block, at.channels()), model, before);
        }
        self.usual
    }

    #[cold]
    fn follow_prior(
        &mut self,
        (block, [n, p, _]): (&mut [f64], [usize; 3]),
        model: &Model<'_>,
        before: Range<usize>,
    ) {
        let (known, room) = block.split_at_mut(self.tail);
        let Arrays { tail, prior, loss, work, .. } = self.arrays(n, room);
        prior.copy_from_slice(if self.settled { model.P } else { tail });
        for y in known[before].chunks_exact(p) {
            model.follow(y, prior, work);
        }
        model.lacking(prior, loss, work);
    }

    /// The window from x̄ and its covariance on, forwards and back.
    #[cold]
    pub fn pass(&mut self, block: &mut [f64], at: Stretches, model: &Model<'_>) {
        let ([n, p, m], depth) = (at.channels(), at.depth);
        let x = at.states.last(depth).start;
        let (y, u) = (at.outputs.last(depth), at.inputs.last(depth));
        let (known, room) = block.split_at_mut(self.tail);
        let own = self.arrays(n, room);
        let Arrays { prior, work, predicted, gains, errors, states, disturbances, .. } = own;
        predicted[..n * n].copy_from_slice(if self.usual { model.P } else { prior });
        states[..n].copy_from_slice(&known[x..x + n]);
        let sample = |k: usize| (&known[y.start + k * p..][..p], &known[u.start + k * m..][..m]);
        let mut cost = 0.0;
        for k in 0..depth {
            let (y, u) = sample(k);
            let (now, next) = states[k * n..(k + 2) * n].split_at_mut(n);
            let (before, after) = predicted[k * n * n..(k + 2) * n * n].split_at_mut(n * n);
            next.copy_from_slice(now);
            after.copy_from_slice(before);
            errors[k * p..(k + 1) * p].fill(f64::NAN);
            model.measure(y, after, work, |i, gain, s| {
                let error = y[i] - model.pushed_output(i, u) - dot(model.c(i), next);
                axpy(error, gain, next);
                gains[(k * p + i) * n..(k * p + i + 1) * n].copy_from_slice(gain);
                errors[k * p + i] = error / s;
                cost += error * error / s;
            });
            model.predict(after, work);
            model.move_on(next, u, work);
        }
        self.cost = cost;
        // λ(t) = 0, and back
        let (lambda, later) = work.split_at_mut(n);
        lambda.fill(0.0);
        for k in (0..depth).rev() {
            model.times_Q(lambda, &mut disturbances[k * n..(k + 1) * n]);
            model.times_A_transposed(lambda, &mut later[..n]);
            lambda.copy_from_slice(&later[..n]);
            for i in (0..p).rev().filter(|i| !errors[k * p + i].is_nan()) {
                let along = dot(&gains[(k * p + i) * n..(k * p + i + 1) * n], lambda);
                axpy(errors[k * p + i] - along, model.c(i), lambda);
            }
            for (i, row) in predicted[k * n * n..(k + 1) * n * n].chunks_exact(n).enumerate() {
                states[k * n + i] += dot(row, lambda);
            }
        }
    }
}
