//! A body seen by sensors that lag: where its fits begin, and when it is believed.

use crate::error::Error;
use crate::history::History;
use crate::rigid::choice::Choice;
use crate::rigid::config::RigidConfig;
use crate::rigid::family::Fitted;
use crate::rigid::ground::Ground;
use crate::rigid::recording::Recording;
use ddmhe_run::rigid::motion::{Family, Motion};
use ddmhe_run::rigid::{Body, LaggedBody, Start};

/// Prior standard deviation of a lag: the body turns by so much meanwhile (rad), and it is at most
/// that share of the recording.
const SPREAD: (f64, f64) = (0.2, 0.1);

impl<const P: usize, const N: usize> Fitted<P, N> for LaggedBody<P, N> {
    const OF_OUTPUT: usize = <Body<P, N> as Fitted<P, N>>::OF_OUTPUT;
    const SIMULATED: bool = false;
    const STARTS: [&'static [usize]; 2] = [<Body<P, N> as Fitted<P, N>>::STARTS[0], &[]];
    #[cfg(feature = "serde")]
    const NUMBERS: usize = 0;

    type Lagging = Self;

    fn start(recording: &Recording<P>, _: &[()], trial: usize, _: bool) -> Start<Self, N> {
        let whole = recording.steps().dt * recording.y.len() as f64;
        let spread = (SPREAD.0 / recording.W).min(SPREAD.1 * whole);
        LaggedBody::start(&recording.body(trial, false), spread)
    }

    fn known(_: &[f64], _: &[f64]) {}

    #[cfg(feature = "serde")]
    fn numbers((): &()) -> Vec<f64> {
        Vec::new()
    }
}

impl<const P: usize, const N: usize> Ground<LaggedBody<P, N>, P, N> {
    /// Of a body whose outputs lag, if that explains the recording.
    pub fn lagging(history: &History, config: &RigidConfig) -> Result<Option<Self>, Error> {
        let mut recording = Recording::<P>::new(history, config)?;
        recording.lose_beginnings();
        let known = <LaggedBody<P, N> as Motion<P, N>>::EVERYWHERE;
        let credible = |choice: &Choice<LaggedBody<P, N>, N>| {
            choice.optima[0].is_some_and(|best| best.motion.is_credible(&best.z, &best.P))
        };
        let choice = Choice::explaining(&recording, known).ok().filter(credible);
        Ok(choice.map(|choice| Self::on((recording, Vec::new()), choice, config)))
    }
}
