//! The engine of `ddmhe.interval.IntervalObserver`.

use crate::convert::{DdmheError, Numbers, ShapeError, raise, text, whole};
use crate::exclusive::Exclusive;
use crate::interval::dynamics::{Dynamics, Raised};
use crate::interval::ends::{Ends, ends};
use crate::interval::estimate::IntervalEstimate;
use crate::interval::log::IntervalLog;
use crate::interval::zonotope::reduction;
use crate::measured::outputs;
use crate::pickle::bytes;
use crate::signals::{Signals, with_finished};
use crate::words::quoted;
use ddmhe_core::observer::{Dynamics as Enclose, Gain, Method, Options, System};
use ddmhe_core::{Error, Interrupt};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::sync::{MutexGuard, PoisonError};

/// The compiled part of `ddmhe.interval.IntervalObserver`, which checks and documents.
#[pyclass(module = "ddmhe._core", frozen, name = "ObserverCore")]
pub struct ObserverCore {
    core: Exclusive<Observer>,
    raised: Raised,
}

type Observer = ddmhe_core::IntervalObserver<Box<dyn Enclose + Send + Sync>>;

impl ObserverCore {
    fn core(&self) -> PyResult<MutexGuard<'_, Observer>> {
        self.core.get("an observer")
    }

    /// What a callable raised, if that interrupted it.
    fn taken(&self) -> Option<PyErr> {
        self.raised.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    /// The exception of a core error: what a callable raised, if that interrupted it.
    fn raise(&self, error: Error) -> PyErr {
        self.taken().unwrap_or_else(|| raise(error))
    }
}

#[pymethods]
impl ObserverCore {
    #[new]
    #[pyo3(signature = (dynamics, matrices, gain, x0_center, x0_radius, order, method, reduce))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        dynamics: &Bound<'_, Dynamics>,
        matrices: &Bound<'_, PyAny>,
        gain: &Bound<'_, PyAny>,
        x0_center: Vec<f64>,
        x0_radius: Vec<f64>,
        order: &Bound<'_, PyAny>,
        method: &Bound<'_, PyAny>,
        reduce: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let (name, reduce) = (text("method", method)?, text("reduction", reduce)?);
        let system = system(matrices)?;
        let gain = design(gain)?;
        let method = Method::ALL.into_iter().find(|m| m.as_str() == name).ok_or_else(|| {
            let text = format!("method: expected \"tight\" or \"paper\", found {}", quoted(&name));
            DdmheError::new_err(text)
        })?;
        let options =
            Options { order: whole("order", order)?, method, reduction: reduction(&reduce)? };
        let raised = Raised::default();
        let n = x0_center.len();
        dynamics.get().check(n, system.C.len() / n.max(1))?;
        let dynamics = dynamics.get().enclosing(dynamics.py(), &raised);
        let core = ddmhe_core::IntervalObserver::new(
            dynamics, system, gain, &x0_center, &x0_radius, options,
        );
        Ok(ObserverCore { core: Exclusive::new(core.map_err(raise)?), raised })
    }

    /// What an observer does unless told otherwise: (order, method, reduction).
    #[staticmethod]
    fn defaults() -> (usize, &'static str, &'static str) {
        let Options { order, method, reduction } = Options::default();
        (order, method.as_str(), reduction.as_str())
    }

    /// Where the observer stands, for resume.
    fn present<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        Ok(PyBytes::new(py, &self.core()?.present()))
    }

    /// Continues from where an observer with the same arguments stood.
    fn resume(&self, blob: &Bound<'_, PyAny>) -> PyResult<()> {
        self.core()?.resume(bytes(blob)?).map_err(raise)
    }

    fn step(
        &self,
        y: &Bound<'_, PyAny>,
        u: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<IntervalEstimate> {
        let mut core = self.core()?;
        let y = Numbers::measured("y", y)?.into_vector("y", core.p())?;
        let u = u.map(|u| Numbers::vector("u", u, core.inputs())).transpose()?.unwrap_or_default();
        core.step(&y, &u).map(|e| IntervalEstimate(e.clone())).map_err(|e| self.raise(e))
    }

    fn run(
        &self,
        py: Python<'_>,
        y: &Bound<'_, PyAny>,
        u: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<IntervalLog> {
        let mut core = self.core()?;
        let core = &mut *core;
        let (p, inputs) = (core.p(), core.inputs());
        let (Y, rows) = outputs("Y", y, p)?;
        let channels = |u| match inputs {
            1 => Numbers::from("U", u)?.into_channels("U", "(N, 1)"),
            _ => Numbers::matrix("U", u, &format!("({rows}, {inputs})")),
        };
        let U = u.map(channels).transpose()?;
        if U.as_ref().is_some_and(|(_, r, w)| (*r, *w) != (rows, inputs)) {
            return Err(ShapeError::new_err(format!(
                "U: expected ({rows}, {inputs}), found another shape"
            )));
        }
        let U = U.map(|(data, ..)| data).unwrap_or_default();
        let mut log = IntervalLog::empty(core.n(), rows);
        let mut signals = Signals::default();
        let found = py.detach(|| {
            let mut stop = || signals.raised();
            run(core, &Y, &U, &mut log, &mut Interrupt::new(&mut stop))
        });
        let words = format!("{} of {rows} steps were made", log.rows());
        match (found, self.taken()) {
            (Err(_), Some(raised)) => Err(with_finished(py, raised, log, &words)),
            (Err(error), None) => Err(raise(error)),
            (Ok(()), _) => signals.outcome(py, log, &words),
        }
    }

    fn reset(&self) -> PyResult<()> {
        self.core()?.reset();
        Ok(())
    }

    /// Bounds of x(0) before the first step, of x(k) after k: (lo, hi).
    fn predicted<'py>(&self, py: Python<'py>) -> PyResult<Ends<'py>> {
        Ok(ends(py, &self.core()?.estimate().predicted))
    }
}

