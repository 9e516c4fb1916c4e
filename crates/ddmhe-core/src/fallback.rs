//! What a step has on the ground and not in flight: see [`ddmhe_run::fallback`].

use crate::design::Design;
use crate::extended::way_out_priced;
use crate::plan_builder::Prepared;
use crate::way_out::way_out;
use crate::weights::Weights;
use ddmhe_run::Status;
use ddmhe_run::active_set::{Erased, WorkingSet};
use ddmhe_run::fallback::{self, Fallback};
use ddmhe_run::problem::{Data, Fit, Scratch, WindowSolution};

/// What a step on the ground has beside the methods of [`ddmhe_run`].
pub(crate) struct Fallbacks<'a> {
    pub design: &'a Design,
    pub weights: &'a Weights, // that the problem was made with
    pub prepared: &'a Prepared,
}

/// For a machine without vector units of the newer kinds: once in the program, not in every caller.
#[cold]
#[inline(never)]
fn apart<R>(f: impl FnOnce() -> R) -> R {
    f()
}

impl Fallback for Fallbacks<'_> {
    #[inline(always)]
    fn vectorised<R>(&self, f: impl FnOnce() -> R) -> R {
        match self.design.units {
            pulp::Arch::Scalar => apart(f),
            units => units.dispatch(f),
        }
    }

    fn decide(&self, problem: &Erased<'_>, z: &mut [f64], w: &mut [f64]) -> (Status, u32) {
        match problem.prices {
            None => way_out(problem, z, w),
            Some(_) => way_out_priced(problem, z, w),
        }
    }

    fn two_stages(
        &self,
        problem: &Erased<'_>,
        room: (&mut WorkingSet<'_>, &mut [f64]),
        z: &mut [f64],
        w: &mut [f64],
    ) -> (Status, u32) {
        match &self.prepared.surplus {
            Some(surplus) => surplus.solve(problem, self, room, z, w),
            None => fallback::decide_erased(problem, self, room, z, w),
        }
    }

    #[cold]
    fn anew(
        &self,
        data: &Data<'_>,
        room: (&mut WorkingSet<'_>, &mut Scratch<'_>),
        mut fit: Fit<'_>,
    ) -> Option<WindowSolution> {
        let lacking = data.lacking.and_then(|lost| self.weights.lacking(lost));
        let weights = lacking.as_ref().unwrap_or(self.weights);
        let made = self.design.without_missing(self.prepared, weights, data.outputs).ok()?;
        let fallback = Fallbacks { prepared: &made, weights, ..*self };
        let data = &Data { lacking: None, ..*data };
        made.problem().solve_vectorised(&fallback, data, room, &mut fit)
    }
}
