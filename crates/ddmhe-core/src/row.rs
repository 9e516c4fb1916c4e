//! Steps of a run in a row, of which nothing but x̂ and the cost is asked for.

use crate::design::Design;
use crate::run::Run;
use ddmhe_run::Status;
use ddmhe_run::alone::Row;

impl Run {
    /// As many steps as [`advance_alone`](Self::advance_alone) would make in a row, as far as they
    /// can be made in one go: how many. x̂ (n) and cost of each go into `out`, what they share is
    /// that of the newest.
    pub fn advance_row(
        &mut self,
        design: &Design,
        (y, u): (&[f64], &[f64]),
        out: Row<'_>,
    ) -> usize {
        let horizon = design.settings.horizon;
        let growing = self.memory.grows(horizon);
        if growing || self.estimate.x.is_empty() || self.memory.len() < horizon {
            return 0;
        }
        let problem = design.problem(horizon).problem();
        if problem.shared.sizes.judged() || !problem.depth.kind.filtered {
            return 0;
        }
        let Row { x, cost } = out;
        let (memory, row) = (&mut self.memory, Row { x: &mut *x, cost: &mut *cost });
        let made = design.units.dispatch(
            #[inline(always)]
            || memory.filter_row(&problem.shared, (y, u), row),
        );
        let p = design.history.p();
        for (k, y) in y.chunks_exact(p).take(made).enumerate() {
            self.t += 1;
            design.watch.note(&mut self.seen, y, self.t);
            if design.history.m() > 0 {
                let u = self.memory.inputs_before(made - 1 - k);
                design.input_watch.note(&mut self.seen_inputs, u, self.t);
            }
        }
        if let Some(last) = made.checked_sub(1) {
            let n = self.estimate.x.len();
            self.estimate.x.copy_from_slice(&x[last * n..made * n]);
            (self.estimate.cost, self.estimate.status) = (cost[last], Status::Optimal);
            (self.estimate.active, self.estimate.iterations) = (0, 0);
        }
        made
    }
}
