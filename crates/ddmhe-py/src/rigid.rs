//! `ddmhe.RigidBodyMhe`.

use crate::bounds::bounds;
use crate::convert::{DdmheError, Numbers, ShapeError, raise, text, writable};
use crate::estimate::Estimate;
use crate::exclusive::Exclusive;
use crate::field::known_field;
use crate::frames::Clock;
use crate::history::History;
use crate::log::Log;
use crate::measured::outputs;
use crate::mhe::DdMhe;
use crate::pickle::{Made, bytes, made};
use crate::rigid_report::RigidBodyReport;
use crate::signals::Signals;
use ddmhe_core::rigid::{KnownField, Measured, Refits, RigidConfig};
use numpy::{Ix1, Ix2, PyArray2};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PySlice, PyType};
use std::sync::MutexGuard;
use std::time::{Duration, Instant};

/// The rates of a tumbling rigid body that eddy currents brake, from a torque.
///
/// Euler's equation is all that is known beforehand: inertia, drag and the map to the outputs are
/// fitted to the recording, and refined by what is measured after it. The estimate holds where the
/// motion has left the recording. Where no rigid body explains the recording, a DdMhe estimates in
/// its place.
///
/// Parameters
/// ----------
/// history : History
///     Three rates (rad/s, about axes fixed in the body) and one to six outputs, at least 100
///     samples, without inputs. Up to eight recordings of one body, each at a spin of its own: the
///     run goes on from the end of the last. A history of other sizes is no body's: a DdMhe
///     estimates.
/// x_noise : float or array (3,), optional
///     Standard deviation of the noise on recorded rates; None: as fifth differences show.
/// y_noise : float or array (p,), optional
///     The same of recorded outputs.
/// output_noise : float or array (p,), optional
///     Of later outputs; None: as on recorded ones.
/// x_bounds : (lo, hi), optional
///     Box on the rates; each side a scalar or (3,). None: what the recorded energy allows a body
///     that is braked, where one explains the recording.
/// field : (B, K), optional
///     A magnetic field that is known and moves, since the magnet turns or is modulated: B (T, 3)
///     and K (T, p, 3) at the outputs of the recording, or (T+1, 3) and (T+1, p, 3) with that at
///     its last rate, which is left out else. The body is then braked by B × M (B × ω), and the
///     outputs are
///     -κ K M (B × ω), with M symmetric and κ a number; up to three outputs. Each step takes the
///     field, too.
/// rate_noise : float or array (3,), optional
///     Standard deviation of the noise on rates that are measured later (step's x); None: as on
///     recorded ones.
/// output_lag : bool, optional
///     Whether the outputs lag behind the motion by a time that is fitted, too, as those of
///     first-order sensors do; up to three outputs. None: only where no body explains all data
///     without. A small lag is seen late or not at all: say True of sensors that are known to have
///     one, or may.
/// fallback : DdMhe, optional
///     What estimates where no rigid body does, as it stands; None: one with its defaults, this box
///     and this noise.
/// refit : "now" | "sliced" | "manual"
///     When the motion is fitted anew to recording and all outputs since, which is due .25, .35,
///     .5, .7, 1, 1.4 and 2 lengths of the recording (of all together) behind its end, and then
///     each time that 1.15 times as much has passed, up to 32. "now": in the steps that it is due
///     in, which take some 10 ms to some 100 ms. "sliced": a little with each step, while the
///     filter goes on; fits then come somewhat later, and errors are up to some 10 % larger in the
///     mean. "manual": when refit is called, which may have a budget of time.
/// optima : int
///     How many motions that may have made the data are followed at once, 1 to 4, each with its
///     probability: the estimate is their mean, and its covariance has how far they are apart. 1:
///     the most probable one alone.
///
/// Raises
/// ------
/// ShapeError, NotFiniteError, RankError, DdmheError
///     One clear error naming the argument.
///
/// Examples
/// --------
/// >>> import numpy as np
/// >>> import ddmhe
/// >>> record = ddmhe.models.detumbling().simulate(duration=60.0, dt=0.1, noise=0.01)
/// >>> body = ddmhe.RigidBodyMhe(record.history(200))
/// >>> log = body.run(record.y[200:-1])
/// >>> body.explained, bool(np.abs(log.x - record.x[201:]).max() < 1e-3)  # rad/s
/// (True, True)
#[pyclass(module = "ddmhe", frozen, name = "RigidBodyMhe")]
pub struct RigidBodyMhe {
    core: Exclusive<ddmhe_core::RigidBodyMhe>,
}

