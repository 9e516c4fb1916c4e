//! Families of motions that are fitted to a recording: where their fits begin, and what they are
//! told of each sample.

use crate::rigid::config::FEW_OUTPUTS;
use crate::rigid::recording::Recording;
use ddmhe_run::rigid::layout::unknowns;
use ddmhe_run::rigid::motion::{Family, Motion};
use ddmhe_run::rigid::{Body, LaggedBody, Start};

/// Prior deviation of a lag (s) that is to have no part in whether there is one.
const UNKNOWN: f64 = 1e3;

/// One of them.
pub(crate) trait Fitted<const P: usize, const N: usize>:
    Family<P, N, Known: Send + Sync> + Send + Sync + 'static
{
    /// Unknowns that an output has of its own.
    const OF_OUTPUT: usize;
    /// Whether a simulation by Euler's forward rule may have made the recording, too.
    const SIMULATED: bool;
    /// From which starts it is fitted: without a cubic part, and with one.
    const STARTS: [&'static [usize]; 2];
    /// How many numbers are known of a sample.
    #[cfg(feature = "serde")]
    const NUMBERS: usize;

    /// Whether its outputs may be found to lag.
    const SEEKS_LAG: bool = false;

    /// The same motion where outputs may lag, by the last unknown.
    type Lagging: Motion<P, N, Known = Self::Known>;

    /// A motion as one of that family, without a lag; None where none is looked for.
    fn lagging(_: &Start<Self, N>) -> Option<Start<Self::Lagging, N>> {
        None
    }

    /// Where its fit begins.
    fn start(
        recording: &Recording<P>,
        known: &[Self::Known],
        trial: usize,
        cubic: bool,
    ) -> Start<Self, N>;

    /// What a field says of a sample: B (3) and K (p x 3, by rows); both empty where none is known.
    fn known(B: &[f64], K: &[f64]) -> Self::Known;

    /// Its numbers: B, then K with all P rows.
    #[cfg(feature = "serde")]
    fn numbers(known: &Self::Known) -> Vec<f64>;
}

impl<const P: usize, const N: usize> Fitted<P, N> for Body<P, N> {
    const OF_OUTPUT: usize = unknowns(1) - unknowns(0);
    const SIMULATED: bool = true;
    const STARTS: [&'static [usize]; 2] = [&[0, 1, 2, 3, 4], &[0]];
    #[cfg(feature = "serde")]
    const NUMBERS: usize = 0;

    const SEEKS_LAG: bool = P <= FEW_OUTPUTS;

    type Lagging = LaggedBody<P, N>;

    fn lagging(of: &Start<Self, N>) -> Option<Start<LaggedBody<P, N>, N>> {
        let body = &of.motion;
        (!body.given.cubic && !body.is_simulated()).then(|| LaggedBody::start(of, UNKNOWN))
    }

    fn start(recording: &Recording<P>, _: &[()], trial: usize, cubic: bool) -> Start<Self, N> {
        recording.body(trial, cubic)
    }

    fn known(_: &[f64], _: &[f64]) {}

    #[cfg(feature = "serde")]
    fn numbers((): &()) -> Vec<f64> {
        Vec::new()
    }
}
