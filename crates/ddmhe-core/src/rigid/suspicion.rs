//! Whether outputs lag, asked of fits without a lag: what one would gain.
//!
//! > cost(z + d) ≈ cost(z) - ‖q‖² + ‖R d - q‖²
//!
//! At the optimum of a fit without a lag the q of all unknowns but the last, the lag, is 0: its
//! square is by how much the cost would fall (a score test, χ² of one degree of freedom where there
//! is none).

use crate::rigid::family::Fitted;
use ddmhe_run::rigid::pass::{Pass, Units};
use ddmhe_run::rigid::{Data, Start, Stepper};

/// A gain that noise does not make: five deviations.
const GAIN: f64 = 25.0;
/// A fit is asked that is of so many times as many later outputs as the last that was: in one step,
/// and in slices.
const AGAIN: (usize, usize) = (2, 4);

/// What has been asked so far.
#[derive(Debug, Clone)]
pub(crate) struct Suspicion<const P: usize, const N: usize> {
    /// A pass over the data of the fit that is asked.
    pass: Option<Pass<P, N>>,
    /// How many later outputs the fit was of that was asked last.
    pub asked: usize,
    /// How often the pass was advanced.
    pub calls: usize,
    /// Whether a lag would gain much.
    pub lags: bool,
}

impl<const P: usize, const N: usize> Suspicion<P, N> {
    /// Nothing yet.
    pub const NEW: Self = Suspicion { pass: None, asked: 0, calls: 0, lags: false };

    /// Asks the latest fit, if it is time: of so many of its samples in this step. The data are
    /// those of each output by itself. Where fits go on beside the filters it waits.
    pub fn ask<M: Fitted<P, N>>(
        &mut self,
        stepper: &Stepper<M, P, N>,
        data: &Data<'_, P, M::Known>,
        samples: usize,
        units: &impl Units,
    ) {
        let of = stepper.mixture.of;
        let again = if samples == usize::MAX { AGAIN.0 } else { AGAIN.1 };
        if stepper.work.is_some() || of == 0 || of < again * self.asked {
            (self.pass, self.calls) = (None, 0);
            return;
        }
        let found = stepper.leading().and_then(|leading| M::lagging(&leading.found.start()));
        let Some(Start { motion, z, firsts }) = found else { return };
        let pass = self.pass.get_or_insert_with(|| {
            let mut pass = Pass::at(&z, &firsts);
            pass.begin(&motion, &z, &firsts);
            pass
        });
        self.calls += 1;
        let end = data.y.len() + of;
        let ended = units.run(
            #[inline(always)]
            || pass.advance(&motion, data, (end, samples), f64::INFINITY),
        );
        if ended {
            let gain = pass.factor.q[N - 1] * pass.factor.q[N - 1];
            self.lags = pass.cost.is_finite() && gain > GAIN;
            (self.pass, self.calls, self.asked) = (None, 0, of);
        }
    }
}
