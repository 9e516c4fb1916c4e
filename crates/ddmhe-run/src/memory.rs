//! The numbers of a running estimator, in one block: the moving window and the room that a step
//! works in.

use crate::active_set::working_set::{ActiveBound, Kept, Sides, WorkingSet};
use crate::kalman::Kalman;
use crate::panels::padded;
use crate::plan::common::{Shared, Sizes};
use crate::problem::{Scratch, Spare};
use crate::sliding::SlidingBuffer;
use crate::tol;
pub(crate) use considered::FilterStep;
use core::ops::Range;
use filtering::Filtering;
use forced::Forced;
use gate::Gate;
pub use parts::Parts;
use room::Room;
use stretches::{Stretches, samples};
use witness::Witness;
pub use witness::{Judged, Told};

mod considered;
mod filtering;
mod forced;
mod gate;
mod losses;
mod parts;
mod room;
mod stretches;
mod witness;

/// The moving window, as scaled deviations, and room for a step, in numbers that are owned or lent.
///
/// The window of a step may be shorter than what is kept: a run that grows through a few depths
/// only keeps all outputs until the horizon is reached.
#[derive(Debug, Clone)]
pub struct Memory<B> {
    pub(crate) block: B,
    pub(crate) outputs: SlidingBuffer,
    pub(crate) states: SlidingBuffer,
    pub(crate) inputs: SlidingBuffer,
    pub(crate) depth: usize,   // outputs in the window of this step
    pub(crate) missing: usize, // NaN among the outputs that are kept
    aside: usize,              // where the outputs are kept that were set aside
    pub(crate) forced: Forced, // where the forced motion is
    pub(crate) filtering: Filtering,
    pub(crate) witness: Witness, // what says how far to trust an estimate
    pub(crate) gate: Gate,       // what outputs are doubted with
    /// Outputs since the run started, or started again, from an unknown state; `usize::MAX` of one
    /// that started from a known one.
    pub(crate) since: usize,
    pub(crate) room: Room,
    pub(crate) scratch: usize, // where the room begins
    pub(crate) sides: usize,   // active bounds of the last step
    before: usize,
    kept: Kept,
}

/// Numbers that a memory takes, for windows up to `horizon` and up to `rank` directions.
pub fn memory_len(sizes: Sizes) -> usize {
    let Sizes { n, p, horizon, .. } = sizes;
    let stretch = padded(samples(horizon) * p) + padded(samples(horizon) * n);
    let judged = Witness::new(sizes, 0).end + Gate::new(sizes, 0).end;
    let filtering = Filtering::new(sizes, 0).end() + judged;
    let known = padded(horizon * p) + Forced::new(sizes, 0).len() + filtering;
    stretch + known + Room::new(sizes).len(sizes)
}

impl<B: AsRef<[f64]> + AsMut<[f64]>> Memory<B> {
    /// In a block of [`memory_len`] zeros.
    pub fn new(sizes: Sizes, block: B) -> Self {
        let Sizes { n, p, m, horizon, .. } = sizes;
        let samples = samples(horizon);
        let aside = padded(samples * p) + padded(samples * n);
        let forced = Forced::new(sizes, aside + padded(horizon * p));
        let filtering = Filtering::new(sizes, forced.end);
        let witness = Witness::new(sizes, filtering.end());
        let gate = Gate::new(sizes, witness.end);
        let slide = |at, width| SlidingBuffer::new(at, width, samples);
        Memory {
            block,
            outputs: slide(0, p),
            states: slide(padded(samples * p), n),
            inputs: slide(forced.inputs, m),
            depth: 0,
            missing: 0,
            aside,
            room: Room::new(sizes),
            scratch: gate.end,
            forced,
            filtering,
            witness,
            gate,
            since: usize::MAX,
            sides: 0,
            before: 0,
            kept: Kept::default(),
        }
    }

