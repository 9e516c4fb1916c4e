//! Certificates and disturbance sizes from Python: any object with the attributes of
//! `ddmhe.design.Certificate`, and no others.

use crate::convert::{DdmheError, Numbers, ShapeError, number, raise};
use crate::history::Channels;
use crate::words::{nearest, quoted, shown};
use ddmhe_core::{Certificate, Disturbance, Model, Uncertainty};
use pyo3::prelude::*;
use pyo3::types::PyDict;

const ARGUMENT: &str = "certificate";

/// Attributes of a certificate; the estimator takes no notice of the last three.
const FIELDS: [&str; 16] = [
    "P",
    "Q",
    "R",
    "eta",
    "growth",
    "A",
    "B",
    "C",
    "D",
    "e",
    "r",
    "uncertainty",
    "identified",
    "residual",
    "noise",
    "optimised",
];

/// P, Q, R, eta; growth, the model (A, C, with e and r) and its uncertainty where they are not
/// None. `sizes` are (n, p), else those of P and R.
pub fn certificate(value: &Bound<'_, PyAny>, sizes: Option<Channels>) -> PyResult<Certificate> {
    let own = Attributes(value);
    let [P, Q, R, eta] = ["P", "Q", "R", "eta"].map(|name| own.required(name));
    let (P, Q, R, eta) = (P?, Q?, R?, eta?);
    own.check_names()?;
    own.get("residual").map(|v| scalar("residual", &v)).transpose()?;
    let sizes = match sizes {
        Some(sizes) => sizes,
        None => Channels { n: rows(&P)?, p: rows(&R)?, m: inputs(&own)? },
    };
    let Channels { n, p, .. } = sizes;
    Ok(Certificate {
        P: matrix(&P, n, n)?,
        Q: matrix(&Q, n, n)?,
        R: matrix(&R, p, p)?,
        eta: scalar("eta", &eta)?,
        growth: own.get("growth").map(|v| scalar("growth", &v)).transpose()?,
        model: model(&own, sizes)?,
    })
}

/// The model, if A and C are there; without e and r they are to be taken from the recording.
fn model(own: &Attributes<'_, '_>, Channels { n, p, m }: Channels) -> PyResult<Option<Model>> {
    let (Some(A), Some(C)) = (own.get("A"), own.get("C")) else { return Ok(None) };
    let offset = |name: &str, len: usize| {
        own.get(name).map(|v| Numbers::vector(ARGUMENT, &v, len)).transpose()
    };
    let (e, r) = (offset("e", n)?, offset("r", p)?);
    if e.is_some() != r.is_some() {
        return Err(wrong("both e and r or neither, found one"));
    }
    let of_inputs = |name: &str, rows: usize| match own.get(name) {
        Some(value) if m > 0 => matrix(&value, rows, m),
        None if m > 0 => Err(wrong(&format!("{name} beside A and C, for a recording with inputs"))),
        _ => Ok(Vec::new()),
    };
    Ok(Some(Model {
        B: of_inputs("B", n)?,
        D: of_inputs("D", p)?,
        A: matrix(&A, n, n)?,
        e: e.unwrap_or_default(),
        C: matrix(&C, p, n)?,
        r: r.unwrap_or_default(),
        identified: own.get("identified").map_or(Ok(false), |v| truth("identified", &v))?,
        uncertainty: own.get("uncertainty").map(|u| uncertainty(&u, n + m)).transpose()?,
    }))
}

fn uncertainty(value: &Bound<'_, PyAny>, n: usize) -> PyResult<Uncertainty> {
    let part = |name: &str| {
        let missing = |_| wrong(&format!("an uncertainty with {name}, found {}", shown(value)));
        value.getattr(name).map_err(missing)
    };
    let metric = matrix(&part("metric")?, n + 1, n + 1)?;
    Ok(Uncertainty { metric, w: scalar("w", &part("w")?)?, v: scalar("v", &part("v")?)? })
}

/// What an object says of itself, None like nothing.
struct Attributes<'a, 'py>(&'a Bound<'py, PyAny>);

impl<'py> Attributes<'_, 'py> {
    fn get(&self, name: &str) -> Option<Bound<'py, PyAny>> {
        self.0.getattr(name).ok().filter(|v| !v.is_none())
    }

    fn required(&self, name: &str) -> PyResult<Bound<'py, PyAny>> {
        let missing = |_| wrong(&format!("a ddmhe.design.Certificate, found one without {name}"));
        self.0.getattr(name).map_err(missing)
    }

    /// A misspelt attribute would count as one that is not there.
    fn check_names(&self) -> PyResult<()> {
        let Ok(own) = self.0.getattr("__dict__") else { return Ok(()) };
        let Ok(own) = own.cast_into::<PyDict>() else { return Ok(()) };
        for name in own.keys() {
            let name: String = name.extract()?;
            if !name.starts_with('_') && !FIELDS.contains(&name.as_str()) {
                let near = nearest(self.0.py(), &name, &FIELDS)?;
                let found =
                    format!("a ddmhe.design.Certificate, found one with {}{near}", quoted(&name));
                return Err(wrong(&found));
            }
        }
        Ok(())
    }
}

fn wrong(words: &str) -> PyErr {
    DdmheError::new_err(format!("{ARGUMENT}: expected {words}"))
}

fn scalar(name: &str, value: &Bound<'_, PyAny>) -> PyResult<f64> {
    value.extract().map_err(|_| wrong(&format!("a number for {name}, found {}", shown(value))))
}

fn truth(name: &str, value: &Bound<'_, PyAny>) -> PyResult<bool> {
    value.extract().map_err(|_| wrong(&format!("True or False for {name}, found {}", shown(value))))
}

/// Inputs of its model: columns of B.
fn inputs(own: &Attributes<'_, '_>) -> PyResult<usize> {
    let Some(B) = own.get("B") else { return Ok(0) };
    Ok(Numbers::matrix(ARGUMENT, &B, "(n, m)")?.2)
}

fn rows(value: &Bound<'_, PyAny>) -> PyResult<usize> {
    Ok(Numbers::matrix(ARGUMENT, value, "(n, n)")?.1)
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
///
/// Examples
/// --------
/// >>> import ddmhe
/// >>> ddmhe.design.minimum_horizon(0.8)  # 4 * 0.8**7 is below 1, 4 * 0.8**6 is not
/// 7
#[pyfunction]
pub fn minimum_horizon(rho: &Bound<'_, PyAny>) -> PyResult<usize> {
    ddmhe_core::minimum_horizon(number("rho", rho)?).map_err(raise)
}

/// (initial, w, v).
pub fn disturbance(value: &Bound<'_, PyAny>) -> PyResult<Disturbance> {
    let [initial, w, v] = value.extract().map_err(|_| {
        ShapeError::new_err(format!(
            "disturbance: expected three numbers (initial, w, v), found {}",
            shown(value)
        ))
    })?;
    Ok(Disturbance { initial, w, v })
}
