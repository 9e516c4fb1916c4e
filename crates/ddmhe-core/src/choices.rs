//! What a configuration leaves open, chosen: scales, rule, space and weight.

use crate::config::{Config, ProcessNoise, Weighting};
use crate::config_checks::validate;
use crate::defaults::{Defaults, stable};
use crate::error::Error;
use crate::history::History;
use crate::magnitude::{check_reach, check_rest, check_scales, check_sizes};
use crate::plan_builder::Draft;
use crate::scaling::Scaling;
use crate::space::{Penalty, Selection, Space};
use crate::tol;
use crate::weights::Weights;

/// What is made of a selection, with the weight of the default rule raised until errors do not
/// grow; `make` tells the spectral radius too.
pub(crate) fn guarded<T, E>(
    config: &Config,
    mut selection: Selection,
    make: impl Fn(Selection) -> Result<(f64, T), E>,
) -> Result<T, E> {
    let (mut radius, mut made) = make(selection)?;
    for _ in 0..tol::GUARD {
        let grows = config.space == Space::Auto && !stable(radius);
        let Some(heavier) = selection.heavier().filter(|_| grows) else { break };
        selection = heavier;
        (radius, made) = make(selection)?;
    }
    Ok(made)
}

/// Whether the recording may choose the scales too, see [`challenge`].
pub(crate) fn leaves_all_open(config: &Config) -> bool {
    config.horizon.is_none()
        && config.rho.is_none()
        && config.mu.is_none()
        && config.space == Space::Auto
        && config.weighting() == Weighting::Scaled
        && *config.disturbance_to_fit() == ProcessNoise::None
}

/// The scales and the rule of checked settings.
pub(crate) fn prepared(history: &History, config: &Config) -> Result<(Scaling, Defaults), Error> {
    validate(history, config)?;
    check_sizes(history)?;
    let scaling = Scaling::new(history)?;
    check_scales(&scaling)?;
    check_reach("x_prior", &scaling, config.x_prior.as_deref().unwrap_or(&[]), &[])?;
    let rest = config.rest();
    if let Some(rest) = rest {
        check_rest(&scaling, rest)?;
    }
    let rule = Defaults::new(history, &scaling, rest);
    Ok((scaling, rule))
}

/// The chosen space in normalised units.
pub(crate) fn select(space: &Space, rule: &Defaults, weights: &Weights, n: usize) -> Selection {
    match *space {
        Space::Auto => rule.selection(weights.mu()),
        Space::Exact => Selection { rank: None, tol: None, penalty: Penalty::None },
        Space::Truncated { rank: None, tol: None } => {
            Selection { rank: Some(n), tol: None, penalty: Penalty::None }
        }
        Space::Truncated { rank, tol } => Selection { rank, tol, penalty: Penalty::None },
        Space::Ridge { weight, normalised } => {
            let penalty = if normalised {
                Penalty::Normalised(weight)
            } else {
                Penalty::Alpha(weight / weights.unit)
            };
            Selection { rank: None, tol: None, penalty }
        }
    }
}

pub(crate) fn spectral_radius(problem: &Draft) -> f64 {
    // An eigenvalue iteration that fails (never seen on finite data) must not pass as stable.
    problem
        .prior_map
        .eigenvalues()
        .map_or(f64::NAN, |values| values.iter().map(|z| z.norm()).fold(0.0, f64::max))
}
