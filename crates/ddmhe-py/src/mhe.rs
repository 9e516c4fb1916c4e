//! `ddmhe.DdMhe`, `ddmhe.Estimate`, `ddmhe.Log`.

use crate::certificate;
use crate::convert::{
    DdmheError, Numbers, ShapeError, array1, array2, bounds, flag, number, pair, raise, shown,
    text, whole, writable,
};
use crate::exclusive::Exclusive;
use crate::history::History;
use crate::pickle::{Made, bytes, made};
use crate::signals::Signals;
use crate::spaces;
use ddmhe_core::snapshot::{Kind, from_bytes, to_bytes};
use ddmhe_core::{Bounds, Center, Config, Space, Start, Weighting};
use numpy::{Ix1, Ix2, PyArray1, PyArray2, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::PyTypeInfo;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyBytes, PySlice, PyTuple, PyType};
use std::sync::MutexGuard;

/// Data-driven moving horizon estimation (Liu 2026, (16), (17), Algorithm 1).
///
/// Each setting left at None is set by the documented default rule from the recording alone.
///
/// Parameters
/// ----------
/// history : History
///     The recording that stands in for the model.
/// horizon : int, optional
///     Horizon M: outputs in the full window.
/// rho : float in (0, 1), optional
///     Discount per sample.
/// mu : float > 0, optional
///     Weight on the fitted noise, as in (17): unit (unit of x / unit of y)**2, or none with
///     weights="scaled".
/// x_prior : array (n,), optional
///     Prior state at t = 0; default the last recorded state. Given, it means start="state".
/// x_bounds : (lo, hi), optional
///     Box on every state of the window; each side a scalar or (n,); infinite = no bound.
/// x_center : None or "history"
///     None: x_bounds are absolute. "history": relative to x_c(t), the window that the recording
///     alone associates with the measured outputs (IV-A1, affine form).
/// v_bounds : (lo, hi), optional
///     Box on the fitted noise; each side a scalar or (p,).
/// equilibrium : (x_e, y_e), optional
///     A known rest of the system, added to the data as constant windows if the recording is noisy.
/// warm_start : bool, optional
///     The old name: True is start="recording" (beside x_prior, which then counts: "state"), False
///     is start="state".
/// space : "auto" | Exact() | Truncated(rank, tol) | Ridge(weight)
///     Which windows count as trajectories of the system.
/// certificate : ddmhe.design.Certificate, optional
///     Weights 2 eta**M P and eta**(j-1) R in the place of rho and mu; the horizon must satisfy 4
///     eta**M < 1 and is long enough by default.
/// disturbance : (initial, w, v), optional
///     With a certificate: bounds on the Euclidean norms of the initial error, of every w(t) and of
///     every v(t). Each estimate then carries a bound on its error.
/// weights : "auto" | "paper" | "scaled"
///     What rho and mu are meant in. "paper": (17) in the units of x and y, as printed. "scaled":
///     every channel in units of its own scale (channels of one unit share theirs), so that mu has
///     no unit. "auto": "paper" beside an explicit rho or mu or a certificate, else "scaled".
/// start : "recording" | "state" | "unknown", optional
///     Where a run starts. "recording": where the recording ends; the log goes on from there, and
///     the window starts filled from the recording's end. "state": from x_prior, believed as much
///     as any prior in (17); the window grows from 1 to M. "unknown": anywhere; the window grows
///     from a prior that is as wide as the recorded states. Neither start nor x_prior given:
///     Algorithm 1 with the last recorded state as prior, which assumes that the run starts at (or
///     near) that state.
///
/// Raises
/// ------
/// ShapeError, NotFiniteError, RankError, DdmheError
///     One clear error naming the argument. What the optimisation finds is never an error: see
///     Estimate.status.
#[pyclass(module = "ddmhe", frozen, name = "DdMhe")]
pub struct DdMhe {
    core: Exclusive<ddmhe_core::DdMhe>,
}

impl DdMhe {
    fn of(core: ddmhe_core::DdMhe) -> Self {
        DdMhe { core: Exclusive::new(core) }
    }

    fn core(&self) -> PyResult<MutexGuard<'_, ddmhe_core::DdMhe>> {
        self.core.get("an estimator")
    }
}