    /// As new.
    pub fn clear(&mut self) {
        self.block.as_mut().fill(0.0);
        self.outputs.clear();
        self.states.clear();
        self.inputs.clear();
        self.forced.clear();
        self.filtering.clear();
        self.witness.clear();
        self.gate.start(self.block.as_mut());
        self.since = usize::MAX;
        (self.depth, self.missing, self.sides, self.before) = (0, 0, 0, 0);
        self.kept = Kept::default();
    }

    /// What is made once of a plan, at the start of a run: else its first step makes it.
    pub fn prepare(&mut self, shared: &Shared<'_>) {
        self.forced.prepare(self.block.as_mut(), shared);
    }

    /// Outputs that are kept.
    #[inline]
    pub fn len(&self) -> usize {
        self.outputs.len
    }

    /// Whether no output is kept.
    pub fn is_empty(&self) -> bool {
        self.outputs.len == 0
    }

    /// Outputs in the window of this step.
    #[inline]
    pub fn depth(&self) -> usize {
        self.depth
    }

    /// The window of this step has another depth: rows have other places in it.
    pub fn deepen(&mut self, depth: usize) {
        self.depth = depth;
        self.working_set().clear();
    }

    /// All outputs that are kept.
    #[inline]
    pub fn outputs(&self) -> &[f64] {
        &self.block.as_ref()[self.outputs.window()]
    }

    /// All states that are kept.
    #[inline]
    pub fn states(&self) -> &[f64] {
        &self.block.as_ref()[self.states.window()]
    }

    /// The states of the window of this step but the newest, which is not estimated yet: x̄ first.
    #[inline]
    pub fn past(&self) -> &[f64] {
        &self.block.as_ref()[self.states.last(self.depth)]
    }

    /// The outputs in the window of this step.
    #[inline]
    pub fn window(&self) -> &[f64] {
        &self.block.as_ref()[self.outputs.last(self.depth)]
    }

    /// All inputs that are kept.
    pub fn inputs(&self) -> &[f64] {
        &self.block.as_ref()[self.inputs.window()]
    }

    /// The inputs in the window of this step.
    pub fn window_inputs(&self) -> &[f64] {
        &self.block.as_ref()[self.inputs.last(self.depth)]
    }

    /// Appends the inputs at the instant of the newest output, as scaled deviations.
    #[inline(always)]
    pub fn push_input(&mut self, u: impl Iterator<Item = f64>) {
        if self.inputs.width == 0 {
            return;
        }
        let block = self.block.as_mut();
        let at = self.inputs.next(block);
        block[at].iter_mut().zip(u).for_each(|(slot, u)| *slot = u);
    }

    #[inline(always)]
    pub(crate) fn stretches(&self) -> Stretches {
        let Memory { outputs, states, inputs, depth, missing, .. } = *self;
        Stretches { outputs, states, inputs, depth, missing }
    }

    /// The forced motion of the window of this step, from its inputs.
    #[inline(always)]
    pub fn force(&mut self, shared: &Shared<'_>) {
        let at = self.stretches();
        self.forced.force(self.block.as_mut(), at, shared);
    }

    /// The window of this step as a filter has it, if its problem is `filtered`.
    #[inline(always)]
    pub(crate) fn filter(&mut self, kalman: &Kalman<'_>, filtered: bool) {
        let at = self.stretches();
        self.filtering.filter(self.block.as_mut(), at, (kalman, filtered));
    }

    /// Whether the estimates that are kept are one filter's.
    pub fn is_chain(&self) -> bool {
        self.filtering.is_chain()
    }

    /// From now on they are not.
    #[inline]
    pub fn unchain(&mut self) {
        self.filtering.unchain();
    }

    /// The covariance of the oldest estimate (n × n), unless it is the stationary one: to be saved.
    pub fn tail(&self) -> Option<&[f64]> {
        self.filtering.losses.tail(self.block.as_ref(), self.states.width)
    }

