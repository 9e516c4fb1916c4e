//! `ddmhe.Exact`, `ddmhe.Truncated`, `ddmhe.Ridge`.

use crate::convert::{DdmheError, flag, number, whole};
use crate::words::shown;
use ddmhe_core::Space;
use pyo3::IntoPyObjectExt;
use pyo3::prelude::*;
use pyo3::types::PyType;

/// Every direction above rounding level: the equality (16b) as printed, with the least-norm alpha.
///
/// Examples
/// --------
/// >>> import ddmhe
/// >>> history = ddmhe.models.detumbling().simulate(duration=30.0, dt=0.1).history(200)
/// >>> ddmhe.DdMhe(history, horizon=10, rho=0.8, mu=1e5, space=ddmhe.Exact()).horizon
/// 10
#[pyclass(module = "ddmhe", frozen, eq, hash, name = "Exact")]
#[derive(PartialEq, Hash)]
pub struct Exact;

#[pymethods]
impl Exact {
    #[new]
    fn new() -> Self {
        Exact
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> (Bound<'py, PyType>, ()) {
        (py.get_type::<Self>(), ())
    }

    fn __repr__(&self) -> &'static str {
        "Exact()"
    }
}

/// The strongest directions only.
///
/// Parameters
/// ----------
/// rank : int, optional
///     Largest number of directions; windows too short for it keep what they have.
/// tol : float, optional
///     Relative singular value below which a direction is dropped.
///
/// With neither given: rank n, the dimension that noise-free linear data have.
///
/// Examples
/// --------
/// >>> import ddmhe
/// >>> history = ddmhe.models.detumbling().simulate(duration=30.0, dt=0.1, noise=0.01).history(200)
/// >>> ddmhe.DdMhe(history, horizon=10, rho=0.8, mu=1e5, space=ddmhe.Truncated(3)).rank
/// 3
#[pyclass(module = "ddmhe", frozen, eq, name = "Truncated")]
#[derive(PartialEq)]
pub struct Truncated {
    #[pyo3(get)]
    rank: Option<usize>,
    #[pyo3(get)]
    tol: Option<f64>,
}

#[pymethods]
impl Truncated {
    #[new]
    #[pyo3(signature = (rank=None, tol=None))]
    fn new(rank: Option<&Bound<'_, PyAny>>, tol: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let rank = rank.map(|r| whole("rank", r)).transpose()?;
        Ok(Truncated { rank, tol: tol.map(|t| number("tol", t)).transpose()? })
    }

    fn __reduce__<'py>(
        &self,
        py: Python<'py>,
    ) -> (Bound<'py, PyType>, (Option<usize>, Option<f64>)) {
        (py.get_type::<Self>(), (self.rank, self.tol))
    }

    fn __repr__(&self) -> String {
        let mut parts = Vec::new();
        parts.extend(self.rank.map(|r| format!("rank={r}")));
        parts.extend(self.tol.map(|t| format!("tol={t:e}")));
        format!("Truncated({})", parts.join(", "))
    }
}

/// Every direction above rounding level, and weight * ||alpha||**2 added to the cost (17), in its
/// units.
///
/// Parameters
/// ----------
/// weight : float > 0
/// normalised : bool
///     True: the weight is on ||a||**2 = N ||alpha||**2 - 1, in units of the cost: what DdMhe.ridge
///     shows, and the same for every length of recording, horizon and unit.
///
/// Examples
/// --------
/// >>> import ddmhe
/// >>> history = ddmhe.models.detumbling().simulate(duration=30.0, dt=0.1, noise=0.01).history(200)
/// >>> ddmhe.DdMhe(history, space=ddmhe.Ridge(1e-5, normalised=True)).ridge
/// 1e-05
#[pyclass(module = "ddmhe", frozen, eq, name = "Ridge")]
#[derive(PartialEq)]
pub struct Ridge {
    #[pyo3(get)]
    weight: f64,
    #[pyo3(get)]
    normalised: bool,
}

#[pymethods]
impl Ridge {
    #[new]
    #[pyo3(signature = (weight, normalised=None), text_signature = "(weight, normalised=False)")]
    fn new(weight: &Bound<'_, PyAny>, normalised: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let normalised = normalised.map_or(Ok(false), |n| flag("normalised", n))?;
        Ok(Ridge { weight: number("weight", weight)?, normalised })
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> (Bound<'py, PyType>, (f64, bool)) {
        (py.get_type::<Self>(), (self.weight, self.normalised))
    }

    fn __repr__(&self) -> String {
        format!(
            "Ridge({:e}{})",
            self.weight,
            if self.normalised { ", normalised=True" } else { "" }
        )
    }
}

/// The space that a Python argument names.
pub fn space(value: &Bound<'_, PyAny>) -> PyResult<Space> {
    if value.cast::<Exact>().is_ok() {
        return Ok(Space::Exact);
    }
    if let Ok(t) = value.cast::<Truncated>() {
        return Ok(Space::Truncated { rank: t.get().rank, tol: t.get().tol });
    }
    if let Ok(r) = value.cast::<Ridge>() {
        return Ok(Space::Ridge { weight: r.get().weight, normalised: r.get().normalised });
    }
    if let Some(named) = value.extract::<String>().ok().and_then(|text| named(&text)) {
        return Ok(named);
    }
    let found = shown(value);
    Err(DdmheError::new_err(format!(
        "space: expected \"auto\", \"exact\", \"truncated:RANK\", \"ridge:WEIGHT\", Exact(), \
         Truncated(...) or Ridge(weight), found {found}"
    )))
}

/// The space that a text names, as on the command line.
fn named(text: &str) -> Option<Space> {
    match text.split_once(':') {
        None => match text {
            "auto" => Some(Space::Auto),
            "exact" => Some(Space::Exact),
            _ => None,
        },
        Some(("truncated", rank)) => {
            Some(Space::Truncated { rank: Some(rank.parse().ok()?), tol: None })
        }
        Some(("ridge", weight)) => {
            Some(Space::Ridge { weight: weight.parse().ok()?, normalised: false })
        }
        Some(_) => None,
    }
}

/// The Python object that stands for a space.
pub fn to_python(py: Python<'_>, space: Space) -> PyResult<Bound<'_, PyAny>> {
    match space {
        Space::Auto => "auto".into_bound_py_any(py),
        Space::Exact => Exact.into_bound_py_any(py),
        Space::Truncated { rank, tol } => Truncated { rank, tol }.into_bound_py_any(py),
        Space::Ridge { weight, normalised } => Ridge { weight, normalised }.into_bound_py_any(py),
    }
}
