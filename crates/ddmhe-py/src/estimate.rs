//! `ddmhe.Estimate`.

use crate::convert::{DdmheError, array1, array2, raise};
use crate::evidence::{self, Evidence};
use crate::frames::{self, Clock};
use crate::pickle::{Made, bytes, made};
use ddmhe_core::snapshot::{Kind, from_bytes, to_bytes};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyIterator, PyType};

/// The estimate of one step, with its evidence. Arrays are made when they are first asked for.
///
/// Examples
/// --------
/// >>> import ddmhe
/// >>> record = ddmhe.models.detumbling().simulate(duration=40.0, dt=0.1, noise=0.01)
/// >>> estimate = ddmhe.DdMhe(record.history(200)).step(record.y[200])
/// >>> estimate.x.shape, estimate.std.shape, estimate.status
/// ((3,), (3,), 'optimal')
/// >>> bool((estimate.window[-1] == estimate.x).all())
/// True
#[pyclass(module = "ddmhe", frozen, name = "Estimate")]
pub struct Estimate {
    core: ddmhe_core::Estimate,
    n: usize,
    p: usize,
    clock: Clock,
    x: PyOnceLock<Py<PyArray1<f64>>>,
    window: PyOnceLock<Py<PyArray2<f64>>>,
    v: PyOnceLock<Py<PyArray2<f64>>>,
    w: PyOnceLock<Py<PyArray2<f64>>>,
}

impl Estimate {
    pub fn new(core: &ddmhe_core::Estimate, n: usize, p: usize, clock: Clock) -> Self {
        let (x, window) = (PyOnceLock::new(), PyOnceLock::new());
        let (v, w) = (PyOnceLock::new(), PyOnceLock::new());
        Estimate { core: core.clone(), n, p, clock, x, window, v, w }
    }
}

