//! Whether recordings, weights and states are of magnitudes that can be computed with.

use crate::config::{Config, Weighting};
use crate::error::Error;
use crate::history::History;
use crate::scaling::Scaling;
use crate::space::Space;
use crate::tol;
use crate::variation::Rest;
use crate::weights::Weights;

/// One signal of a recording, time-major.
type Signal = fn(&History, usize) -> &[f64];

/// Numbers whose squares and quotients are numbers too; a channel of zeros alone is one that never
/// moved.
pub(crate) fn check_sizes(history: &History) -> Result<(), Error> {
    let (least, most) = tol::SIZES;
    let fits = |v: &f64| *v == 0.0 || (least..=most).contains(v);
    let signals: [(_, Signal, _); 3] = [
        ("x", History::states, history.n()),
        ("y", History::outputs, history.p()),
        ("u", History::inputs, history.m()),
    ];
    for (name, of, width) in signals.into_iter().filter(|(.., width)| *width > 0) {
        let mut largest = vec![0.0_f64; width];
        for row in (0..history.recordings()).flat_map(|k| of(history, k).chunks_exact(width)) {
            largest.iter_mut().zip(row).for_each(|(largest, v)| *largest = largest.max(v.abs()));
        }
        if let Some(i) = largest.iter().position(|v| !fits(v)) {
            let expected = format!(
                "{name}{} of magnitudes between {least:e} and {most:e} (in other units, if need \
                be)",
                i + 1
            );
            return Err(Error::value("history", expected, largest[i]));
        }
    }
    Ok(())
}

/// The same of deviations.
pub(crate) fn check_scales(scaling: &Scaling) -> Result<(), Error> {
    let (least, most) = tol::SIZES;
    for (name, s) in [("x", &scaling.s_x), ("y", &scaling.s_y)] {
        if let Some(&s) = s.iter().find(|s| !(least..=most).contains(*s)) {
            let expected =
                format!("{name} with standard deviations between {least:e} and {most:e}");
            return Err(Error::value("history", expected, s));
        }
    }
    Ok(())
}

/// Weights that leave something of both terms of (17).
pub(crate) fn check_weights(
    weights: &Weights,
    config: &Config,
    scaling: &Scaling,
) -> Result<(), Error> {
    let [(P, P_most), (R, R_most)] = weights.ranges();
    let fits = |least: f64, most: f64| least > 0.0 && most / least <= tol::WEIGHTS;
    let found = format!("weights between {:.1e} and {:.1e}", P.min(R), P_most.max(R_most));
    if fits(P.min(R), P_most.max(R_most)) {
        return Ok(());
    }
    if config.certificate.is_some() {
        let expected = format!("P and R that differ by at most {:e} in scaled units", tol::WEIGHTS);
        return Err(Error::value("certificate", expected, found));
    }
    let paper = config.weighting() == Weighting::Paper;
    let per_mu = scaling.s_y.iter().map(|s| if paper { s * s / weights.unit } else { 1.0 });
    let (low, high) =
        per_mu.fold((f64::INFINITY, 0.0_f64), |(low, high), w| (low.min(w), high.max(w)));
    let (least, most) = (P_most / tol::WEIGHTS / low, P * tol::WEIGHTS / high);
    match config.mu {
        Some(mu) if least <= most => Err(Error::value(
            "mu",
            format!("between {least:.1e} and {most:.1e} for this recording"),
            format!("{mu:e}"),
        )),
        _ => Err(Error::value("weights", "units less far apart, or \"scaled\"", found)),
    }
}

/// A weight on ‖α‖² that leaves something of the cost (17), and of which something is left beside
/// it.
pub(crate) fn check_ridge(weights: &Weights, config: &Config, lambda: f64) -> Result<(), Error> {
    let Space::Ridge { weight, .. } = config.space else { return Ok(()) };
    let [(P, P_most), (R, R_most)] = weights.ranges();
    let (least, most) = (P_most.max(R_most) / tol::WEIGHTS, P.min(R) * tol::WEIGHTS);
    if (least..=most).contains(&lambda) {
        return Ok(());
    }
    let per_weight = lambda / weight;
    let expected = format!(
        "a weight between {:.1e} and {:.1e} for these settings, or Exact or Truncated",
        least / per_weight,
        most / per_weight
    );
    Err(Error::value("space", expected, format!("{weight:e}")))
}

/// A known rest that is not beyond [`MEASURABLE`](tol::MEASURABLE), nor its inputs.
pub(crate) fn check_rest(scaling: &Scaling, Rest { x, y, u }: Rest<'_>) -> Result<(), Error> {
    check_reach("equilibrium", scaling, x, y)?;
    within_reach("equilibrium", scaling.input_deviations(u), |k| u[k])
}

/// A state or an output (either may be empty) that is not beyond [`MEASURABLE`](tol::MEASURABLE).
pub(crate) fn check_reach(
    argument: &'static str,
    scaling: &Scaling,
    x: &[f64],
    y: &[f64],
) -> Result<(), Error> {
    let number = |k: usize| if k < x.len() { x[k] } else { y[k - x.len()] };
    within_reach(argument, scaling.deviations(x, y), number)
}

/// The first number whose deviation is beyond reach is named.
fn within_reach(
    argument: &'static str,
    mut deviations: impl Iterator<Item = f64>,
    number: impl Fn(usize) -> f64,
) -> Result<(), Error> {
    match deviations.position(|v| !(v.abs() <= tol::MEASURABLE)) {
        None => Ok(()),
        Some(k) => {
            let expected = format!(
                "at most {:.1e} standard deviations of the recording from its mean",
                tol::MEASURABLE
            );
            Err(Error::value(argument, expected, number(k)))
        }
    }
}
