//! The checks of every setting alone, and of samples.

use crate::check::check_vector;
use crate::config::{
    Bounds, Center, Config, Equilibrium, Gate, ProcessNoise, Start, Stuck, Weighting,
};
use crate::covariance::check_covariance;
use crate::error::Error;
use crate::history::History;
use crate::space::Space;
use crate::tol;

impl Config {
    /// Every setting alone, for the sizes of a recording; [`DdMhe::new`](crate::DdMhe::new) begins
    /// with it.
    ///
    /// # Errors
    /// [`Error::Shape`], [`Error::NotFinite`] or [`Error::Value`] naming the setting.
    pub fn check(&self, history: &History) -> Result<(), Error> {
        validate(history, self)
    }
}

/// Every setting alone, before anything is computed.
pub(crate) fn validate(history: &History, config: &Config) -> Result<(), Error> {
    let (n, p) = (history.n(), history.p());
    check_weights(config, n, p, history.m())?;
    if config.horizon == Some(0) {
        return Err(Error::value("horizon", "at least 1", 0));
    }
    check_space(config.space)?;
    if let Some(x) = &config.x_prior {
        check_vector("x_prior", x, n)?;
        check_start(config.start)?;
    }
    check_beside(config, config.start)?;
    if let Some(bounds) = &config.x_bounds {
        check_box("x_bounds", bounds, &[n])?;
    }
    if let Some(bounds) = &config.v_bounds {
        check_box("v_bounds", bounds, &[p])?;
    }
    check_process_noise(config, n)?;
    check_evidence(config, n, p)?;
    if let Some(soft) = config.soft {
        soft.check(config.bounded())?;
    }
    if let Some(Equilibrium { x, y, u }) = &config.equilibrium {
        check_vector("equilibrium", x, n)?;
        check_vector("equilibrium", y, p)?;
        check_vector("equilibrium", u, history.m())?;
    }
    Ok(())
}

/// ρ and μ, or a certificate in their place.
fn check_weights(config: &Config, n: usize, p: usize, m: usize) -> Result<(), Error> {
    match config.rho {
        Some(rho) if !(rho > 0.0 && rho < 1.0) => {
            return Err(Error::value("rho", "a number in (0, 1)", rho));
        }
        _ => {}
    }
    match config.mu {
        Some(mu) if !(mu > 0.0 && mu.is_finite()) => {
            return Err(Error::value("mu", "a positive finite number", mu));
        }
        _ => {}
    }
    if let Some(certificate) = &config.certificate {
        certificate.check(n, p, m)?;
        check_beside_certificate(config)?;
    }
    if let Some(disturbance) = &config.disturbance {
        disturbance.check()?;
        if config.certificate.is_none() {
            return Err(Error::value("disturbance", "a certificate beside it", "none"));
        }
    }
    Ok(())
}

/// What only evidence uses.
fn check_evidence(config: &Config, n: usize, p: usize) -> Result<(), Error> {
    if let Some(noise) = &config.output_noise {
        if noise.len() != 1 {
            check_vector("output_noise", noise, p)?;
        }
        if let Some(bad) = noise.iter().find(|sd| !(**sd >= 0.0 && sd.is_finite())) {
            let expected = "standard deviations, finite and not negative";
            return Err(Error::value("output_noise", expected, bad));
        }
    }
    check_gate(config)?;
    if let Some(drift) = &config.drift {
        check_covariance("drift", drift, n)?;
    }
    for (name, asked) in [
        ("output_noise", config.output_noise.is_some()),
        ("drift", config.drift.is_some()),
        ("gate", config.gate != Gate::None),
        ("stuck", config.stuck != Stuck::Tell),
    ] {
        if asked && !config.evidence {
            return Err(Error::value(name, "none without evidence", "some"));
        }
    }
    Ok(())
}

/// From how many deviations on outputs are rejected.
fn check_gate(config: &Config) -> Result<(), Error> {
    if let Gate::At(k) = config.gate
        && !(k > 1.0 && k.is_finite())
    {
        return Err(Error::value("gate", "a number of deviations above 1", k));
    }
    if config.gate != Gate::None && config.disturbance.is_some() {
        let expected = "none beside disturbance, whose error bound ends where a run starts again";
        return Err(Error::value("gate", expected, "some"));
    }
    Ok(())
}

/// A disturbance, its box, and what does not go with it.
fn check_process_noise(config: &Config, n: usize) -> Result<(), Error> {
    let recorded = config.weighting() == Weighting::Recorded;
    if recorded {
        check_beside_recorded(config)?;
    }
    let none = *config.disturbance_to_fit() == ProcessNoise::None;
    if none && recorded {
        let expected = "a disturbance beside weights = \"recorded\"";
        return Err(Error::value("process_noise", expected, "none"));
    }
    if let ProcessNoise::Given(Q) = &config.process_noise {
        check_covariance("process_noise", Q, n)?;
    }
    if let Some(bounds) = &config.w_bounds {
        if none {
            return Err(Error::value("w_bounds", "none without process_noise", "some"));
        }
        check_box("w_bounds", bounds, &[n])?;
    }
    if !none && config.certificate.is_some() {
        let expected = "none beside a certificate, which holds for undisturbed windows";
        return Err(Error::value("process_noise", expected, "a disturbance"));
    }
    Ok(())
}

