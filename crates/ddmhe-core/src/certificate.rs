//! Stability certificates: weights for which the estimation error is known to shrink.
//!
//! # Derivation
//! For two trajectories of x(t+1) = A x + e + w, y = C x + r + v, one of them (the estimate)
//! without w, the difference d = x̂ - x obeys d⁺ = A d - w. Matrices P, Q, R and η < 1 with
//!
//! > \[\[AᵀPA - ηP - CᵀRC, AᵀP\], \[PA, P - Q\]\] ⪯ 0
//!
//! make ‖d‖²_P an incremental input/output-to-state Lyapunov function with exponential discount
//! (Schiller, Muntwiler, Köhler, Zeilinger, Müller 2023):
//!
//! > ‖d⁺‖²_P ≤ η‖d‖²_P + ‖w‖²_Q + ‖C d‖²_R.    (L)
//!
//! With prior weight 2η^M P and noise weights η^{j-1} R in the place of (17)'s scalars the error
//! contracts when 4η^M < 1. The scalar weights of (17) are the case P = I, R = μI, η = ρ, Q = 3I:
//! (24) implies (L) for them. `error_bound` walks (L) along the estimated windows.

use crate::check::{check_finite, check_vector};
use crate::error::Error;
use crate::tol;
use faer::{Mat, Side};
#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};

/// P, Q, R and η that satisfy (L) for a system, all in the user's units. Matrices are row-major.
///
/// Whether they do is for the designer to verify: the estimator does not know (A, C).
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(deny_unknown_fields))]
pub struct Certificate {
    /// Symmetric positive definite (n·n), cost per unit of x².
    pub P: Vec<f64>,
    /// Symmetric positive definite (n·n), Q ⪰ P.
    pub Q: Vec<f64>,
    /// Symmetric positive definite (p·p), cost per unit of y².
    pub R: Vec<f64>,
    /// Discount η in (0, 1) per sample.
    pub eta: f64,
    /// Largest ‖A d‖_P / ‖d‖_P, if known: carries an error bound over samples that were not
    /// measured.
    pub growth: Option<f64>,
    /// The model behind the certificate, if known: windows that are not its trajectories are then
    /// accounted for.
    pub model: Option<Model>,
}

/// x(t+1) = A x + B u + e, y = C x + D u + r, and how far the true system may be from it.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(deny_unknown_fields))]
pub struct Model {
    /// (n·n)
    pub A: Vec<f64>,
    /// (n); empty with r: both are taken from the recording, if that is a trajectory of (A, C).
    pub e: Vec<f64>,
    /// (p·n)
    pub C: Vec<f64>,
    /// (n·m); empty for a system without inputs.
    pub B: Vec<f64>,
    /// (p·m); empty with B.
    pub D: Vec<f64>,
    /// (p), or empty with e.
    pub r: Vec<f64>,
    /// Whether it was fitted to a noisy recording whose noise is not known: how far the true system
    /// is from it, nobody knows then.
    pub identified: bool,
    /// For the true system, ‖ΔA x + ΔB u + Δe‖_Q ≤ `w`·q and ‖ΔC x + ΔD u + Δr‖_R ≤ `v`·q with q² =
    /// \[x; u; 1\]ᵀ metric \[x; u; 1\].
    pub uncertainty: Option<Uncertainty>,
}

/// The distance between the model and the true system, see [`Model::uncertainty`].
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(deny_unknown_fields))]
pub struct Uncertainty {
    /// Symmetric positive semidefinite ((n+m+1)·(n+m+1)).
    pub metric: Vec<f64>,
    /// Factor of the states' equation.
    pub w: f64,
    /// Factor of the outputs' equation.
    pub v: f64,
}

/// What a user knows of the true trajectory: Euclidean norms, in the user's units.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(deny_unknown_fields))]
pub struct Disturbance {
    /// ‖x̄(0) - x(0)‖, and with a warm start of every recorded state.
    pub initial: f64,
    /// ‖w(t)‖ at every t.
    pub w: f64,
    /// ‖v(t)‖ at every t.
    pub v: f64,
}

impl Certificate {
    /// Smallest M with 4η^M < 1.
    pub fn minimum_horizon(&self) -> usize {
        smallest_contracting(self.eta)
    }

