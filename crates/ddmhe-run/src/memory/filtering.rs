//! The filter behind the estimates of a window: see [`kalman`](crate::kalman).

use super::{Memory, samples};
use crate::kalman::{Filtered, Kalman};
use crate::panels::{dot, padded};
use crate::plan::common::{Shared, Sizes};
use crate::sliding::SlidingBuffer;
use crate::tol;
use core::ops::Range;

/// Where what the filter makes is kept; nothing without the weights of the recording.
#[derive(Debug, Clone)]
pub(super) struct Filtering {
    innovations: SlidingBuffer, // beside the outputs that are kept
    ahead: usize,               // [x̂(k+1); ν(k)]
    predicted: usize,           // x̂ of a pass over the window
    whitened: usize,            // ν of one
    pub end: usize,
    /// Whether the estimates that are kept are one filter's.
    chain: bool,
    unfiltered: usize, // outputs that came after the last one that was filtered
    depth: usize,      // of the window that was filtered last
    found: Option<Way>,
}

/// How the window of this step was filtered.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Way {
    /// From the estimate before.
    Chain,
    /// From x̄.
    Pass,
    /// From x̄ on with covariances of their own: outputs were lost in it, or before it.
    Losses,
}

impl Filtering {
    pub fn new(sizes: Sizes, at: usize) -> Self {
        let Sizes { n, p, horizon, .. } = sizes;
        let kept = |len: usize| if sizes.recorded { padded(len) } else { 0 };
        let ahead = at + kept(samples(horizon) * p);
        let predicted = ahead + kept(n + p);
        let whitened = predicted + kept(horizon * n);
        let width = if sizes.recorded { p } else { 0 };
        Filtering {
            innovations: SlidingBuffer::new(at, width, samples(horizon)),
            ahead,
            predicted,
            whitened,
            end: whitened + kept(horizon * p),
            chain: true,
            unfiltered: 0,
            depth: 0,
            found: None,
        }
    }

    pub fn clear(&mut self) {
        self.innovations.clear();
        (self.chain, self.unfiltered, self.depth, self.found) = (true, 0, 0, None);
    }

    /// Room for ν of a new output.
    pub fn push(&mut self, block: &mut [f64]) {
        if self.innovations.width > 0 {
            self.innovations.next(block);
            self.unfiltered += 1;
            self.found = None;
        }
    }

    /// The outputs of the window are others than those that were filtered.
    pub fn doubted(&mut self) {
        (self.chain, self.found) = (false, None);
    }

    pub fn forget(&mut self) {
        if self.innovations.width > 0 {
            self.innovations.forget();
        }
    }
}

impl<B: AsRef<[f64]> + AsMut<[f64]>> Memory<B> {
    /// The window of this step, if its problem is `filtered`: by one step from the estimate before
    /// where all estimates in the window are one filter's, else from x̄ on.
    #[inline(always)]
    pub(crate) fn filter(&mut self, kalman: &Kalman<'_>, filtered: bool) {
        if !filtered {
            (self.filtering.unfiltered, self.filtering.depth) = (0, self.depth);
            (self.filtering.chain, self.filtering.found) = (false, None);
            self.losses.clear_prior();
            return;
        }
        let all = self.settle_prior(&kalman.model) && !self.missing();
        // an estimate after each output, and none in the window that no window before held
        let whole = self.filtering.unfiltered == 1 && self.depth <= self.filtering.depth + 1;
        (self.filtering.unfiltered, self.filtering.depth) = (0, self.depth);
        self.filtering.chain &= whole && all;
        self.filtering.found = match all {
            true if self.filtering.chain => {
                self.step_ahead(kalman, 1);
                Some(Way::Chain)
            }
            true => {
                self.pass(kalman);
                Some(Way::Pass)
            }
            false => {
                self.pass_losses(&kalman.model);
                Some(Way::Losses)
            }
        };
    }

    /// \[x̂(k+1); ν(k)\] from the k-th latest sample, k from 1; ν to its place.
    #[inline(always)]
    fn step_ahead(&mut self, kalman: &Kalman<'_>, k: usize) {
        let (n, p, m) = (self.states.width, self.outputs.width, self.inputs.width);
        let (x, y, u) = (self.states.last(k), self.outputs.last(k), self.inputs.last(k));
        let (ahead, nu) = (self.filtering.ahead, self.filtering.innovations.last(k).start);
        let (known, room) = self.block.as_mut().split_at_mut(ahead);
        let room = &mut room[..padded(n + p)];
        let (x, y) = (&known[x.start..x.start + n], &known[y.start..y.start + p]);
        kalman.ahead(x, y, &known[u.start..u.start + m], room);
        known[nu..nu + p].copy_from_slice(&room[n..n + p]);
    }