/// The weights of the recording leave none of these open.
fn check_beside_recorded(config: &Config) -> Result<(), Error> {
    let expected = |what: &str| format!("{what} beside weights = \"recorded\"");
    for (name, value) in [("rho", config.rho), ("mu", config.mu)] {
        if let Some(value) = value {
            return Err(Error::value(name, expected("none"), value));
        }
    }
    if config.space != Space::Auto {
        let found = "another";
        return Err(Error::value(
            "space",
            expected("\"auto\", windows of the linear model,"),
            found,
        ));
    }
    if config.equilibrium.is_some() {
        return Err(Error::value("equilibrium", expected("none"), "one"));
    }
    if config.x_center != Center::Absolute {
        return Err(Error::value("x_center", expected("none"), "\"history\""));
    }
    Ok(())
}

/// A certificate holds the weights, in the user's units.
fn check_beside_certificate(config: &Config) -> Result<(), Error> {
    for (name, value) in [("rho", config.rho), ("mu", config.mu)] {
        if let Some(value) = value {
            let expected = "none beside a certificate, which holds the weights";
            return Err(Error::value(name, expected, value));
        }
    }
    if matches!(config.weights, Weighting::Scaled | Weighting::Recorded) {
        let expected = "\"paper\" or \"auto\" beside a certificate, whose units are the user's";
        return Err(Error::value("weights", expected, config.weights));
    }
    Ok(())
}

fn check_space(space: Space) -> Result<(), Error> {
    match space {
        Space::Truncated { rank: Some(0), .. } => {
            Err(Error::value("space", "Truncated with rank at least 1", 0))
        }
        Space::Truncated { tol: Some(tol), .. } if !(0.0..1.0).contains(&tol) => {
            Err(Error::value("space", "Truncated with tol in [0, 1)", tol))
        }
        Space::Ridge { weight, .. } if !(weight > 0.0 && weight.is_finite()) => {
            Err(Error::value("space", "Ridge with a positive finite weight", weight))
        }
        _ => Ok(()),
    }
}

/// A state to start from belongs to one start alone.
pub(crate) fn check_start(start: Start) -> Result<(), Error> {
    match start {
        Start::State | Start::Auto => Ok(()),
        other => Err(Error::value(
            "start",
            "\"state\" beside x_prior, which is the state it starts from",
            other,
        )),
    }
}

/// An error bound begins with one on x̄(0), which an unknown start has not.
pub(crate) fn check_beside(config: &Config, start: Start) -> Result<(), Error> {
    match start {
        Start::Unknown if config.disturbance.is_some() => {
            let expected = "\"state\" or \"recording\" beside disturbance, which bounds the \
            error of a known start";
            Err(Error::value("start", expected, start))
        }
        _ => Ok(()),
    }
}

/// Sizes, no NaN, lo ≤ hi, and neither side beyond reach.
pub(crate) fn check_box(
    argument: &'static str,
    bounds: &Bounds,
    lengths: &[usize],
) -> Result<(), Error> {
    for side in [&bounds.lo, &bounds.hi] {
        if !lengths.contains(&side.len()) || side.len() != bounds.lo.len() {
            let allowed: Vec<String> = lengths.iter().map(ToString::to_string).collect();
            return Err(Error::shape(
                argument,
                format!("{} numbers in lo and in hi", allowed.join(" or ")),
                side.len(),
            ));
        }
    }
    for (i, (&lo, &hi)) in bounds.lo.iter().zip(&bounds.hi).enumerate() {
        let crossed = !(lo <= hi) || lo > tol::BOUND || hi < -tol::BOUND;
        if crossed {
            return Err(Error::value(
                argument,
                "lo <= hi in every entry",
                format!("lo = {lo}, hi = {hi} in entry {i}"),
            ));
        }
    }
    Ok(())
}

pub(crate) fn check_output(y: &[f64], p: usize) -> Result<(), Error> {
    if y.len() != p {
        return Err(Error::shape("y", format!("{p} numbers"), y.len()));
    }
    check_measured("y", y, p)
}

/// NaN means "not measured"; infinity is an error.
pub(crate) fn check_measured(argument: &'static str, y: &[f64], p: usize) -> Result<(), Error> {
    // all of them without a branch: a log is long, and seldom wrong
    let any = y.iter().fold(false, |any, v| any | v.is_infinite());
    match any.then(|| y.iter().position(|v| v.is_infinite())).flatten() {
        None => Ok(()),
        Some(k) => Err(Error::NotFinite { argument, row: k / p, column: k % p, value: y[k] }),
    }
}
