//! What a step does where the methods of this crate are not certain.

use crate::active_set::problem::{Erased, LeastDistance, Outcome, Windows};
use crate::active_set::working_set::WorkingSet;
use crate::problem::{Data, Fit, Scratch, WindowSolution};
use crate::status::Status;

/// Another way to an answer. A ground station has solvers and memory for it; in flight there is
/// [`Alone`].
pub trait Fallback {
    /// Runs `f`, which is inlined, compiled for the vector units of this machine if there is a way.
    #[inline(always)]
    fn vectorised<R>(&self, f: impl FnOnce() -> R) -> R {
        f()
    }

    /// Into z and its window w, where the active-set method is not certain: the answer, or z* with
    /// its window if there is none; with the changes that it took.
    fn decide(&self, problem: &Erased<'_>, z: &mut [f64], w: &mut [f64]) -> (Status, u32);

    /// The same where the cost leaves directions to the least norm and bounds are active.
    fn two_stages(
        &self,
        problem: &Erased<'_>,
        room: (&mut WorkingSet<'_>, &mut [f64]),
        z: &mut [f64],
        w: &mut [f64],
    ) -> (Status, u32);

    /// The window where too little is left of the cost without the missing outputs, by a problem
    /// made for what was measured; None where that is not to be had.
    fn anew(
        &self,
        data: &Data<'_>,
        room: (&mut WorkingSet<'_>, &mut Scratch<'_>),
        fit: Fit<'_>,
    ) -> Option<WindowSolution>;
}

/// No other way: what is not certain is [`Status::Failed`].
#[derive(Debug, Clone, Copy, Default)]
pub struct Alone;

impl Fallback for Alone {
    fn decide(&self, problem: &Erased<'_>, z: &mut [f64], w: &mut [f64]) -> (Status, u32) {
        let r = problem.rows.r;
        z[..r].copy_from_slice(&problem.unconstrained[..r]);
        problem.windows.window(&z[..r], w);
        (Status::Failed, 0)
    }

    fn two_stages(
        &self,
        problem: &Erased<'_>,
        _: (&mut WorkingSet<'_>, &mut [f64]),
        z: &mut [f64],
        w: &mut [f64],
    ) -> (Status, u32) {
        self.decide(problem, z, w)
    }

    fn anew(
        &self,
        _: &Data<'_>,
        _: (&mut WorkingSet<'_>, &mut Scratch<'_>),
        _: Fit<'_>,
    ) -> Option<WindowSolution> {
        None
    }
}

/// The dual active-set method and, where that is not certain, the fallback.
#[inline(always)]
pub fn decide<W: Windows>(
    problem: &LeastDistance<'_, W>,
    fallback: &impl Fallback,
    (working, work): (&mut WorkingSet<'_>, &mut [f64]),
    z: &mut [f64],
    w: &mut [f64],
) -> (Status, u32) {
    if problem.prices.is_some() {
        return decide_erased(&problem.erased(), fallback, (working, work), z, w);
    }
    match problem.solve(working, work, z, w) {
        Outcome::Optimal(changes) => (Status::Optimal, changes),
        outcome => without_minimiser(outcome, &problem.erased(), fallback, z, w),
    }
}

/// The same of any problem. Bounds that may be left are hard first: the answer is that of both
/// where no multiplier is above its price.
#[cold]
pub fn decide_erased(
    problem: &Erased<'_>,
    fallback: &impl Fallback,
    (working, work): (&mut WorkingSet<'_>, &mut [f64]),
    z: &mut [f64],
    w: &mut [f64],
) -> (Status, u32) {
    let (mut outcome, mut before) = (problem.solve_erased(working, work, z, w), 0);
    if problem.prices.is_some() {
        if let Outcome::Optimal(changes) = outcome {
            if problem.below_prices(working, work) {
                return (Status::Optimal, changes);
            }
            before = changes;
        }
        working.clear(); // which rows are left is found anew at each step
        outcome = problem.priced(working, work, z, w);
    }
    match outcome {
        Outcome::Optimal(changes) => (Status::Optimal, before + changes),
        Outcome::Infeasible(changes) => {
            without_minimiser(Outcome::Infeasible(before + changes), problem, fallback, z, w)
        }
        outcome => without_minimiser(outcome, problem, fallback, z, w),
    }
}

/// The window of z* where no window is within the bounds; the fallback's where nothing is certain.
#[cold]
fn without_minimiser(
    outcome: Outcome,
    problem: &Erased<'_>,
    fallback: &impl Fallback,
    z: &mut [f64],
    w: &mut [f64],
) -> (Status, u32) {
    let Outcome::Infeasible(changes) = outcome else { return fallback.decide(problem, z, w) };
    problem.windows.window(&problem.unconstrained[..problem.rows.r], w);
    (Status::Infeasible, changes)
}