#[pymethods]
impl Estimate {
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Made<'py>> {
        let Clock { before, dt } = self.clock;
        let parts = (self.n, self.p, before, dt, &self.core);
        made::<Self>(py, "_restore", &to_bytes(Kind::Estimate, &parts))
    }

    #[classmethod]
    fn _restore(_cls: &Bound<'_, PyType>, blob: &Bound<'_, PyAny>) -> PyResult<Self> {
        let (n, p, before, dt, core): (usize, usize, usize, f64, ddmhe_core::Estimate) =
            from_bytes(Kind::Estimate, bytes(blob)?).map_err(raise)?;
        if n == 0 || p == 0 || !core.fits(n, p) {
            return Err(DdmheError::new_err(
                "blob: expected a saved estimate, found one of other sizes",
            ));
        }
        Ok(Estimate::new(&core, n, p, Clock { before, dt }))
    }

    /// Estimated state (n,), from outputs up to y(t-1).
    #[getter]
    fn x(&self, py: Python<'_>) -> Py<PyArray1<f64>> {
        self.x.get_or_init(py, || array1(py, &self.core.x).unbind()).clone_ref(py)
    }

    /// The whole estimated window (M_t+1, n), oldest first; window[-1] equals x.
    #[getter]
    fn window(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f64>>> {
        let made = || array2(py, self.core.window.clone(), self.n).map(Bound::unbind);
        Ok(self.window.get_or_try_init(py, made)?.clone_ref(py))
    }

    /// Fitted noise (M_t, p); NaN where nothing was measured.
    #[getter]
    fn v(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f64>>> {
        let made = || array2(py, self.core.v.clone(), self.p).map(Bound::unbind);
        Ok(self.v.get_or_try_init(py, made)?.clone_ref(py))
    }

    /// Fitted disturbance (M_t, n); None where none is fitted.
    #[getter]
    fn w(&self, py: Python<'_>) -> PyResult<Option<Py<PyArray2<f64>>>> {
        if self.core.w.is_empty() {
            return Ok(None);
        }
        let made = || array2(py, self.core.w.clone(), self.n).map(Bound::unbind);
        Ok(Some(self.w.get_or_try_init(py, made)?.clone_ref(py)))
    }

    /// Cost (17) at the estimate, with that of the disturbance, where one is fitted, and what it
    /// pays for leaving soft bounds.
    #[getter]
    fn cost(&self) -> f64 {
        self.core.cost
    }

    /// Bound on the Euclidean norm of x's error, with a certificate and the disturbance's size
    /// where it can be relied on; else None, and DdMhe.warnings says why.
    #[getter]
    fn bound(&self) -> Option<f64> {
        self.core.bound
    }

    /// "optimal", "almost_optimal", "infeasible" or "failed"; in the last two x and window are
    /// inside the box on the states, made without the outputs at fault or, where the box is at
    /// fault, by moving the minimiser into it.
    #[getter]
    fn status(&self) -> &'static str {
        self.core.status.as_str()
    }

    /// Number of bounds that the window touches, or leaves where they are soft.
    #[getter]
    fn active(&self) -> usize {
        self.core.active
    }

    /// Changes of the active set since the last step (or iterations of the interior-point solver,
    /// where that decided).
    #[getter]
    fn iterations(&self) -> u32 {
        self.core.iterations
    }

    /// Covariance (n, n) of the error of x; None where no evidence was asked for.
    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        let own = self.core.evidence.as_ref();
        own.map(|own| array2(py, own.covariance.clone(), self.n)).transpose()
    }

    /// Standard deviation (n,) of the error of each state, the roots of covariance's diagonal.
    #[getter]
    fn std<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        let own = self.core.evidence.as_ref()?;
        Some(array1(py, &evidence::diagonal(&own.covariance, self.n)))
    }

    /// Whether the estimate is trusted: reasons hold neither NOVEL nor UNCERTAIN nor STUCK. What is
    /// OUTSIDE is told, and not for that alone in doubt.
    #[getter]
    fn trusted(&self) -> Option<bool> {
        Some(self.core.evidence.as_ref()?.trusted())
    }

    /// Why the estimate is not trusted, a ddmhe.Reason; Reason(0): it is.
    #[getter]
    fn reasons<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let own = self.core.evidence.as_ref();
        own.map(|own| evidence::reason(py, own.reasons.bits())).transpose()
    }

    /// What speaks for and against it, an Evidence; None where none was asked for.
    #[getter]
    fn evidence(&self) -> Option<Evidence> {
        self.core.evidence.as_ref().map(Evidence::new)
    }

    /// Times (M_t+1,) of the window, s since the run began; x is the state at t[-1].
    #[getter]
    fn t<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let states = self.core.window.len() / self.n;
        let first = self.clock.before as f64 + 2.0 - states as f64;
        let times = (0..states).map(|k| (first + k as f64) * self.clock.dt).collect();
        PyArray1::from_vec(py, times)
    }

    /// Number of states of the window, M_t + 1.
    fn __len__(&self) -> usize {
        self.core.window.len() / self.n
    }

    /// The states (n,) of the window, oldest first.
    fn __iter__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyIterator>> {
        self.window(py)?.into_bound(py).try_iter()
    }

    /// Whether all numbers are the same.
    fn __eq__(&self, other: &Bound<'_, PyAny>) -> bool {
        let same = |other: &Estimate| {
            let own = (self.n, self.p, self.clock) == (other.n, other.p, other.clock);
            let blob = |one: &Self| to_bytes(Kind::Estimate, &one.core);
            own && blob(self) == blob(other)
        };
        other.cast::<Estimate>().is_ok_and(|other| same(other.get()))
    }

    /// The window as a frame of pandas, with t as its index: states, called by `names` (else x0,
    /// x1, …).
    #[pyo3(signature = (names=None))]
    fn to_pandas<'py>(
        slf: &Bound<'py, Self>,
        names: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        frames::made("window_to_pandas", slf.as_any(), names)
    }

    /// The same as a frame of polars, with t as its first column.
    #[pyo3(signature = (names=None))]
    fn to_polars<'py>(
        slf: &Bound<'py, Self>,
        names: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        frames::made("window_to_polars", slf.as_any(), names)
    }

    /// The same as a Dataset of xarray over t and state.
    #[pyo3(signature = (names=None))]
    fn to_xarray<'py>(
        slf: &Bound<'py, Self>,
        names: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        frames::made("window_to_xarray", slf.as_any(), names)
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        let (x, e) = (self.x(py), &self.core);
        format!(
            "Estimate(x={}, status='{}', cost={:.4e}, active={})",
            x.bind(py),
            e.status.as_str(),
            e.cost,
            e.active
        )
    }
}
