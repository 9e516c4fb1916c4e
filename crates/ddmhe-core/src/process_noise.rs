//! The disturbance that a configuration asks for: see [`driving`](crate::driving).

use crate::config::{Config, ProcessNoise, Weighting};
use crate::driving::{Driving, diagonal};
use crate::error::Error;
use crate::history::History;
use crate::linear_model::LinearModel;
use crate::recorded_noise::{RecordedNoise, SHARE};
use crate::scaling::{EXACT, Scaling};
use faer::Mat;

/// Blocks in a window of the horizon, where the weights are not the recording's.
const BLOCKS: usize = 4;

/// What a configuration asks for; None for no disturbance.
///
/// # Errors
/// [`Error::Value`] for a recording that shows none.
pub(crate) fn driving(
    history: &History,
    scaling: &Scaling,
    config: &Config,
    horizon: usize,
) -> Result<Option<Driving>, Error> {
    let recorded = config.weighting() == Weighting::Recorded;
    let wanted = config.disturbance_to_fit();
    if *wanted == ProcessNoise::None {
        return Ok(None);
    }
    if let ProcessNoise::Recorded | ProcessNoise::Residual = wanted {
        check_shown(scaling, &config.process_noise)?;
    }
    let mut model = LinearModel::new(history, scaling);
    let none = Mat::zeros(history.n(), history.n());
    let (Q, R, N) = match wanted {
        ProcessNoise::Recorded => {
            let mut noise = RecordedNoise::new(history, scaling, &model);
            let large = noise.share_of_states(history, scaling) > SHARE;
            if recorded && large && history.m() == 0 {
                model = model.of_windows(history, scaling);
                noise = RecordedNoise::new(history, scaling, &model);
            }
            (noise.Q, noise.R, noise.N)
        }
        ProcessNoise::Given(Q) => (scaled(Q, &scaling.s_x), diagonal(&model.of_outputs()), none),
        _ => (model.of_states(), diagonal(&model.of_outputs()), none),
    };
    if recorded {
        let driving = Driving::of_recording(scaling, model, (Q, R))?;
        return Ok(Some(driving.with_readings(N)));
    }
    Driving::of(scaling, model, (Q, R), (horizon / BLOCKS).max(1)).map(Some)
}

/// States that an affine step predicts exactly show no disturbance.
fn check_shown(scaling: &Scaling, asked: &ProcessNoise) -> Result<(), Error> {
    let [left, _] = scaling.misfit(&scaling.one_step);
    if left >= EXACT {
        return Ok(());
    }
    let found = match asked {
        ProcessNoise::Residual => "\"residual\"",
        _ => "\"recorded\"",
    };
    let expected = "a covariance, or none, for a recording whose states show no disturbance";
    Err(Error::value("process_noise", expected, found))
}

/// A covariance in the user's units (n·n, by rows) in those of the scales.
fn scaled(Q: &[f64], s: &[f64]) -> Mat<f64> {
    let n = s.len();
    Mat::from_fn(n, n, |i, j| 0.5 * (Q[i * n + j] + Q[j * n + i]) / (s[i] * s[j]))
}