#[pymethods]
impl DdMhe {
    #[new]
    #[pyo3(
        signature = (history, horizon=None, rho=None, mu=None, x_prior=None, x_bounds=None, x_center=None, v_bounds=None, equilibrium=None, warm_start=None, space=None, certificate=None, disturbance=None, *, weights=None, start=None),
        text_signature = "(history, horizon=None, rho=None, mu=None, x_prior=None, x_bounds=None, x_center=None, v_bounds=None, equilibrium=None, warm_start=None, space='auto', certificate=None, disturbance=None, *, weights='auto', start=None)"
    )]
    #[allow(clippy::too_many_arguments)]
    fn new(
        py: Python<'_>,
        history: &Bound<'_, PyAny>,
        horizon: Option<&Bound<'_, PyAny>>,
        rho: Option<&Bound<'_, PyAny>>,
        mu: Option<&Bound<'_, PyAny>>,
        x_prior: Option<&Bound<'_, PyAny>>,
        x_bounds: Option<&Bound<'_, PyAny>>,
        x_center: Option<&Bound<'_, PyAny>>,
        v_bounds: Option<&Bound<'_, PyAny>>,
        equilibrium: Option<&Bound<'_, PyAny>>,
        warm_start: Option<&Bound<'_, PyAny>>,
        space: Option<&Bound<'_, PyAny>>,
        certificate: Option<&Bound<'_, PyAny>>,
        disturbance: Option<&Bound<'_, PyAny>>,
        weights: Option<&Bound<'_, PyAny>>,
        start: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let history = cast_history("history", history)?;
        let (n, p) = (history.core.n(), history.core.p());
        let config = Config {
            horizon: horizon.map(|v| whole("horizon", v)).transpose()?,
            rho: rho.map(|v| number("rho", v)).transpose()?,
            mu: mu.map(|v| number("mu", v)).transpose()?,
            x_prior: x_prior.map(|v| Numbers::vector("x_prior", v, n)).transpose()?,
            x_bounds: x_bounds.map(|v| bounds("x_bounds", v, n, None)).transpose()?,
            x_center: x_center.map_or(Ok(Center::Absolute), center)?,
            v_bounds: v_bounds.map(|v| bounds("v_bounds", v, p, None)).transpose()?,
            equilibrium: equilibrium.map(|v| rest(v, n, p)).transpose()?,
            start: started(start, warm_start, x_prior.is_some())?,
            space: space.map_or(Ok(Space::Auto), spaces::space)?,
            certificate: certificate.map(|c| certificate::certificate(c, n, p)).transpose()?,
            disturbance: disturbance.map(certificate::disturbance).transpose()?,
            weights: weights.map_or(Ok(Weighting::Auto), weighting)?,
        };
        let core = py.detach(|| ddmhe_core::DdMhe::new(&history.core, config)).map_err(raise)?;
        Ok(DdMhe::of(core))
    }

    /// Consume y(t-1) and estimate x(t), at step number t.
    ///
    /// y_t : array (p,), NaN where this entry was not measured. x_bounds : (lo, hi) for this step
    /// alone; each side a scalar, (n,), or one row per state of the window (M_t+1, n). out :
    /// float64 array (n,), optional. It receives the state and is returned in the place of an
    /// Estimate, so that nothing is
    ///     allocated; all else about the step is in `estimate`.
    #[pyo3(signature = (y_t, x_bounds=None, out=None))]
    fn step<'py>(
        &self,
        py: Python<'py>,
        y_t: &Bound<'py, PyAny>,
        x_bounds: Option<&Bound<'py, PyAny>>,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let mut core = self.core()?;
        let (n, p) = (core.n(), core.p());
        let limits: Option<Bounds> =
            x_bounds.map(|v| bounds("x_bounds", v, n, Some(core.next_depth()))).transpose()?;
        out.map(|out| writable::<Ix1>("out", out, &[n])).transpose()?; // checked first, let go: it may be y_t itself
        let copied;
        // a subclass may say more than its numbers do: a mask
        let plain = y_t.get_type().is(PyArray1::<f64>::type_object(py)).then_some(y_t);
        let array = plain
            .and_then(|y| y.cast::<PyArray1<f64>>().ok())
            .filter(|y| y.len() == p)
            .map(PyArrayMethods::try_readonly)
            .transpose()?;
        let y = match array.as_ref().and_then(|y| y.as_slice().ok()) {
            Some(y) => y,
            None => {
                copied = Numbers::measured("y_t", y_t)?.into_vector("y_t", p)?;
                &copied
            }
        };
        let estimate = core.step_within(y, limits.as_ref()).map_err(raise)?;
        drop(array);
        let Some(out) = out else {
            return Ok(Bound::new(py, Estimate::new(estimate, n, p))?.into_any());
        };
        writable::<Ix1>("out", out, &[n])?.as_slice_mut()?.copy_from_slice(&estimate.x);
        Ok(out.clone())
    }

    /// A copy that continues on its own from the same window; what was computed at construction is
    /// shared.
    fn __copy__(&self) -> PyResult<Self> {
        Ok(DdMhe::of(self.core()?.clone()))
    }

    fn __deepcopy__(&self, _memo: &Bound<'_, PyAny>) -> PyResult<Self> {
        self.__copy__() // what is shared never changes
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Made<'py>> {
        made::<Self>(py, "_restore", &self.core()?.snapshot())
    }

    /// restore as a class method, which pickle can name.
    #[classmethod]
    fn _restore(_cls: &Bound<'_, PyType>, blob: &Bound<'_, PyAny>) -> PyResult<Self> {
        Self::restore(blob)
    }

    /// The latest step's Estimate; None before the first.
    #[getter]
    fn estimate(&self) -> PyResult<Option<Estimate>> {
        let core = self.core()?;
        let estimate = core.estimate();
        Ok((!estimate.x.is_empty()).then(|| Estimate::new(estimate, core.n(), core.p())))
    }

    /// Estimate over a whole log Y (N, p), with the GIL released: the same numbers as N calls of
    /// step.
    ///
    /// out : float64 array (N, n), optional. It receives the states and is the Log's x.
    ///
    /// A KeyboardInterrupt (any exception of a signal's handler) ends the run within about 50 ms.
    /// The estimator then stands behind the last step made, and the Log of the steps made is the
    /// exception's attribute `finished`.
    #[pyo3(signature = (Y, out=None))]
    #[allow(non_snake_case)]
    fn run(
        &self,
        py: Python<'_>,
        Y: &Bound<'_, PyAny>,
        out: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Log> {
        let (data, rows, columns) = Numbers::measured("Y", Y)?.into_matrix("Y", "(N, p)")?;
        let mut core = self.core()?;
        let core = &mut *core;
        let (n, p) = (core.n(), core.p());
        if columns != p {
            return Err(ShapeError::new_err(format!("Y: expected {p} columns, found {columns}")));
        }
        let room = out.map(|out| writable::<Ix2>("out", out, &[rows, n])).transpose()?;
        let mut signals = Signals::default();
        let log = py.detach(|| core.run_until(&data, &mut || signals.raised())).map_err(raise)?;
        let made = log.status.len();
        let x = match (out, room) {
            (Some(out), Some(mut room)) => {
                room.as_slice_mut()?[..made * n].copy_from_slice(&log.x);
                let all = made == rows;
                let x = if all {
                    out.clone()
                } else {
                    out.get_item(PySlice::new(py, 0, made as isize, 1))?
                };
                Some(x.cast_into::<PyArray2<f64>>()?)
            }
            _ => None,
        };
        let log = Log::new(py, log, n, core.is_bounded(), x)?;
        signals.outcome(py, log, &format!("{made} of {rows} steps were made"))
    }

    /// Back to t = 0: from x_prior (n,), or with another start, as in DdMhe; with neither, as
    /// constructed.
    #[pyo3(signature = (x_prior=None, start=None))]
    fn reset(
        &self,
        py: Python<'_>,
        x_prior: Option<&Bound<'_, PyAny>>,
        start: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let mut core = self.core()?;
        let core = &mut *core;
        let prior = x_prior.map(|v| Numbers::vector("x_prior", v, core.n())).transpose()?;
        let given = start.map(self::start).transpose()?;
        py.detach(|| match given {
            Some(start) => core.reset_from(start, prior.as_deref()),
            None => core.reset(prior.as_deref()),
        })
        .map_err(raise)
    }

    /// The estimator with its recording and its window as bytes; see restore.
    fn snapshot<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        Ok(PyBytes::new(py, &self.core()?.snapshot()))
    }

    /// The estimator that snapshot saved; its next steps give the same numbers.
    #[staticmethod]
    fn restore(blob: &Bound<'_, PyAny>) -> PyResult<Self> {
        Ok(DdMhe::of(ddmhe_core::DdMhe::restore(bytes(blob)?).map_err(raise)?))
    }

    /// Number of states.
    #[getter]
    fn n(&self) -> PyResult<usize> {
        Ok(self.core()?.n())
    }

    /// Number of outputs.
    #[getter]
    fn p(&self) -> PyResult<usize> {
        Ok(self.core()?.p())
    }

    /// Horizon M in force.
    #[getter]
    fn horizon(&self) -> PyResult<usize> {
        Ok(self.core()?.settings().horizon)
    }

    /// Discount in force.
    #[getter]
    fn rho(&self) -> PyResult<f64> {
        Ok(self.core()?.settings().rho)
    }

    /// Noise weight in force: of (17) in the units of x and y where weights is "paper", without a
    /// unit where it is "scaled".
    #[getter]
    fn mu(&self) -> PyResult<f64> {
        Ok(self.core()?.settings().mu)
    }

    /// What rho and mu are meant in: "paper" or "scaled".
    #[getter]
    fn weights(&self) -> PyResult<&'static str> {
        Ok(match self.core()?.settings().weights {
            Weighting::Scaled => "scaled",
            Weighting::Auto | Weighting::Paper => "paper",
        })
    }

    /// The trajectory space that was asked for.
    #[getter]
    fn space<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        spaces::to_python(py, self.core()?.config().space)
    }

    /// Directions of the trajectory space at full depth.
    #[getter]
    fn rank(&self) -> PyResult<usize> {
        Ok(self.core()?.settings().rank)
    }

    /// Weight on the normalised ||a||**2 = N ||alpha||**2 - 1, in units of the cost; 0 for none.
    #[getter]
    fn ridge(&self) -> PyResult<f64> {
        Ok(self.core()?.settings().lambda)
    }

    /// Steps since the start or the last reset.
    #[getter]
    fn t(&self) -> PyResult<usize> {
        Ok(self.core()?.t())
    }

    /// Depth M_t of the next step's window.
    #[getter]
    fn next_depth(&self) -> PyResult<usize> {
        Ok(self.core()?.next_depth())
    }

    /// Spectral radius of the map prior -> estimate without new information; above 1 errors grow.
    #[getter]
    fn spectral_radius(&self) -> PyResult<f64> {
        Ok(self.core()?.spectral_radius())
    }

    /// What to know about the recording and these settings, in words; grows when outputs do what
    /// they never did in the recording.
    #[getter]
    fn warnings(&self) -> PyResult<Vec<String>> {
        Ok(self.core()?.warnings())
    }

    fn __repr__(&self) -> String {
        let Ok(core) = self.core() else { return "DdMhe(at work in another call)".into() };
        let (s, t) = (core.settings(), core.t());
        format!(
            "DdMhe(horizon={}, rho={:.4}, mu={:.4e}, rank={}, ridge={:.3e}, t={t})",
            s.horizon, s.rho, s.mu, s.rank, s.lambda
        )
    }
}

