//! The window that a new run begins with.

use crate::config::Start;
use crate::history::History;
use crate::scaling::Scaling;
#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};

/// Outputs that are in the window before the first step: those at the end of the last recording, if
/// that is where it starts.
pub(crate) fn filled(history: &History, start: Start, horizon: usize) -> usize {
    let recorded = history.outputs(history.recordings() - 1).len() / history.p();
    let goes_on = matches!(start, Start::Recording | Start::Auto);
    if goes_on { recorded.min(horizon) } else { 0 }
}

/// The samples in the window of a run, as scaled deviations.
#[derive(Debug, Clone)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub(crate) struct Samples {
    /// ((filled+1)·n)
    pub states: Vec<f64>,
    /// (filled·p)
    pub outputs: Vec<f64>,
    /// (filled·m)
    pub inputs: Vec<f64>,
}

/// The window of a new run: the recording's end, the prior, or the recording's mean.
pub(crate) fn first_window(
    (history, scaling): (&History, &Scaling),
    start: Start,
    filled: usize,
    x_prior: Option<&[f64]>,
) -> Samples {
    let (n, p, last) = (history.n(), history.p(), history.recordings() - 1);
    let (x, y) = (history.states(last), history.outputs(last));
    let mut states = x[x.len() - (filled + 1) * n..].to_vec();
    match (start, x_prior) {
        (Start::State, Some(prior)) => states.copy_from_slice(prior),
        (Start::Unknown, _) => states.copy_from_slice(&scaling.mean_x),
        _ => {}
    }
    let outputs = &y[y.len() - filled * p..];
    let inputs = history.window_inputs(last, y.len() / p - filled, filled);
    Samples {
        states: states.chunks_exact(n).flat_map(|x| scaling.deviations(x, &[])).collect(),
        outputs: outputs.chunks_exact(p).flat_map(|y| scaling.deviations(&[], y)).collect(),
        inputs: scaling.input_deviations(inputs).collect(),
    }
}