impl RigidBodyMhe {
    fn of(core: ddmhe_core::RigidBodyMhe) -> Self {
        RigidBodyMhe { core: Exclusive::new(core) }
    }

    fn core(&self) -> PyResult<MutexGuard<'_, ddmhe_core::RigidBodyMhe>> {
        self.core.get("an estimator")
    }
}

/// Of estimates that follow so many steps.
fn clock(core: &ddmhe_core::RigidBodyMhe, before: usize) -> Clock {
    Clock { before, dt: core.history().dt() }
}

/// A number, or several.
fn levels(argument: &str, given: Option<&Bound<'_, PyAny>>) -> PyResult<Option<Vec<f64>>> {
    let Some(given) = given else { return Ok(None) };
    let numbers = Numbers::from(argument, given)?;
    let count = numbers.data.len();
    numbers.into_vector(argument, count).map(Some)
}

fn refits(given: &Bound<'_, PyAny>) -> PyResult<Refits> {
    match &text("refit", given)?[..] {
        "sliced" => Ok(Refits::Sliced),
        "now" => Ok(Refits::Now),
        "manual" => Ok(Refits::Manual),
        other => Err(DdmheError::new_err(format!(
            "refit: expected \"now\", \"sliced\" or \"manual\", found \"{other}\""
        ))),
    }
}