/// The History behind a Python argument.
pub fn cast_history<'a>(argument: &str, value: &'a Bound<'_, PyAny>) -> PyResult<&'a History> {
    let wrong = |_| {
        DdmheError::new_err(format!("{argument}: expected a History, found {}", value.get_type()))
    };
    Ok(value.cast::<History>().map_err(wrong)?.get())
}

/// The start asked for, by its name or by the old one.
fn started(
    start: Option<&Bound<'_, PyAny>>,
    warm_start: Option<&Bound<'_, PyAny>>,
    x_prior: bool,
) -> PyResult<Start> {
    match (start, warm_start) {
        (Some(_), Some(_)) => Err(DdmheError::new_err(
            "warm_start: expected none beside start, of which it is the old name, found both",
        )),
        (Some(given), None) => self::start(given),
        (None, Some(warm)) if flag("warm_start", warm)? && !x_prior => Ok(Start::Recording),
        _ => Ok(Start::State),
    }
}

/// A start by its name.
pub fn start(value: &Bound<'_, PyAny>) -> PyResult<Start> {
    let found = text("start", value)?;
    let known =
        [("recording", Start::Recording), ("state", Start::State), ("unknown", Start::Unknown)];
    known.iter().find(|(name, _)| *name == found).map(|(_, start)| *start).ok_or_else(|| {
        DdmheError::new_err(format!(
            "start: expected \"recording\", \"state\" or \"unknown\", found {found:?}"
        ))
    })
}

