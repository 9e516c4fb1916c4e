//! `ddmhe.Zonotope`.

use crate::convert::{DdmheError, Numbers, ShapeError, array1, raise, text, whole};
use crate::interval::ends::{Ends, columns, ends, intervals};
use crate::words::{kind, quoted};
use ddmhe_core::Reduction;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyType;

/// The reduction of this name.
pub fn reduction(name: &str) -> PyResult<Reduction> {
    Reduction::ALL.into_iter().find(|method| method.as_str() == name).ok_or_else(|| {
        let expected = "expected \"girard\", \"combastel\", \"pca\" or \"paper\"";
        DdmheError::new_err(format!("method: {expected}, found {}", quoted(name)))
    })
}

/// Zonotope {center + generators @ xi : |xi_i| <= 1}.
///
/// Parameters
/// ----------
/// center : array (n,)
/// generators : array (n, m)
///
/// Raises
/// ------
/// ShapeError, NotFiniteError
///
/// Examples
/// --------
/// >>> import ddmhe
/// >>> z = ddmhe.Zonotope([0.0, 0.0], [[1.0, 0.5], [0.0, 1.0]])
/// >>> z.contains([1.5, 1.0]), z.contains([1.6, 1.0])
/// (True, False)
/// >>> lo, hi = z.interval_hull()
/// >>> bool((lo <= [-1.5, -1.0]).all()), z.order
/// (True, 1.0)
#[pyclass(module = "ddmhe", name = "Zonotope", frozen)]
pub struct Zonotope(pub ddmhe_core::Zonotope);

/// Center and generators.
type Parts<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>);

#[pymethods]
impl Zonotope {
    #[new]
    fn new(center: &Bound<'_, PyAny>, generators: &Bound<'_, PyAny>) -> PyResult<Self> {
        let numbers = Numbers::from("center", center)?;
        let [n] = numbers.shape[..] else {
            return Err(ShapeError::new_err(format!(
                "center: expected a 1-D array, found {} dimensions",
                numbers.shape.len()
            )));
        };
        let (data, rows, m) = Numbers::matrix("generators", generators, &format!("({n}, m)"))?;
        if rows != n {
            return Err(ShapeError::new_err(format!(
                "generators: expected {n} rows, as center has, found {rows}"
            )));
        }
        let columns = (0..m)
            .flat_map(|j| (0..n).map(move |i| (i, j)))
            .map(|(i, j)| data[i * m + j])
            .collect();
        ddmhe_core::Zonotope::new(numbers.data, columns).map(Zonotope).map_err(raise)
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyType>, Parts<'py>)> {
        Ok((py.get_type::<Self>(), (self.center(py), self.generators(py)?)))
    }

    /// Center (n,).
    #[getter]
    fn center<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.0.center())
    }

    /// Generators (n, m), one per column.
    #[getter]
    fn generators<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        columns(py, self.0.generators(), self.0.n())
    }

    /// Generators per dimension, m / n.
    #[getter]
    fn order(&self) -> f64 {
        self.0.order()
    }

    /// A @ Z, (2). A : array (k, n).
    #[pyo3(signature = (A))]
    fn linear_map(&self, A: &Bound<'_, PyAny>) -> PyResult<Self> {
        let n = self.0.n();
        let (data, _, width) = Numbers::matrix("A", A, &format!("(k, {n})"))?;
        if width != n {
            return Err(ShapeError::new_err(format!("A: expected {n} columns, found {width}")));
        }
        self.0.linear_map(&data).map(Zonotope).map_err(raise)
    }

    /// The interval matrix [A_lo, A_hi] (k, n) times Z, Lemma 2.
    #[pyo3(signature = (A_lo, A_hi))]
    fn interval_map(&self, A_lo: &Bound<'_, PyAny>, A_hi: &Bound<'_, PyAny>) -> PyResult<Self> {
        let shape = format!("(k, {})", self.0.n());
        let (lo, rows, width) = Numbers::matrix("A_lo", A_lo, &shape)?;
        let (hi, rows_hi, width_hi) = Numbers::matrix("A_hi", A_hi, &shape)?;
        if width != self.0.n() || (rows, width) != (rows_hi, width_hi) {
            let found = format!("({rows}, {width}) and ({rows_hi}, {width_hi})");
            return Err(ShapeError::new_err(format!(
                "A_lo, A_hi: expected both {shape}, found {found}"
            )));
        }
        self.0.interval_map(&intervals("A_lo", &lo, &hi)?).map(Zonotope).map_err(raise)
    }

    /// Z + v. v : array (n,).
    fn translate(&self, v: &Bound<'_, PyAny>) -> PyResult<Self> {
        self.0.translate(&Numbers::vector("v", v, self.0.n())?).map(Zonotope).map_err(raise)
    }

    /// Minkowski sum with another zonotope, (5).
    fn minkowski_sum(&self, other: &Bound<'_, PyAny>) -> PyResult<Self> {
        let wrong =
            |_| DdmheError::new_err(format!("other: expected a Zonotope, found {}", kind(other)));
        let other = other.cast::<Self>().map_err(wrong)?.get();
        self.0.minkowski_sum(&other.0).map(Zonotope).map_err(raise)
    }

    /// Smallest box around it, (6), rounded outward: (lo (n,), hi (n,)).
    fn interval_hull<'py>(&self, py: Python<'py>) -> Ends<'py> {
        ends(py, &self.0.interval_hull())
    }

    /// A zonotope of at most q >= n generators that holds this one.
    ///
    /// method : "girard", "combastel", "pca" or "paper" (the appendix of the interval paper).
    #[pyo3(signature = (q, method=None), text_signature = "(q, method='girard')")]
    fn reduce(&self, q: &Bound<'_, PyAny>, method: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let method = match method {
            None => Reduction::default(),
            Some(method) => reduction(&text("method", method)?)?,
        };
        self.0.reduce(whole("q", q)?, method).map(Zonotope).map_err(raise)
    }

    /// Is x (n,) in it? Exact by a linear programme, to 1e-9 of its size.
    fn contains(&self, x: &Bound<'_, PyAny>) -> PyResult<bool> {
        self.0.contains(&Numbers::vector("x", x, self.0.n())?).map_err(raise)
    }

    /// max d @ x over it. d : array (n,).
    fn support(&self, d: &Bound<'_, PyAny>) -> PyResult<f64> {
        self.0.support(&Numbers::vector("d", d, self.0.n())?).map_err(raise)
    }

    /// Largest half width of the interval hull.
    #[getter]
    fn radius(&self) -> f64 {
        self.0.radius()
    }

    /// Length, area or volume (n at most 3).
    fn volume(&self) -> PyResult<f64> {
        self.0.volume().map_err(raise)
    }

    fn __repr__(&self) -> String {
        format!("Zonotope(n={}, generators={})", self.0.n(), self.0.count())
    }
}