#[pymethods]
impl RigidBodyMhe {
    #[new]
    #[pyo3(
        signature = (history, *, x_noise=None, y_noise=None, output_noise=None, x_bounds=None,
            field=None, rate_noise=None, output_lag=None, fallback=None, refit=None, optima=4),
        text_signature = "(history, *, x_noise=None, y_noise=None, output_noise=None, \
            x_bounds=None, field=None, rate_noise=None, output_lag=None, fallback=None, \
            refit='now', optima=4)"
    )]
    #[allow(clippy::too_many_arguments)] // as many as users see
    fn new(
        history: &Bound<'_, PyAny>,
        x_noise: Option<&Bound<'_, PyAny>>,
        y_noise: Option<&Bound<'_, PyAny>>,
        output_noise: Option<&Bound<'_, PyAny>>,
        x_bounds: Option<&Bound<'_, PyAny>>,
        field: Option<&Bound<'_, PyAny>>,
        rate_noise: Option<&Bound<'_, PyAny>>,
        output_lag: Option<bool>,
        fallback: Option<&Bound<'_, DdMhe>>,
        refit: Option<&Bound<'_, PyAny>>,
        optima: usize,
    ) -> PyResult<Self> {
        let py = history.py();
        let history = History::cast("history", history)?;
        let recorded = &[history.core.T(), history.core.T() + 1];
        let config = RigidConfig {
            x_noise: levels("x_noise", x_noise)?,
            y_noise: levels("y_noise", y_noise)?,
            output_noise: levels("output_noise", output_noise)?,
            x_bounds: x_bounds
                .map(|v| bounds("x_bounds", v, history.core.n(), None))
                .transpose()?,
            field: field.map(|field| known_field(field, recorded, history.core.p())).transpose()?,
            rate_noise: levels("rate_noise", rate_noise)?,
            output_lag,
            refit: refit.map(refits).transpose()?.unwrap_or_default(),
            optima,
        };
        let fallback = fallback.map(|own| Ok::<_, PyErr>(own.get().core()?.clone())).transpose()?;
        let made = || ddmhe_core::RigidBodyMhe::new(&history.core, config, fallback);
        Ok(RigidBodyMhe::of(py.detach(made).map_err(raise)?))
    }

    /// Consume y(t-1) and estimate the rates at t, at step number t.
    ///
    /// y_t : array (p,), NaN where this entry was not measured.
    /// x : array (3,), optional. Rates (rad/s) that a sensor read at the instant of y_t, NaN where
    /// it
    ///     did not; their noise is rate_noise.
    /// field : (B, K), arrays (3,) and (p, 3). The field at the instant of y_t, of an estimator
    /// that was
    ///     made with one. The rates at t are foretold with the field as it would go on linearly;
    ///     the next step puts what it then is in the place of that.
    /// out : float64 array (3,), optional. It receives the rates and is returned in the place of an
    ///     Estimate; all else about the step is in `estimate`.
    #[pyo3(signature = (y_t, *, x=None, field=None, out=None))]
    fn step<'py>(
        &self,
        py: Python<'py>,
        y_t: &Bound<'py, PyAny>,
        x: Option<&Bound<'py, PyAny>>,
        field: Option<&Bound<'py, PyAny>>,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let mut core = self.core()?;
        let core = &mut *core;
        let (n, p) = (core.n(), core.p());
        out.map(|out| writable::<Ix1>("out", out, &[n])).transpose()?;
        let clock = clock(core, core.t());
        let y = Numbers::measured("y_t", y_t)?.into_vector("y_t", p)?;
        let rates = x.map(|x| Numbers::measured("x", x)?.into_vector("x", 3)).transpose()?;
        let field = field.map(|field| known_field(field, &[], p)).transpose()?;
        let field = field.as_ref().map(|KnownField { B, K }| (&B[..], &K[..]));
        let sample = Measured { y: &y, x: rates.as_deref(), field };
        let estimate = py.detach(|| core.step_with(sample));
        let estimate = estimate.map_err(raise)?;
        let Some(out) = out else {
            return Ok(Bound::new(py, Estimate::new(estimate, n, p, clock))?.into_any());
        };
        writable::<Ix1>("out", out, &[n])?.as_slice_mut()?.copy_from_slice(&estimate.x);
        Ok(out.clone())
    }

    /// Estimate over a whole log Y (N, p), with the GIL released: the same numbers as N calls of
    /// step.
    ///
    /// X : array (N, 3), optional. Rates (rad/s) that a sensor read at the instants of Y, NaN where
    /// it
    ///     did not.
    /// field : (B, K), arrays (N, 3) and (N, p, 3). The field at the instants of Y, of an estimator
    /// that
    ///     was made with one.
    /// out : float64 array (N, 3), optional. It receives the rates and is the Log's x.
    ///
    /// A KeyboardInterrupt ends the run as in DdMhe.run.
    #[pyo3(signature = (Y, *, X=None, field=None, out=None))]
    #[allow(non_snake_case)]
    fn run(
        &self,
        py: Python<'_>,
        Y: &Bound<'_, PyAny>,
        X: Option<&Bound<'_, PyAny>>,
        field: Option<&Bound<'_, PyAny>>,
        out: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Log> {
        let mut core = self.core()?;
        let core = &mut *core;
        let (states, p) = (core.n(), core.p());
        let (data, rows) = outputs("Y", Y, p)?;
        let rates = X.map(|X| Numbers::measured("X", X)?.into_matrix("X", "(N, 3)")).transpose()?;
        if let Some((_, n, width)) = &rates
            && (*n, *width) != (rows, 3)
        {
            let found = format!("X: expected ({rows}, 3), found ({n}, {width})");
            return Err(ShapeError::new_err(found));
        }
        let room = out.map(|out| writable::<Ix2>("out", out, &[rows, states])).transpose()?;
        let mut signals = Signals::default();
        let clock = clock(core, core.t());
        let field = field.map(|field| known_field(field, &[rows], p)).transpose()?;
        let field = field.as_ref().map(|KnownField { B, K }| (&B[..], &K[..]));
        let samples = Measured { y: &data, x: rates.as_ref().map(|(x, ..)| &x[..]), field };
        let run = || core.run_until(&samples, &mut || signals.raised());
        let log = py.detach(run).map_err(raise)?;
        let made = log.status.len();
        let x = match (out, room) {
            (Some(out), Some(mut room)) => {
                room.as_slice_mut()?[..made * states].copy_from_slice(&log.x);
                let x = match made == rows {
                    true => out.clone(),
                    false => out.get_item(PySlice::new(py, 0, made as isize, 1))?,
                };
                Some(x.cast_into::<PyArray2<f64>>()?)
            }
            _ => None,
        };
        let log = Log::new(py, log, (states, p), false, x, clock)?;
        signals.outcome(py, log, &format!("{made} of {rows} steps were made"))
    }

    /// Fit the motion anew to recording and all outputs since; whether a rigid body explains them.
    /// False, too, where refit is not "manual" and more has passed than outputs are kept.
    ///
    /// budget_s : float, optional
    ///     Stop after about so many seconds. None is then returned where that was not enough; the
    ///     next call goes on from there, with steps in between or without, and at the end the
    ///     estimates are of the new motion. None: to the end, of all that was measured up to now.
    #[pyo3(signature = (budget_s=None))]
    fn refit(&self, py: Python<'_>, budget_s: Option<f64>) -> PyResult<Option<bool>> {
        let mut core = self.core()?;
        let core = &mut *core;
        let Some(budget) = budget_s else { return Ok(Some(py.detach(|| core.refit()))) };
        let budget = Duration::try_from_secs_f64(budget).map_err(|_| {
            let expected = "budget_s: expected seconds, 0 or more";
            DdmheError::new_err(format!("{expected}, found {budget}"))
        })?;
        let begun = Instant::now();
        Ok(py.detach(|| core.refit_while(&mut || begun.elapsed() < budget)))
    }

    /// Back to the recording's end, as constructed.
    fn reset(&self) -> PyResult<()> {
        self.core()?.reset().map_err(raise)
    }

    /// The estimator with its recording as bytes; see restore.
    fn snapshot<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        Ok(PyBytes::new(py, &self.core()?.snapshot()))
    }

    /// The estimator that snapshot saved; its next steps give the same numbers. The recording is
    /// fitted again.
    #[staticmethod]
    fn restore(blob: &Bound<'_, PyAny>) -> PyResult<Self> {
        Ok(RigidBodyMhe::of(ddmhe_core::RigidBodyMhe::restore(bytes(blob)?).map_err(raise)?))
    }

    /// A copy that continues on its own.
    fn __copy__(&self) -> PyResult<Self> {
        Ok(RigidBodyMhe::of(self.core()?.clone()))
    }

    fn __deepcopy__(&self, _memo: &Bound<'_, PyAny>) -> PyResult<Self> {
        self.__copy__()
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
        let clock = clock(&core, core.t().saturating_sub(1));
        Ok((!estimate.x.is_empty()).then(|| Estimate::new(estimate, core.n(), core.p(), clock)))
    }

    /// Whether a rigid body explains the recording.
    #[getter]
    fn explained(&self) -> PyResult<bool> {
        Ok(self.core()?.explained())
    }

    /// What is known of the body as of now, a RigidBodyReport; None where no fit of the recording
    /// came to an end.
    fn report(&self) -> PyResult<Option<RigidBodyReport>> {
        Ok(self.core()?.report().map(|core| RigidBodyReport { core }))
    }

    /// Number of states, 3 of a body.
    #[getter]
    fn n(&self) -> PyResult<usize> {
        Ok(self.core()?.n())
    }

    /// Number of outputs.
    #[getter]
    fn p(&self) -> PyResult<usize> {
        Ok(self.core()?.p())
    }

    /// Steps since the start or the last reset.
    #[getter]
    fn t(&self) -> PyResult<usize> {
        Ok(self.core()?.t())
    }

    /// What to know about the recording and this run, in words.
    #[getter]
    fn warnings(&self) -> PyResult<Vec<String>> {
        Ok(self.core()?.warnings())
    }

    fn __repr__(&self) -> String {
        let Ok(core) = self.core() else { return "RigidBodyMhe(at work in another call)".into() };
        let explained = if core.explained() { "True" } else { "False" };
        format!("RigidBodyMhe(p={}, explained={explained}, t={})", core.p(), core.t())
    }
}