    /// Sizes, finite numbers, symmetry, definiteness, η.
    pub(crate) fn check(&self, n: usize, p: usize, m: usize) -> Result<(), Error> {
        if !(self.eta > 0.0 && self.eta < 1.0) {
            return Err(Error::value("certificate", "eta in (0, 1)", self.eta));
        }
        for (name, matrix, size) in [("P", &self.P, n), ("Q", &self.Q, n), ("R", &self.R, p)] {
            check_square(name, matrix, size)?;
            if factor(matrix, size).is_none() {
                let expected = format!("a symmetric positive definite {name}");
                return Err(Error::value("certificate", expected, "one that is not"));
            }
        }
        if let Some(growth) = self.growth.filter(|g| !(*g >= 0.0 && g.is_finite())) {
            return Err(Error::value("certificate", "a finite growth of at least 0", growth));
        }
        let Some(model) = &self.model else { return Ok(()) };
        let offsets = !(model.e.is_empty() && model.r.is_empty());
        let sizes = [(&model.A, n * n), (&model.C, p * n), (&model.B, n * m), (&model.D, p * m)];
        for (values, len) in sizes {
            check_vector("certificate", values, len)?;
        }
        for (values, len) in [(&model.e, n), (&model.r, p)] {
            check_vector("certificate", values, if offsets { len } else { 0 })?;
        }
        if let Some(u) = &model.uncertainty {
            check_square("metric", &u.metric, n + m + 1)?;
            check_factor("w", u.w)?;
            check_factor("v", u.v)?;
        }
        Ok(())
    }
}

impl Disturbance {
    /// Finite and not negative.
    pub(crate) fn check(&self) -> Result<(), Error> {
        for (name, value) in [("initial", self.initial), ("w", self.w), ("v", self.v)] {
            if !(value >= 0.0 && value.is_finite()) {
                return Err(Error::value(
                    "disturbance",
                    format!("a finite {name} of at least 0"),
                    value,
                ));
            }
        }
        Ok(())
    }
}

/// Smallest M with 4ρ^M < 1 (Liu 2026, (33)).
///
/// # Errors
/// [`Error::Value`] unless ρ is in (0, 1).
pub fn minimum_horizon(rho: f64) -> Result<usize, Error> {
    if !(rho > 0.0 && rho < 1.0) {
        return Err(Error::value("rho", "a number in (0, 1)", rho));
    }
    Ok(smallest_contracting(rho))
}

/// [`minimum_horizon`] of a checked ρ. Rounding of the logarithm is mended by looking at both
/// neighbours.
pub(crate) fn smallest_contracting(rho: f64) -> usize {
    let contracts = |M: usize| 4.0 * rho.powf(M as f64) < 1.0;
    let mut M = (0.25_f64.ln() / rho.ln()).floor().max(1.0) as usize;
    while M > 1 && contracts(M - 1) {
        M -= 1;
    }
    while !contracts(M) {
        M += 1;
    }
    M
}

fn check_factor(name: &str, value: f64) -> Result<(), Error> {
    if value >= 0.0 && value.is_finite() {
        return Ok(());
    }
    Err(Error::value(
        "certificate",
        format!("an uncertainty with a finite {name} of at least 0"),
        value,
    ))
}

fn check_square(name: &str, matrix: &[f64], size: usize) -> Result<(), Error> {
    if matrix.len() != size * size {
        return Err(Error::shape(
            "certificate",
            format!("a {size} x {size} {name}"),
            format!("{} numbers", matrix.len()),
        ));
    }
    check_finite("certificate", matrix, size)?;
    let largest = matrix.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    let skew = (0..size * size)
        .map(|k| (matrix[k] - matrix[(k % size) * size + k / size]).abs())
        .fold(0.0, f64::max);
    if skew > tol::SYMMETRIC * largest {
        return Err(Error::value(
            "certificate",
            format!("a symmetric {name}"),
            format!("one that is off by {skew:.3e}"),
        ));
    }
    Ok(())
}

/// Upper triangular U with matrix = UᵀU; None unless positive definite.
pub(crate) fn factor(matrix: &[f64], size: usize) -> Option<Mat<f64>> {
    let full = Mat::from_fn(size, size, |i, j| 0.5 * (matrix[i * size + j] + matrix[j * size + i]));
    Some(full.llt(Side::Lower).ok()?.L().transpose().to_owned())
}
