//! `ddmhe.DdMhe`.

use crate::bounds::bounds;
use crate::convert::{Numbers, ShapeError, array1, raise, writable};
use crate::estimate::Estimate;
use crate::exclusive::Exclusive;
use crate::frames::Clock;
use crate::history::History;
use crate::in_force::{self, InForce};
use crate::log::Log;
use crate::measured::{inputs, outputs};
use crate::pickle::{Made, bytes, made};
use crate::settings;
use crate::signals::Signals;
use crate::spaces;
use ddmhe_core::{Bounds, Step};
use numpy::{Ix1, Ix2, PyArray1, PyArray2, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::PyTypeInfo;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PySlice, PyTuple, PyType};
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
///     Box on every state of the window; each side a scalar or (n,); infinite = no bound. As in
///     SciPy a list of n pairs, None for no bound, and scipy.optimize.Bounds are taken, too.
/// x_center : None or "history"
///     None: x_bounds are absolute. "history": relative to x_c(t), the window that the recording
///     alone associates with the measured outputs (IV-A1, affine form).
/// v_bounds : (lo, hi), optional
///     Box on the fitted noise; each side a scalar or (p,).
/// equilibrium : (x_e, y_e), or (x_e, y_e, u_e) with inputs, optional
///     A known rest of the system, added to the data as constant windows if the recording is noisy.
/// warm_start : bool, optional
///     The old name: True is start="recording" (beside x_prior, which then counts: "state"), False
///     is start="state".
/// space : "auto" | "exact" | Exact() | "truncated:RANK" | Truncated(rank, tol) | "ridge:WEIGHT" |
///         Ridge(weight)
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
///     no unit. "recorded": those of the recording: its outputs' noise R, its process_noise Q and
///     the error covariance P that a Kalman filter settles to with them; no rho, no mu, windows of
///     its linear model. Without bounds this is that filter. "auto": "paper" beside an explicit rho
///     or mu or a certificate, else "scaled".
/// start : "auto" | "recording" | "state" | "unknown", optional
///     Where a run starts. "auto", the default: as "recording" as long as the first M windows are
///     like those of a run that goes on, else as "unknown" from its first output on, and warnings
///     say so. Until that is decided the estimates of "recording" are handed out; the step that
///     finds out replays the outputs since, and makes the problems that this takes (start="unknown"
///     or a plan has them from the beginning). "recording": where the recording ends; the log goes
///     on from there, and the window starts filled from the recording's end. "state": from x_prior,
///     believed as much as any prior in (17); the window grows from 1 to M. "unknown": anywhere;
///     the window grows from a prior that is as wide as the recorded states. Without evidence, or
///     beside disturbance, the default is "state" from the last recorded state, which assumes that
///     the run starts at (or near) that state.
/// process_noise : None | "recorded" | "residual" | array (n, n) | "auto"
///     A disturbance w(k) that is fitted between x(k) and x(k+1), by its covariance (Remark 1), in
///     products of the units of x. "residual": that of the recording's one-step residuals, right
///     where the recorded states are exact. "recorded": the share of it that makes the recording
///     most likely when its states carry reading noise. "auto": "recorded" beside
///     weights="recorded", else None.
/// w_bounds : (lo, hi), optional
///     Box on the fitted disturbance; each side a scalar or (n,).
/// soft : float > 0, or a mapping {"x": price, "v": price, "w": price}, optional
///     Bounds may be left at that price: a row of the window that is e deviations of its recorded
///     channel outside adds price * (e + e**2) to the cost in scaled units, so that a window always
///     has an estimate. It is the estimate of hard bounds where these can be met at less than that
///     price, and the estimate is outside of the box where not. None, and what a mapping does not
///     name: hard. "x" is the price of bounds that are given to a step, too.
/// output_noise : float or array (p,), optional
///     Standard deviation of the noise of later outputs, where it is more than the recording's; an
///     exact recording shows none. Evidence alone uses it.
/// drift : array (n, n), optional
///     Covariance that each sample adds to the error of the states, for what no output shows and
///     the recording did not do. Evidence alone uses it.
/// evidence : bool
///     Whether estimates carry evidence: covariance, std, trusted, reasons. The estimates are the
///     same without (beside the same start), and a step is cheaper.
/// gate : "auto" | float > 1, optional
///     Outputs that cannot be right are rejected: an entry of the newest output that differs from
///     what all others say it is by more than so many standard deviations ("auto": 4) counts as not
///     measured. The scale widens where errors grow with the motion. Four rejections in a row to
///     one side are a jump of the state: the run starts again four samples ago, from a state that
///     is unknown. See Estimate.evidence.gated and .restarted.
/// stuck : "tell" | "missing"
///     What becomes of an output that repeats one value longer than it ever did in the recording:
///     it is told (Reason.STUCK), or counts as not measured, with its repetitions.
///
/// Raises
/// ------
/// ShapeError, NotFiniteError, RankError, DdmheError
///     One clear error naming the argument. What the optimisation finds is never an error: see
///     Estimate.status.
///
/// Examples
/// --------
/// >>> import numpy as np
/// >>> import ddmhe
/// >>> record = ddmhe.models.detumbling().simulate(duration=40.0, dt=0.1, noise=0.01)
/// >>> estimator = ddmhe.DdMhe(record.history(200), x_bounds=(-0.5, 0.5))
/// >>> estimate = estimator.step(record.y[200])  # the state at sample 201
/// >>> estimate.status, estimate.x.shape, estimate.trusted
/// ('optimal', (3,), True)
/// >>> log = estimator.run(record.y[201:300])
/// >>> bool(np.abs(log.x - record.x[202:301]).max() < 0.01)  # rad/s
/// True
#[pyclass(module = "ddmhe", frozen, name = "DdMhe")]
pub struct DdMhe {
    core: Exclusive<ddmhe_core::DdMhe>,
}

