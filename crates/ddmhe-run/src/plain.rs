//! The window of most steps: all of it was measured, and no bound was active before.
//!
//! z* = z_0 + K [x̄; y] and its window w = c + A z* are then the answer, if w is inside of all
//! bounds: nothing but these numbers is looked at, and each block of the window once. Where w is
//! not inside, it is where [`window`](crate::window) goes on from.

use crate::active_set::problem::Windows;
use crate::at_once::{AtOnce, noise};
use crate::memory::Memory;
use crate::panels::{each, margins, smaller, sum};
use crate::plan::common::Limits;
use crate::problem::{Data, Fit, Scratch, Spare, WindowProblem, WindowSolution};
use crate::status::Status;
use crate::tol;

/// Such a window: x̄, all outputs, and what makes states of its deviations.
#[derive(Debug)]
pub(crate) struct Plain<'a> {
    pub prior: &'a [f64],
    pub outputs: &'a [f64],
    pub means: Option<&'a [f64]>,
    pub scratch: Scratch<'a>,
}

impl<B: AsRef<[f64]> + AsMut<[f64]>> Memory<B> {
    /// Whether all of the window was measured, and no bound was active in the last one.
    #[inline(always)]
    pub(crate) fn is_plain(&self) -> bool {
        self.missing == 0 && self.sides == 0
    }

    /// Such a window, of a system without a filter.
    #[inline(always)]
    pub(crate) fn plain(&mut self) -> Plain<'_> {
        let (n, at, room) = (self.states.width, self.stretches(), &self.room);
        let (prior, outputs) = (at.states.last(at.depth).start, at.outputs.last(at.depth));
        let block = self.block.as_mut();
        let inputs = at.inputs.width > 0;
        if inputs {
            self.forced.free(block, at);
        }
        let (known, block) = block.split_at_mut(self.scratch);
        let (unconstrained, block) = block.split_at_mut(room.rank);
        let (window, block) = block.split_at_mut(room.window);
        let scratch = Scratch {
            unconstrained,
            window,
            spare: Spare { block: &mut block[2 * room.sides..], lengths: &room.spare },
        };
        let prior = &known[prior..prior + n];
        if !inputs {
            return Plain { prior, outputs: &known[outputs], means: None, scratch };
        }
        let [outputs, means] = self.forced.moved(at);
        Plain { prior, outputs: &known[outputs], means: Some(&known[means]), scratch }
    }
}

impl WindowProblem<'_> {
    /// The cost (17) and V of a window whose minimiser is inside of all bounds, with its states and
    /// v in the answer. None where it is not, or none can be computed: z*, its window and v are
    /// there then.
    #[inline(always)]
    pub(crate) fn minimise_at_once(
        &self,
        known: &AtOnce<'_>,
        plain: Plain<'_>,
        fit: &mut Fit<'_>,
    ) -> Option<[f64; 2]> {
        let Plain { prior, outputs, means, scratch: mut s } = plain;
        self.minimiser(prior, outputs, s.unconstrained);
        self.window(&s.unconstrained[..self.depth.rank], s.window);
        let (of_x, of_y) = s.window.split_at(self.depth.layout.split());
        let (inside, square) = if known.bounded {
            let [per_x, per_v, _] = self.shared.margins.map(|margin| margin.per_largest);
            let Limits { lo, hi } = self.x_limits;
            let mut near = margins(of_x, lo, hi).map(|margin| margin * per_x); // (16c)
            let square = match known.v_limits {
                Some(limits) => {
                    let (noise, square) = noise::<true>(known, outputs, of_y, limits, fit.v);
                    near = each(noise.map(|margin| margin * per_v), near, smaller); // (16d)
                    square
                }
                None => noise::<false>(known, outputs, of_y, self.x_limits, fit.v).1,
            };
            (near.iter().fold(true, |inside, margin| inside & (*margin > tol::ACTIVE_SET)), square)
        } else {
            (true, noise::<false>(known, outputs, of_y, self.x_limits, fit.v).1)
        };
        sum(of_x, means.unwrap_or(known.means), fit.states);
        let cost = self.depth.prior_weight * self.prior_size(prior, &mut s) + square; // (17)
        if !(inside & cost.is_finite() & self.within_reach(s.window)) {
            return None;
        }
        let judged = self.depth.kind.judged;
        Some([cost, if judged { self.value(prior, outputs, &mut s, (fit.v, cost)) } else { 0.0 }])
    }

    /// V.
    #[inline(always)]
    fn value(
        &self,
        prior: &[f64],
        outputs: &[f64],
        s: &mut Scratch<'_>,
        (v, cost): (&[f64], f64),
    ) -> f64 {
        let (missing, begun, means, x_bounds) = (false, true, &[][..], None);
        let (filtered, lacking) = (None, None);
        let data = Data { prior, outputs, missing, filtered, lacking, means, x_bounds, begun };
        let found = WindowSolution { status: Status::Optimal, cost, ..WindowSolution::default() };
        self.judge(&data, s, v, &found).value
    }
}
