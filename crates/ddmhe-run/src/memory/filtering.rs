//! The filter behind the estimates of a window: see [`kalman`](crate::kalman).

use crate::kalman::{Filtered, Kalman};
use crate::memory::losses::Losses;
use crate::memory::stretches::{Stretches, samples};
use crate::panels::{padded, square};
use crate::plan::common::Sizes;
use crate::sliding::SlidingBuffer;
use crate::tol;
use core::ops::Range;

/// Where what the filter makes is kept; nothing without the weights of the recording.
#[derive(Debug, Clone)]
pub(crate) struct Filtering {
    innovations: SlidingBuffer, // beside the outputs that are kept
    ahead: usize,               // [x̂(k+1); ν(k)]
    predicted: usize,           // x̂ of a pass over the window
    whitened: usize,            // ν of one
    /// Whether the estimates that are kept are one filter's.
    chain: bool,
    /// Outputs that came after the last one that was filtered.
    unfiltered: usize, // outputs that came after the last one that was filtered
    depth: usize, // of the window that was filtered last
    found: Option<Way>,
    pub losses: Losses,
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
    /// Where its numbers end.
    pub fn end(&self) -> usize {
        self.losses.end
    }

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
            chain: width > 0,
            unfiltered: 0,
            depth: 0,
            found: None,
            losses: Losses::new(sizes, whitened + kept(horizon * p)),
        }
    }

    pub fn clear(&mut self) {
        self.innovations.clear();
        self.chain = self.innovations.width > 0;
        (self.unfiltered, self.depth, self.found) = (0, 0, None);
        self.losses.clear();
    }

    /// Whether there is a filter.
    #[inline(always)]
    pub fn is_used(&self) -> bool {
        self.innovations.width > 0
    }

    /// Room for ν of a new output.
    pub fn push(&mut self, block: &mut [f64]) {
        self.innovations.next(block);
        self.unfiltered += 1;
        self.found = None;
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

impl Filtering {
    /// The window of this step, if its problem is `filtered`: by one step from the estimate before
    /// where all estimates in the window are one filter's, else from x̄ on.
    #[inline(always)]
    pub fn filter(
        &mut self,
        block: &mut [f64],
        at: Stretches,
        (kalman, filtered): (&Kalman<'_>, bool),
    ) {
        if !filtered {
            (self.unfiltered, self.depth) = (0, at.depth);
            (self.chain, self.found) = (false, None);
            self.losses.clear_prior();
            return;
        }
        let all = self.losses.settle_prior(block, at, &kalman.model) && !at.missing(block);
        // an estimate after each output, and none in the window that no window before held
        let whole = self.unfiltered == 1 && at.depth <= self.depth + 1;
        (self.unfiltered, self.depth) = (0, at.depth);
        self.chain &= whole && all;
        self.found = match all {
            true if self.chain => {
                self.step_ahead(block, at, kalman, [1, 1]);
                Some(Way::Chain)
            }
            true => {
                self.pass(block, at, kalman);
                Some(Way::Pass)
            }
            false => {
                self.losses.pass(block, at, &kalman.model);
                Some(Way::Losses)
            }
        };
    }

    /// \[x̂(k+1); ν(k)\] from the i-th latest state and the j-th latest output; ν to its place.
    #[inline(always)]
    pub fn step_ahead(
        &mut self,
        block: &mut [f64],
        at: Stretches,
        kalman: &Kalman<'_>,
        [i, j]: [usize; 2],
    ) {
        let [n, p, m] = at.channels();
        let (x, y, u) =
            (at.states.last(i).start, at.outputs.last(j).start, at.inputs.last(j).start);
        let nu = self.innovations.last(j).start;
        let (known, room) = block.split_at_mut(self.ahead);
        let room = &mut room[..padded(n + p)];
        kalman.ahead(&known[x..x + n], &known[y..y + p], &known[u..u + m], room);
        known[nu..nu + p].copy_from_slice(&room[n..n + p]);
    }

    /// The whole window from x̄ on. Its estimates are one filter's again where they are what the
    /// pass makes of them.
    fn pass(&mut self, block: &mut [f64], at: Stretches, kalman: &Kalman<'_>) {
        let ([n, p, m], depth) = (at.channels(), at.depth);
        let (x, y, u) = (at.states.last(depth), at.outputs.last(depth), at.inputs.last(depth));
        let Filtering { ahead, predicted, whitened, .. } = *self;
        let (known, room) = block.split_at_mut(ahead);
        let (next, room) = room.split_at_mut(predicted - ahead);
        let (past, nu) = room.split_at_mut(whitened - predicted);
        let mut same = true;
        past[..n].copy_from_slice(&known[x.start..x.start + n]);
        for k in 0..depth {
            let (y, u) = (y.start + k * p, u.start + k * m);
            let from = &past[k * n..(k + 1) * n];
            kalman.ahead(from, &known[y..y + p], &known[u..u + m], next);
            nu[k * p..(k + 1) * p].copy_from_slice(&next[n..n + p]);
            if k + 1 < depth {
                past[(k + 1) * n..(k + 2) * n].copy_from_slice(&next[..n]);
                let kept = &known[x.start + (k + 1) * n..x.start + (k + 2) * n];
                let near =
                    |(a, b): (&f64, &f64)| (a - b).abs() <= tol::SAME_FILTER * (1.0 + b.abs());
                same &= kept.iter().zip(&*next).all(near);
            }
        }
        if same {
            let kept = self.innovations.last(depth);
            known[kept].copy_from_slice(&nu[..depth * p]);
            self.chain = true;
        }
    }

    /// The window of this step as the filter has it.
    #[inline(always)]
    pub fn filtered(&self, at: Stretches) -> Option<Found> {
        let ([n, p, _], depth) = (at.channels(), at.depth);
        let Filtering { ahead, predicted, whitened, .. } = *self;
        let next = ahead..ahead + n;
        Some(match self.found? {
            Way::Chain => {
                let innovations = self.innovations.last(depth);
                Found::Settled([at.states.last(depth), innovations, next])
            }
            Way::Pass => {
                let past = predicted..predicted + depth * n;
                Found::Settled([past, whitened..whitened + depth * p, next])
            }
            Way::Losses => Found::Losses(self.losses.window(depth, n), self.losses.cost),
        })
    }

    /// Whether a window of this depth goes on with the filter.
    #[inline(always)]
    pub fn goes_on(&self, depth: usize) -> bool {
        self.chain && self.unfiltered == 0 && depth <= self.depth + 1
    }

    /// Whether a window of this depth goes on where one of this depth was filtered.
    #[inline(always)]
    pub fn continues(&self, depth: usize) -> bool {
        self.goes_on(depth) && self.depth == depth
    }

    /// Room for ν of the next outputs: of how many.
    #[inline(always)]
    pub fn make_room(&mut self, block: &mut [f64]) -> usize {
        self.innovations.make_room(block);
        self.innovations.room()
    }

    /// Where ν end, and where the numbers of a step ahead begin.
    #[inline(always)]
    pub fn ends(&self) -> [usize; 2] {
        [self.innovations.window().end, self.ahead]
    }

    /// As of a [`SlidingBuffer`], for ν that are there.
    pub fn move_on(&mut self, samples: usize) {
        self.innovations.move_on(samples);
    }

    /// x̂(t) (n), made a step ahead.
    #[inline(always)]
    pub fn ahead<'b>(&self, block: &'b [f64], n: usize) -> &'b [f64] {
        &block[self.ahead..self.ahead + n]
    }

    /// (17) of a window of this depth that went on with the filter.
    #[inline(always)]
    pub fn cost(&mut self, block: &[f64], depth: usize) -> f64 {
        (self.unfiltered, self.depth) = (0, depth);
        square(&block[self.innovations.last(depth)])
    }

    /// Of so many outputs.
    pub fn keep(&mut self, outputs: usize) {
        if self.innovations.width > 0 {
            self.innovations.keep(outputs);
        }
        self.losses.clear();
    }

    /// The newest output is taken back.
    pub fn retract(&mut self) {
        self.innovations.retract();
        self.unfiltered = 0;
    }

    /// Where the covariance of x̂(t) is (n × n), unless it is the stationary one.
    pub fn covariance(&self, depth: usize, n: usize) -> Option<Range<usize>> {
        (self.found == Some(Way::Losses)).then(|| self.losses.covariance(depth, n))
    }

    /// Whether the estimates that are kept are one filter's: not before outputs that were there
    /// from the start, the recording's, are filtered.
    pub fn is_chain(&self) -> bool {
        self.chain && self.unfiltered == 0
    }

    /// From now on they are not.
    #[inline]
    pub fn unchain(&mut self) {
        self.chain = false;
    }

    /// Where ν of the outputs that are kept are.
    pub fn innovations(&self) -> Range<usize> {
        self.innovations.window()
    }

    /// They are: of a saved run with these ν.
    pub fn chain(&mut self, block: &mut [f64], depth: usize, innovations: &[f64]) {
        block[self.innovations.window()].copy_from_slice(innovations);
        (self.chain, self.unfiltered, self.depth) = (true, 0, depth);
    }
}

/// Where a [`Filtered`] is.
pub(crate) enum Found {
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
