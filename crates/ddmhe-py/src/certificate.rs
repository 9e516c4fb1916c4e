//! Certificates and disturbance sizes from Python: any object with the attributes of
//! `ddmhe.design.Certificate`.

use crate::convert::{DdmheError, Numbers, ShapeError, number, raise, shown};
use ddmhe_core::{Certificate, Disturbance, Model, Uncertainty};
use pyo3::prelude::*;

const ARGUMENT: &str = "certificate";

/// P, Q, R, eta; growth, the model (A, C, with e and r) and its uncertainty where they are not
/// None.
pub fn certificate(value: &Bound<'_, PyAny>, n: usize, p: usize) -> PyResult<Certificate> {
    let wrong = |name: &str| {
        DdmheError::new_err(format!(
            "{ARGUMENT}: expected a ddmhe.design.Certificate, found one without {name}"
        ))
    };
    let part = |name: &str| value.getattr(name).map_err(|_| wrong(name));
    let eta: f64 = part("eta")?.extract().map_err(|_| wrong("a number eta"))?;
    let growth =
        value.getattr("growth").ok().filter(|v| !v.is_none()).map(|v| v.extract()).transpose();
    Ok(Certificate {
        P: matrix(&part("P")?, n, n)?,
        Q: matrix(&part("Q")?, n, n)?,
        R: matrix(&part("R")?, p, p)?,
        eta,
        growth: growth.map_err(|_: PyErr| wrong("a number growth"))?,
        model: model(value, n, p)?,
    })
}

/// The model, if A and C are there; without e and r they are to be taken from the recording.
fn model(value: &Bound<'_, PyAny>, n: usize, p: usize) -> PyResult<Option<Model>> {
    let part = |name: &str| value.getattr(name).ok().filter(|v| !v.is_none());
    let (Some(A), Some(C)) = (part("A"), part("C")) else { return Ok(None) };
    let offset =
        |name: &str, len: usize| part(name).map(|v| Numbers::vector(ARGUMENT, &v, len)).transpose();
    let (e, r) = (offset("e", n)?, offset("r", p)?);
    if e.is_some() != r.is_some() {
        return Err(DdmheError::new_err(format!(
            "{ARGUMENT}: expected both e and r or neither, found one"
        )));
    }
    let identified = part("identified").is_some_and(|v| v.is_truthy().unwrap_or(true));
    let uncertainty = part("uncertainty")
        .map(|u| {
            let metric = matrix(&u.getattr("metric")?, n + 1, n + 1)?;
            Ok::<_, PyErr>(Uncertainty {
                metric,
                w: u.getattr("w")?.extract()?,
                v: u.getattr("v")?.extract()?,
            })
        })
        .transpose()?;
    Ok(Some(Model {
        A: matrix(&A, n, n)?,
        e: e.unwrap_or_default(),
        C: matrix(&C, p, n)?,
        r: r.unwrap_or_default(),
        identified,
        uncertainty,
    }))
}

fn matrix(value: &Bound<'_, PyAny>, rows: usize, columns: usize) -> PyResult<Vec<f64>> {
    let shape = format!("({rows}, {columns})");
    let (data, r, c) = Numbers::matrix(ARGUMENT, value, &shape)?;
    if (r, c) != (rows, columns) {
        return Err(ShapeError::new_err(format!(
            "{ARGUMENT}: expected a matrix {shape}, found ({r}, {c})"
        )));
    }
    Ok(data)
}

/// Smallest M with 4 rho**M < 1 (Liu et al. 2026, (33)); DdmheError unless rho is in (0, 1).
#[pyfunction]
pub fn minimum_horizon(rho: &Bound<'_, PyAny>) -> PyResult<usize> {
    ddmhe_core::minimum_horizon(number("rho", rho)?).map_err(raise)
}

/// (initial, w, v).
pub fn disturbance(value: &Bound<'_, PyAny>) -> PyResult<Disturbance> {
    let (initial, w, v) = value.extract::<(f64, f64, f64)>().map_err(|_| {
        ShapeError::new_err(format!(
            "disturbance: expected three numbers (initial, w, v), found {}",
            shown(value)
        ))
    })?;
    Ok(Disturbance { initial, w, v })
}