    /// The whole window from x̄ on. Its estimates are one filter's again where they are what the pass
    /// makes of them.
    fn pass(&mut self, kalman: &Kalman<'_>) {
        let (n, p, m) = (self.states.width, self.outputs.width, self.inputs.width);
        let (x, y, u) = (
            self.states.last(self.depth),
            self.outputs.last(self.depth),
            self.inputs.last(self.depth),
        );
        let Filtering { ahead, predicted, whitened, .. } = self.filtering;
        let (known, room) = self.block.as_mut().split_at_mut(ahead);
        let (next, room) = room.split_at_mut(predicted - ahead);
        let (past, nu) = room.split_at_mut(whitened - predicted);
        let mut same = true;
        past[..n].copy_from_slice(&known[x.start..x.start + n]);
        for k in 0..self.depth {
            let (y, u) = (y.start + k * p, u.start + k * m);
            let from = &past[k * n..(k + 1) * n];
            kalman.ahead(from, &known[y..y + p], &known[u..u + m], next);
            nu[k * p..(k + 1) * p].copy_from_slice(&next[n..n + p]);
            if k + 1 < self.depth {
                past[(k + 1) * n..(k + 2) * n].copy_from_slice(&next[..n]);
                let kept = &known[x.start + (k + 1) * n..x.start + (k + 2) * n];
                let near =
                    |(a, b): (&f64, &f64)| (a - b).abs() <= tol::SAME_FILTER * (1.0 + b.abs());
                same &= kept.iter().zip(&*next).all(near);
            }
        }
        if same {
            let at = self.filtering.innovations.last(self.depth);
            known[at].copy_from_slice(&nu[..self.depth * p]);
            self.filtering.chain = true;
        }
    }

    /// The window of this step as the filter has it.
    #[inline(always)]
    pub(super) fn filtered(&self) -> Option<Found> {
        let (n, p, depth) = (self.states.width, self.outputs.width, self.depth);
        let Filtering { ahead, predicted, whitened, .. } = self.filtering;
        let next = ahead..ahead + n;
        Some(match self.filtering.found? {
            Way::Chain => {
                let innovations = self.filtering.innovations.last(depth);
                Found::Settled([self.states.last(depth), innovations, next])
            }
            Way::Pass => {
                let past = predicted..predicted + depth * n;
                Found::Settled([past, whitened..whitened + depth * p, next])
            }
            Way::Losses => Found::Losses(self.losses.window(depth, n), self.losses.cost),
        })
    }

    /// Whether the estimates that are kept are one filter's.
    pub fn is_chain(&self) -> bool {
        self.filtering.chain
    }

    /// From now on they are not.
    #[inline]
    pub fn unchain(&mut self) {
        self.filtering.chain = false;
    }

    /// They are: of a saved run.
    pub fn chain(&mut self, shared: &Shared<'_>) {
        let Some(kalman) = &shared.kalman else { return };
        (1..=self.len()).for_each(|k| self.step_again(kalman, k));
        self.filtering.depth = self.depth;
        (self.filtering.chain, self.filtering.unfiltered) = (true, 0);
    }

    /// y(t-1) and u(t-1) taken in, and x̂(t) into x, in the user's units, where the estimates in the
    /// window are one filter's and nothing else is asked for: its cost. None where this step is
    /// another; nothing has changed then.
    #[inline(always)]
    pub(crate) fn filter_alone(
        &mut self,
        shared: &Shared<'_>,
        (y, u): (&[f64], &[f64]),
        (depth, x): (usize, &mut [f64]),
    ) -> Option<f64> {
        let kalman = shared.kalman.as_ref()?;
        let Filtering { chain, unfiltered, depth: before, .. } = self.filtering;
        let usual = chain && unfiltered == 0 && self.missing == 0 && depth <= before + 1;
        let mut outputs = shared.output_deviations(y);
        if !usual || !outputs.all(|y| y.abs() <= tol::MEASURABLE) {
            return None;
        }
        self.push_output(shared.output_deviations(y));
        self.push_input(shared.input_deviations(u));
        self.step_ahead(kalman, 1);
        let next = &self.block.as_ref()[self.filtering.ahead..][..self.states.width];
        if !next.iter().all(|x| x.abs() <= tol::MEASURABLE) {
            self.outputs.retract();
            self.filtering.innovations.retract();
            self.inputs.retract();
            self.filtering.unfiltered = 0;
            return None;
        }
        for (i, (to, next)) in x.iter_mut().zip(next).enumerate() {
            *to = next * shared.s_x[i] + shared.mean_x[i];
        }
        if self.depth != depth {
            self.deepen(depth);
        }
        (self.filtering.unfiltered, self.filtering.depth) = (0, depth);
        self.push_state(shared.state_deviations(x));
        let innovations = &self.block.as_ref()[self.filtering.innovations.last(depth)];
        Some(dot(innovations, innovations))
    }

    /// ν of the k-th latest output, which an estimate followed.
    fn step_again(&mut self, kalman: &Kalman<'_>, k: usize) {
        let (n, p, m) = (self.states.width, self.outputs.width, self.inputs.width);
        let (x, y) = (self.states.last(k + 1).start, self.outputs.last(k).start);
        let (u, nu) = (self.inputs.last(k).start, self.filtering.innovations.last(k).start);
        let (known, room) = self.block.as_mut().split_at_mut(self.filtering.ahead);
        let room = &mut room[..padded(n + p)];
        kalman.ahead(&known[x..x + n], &known[y..y + p], &known[u..u + m], room);
        known[nu..nu + p].copy_from_slice(&room[n..n + p]);
    }
}

/// Where a [`Filtered`] is.
pub(super) enum Found {
    Settled([Range<usize>; 3]),
    Losses([Range<usize>; 2], f64),
}

impl Found {
    /// To be read.
    pub fn of(self, block: &[f64]) -> Filtered<'_> {
        match self {
            Found::Settled([past, innovations, next]) => Filtered::Settled {
                past: &block[past],
                innovations: &block[innovations],
                next: &block[next],
            },
            Found::Losses([states, disturbances], cost) => Filtered::Losses {
                states: &block[states],
                disturbances: &block[disturbances],
                cost,
            },
        }
    }
}