fn center(value: &Bound<'_, PyAny>) -> PyResult<Center> {
    if value.extract::<String>().is_ok_and(|s| s == "history") {
        return Ok(Center::History);
    }
    Err(DdmheError::new_err(format!(
        "x_center: expected None or \"history\", found {}",
        shown(value)
    )))
}

/// What `weights` names.
pub fn weighting(value: &Bound<'_, PyAny>) -> PyResult<Weighting> {
    match value.extract::<String>().as_deref() {
        Ok("auto") => Ok(Weighting::Auto),
        Ok("paper") => Ok(Weighting::Paper),
        Ok("scaled") => Ok(Weighting::Scaled),
        _ => Err(DdmheError::new_err(format!(
            "weights: expected \"auto\", \"paper\" or \"scaled\", found {}",
            value.repr()?
        ))),
    }
}

pub fn rest(value: &Bound<'_, PyAny>, n: usize, p: usize) -> PyResult<(Vec<f64>, Vec<f64>)> {
    let [x, y] = &pair("equilibrium", "a pair (x_e, y_e)", value)?;
    Ok((Numbers::vector("equilibrium", x, n)?, Numbers::vector("equilibrium", y, p)?))
}

/// The estimate of one step, with its evidence. Arrays are made when they are first asked for.
#[pyclass(module = "ddmhe", frozen, name = "Estimate")]
pub struct Estimate {
    core: ddmhe_core::Estimate,
    n: usize,
    p: usize,
    x: PyOnceLock<Py<PyArray1<f64>>>,
    window: PyOnceLock<Py<PyArray2<f64>>>,
    v: PyOnceLock<Py<PyArray2<f64>>>,
}