    /// ν of each output that is kept, where the estimates are one filter's: to be saved.
    pub fn innovations(&self) -> &[f64] {
        let kept = self.filtering.innovations();
        &self.block.as_ref()[if self.is_chain() { kept } else { 0..0 }]
    }

    /// Takes up a saved filter: whether its estimates are one, with ν of each output, and that
    /// covariance if there is one.
    pub fn resume_filter(&mut self, chain: bool, [innovations, tail]: [&[f64]; 2]) {
        let depth = self.depth;
        if !tail.is_empty() {
            self.filtering.losses.set_tail(self.block.as_mut(), tail);
        }
        if chain {
            self.filtering.chain(self.block.as_mut(), depth, innovations);
        } else {
            self.filtering.unchain();
        }
    }

    /// An entry beyond [`MEASURABLE`](tol::MEASURABLE) counts as not measured. Returns how many do.
    #[inline(always)]
    pub fn push_output(&mut self, y: impl Iterator<Item = f64>) -> usize {
        let block = self.block.as_mut();
        let at = self.outputs.next(block);
        let mut missing = 0;
        for (i, y) in at.zip(y) {
            let within = y.abs() <= tol::MEASURABLE;
            block[i] = if within { y } else { f64::NAN }; // one by one: there are few
            missing += usize::from(!within);
        }
        self.missing += missing;
        if self.filtering.is_used() {
            self.filtering.push(self.block.as_mut());
        }
        missing
    }

    /// Whether nothing was measured in these samples of the window.
    pub fn silent(&self, samples: Range<usize>) -> bool {
        let p = self.outputs.width;
        self.window()[samples.start * p..samples.end * p].iter().all(|y| y.is_nan())
    }

    /// The sample of the window with the output that is furthest from the recording's mean.
    pub fn furthest(&self) -> usize {
        let far = |(k, y): (usize, &f64)| (if y.is_nan() { 0.0 } else { y.abs() }, k);
        let most = self.window().iter().enumerate().map(far).max_by(|a, b| a.0.total_cmp(&b.0));
        most.map_or(0, |(_, k)| k / self.outputs.width)
    }

    /// From now on these samples of the window count as not measured;
    /// [`take_back`](Self::take_back) undoes it.
    pub fn set_aside(&mut self, samples: Range<usize>) {
        let (p, window) = (self.outputs.width, self.outputs.last(self.depth));
        let block = self.block.as_mut();
        block.copy_within(window.clone(), self.aside);
        block[window.start + samples.start * p..window.start + samples.end * p].fill(f64::NAN);
        self.count_missing();
    }

    /// The outputs as they were when some were [set aside](Self::set_aside).
    pub fn take_back(&mut self) {
        let window = self.outputs.last(self.depth);
        self.block.as_mut().copy_within(self.aside..self.aside + window.len(), window.start);
        self.count_missing();
    }

    /// A window that nothing is known of: the recording's mean state throughout, and no output.
    pub fn forget_all(&mut self) {
        let (outputs, states) = (self.outputs.window(), self.states.window());
        self.block.as_mut()[outputs].fill(f64::NAN);
        self.block.as_mut()[states].fill(0.0);
        self.count_missing();
    }

    pub(crate) fn count_missing(&mut self) {
        self.filtering.doubted();
        self.missing = self.outputs().iter().filter(|y| y.is_nan()).count();
    }

    /// Another newest state, as scaled deviations.
    pub fn replace_newest(&mut self, x: impl Iterator<Item = f64>) {
        self.unchain();
        let at = self.states.last(1);
        self.block.as_mut()[at].iter_mut().zip(x).for_each(|(slot, x)| *slot = x);
    }

    /// Other states for those of a window that is estimated: its past and the newest.
    pub fn replace_states(&mut self, states: impl Iterator<Item = f64>) {
        self.unchain();
        let at = self.states.last(self.depth + 1);
        self.block.as_mut()[at].iter_mut().zip(states).for_each(|(slot, x)| *slot = x);
    }

