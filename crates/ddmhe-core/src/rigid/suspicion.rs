//! Whether outputs lag, asked of fits without a lag: what one would gain.
//!
//! > cost(z + d) ≈ cost(z) - ‖q‖² + ‖R d - q‖²
//!
//! At the optimum of a fit without a lag the q of all unknowns but the last, the lag, is 0: its
//! square is by how much the cost would fall (a score test, χ² of one degree of freedom where there
//! is none).

use crate::rigid::family::Fitted;
use ddmhe_run::rigid::pass::{Pass, Units};
use ddmhe_run::rigid::{Data, Start};

/// A gain that noise does not make: five deviations.
const GAIN: f64 = 25.0;

/// Whether a lag would gain much in a fit to the outputs before number `end`, each by itself; None
/// where no lag is looked for.
pub(crate) fn suspects<M: Fitted<P, N>, const P: usize, const N: usize>(
    fit: &Start<M, N>,
    data: &Data<'_, P, M::Known>,
    end: usize,
    units: &impl Units,
) -> Option<bool> {
    let Start { motion, z, firsts } = M::lagging(fit)?;
    let mut pass = Pass::at(&z, &firsts);
    pass.begin(&motion, &z, &firsts);
    units.run(
        #[inline(always)]
        || pass.advance(&motion, data, (end, usize::MAX), f64::INFINITY),
    );
    let q = pass.factor.q[N - 1];
    Some(pass.cost.is_finite() && q * q > GAIN)
}
