//! Depths of the windows that a run grows through.

use crate::config::{Config, Weighting};
use crate::plan_builder::Prepared;
use ddmhe_run::plan::kept_depths;

/// Depths of the windows of a run that begins with so many outputs, the horizon first: every one
/// where the weights are stated in the user's units or by a certificate, Algorithm 1 as printed;
/// otherwise few of them.
pub(crate) fn depths(config: &Config, horizon: usize, filled: usize) -> Vec<usize> {
    let mut depths: Vec<usize> = kept_depths(horizon, keeps_every_depth(config)).collect();
    // with outputs in the window before the first step, shorter ones are never reached
    let longer = depths.iter().filter(|depth| **depth > filled + 1).count();
    depths.truncate(longer + 1);
    depths
}

/// Whether windows grow through every depth.
pub(crate) fn keeps_every_depth(config: &Config) -> bool {
    config.certificate.is_some() || config.weighting() == Weighting::Paper
}

/// For each number of outputs up to the horizon, which problem is the deepest that they fill.
pub(crate) fn places(problems: &[Prepared], horizon: usize) -> Vec<usize> {
    let deep = |outputs: usize| {
        problems.partition_point(|problem| problem.layout().depth <= outputs).saturating_sub(1)
    };
    (0..=horizon).map(deep).collect()
}