impl Estimate {
    fn new(core: &ddmhe_core::Estimate, n: usize, p: usize) -> Self {
        let (x, window, v) = (PyOnceLock::new(), PyOnceLock::new(), PyOnceLock::new());
        Estimate { core: core.clone(), n, p, x, window, v }
    }
}

#[pymethods]
impl Estimate {
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Made<'py>> {
        made::<Self>(py, "_restore", &to_bytes(Kind::Estimate, &(self.n, self.p, &self.core)))
    }

    #[classmethod]
    fn _restore(_cls: &Bound<'_, PyType>, blob: &Bound<'_, PyAny>) -> PyResult<Self> {
        let (n, p, core): (usize, usize, ddmhe_core::Estimate) =
            from_bytes(Kind::Estimate, bytes(blob)?).map_err(raise)?;
        if n == 0 || p == 0 || !core.fits(n, p) {
            return Err(DdmheError::new_err(
                "blob: expected a saved estimate, found one of other sizes",
            ));
        }
        Ok(Estimate::new(&core, n, p))
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

    /// Cost (17) at the estimate.
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

    /// Number of bounds that the window touches.
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

/// The estimates of a whole run; row k belongs to step k+1 of it.
#[pyclass(module = "ddmhe", frozen, name = "Log")]
pub struct Log {
    /// Estimated states (N, n).
    #[pyo3(get)]
    x: Py<PyArray2<f64>>,
    /// Cost (17) of each step (N,).
    #[pyo3(get)]
    cost: Py<PyArray1<f64>>,
    /// Error bound of each step (N,), with a certificate and the disturbance's size where it can be
    /// relied on; else None, and DdMhe.warnings says why.
    #[pyo3(get)]
    bound: Option<Py<PyArray1<f64>>>,
    status: PyOnceLock<Py<PyAny>>,
    words: Vec<&'static str>,
    /// Number of touched bounds of each step (N,).
    #[pyo3(get)]
    active: Py<PyArray1<i64>>,
    /// Estimate.iterations of each step (N,).
    #[pyo3(get)]
    iterations: Py<PyArray1<i64>>,
}

/// Run many logs on all cores, with the GIL released: the same numbers as estimator.run(Y) for
/// each.
///
/// Parameters
/// ----------
/// estimators : DdMhe, list of DdMhe or list of History
///     One estimator: each log continues from a copy of it, and it does not move itself. A list of
///     estimators, one a log, each only once: a run moves its window on. A list of recordings, one
///     a log: an estimator with default settings for each.
/// logs : list of arrays (N_i, p_i)
///
/// Returns
/// -------
/// list of Log
///
/// Raises
/// ------
/// ShapeError, NotFiniteError, RankError, DdmheError
///     As DdMhe and run, for the first log at fault; nothing has run if a shape is wrong.
/// KeyboardInterrupt
///     Within about 50 ms of Ctrl-C; its attribute `finished` is the list of Logs, each with the
///     steps made by then.
#[pyfunction]
pub fn run_many(
    py: Python<'_>,
    estimators: &Bound<'_, PyAny>,
    logs: &Bound<'_, PyAny>,
) -> PyResult<Vec<Log>> {
    let logs: Vec<Bound<'_, PyAny>> = items("logs", "a list of arrays", logs)?;
    if let Ok(one) = estimators.cast::<DdMhe>() {
        let core = &*one.get().core()?;
        let data = columns(&logs, |_| core.p())?;
        let slices: Vec<&[f64]> = data.iter().map(Vec::as_slice).collect();
        let mut signals = Signals::default();
        let found = py
            .detach(|| ddmhe_core::run_copies(core, &slices, &mut |_| signals.raised()))
            .map_err(raise)?;
        let sizes = vec![(core.n(), core.is_bounded()); found.len()];
        return logged(py, found, sizes, signals);
    }
    let estimators = items("estimators", "a DdMhe or a list of DdMhe or of History", estimators)?;
    if estimators.len() != logs.len() {
        let (expected, found) = (estimators.len(), logs.len());
        return Err(ShapeError::new_err(format!(
            "logs: expected {expected}, one per estimator, found {found}"
        )));
    }
    if !estimators.is_empty() && estimators.iter().all(|item| item.cast::<History>().is_ok()) {
        let histories: Vec<&History> = estimators
            .iter()
            .map(|item| cast_history("estimators", item))
            .collect::<PyResult<_>>()?;
        let data = columns(&logs, |k| histories[k].core.p())?;
        let (histories, slices): (Vec<_>, Vec<&[f64]>) =
            histories.iter().zip(&data).map(|(h, log)| (&h.core, log.as_slice())).unzip();
        let (mut signals, config) = (Signals::default(), Config::default());
        let found = py
            .detach(|| {
                ddmhe_core::run_recordings(&histories, &config, &slices, &mut |_| signals.raised())
            })
            .map_err(raise)?;
        let sizes = histories.iter().map(|history| (history.n(), false)).collect();
        return logged(py, found, sizes, signals);
    }
    let mut borrowed = Vec::with_capacity(estimators.len());
    for (k, item) in estimators.iter().enumerate() {
        let estimator = item.cast::<DdMhe>().map_err(|_| {
            DdmheError::new_err(format!(
                "estimators: expected DdMhe or History, the same throughout, found {} at {k}",
                item.get_type()
            ))
        })?;
        borrowed.push(estimator.get().core().map_err(|_| in_use(k))?);
    }
    let data = columns(&logs, |k| borrowed[k].p())?;
    let sizes: Vec<(usize, bool)> = borrowed.iter().map(|e| (e.n(), e.is_bounded())).collect();
    let mut cores: Vec<&mut ddmhe_core::DdMhe> = borrowed.iter_mut().map(|e| &mut **e).collect();
    let slices: Vec<&[f64]> = data.iter().map(Vec::as_slice).collect();
    let mut signals = Signals::default();
    let found = py
        .detach(|| ddmhe_core::run_many(&mut cores, &slices, &mut |_| signals.raised()))
        .map_err(raise)?;
    logged(py, found, sizes, signals)
}

/// Logs of (n, whether there are error bounds), or what ended the work, with those that there are.
fn logged(
    py: Python<'_>,
    found: Vec<ddmhe_core::Log>,
    sizes: Vec<(usize, bool)>,
    signals: Signals,
) -> PyResult<Vec<Log>> {
    let logs: Vec<Log> = found
        .into_iter()
        .zip(sizes)
        .map(|(log, (n, bounded))| Log::new(py, log, n, bounded, None))
        .collect::<PyResult<_>>()?;
    signals.outcome(py, logs, "the run was stopped")
}

fn in_use(k: usize) -> PyErr {
    DdmheError::new_err(format!(
        "estimators: expected each only once and none at work in another thread, found number {k} in use already"
    ))
}

fn items<'py>(
    argument: &str,
    expected: &str,
    value: &Bound<'py, PyAny>,
) -> PyResult<Vec<Bound<'py, PyAny>>> {
    let wrong = |_| {
        DdmheError::new_err(format!("{argument}: expected {expected}, found {}", value.get_type()))
    };
    value.try_iter().map_err(wrong)?.collect()
}

