//! The linear parts of a system with its bounds, and an observer's gain: checked once.

use crate::check::{check_finite, check_vector};
use crate::error::Error;
use crate::interval::Interval;

/// The linear parts of (13), the bounds (14) and (17). Matrices are row-major.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct System {
    /// (n·n)
    pub A: Vec<f64>,
    /// (n·inputs), empty without input.
    pub B: Vec<f64>,
    /// (p·n)
    pub C: Vec<f64>,
    /// Offset r of the output (p); empty is zero.
    pub r: Vec<f64>,
    /// (n·w_radius.len())
    pub D1: Vec<f64>,
    /// (p·v_radius.len())
    pub D2: Vec<f64>,
    /// J̲ and J̄ (n·n): global bounds on Df; infinite = none.
    pub j_lo: Vec<f64>,
    /// See `j_lo`.
    pub j_hi: Vec<f64>,
    /// w̄ ≥ 0
    pub w_radius: Vec<f64>,
    /// v̄ ≥ 0
    pub v_radius: Vec<f64>,
}

/// A verified design: L and what (41), (23) give.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Gain {
    /// L (n·p)
    pub L: Vec<f64>,
    /// P (n·n), symmetric positive definite
    pub P: Vec<f64>,
    /// λ in (0, 1)
    pub lambda: f64,
    /// γ of (41); infinite if none is known: then there is neither ball nor ellipsoid, only
    /// zonotope and box.
    pub gamma: f64,
    /// μ_w of (23)
    pub mu_w: f64,
    /// μ_v of (23)
    pub mu_v: f64,
    /// Weights s of the states in the ball ‖diag(s) e‖₂ ≤ φ (n), positive; empty is ones, as in
    /// (23).
    pub weights: Vec<f64>,
}

/// Both, checked and with their defaults filled in.
pub(super) fn checked(
    system: System,
    gain: Gain,
    x0_center: &[f64],
    x0_radius: &[f64],
) -> Result<(System, Gain), Error> {
    let n = x0_center.len();
    let mut system = system;
    if system.C.is_empty() || !system.C.len().is_multiple_of(n) {
        return Err(Error::shape(
            "C",
            format!("rows of {n} numbers"),
            format!("{} numbers", system.C.len()),
        ));
    }
    let p = system.C.len() / n;
    if system.r.is_empty() {
        system.r = vec![0.0; p];
    }
    if !system.B.len().is_multiple_of(n) {
        return Err(Error::shape("B", format!("{n} rows"), format!("{} numbers", system.B.len())));
    }
    let (nw, nv) = (system.w_radius.len(), system.v_radius.len());
    check_vector("A", &system.A, n * n)?;
    check_finite("B", &system.B, 1)?;
    check_finite("C", &system.C, n)?;
    check_vector("r", &system.r, p)?;
    check_vector("D1", &system.D1, n * nw)?;
    check_vector("D2", &system.D2, p * nv)?;
    check_vector("gain", &gain.L, n * p)?;
    check_vector("P", &gain.P, n * n)?;
    check_vector("x0_center", x0_center, n)?;
    for (name, radius, length) in [
        ("w_radius", &system.w_radius[..], nw),
        ("v_radius", &system.v_radius, nv),
        ("x0_radius", x0_radius, n),
    ] {
        check_radius(name, radius, length)?;
    }
    check_jacobian(&system, n)?;
    Ok((system, checked_gain(gain, n)?))
}

fn check_radius(name: &'static str, radius: &[f64], length: usize) -> Result<(), Error> {
    check_vector(name, radius, length)?;
    match radius.iter().find(|r| **r < 0.0) {
        None => Ok(()),
        Some(r) => Err(Error::value(name, "radii of at least 0", r)),
    }
}

/// Bounds of the Jacobian (n × n each).
fn check_jacobian(System { j_lo, j_hi, .. }: &System, n: usize) -> Result<(), Error> {
    for (name, j) in [("j_lo", j_lo), ("j_hi", j_hi)] {
        if j.len() != n * n {
            return Err(Error::shape(name, format!("{} numbers", n * n), j.len()));
        }
    }
    if let Some(k) = (0..n * n).find(|&k| Interval::new(j_lo[k], j_hi[k]).is_none()) {
        let found = format!("{} and {} in row {}, column {}", j_lo[k], j_hi[k], k / n, k % n);
        return Err(Error::value("j_lo", "numbers not above those of j_hi", found));
    }
    Ok(())
}

/// Its scalars and weights, 1 each by default.
fn checked_gain(mut gain: Gain, n: usize) -> Result<Gain, Error> {
    if !(gain.lambda > 0.0 && gain.lambda < 1.0) {
        return Err(Error::value("lambda", "a number in (0, 1)", gain.lambda));
    }
    for (name, mu) in [("gamma", gain.gamma), ("mu_w", gain.mu_w), ("mu_v", gain.mu_v)] {
        if !(mu >= 0.0) {
            return Err(Error::value(name, "a number of at least 0", mu));
        }
    }
    if gain.weights.is_empty() {
        gain.weights = vec![1.0; n];
    }
    check_vector("weights", &gain.weights, n)?;
    if let Some(s) = gain.weights.iter().find(|s| !(**s > 0.0)) {
        return Err(Error::value("weights", "positive numbers", s));
    }
    Ok(gain)
}