    /// Other states for those between the oldest and the newest of such a window.
    pub fn replace_past(&mut self, states: impl Iterator<Item = f64>) {
        self.unchain();
        let at = self.states.last(self.depth);
        self.block.as_mut()[at].iter_mut().zip(states).for_each(|(slot, x)| *slot = x);
    }

    /// Appends a state, as scaled deviations.
    #[inline(always)]
    pub fn push_state(&mut self, x: impl Iterator<Item = f64>) {
        let block = self.block.as_mut();
        let at = self.states.next(block);
        at.zip(x).for_each(|(i, x)| block[i] = x); // one by one: there are few
    }

    /// Forgets the oldest output with its inputs, and the oldest state.
    #[inline(always)]
    pub fn forget(&mut self, shared: &Shared<'_>) {
        if let Some(kalman) = &shared.kalman {
            let at = self.stretches();
            self.filtering.losses.forget(self.block.as_mut(), at, &kalman.model);
        }
        if self.missing > 0 {
            let oldest = &self.outputs()[..self.outputs.width];
            self.missing -= oldest.iter().filter(|y| y.is_nan()).count();
        }
        self.outputs.forget();
        self.states.forget();
        self.filtering.forget();
        self.witness.forget();
        if self.inputs.width > 0 {
            self.inputs.forget();
        }
    }

    /// The active bounds of the last step.
    pub fn working_set(&mut self) -> WorkingSet<'_> {
        self.parts().working
    }

    /// The same, to be saved.
    pub fn active(&self) -> impl Iterator<Item = ActiveBound> + '_ {
        let at = self.scratch + self.room.len_before_sides();
        self.block.as_ref()[at..at + self.sides].iter().map(|code| ActiveBound::decode(*code))
    }

    /// Whether they move with the window.
    pub fn moves(&self) -> bool {
        self.kept.moves
    }

    /// Takes up saved active bounds of a window of this depth.
    pub fn resume(&mut self, depth: usize, active: &[ActiveBound], moves: bool) {
        if depth > self.len() {
            return; // no step was made
        }
        self.deepen(depth);
        let mut working = self.working_set();
        active.iter().for_each(|side| working.sides.push(*side));
        working.kept.moves = moves;
    }

    /// The window's x̄ and outputs, and the room for a step.
    #[inline(always)]
    pub fn parts(&mut self) -> Parts<'_> {
        let missing = self.missing > 0 && self.stretches().missing(self.block.as_ref());
        let (states, outputs) = (self.states.last(self.depth), self.outputs.last(self.depth));
        let (outputs, means) = match self.inputs.width {
            0 => (outputs, None),
            _ => {
                let at = self.stretches();
                self.forced.free(self.block.as_mut(), at);
                let [free, means] = self.forced.moved(at);
                (free, Some(means))
            }
        };
        let (filtered, lacking) = match self.filtering.is_used() {
            false => (None, None),
            true => (
                self.filtering.filtered(self.stretches()),
                self.filtering.losses.loss(self.states.width),
            ),
        };
        let (window, room) = self.block.as_mut().split_at_mut(self.scratch);
        let (unconstrained, room) = room.split_at_mut(self.room.rank);
        let (answer, room) = room.split_at_mut(self.room.window);
        let (sides, room) = room.split_at_mut(self.room.sides);
        let (before, spare) = room.split_at_mut(self.room.sides);
        let n = self.states.width;
        Parts {
            prior: &window[states.start..states.start + n],
            outputs: &window[outputs],
            means: means.map(|means| &window[means]),
            missing,
            filtered: filtered.map(|at| at.of(window)),
            lacking: lacking.map(|at| &window[at]),
            scratch: Scratch {
                unconstrained,
                window: answer,
                spare: Spare { block: spare, lengths: &self.room.spare },
            },
            working: WorkingSet {
                sides: Sides::new(sides, &mut self.sides),
                before: Sides::new(before, &mut self.before),
                kept: &mut self.kept,
            },
        }
    }
}
