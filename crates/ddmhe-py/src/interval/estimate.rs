//! What a step of the interval observer leaves.

use crate::convert::{DdmheError, array1, raise};
use crate::interval::ends::{Ends, ends};
use crate::interval::zonotope::Zonotope;
use crate::pickle::{Made, bytes, made};
use ddmhe_core::snapshot::{Kind, from_bytes, to_bytes};
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyType;

/// One step's sets.
#[pyclass(module = "ddmhe._core", name = "IntervalEstimate", frozen)]
pub struct IntervalEstimate(pub ddmhe_core::IntervalEstimate);

#[pymethods]
impl IntervalEstimate {
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Made<'py>> {
        made::<Self>(
            py,
            "_restore",
            &to_bytes(Kind::IntervalEstimate, &(self.0.predicted.len(), &self.0)),
        )
    }

    #[classmethod]
    fn _restore(_cls: &Bound<'_, PyType>, blob: &Bound<'_, PyAny>) -> PyResult<Self> {
        let (n, estimate): (usize, ddmhe_core::IntervalEstimate) =
            from_bytes(Kind::IntervalEstimate, bytes(blob)?).map_err(raise)?;
        if !estimate.fits(n) {
            return Err(DdmheError::new_err(
                "blob: expected a saved interval estimate, found one of other sizes",
            ));
        }
        Ok(IntervalEstimate(estimate))
    }

    /// Lower bounds of x(k+1) (n,), before y(k+1) is known.
    #[getter]
    fn lower<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        ends(py, &self.0.predicted).0
    }

    /// Upper bounds of x(k+1) (n,), before y(k+1) is known.
    #[getter]
    fn upper<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        ends(py, &self.0.predicted).1
    }

    /// The observer's estimate of x(k+1) (n,), (19): not necessarily the middle of the bounds.
    #[getter]
    fn center<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, &self.0.center)
    }

    /// The zonotope around center that holds x(k+1).
    #[getter]
    fn zonotope(&self) -> Zonotope {
        Zonotope(self.0.zonotope())
    }

    /// (lo, hi) of x(k+1) from the ball (44), (n,) each.
    #[getter]
    fn ball<'py>(&self, py: Python<'py>) -> Ends<'py> {
        ends(py, &self.0.ball)
    }

    /// (lo, hi) of x(k+1) from the ellipsoid of P, (n,) each.
    #[getter]
    fn ellipsoid<'py>(&self, py: Python<'py>) -> Ends<'py> {
        ends(py, &self.0.ellipsoid)
    }

    /// (lo, hi) of x(k+1) from the peak-to-peak design: ball and ellipsoid together, (n,) each.
    #[getter]
    fn peak_to_peak<'py>(&self, py: Python<'py>) -> Ends<'py> {
        let both = self.0.ball.iter().zip(&self.0.ellipsoid);
        ends(py, &both.map(|(a, b)| a.intersect(*b).unwrap_or(*a)).collect::<Vec<_>>())
    }

    /// (lo, hi) of x(k) that use y(k), (n,) each.
    #[getter]
    fn filtered<'py>(&self, py: Python<'py>) -> Ends<'py> {
        ends(py, &self.0.filtered)
    }

    fn __repr__(&self) -> String {
        let text: Vec<String> =
            self.0.predicted.iter().map(|x| format!("[{:.6e}, {:.6e}]", x.lo, x.hi)).collect();
        format!("IntervalEstimate({})", text.join(", "))
    }
}