impl DdMhe {
    fn of(core: ddmhe_core::DdMhe) -> Self {
        DdMhe { core: Exclusive::new(core) }
    }

    pub fn core(&self) -> PyResult<MutexGuard<'_, ddmhe_core::DdMhe>> {
        self.core.get("an estimator")
    }
}

#[pymethods]
impl DdMhe {
    #[new]
    #[pyo3(
        signature = (history, *places, **names),
        text_signature = "(history, horizon=None, rho=None, mu=None, x_prior=None, \
            x_bounds=None, x_center=None, v_bounds=None, equilibrium=None, warm_start=None, \
            space='auto', certificate=None, disturbance=None, *, weights='auto', start=None, \
            process_noise='auto', w_bounds=None, soft=None, output_noise=None, drift=None, \
            evidence=True, gate=None, stuck='tell')"
    )]
    fn new(
        history: &Bound<'_, PyAny>,
        places: &Bound<'_, PyTuple>,
        names: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let settings = settings::bound("DdMhe", places, names)?;
        let history = History::cast("history", history)?;
        let config = settings::config(&settings, Some(history.sizes()))?;
        let made = || ddmhe_core::DdMhe::new(&history.core, config);
        Ok(DdMhe::of(places.py().detach(made).map_err(raise)?))
    }

    /// Consume y(t-1) and estimate x(t), at step number t.
    ///
    /// y_t : array (p,), NaN where this entry was not measured.
    /// u : array (m,), the known inputs at the same instant, all of them; None without inputs.
    /// x_bounds : (lo, hi) for this step alone; each side a scalar, (n,), or one row per state of
    ///     the window (M_t+1, n). With x_center="history" they are about this step's centre, as
    ///     those of construction are, which they replace.
    /// out : float64 array (n,), optional. It receives the state and is returned in the place of
    ///     an Estimate, so that nothing is allocated; all else about the step is in `estimate`.
    #[pyo3(signature = (y_t, u=None, *, x_bounds=None, out=None))]
    fn step<'py>(
        &self,
        py: Python<'py>,
        y_t: &Bound<'py, PyAny>,
        u: Option<&Bound<'py, PyAny>>,
        x_bounds: Option<&Bound<'py, PyAny>>,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let mut core = self.core()?;
        let (n, p) = (core.n(), core.p());
        let limits: Option<Bounds> =
            x_bounds.map(|v| bounds("x_bounds", v, n, Some(core.next_depth()))).transpose()?;
        // checked first, and let go: it may be y_t itself
        out.map(|out| writable::<Ix1>("out", out, &[n])).transpose()?;
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
        let u = match u {
            Some(_) if core.history().m() == 0 => {
                return Err(ShapeError::new_err(
                    "u: expected none, for a recording without inputs",
                ));
            }
            Some(u) => Numbers::vector("u", u, core.history().m())?,
            None => Vec::new(),
        };
        let step = Step { y, u: &u, x_bounds: limits.as_ref() };
        let clock = Clock::of(&core);
        let estimate = core.step_with(step).map_err(raise)?;
        drop(array);
        let Some(out) = out else {
            return Ok(Bound::new(py, Estimate::new(estimate, n, p, clock))?.into_any());
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
        Ok((!estimate.x.is_empty())
            .then(|| Estimate::new(estimate, core.n(), core.p(), Clock::behind(&core))))
    }

    /// Estimate over a whole log Y (N, p), with the GIL released: the same numbers as N calls of
    /// step.
    ///
    /// U : array (N, m), the known inputs at the same instants; None without inputs.
    /// out : float64 array (N, n), optional. It receives the states and is the Log's x.
    ///
    /// A KeyboardInterrupt (any exception of a signal's handler) ends the run within about 50 ms.
    /// The estimator then stands behind the last step made, and the Log of the steps made is the
    /// exception's attribute `finished`.
    #[pyo3(signature = (Y, U=None, *, out=None))]
    #[allow(non_snake_case)]
    fn run(
        &self,
        py: Python<'_>,
        Y: &Bound<'_, PyAny>,
        U: Option<&Bound<'_, PyAny>>,
        out: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Log> {
        let mut core = self.core()?;
        let core = &mut *core;
        let (n, p) = (core.n(), core.p());
        let (data, rows) = outputs("Y", Y, p)?;
        let inputs = inputs("U", U, (rows, core.history().m()))?;
        let room = out.map(|out| writable::<Ix2>("out", out, &[rows, n])).transpose()?;
        let clock = Clock::of(core);
        let mut signals = Signals::default();
        let log = ddmhe_core::Signals { y: &data, u: &inputs };
        let log = py.detach(|| core.run_until(log, &mut || signals.raised())).map_err(raise)?;
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
        let log = Log::new(py, log, (n, p), core.is_bounded(), x, clock)?;
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
        let given = start.map(settings::start).transpose()?;
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

    /// Number of known inputs; 0 for a system without.
    #[getter]
    fn m(&self) -> PyResult<usize> {
        Ok(self.core()?.history().m())
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

    /// What rho and mu are meant in, "paper" or "scaled"; or "recorded".
    #[getter]
    fn weights(&self) -> PyResult<&'static str> {
        Ok(in_force::weights(self.core()?.settings().weights))
    }

    /// The settings in force, and for what was left open why.
    #[getter]
    fn settings(&self) -> PyResult<InForce> {
        Ok(InForce::new(&*self.core()?))
    }

    /// What the recording promises (n,): the root-mean-square error of each state in windows that
    /// were held out of it; NaN where it is too short for that, None without evidence.
    #[getter]
    fn promise<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray1<f64>>>> {
        Ok(self.core()?.promise().map(|promise| array1(py, promise)))
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