/// The numbers of each log, which must have p(k) columns.
fn columns(logs: &[Bound<'_, PyAny>], p: impl Fn(usize) -> usize) -> PyResult<Vec<Vec<f64>>> {
    let log = |(k, log): (usize, &Bound<'_, PyAny>)| {
        let (values, _, columns) = Numbers::measured("logs", log)?.into_matrix("logs", "(N, p)")?;
        let expected = p(k);
        if columns == expected {
            return Ok(values);
        }
        Err(ShapeError::new_err(format!(
            "logs: expected {expected} columns in number {k}, found {columns}"
        )))
    };
    logs.iter().enumerate().map(log).collect()
}

/// What `Log._of` takes.
type Columns<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<f64>>,
    Option<Bound<'py, PyArray1<f64>>>,
    Bound<'py, PyAny>,
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<i64>>,
);

#[pymethods]
impl Log {
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Columns<'py>)> {
        let (x, cost) = (self.x.bind(py).clone(), self.cost.bind(py).clone());
        let (active, iterations) = (self.active.bind(py).clone(), self.iterations.bind(py).clone());
        let bound = self.bound.as_ref().map(|bound| bound.bind(py).clone());
        let status = self.status(py)?.into_bound(py);
        Ok((py.get_type::<Self>().getattr("_of")?, (x, cost, bound, status, active, iterations)))
    }

    /// From its columns.
    #[classmethod]
    #[pyo3(signature = (*columns))]
    fn _of(_cls: &Bound<'_, PyType>, columns: &Bound<'_, PyTuple>) -> PyResult<Self> {
        let (x, cost, bound, status, active, iterations): Columns<'_> = columns
            .extract()
            .map_err(|_| DdmheError::new_err("columns: expected those of a Log, found others"))?;
        let words = PyOnceLock::new();
        let _ = words.set(status.py(), status.unbind()); // it was empty
        Ok(Log {
            x: x.unbind(),
            cost: cost.unbind(),
            bound: bound.map(Bound::unbind),
            status: words,
            words: Vec::new(),
            active: active.unbind(),
            iterations: iterations.unbind(),
        })
    }

    /// Status of each step (N,), strings.
    #[getter]
    fn status(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        let made = || -> PyResult<Py<PyAny>> {
            Ok(py.import("numpy")?.call_method1("array", (&self.words, "U16"))?.unbind())
        };
        Ok(self.status.get_or_try_init(py, made)?.clone_ref(py))
    }
}

impl Log {
    /// With `x` where the states have been written already.
    fn new(
        py: Python<'_>,
        log: ddmhe_core::Log,
        n: usize,
        bounded: bool,
        x: Option<Bound<'_, PyArray2<f64>>>,
    ) -> PyResult<Self> {
        let whole = |values: Vec<i64>| PyArray1::from_vec(py, values).unbind();
        Ok(Log {
            x: x.map_or_else(|| array2(py, log.x, n), Ok)?.unbind(),
            cost: array1(py, &log.cost).unbind(),
            bound: bounded.then(|| array1(py, &log.bound).unbind()),
            status: PyOnceLock::new(),
            words: log.status.iter().map(|s| s.as_str()).collect(),
            active: whole(log.active.iter().map(|&a| a as i64).collect()),
            iterations: whole(log.iterations.iter().map(|&i| i64::from(i)).collect()),
        })
    }
}