/// Steps through Y and U (empty: no input) until they end, `interrupt` does, or a sample
/// contradicts the model.
fn run(
    core: &mut Observer,
    Y: &[f64],
    U: &[f64],
    log: &mut IntervalLog,
    interrupt: &mut Interrupt<'_>,
) -> Result<(), Error> {
    let inputs = core.inputs();
    for (k, y) in Y.chunks_exact(core.p()).enumerate() {
        if interrupt.stopped() {
            break;
        }
        let u = if U.is_empty() { U } else { &U[k * inputs..(k + 1) * inputs] };
        match core.step(y, u) {
            Err(violation @ Error::ModelViolation { .. }) => {
                log.violation = Some(violation.to_string());
                break;
            }
            step => log.push(step?),
        }
    }
    Ok(())
}

fn flat(value: &Bound<'_, PyAny>) -> PyResult<Vec<f64>> {
    Numbers::from("system", value).map(|v| v.data)
}

/// The linear parts by their names.
fn system(matrices: &Bound<'_, PyAny>) -> PyResult<System> {
    let part = |name: &str| flat(&matrices.get_item(name)?);
    Ok(System {
        A: part("A")?,
        B: part("B")?,
        C: part("C")?,
        r: part("r")?,
        D1: part("D1")?,
        D2: part("D2")?,
        j_lo: part("j_lo")?,
        j_hi: part("j_hi")?,
        w_radius: part("w_radius")?,
        v_radius: part("v_radius")?,
    })
}

/// The gain and its bounds by their names.
fn design(gain: &Bound<'_, PyAny>) -> PyResult<Gain> {
    let part = |name: &str| flat(&gain.get_item(name)?);
    let of = |name: &str| -> PyResult<f64> { gain.get_item(name)?.extract() };
    Ok(Gain {
        L: part("L")?,
        P: part("P")?,
        lambda: of("lam")?,
        gamma: of("gamma")?,
        mu_w: of("mu_w")?,
        mu_v: of("mu_v")?,
        weights: part("weights")?,
    })
}
