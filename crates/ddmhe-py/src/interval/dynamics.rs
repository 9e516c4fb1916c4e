//! The nonlinear part of a system: what ships with the core, or Python functions.

use crate::convert::{Numbers, ShapeError, array1, array2, raise};
use crate::interval::ends::{ends, intervals};
use crate::words::said;
use ddmhe_core::observer::{Dynamics as Enclose, Euler, Linear, Pendulum, Uncertain};
use ddmhe_core::{Error, Interval};
use numpy::{PyArray1, PyArray2};
use pyo3::IntoPyObjectExt;
use pyo3::exceptions::PyException;
use pyo3::prelude::*;
use std::sync::{Arc, Mutex, PoisonError};

/// How the core computes the nonlinear part f of a system, and its Jacobian.
///
/// One of the constructors below says which; `f` and `jacobian` are those that the observer
/// encloses.
#[pyclass(module = "ddmhe._core", frozen, name = "Dynamics")]
pub struct Dynamics(Kind);

enum Kind {
    Linear,
    Pendulum(Pendulum),
    Euler(Euler),
    Uncertain(Uncertain),
    Python(Callables),
}

#[pymethods]
impl Dynamics {
    /// f = 0.
    #[staticmethod]
    fn linear() -> Self {
        Dynamics(Kind::Linear)
    }

    /// f = (0, -gain sin x1).
    #[staticmethod]
    fn pendulum(gain: f64) -> Self {
        Dynamics(Kind::Pendulum(Pendulum { gain }))
    }

    /// f = (a1 x2 x3, a2 x3 x1, a3 x1 x2) + dN x: ratios a (lo, hi), (3,) each; linear dN (lo, hi),
    /// (9,) each by rows; output_radius (3 p,) of C by rows.
    #[staticmethod]
    fn euler(
        ratios: (Vec<f64>, Vec<f64>),
        linear: (Vec<f64>, Vec<f64>),
        output_radius: Vec<f64>,
    ) -> PyResult<Self> {
        let of = |pair: &(Vec<f64>, Vec<f64>)| intervals("dynamics", &pair.0, &pair.1);
        let lengths = [ratios.0.len(), ratios.1.len(), linear.0.len(), linear.1.len()];
        if lengths != [3, 3, 9, 9] {
            return Err(ShapeError::new_err(format!(
                "dynamics: expected ends of 3 ratios and 9 entries, found {lengths:?} numbers"
            )));
        }
        let mut euler =
            Euler { ratios: [Interval::ZERO; 3], linear: [Interval::ZERO; 9], output_radius };
        euler.ratios.copy_from_slice(&of(&ratios)?);
        euler.linear.copy_from_slice(&of(&linear)?);
        Ok(Dynamics(Kind::Euler(euler)))
    }

    /// f = offset + D (x, 1), where row i of D is in a rotated box: `rows` hold the generators of
    /// each, n + 1 numbers a generator, those of the n states first, then those of the outputs.
    #[staticmethod]
    fn uncertain(rows: Vec<Vec<f64>>, offset: Vec<f64>) -> PyResult<Self> {
        let n = offset.len();
        if rows.len() < n || rows.iter().any(|row| !row.len().is_multiple_of(n + 1)) {
            return Err(ShapeError::new_err(format!(
                "dynamics: expected at least {n} rows of generators, {} numbers each, found others",
                n + 1
            )));
        }
        Ok(Dynamics(Kind::Uncertain(Uncertain { n, rows, offset })))
    }

    /// f(x) -> (n,) and jacobian(lo, hi) -> (J_lo, J_hi), each value right to the relative `slack`.
    #[staticmethod]
    fn python(f: Py<PyAny>, jacobian: Py<PyAny>, slack: f64) -> Self {
        Dynamics(Kind::Python(Callables { f, jacobian, slack, raised: Raised::default() }))
    }

    /// Whether f holds no parameter that is only known within bounds.
    #[getter]
    fn exact(&self) -> bool {
        !matches!(self.0, Kind::Euler(_) | Kind::Uncertain(_))
    }

    /// Generators of each uncertain row, or None.
    #[getter]
    fn rows(&self) -> Option<Vec<Vec<f64>>> {
        match &self.0 {
            Kind::Uncertain(u) => Some(u.rows.clone()),
            _ => None,
        }
    }

    /// Known constant (n,) of uncertain rows, or None.
    #[getter]
    fn offset(&self) -> Option<Vec<f64>> {
        match &self.0 {
            Kind::Uncertain(u) => Some(u.offset.clone()),
            _ => None,
        }
    }

    /// f(x) (n,), in the middle of what the observer takes it for.
    fn f<'py>(
        &self,
        py: Python<'py>,
        x: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let x = self.sized("x", x)?;
        let mut value = vec![Interval::ZERO; x.len()];
        self.enclosing(py, &Raised::default()).value(&x, &mut value).map_err(raise)?;
        Ok(array1(py, &value.iter().map(|v| v.mid()).collect::<Vec<_>>()))
    }

    /// Df over the box from lo to hi: ends (J_lo, J_hi), (n, n) each.
    fn jacobian<'py>(
        &self,
        py: Python<'py>,
        lo: &Bound<'py, PyAny>,
        hi: &Bound<'py, PyAny>,
    ) -> PyResult<Matrices<'py>> {
        let lo = self.sized("lo", lo)?;
        let x = intervals("lo", &lo, &Numbers::vector("hi", hi, lo.len())?)?;
        let mut J = vec![Interval::ZERO; x.len() * x.len()];
        self.enclosing(py, &Raised::default()).jacobian(&x, &mut J).map_err(raise)?;
        let side = |end: fn(&Interval) -> f64| array2(py, J.iter().map(end).collect(), x.len());
        Ok((side(|v| v.lo)?, side(|v| v.hi)?))
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Made<'py>> {
        let (name, arguments) = match &self.0 {
            Kind::Linear => ("linear", ().into_bound_py_any(py)?),
            Kind::Pendulum(p) => ("pendulum", (p.gain,).into_bound_py_any(py)?),
            Kind::Euler(e) => {
                let sides = |x: &[Interval]| -> (Vec<f64>, Vec<f64>) {
                    x.iter().map(|x| (x.lo, x.hi)).unzip()
                };
                let given = (sides(&e.ratios), sides(&e.linear), e.output_radius.clone());
                ("euler", given.into_bound_py_any(py)?)
            }
            Kind::Uncertain(u) => {
                ("uncertain", (u.rows.clone(), u.offset.clone()).into_bound_py_any(py)?)
            }
            Kind::Python(c) => ("python", (&c.f, &c.jacobian, c.slack).into_bound_py_any(py)?),
        };
        Ok((py.get_type::<Self>().getattr(name)?, arguments))
    }

    fn __repr__(&self) -> &'static str {
        match self.0 {
            Kind::Linear => "Dynamics.linear()",
            Kind::Pendulum(_) => "Dynamics.pendulum(…)",
            Kind::Euler(_) => "Dynamics.euler(…)",
            Kind::Uncertain(_) => "Dynamics.uncertain(…)",
            Kind::Python(_) => "Dynamics.python(…)",
        }
    }
}

/// What makes the object again, and with what.
type Made<'py> = (Bound<'py, PyAny>, Bound<'py, PyAny>);
type Matrices<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>);

impl Dynamics {
    /// What the core asks; `raised` keeps what a callable raised.
    pub fn enclosing(&self, py: Python<'_>, raised: &Raised) -> Box<dyn Enclose + Send + Sync> {
        match &self.0 {
            Kind::Linear => Box::new(Linear),
            Kind::Pendulum(pendulum) => Box::new(*pendulum),
            Kind::Euler(euler) => Box::new(euler.clone()),
            Kind::Uncertain(uncertain) => Box::new(uncertain.clone()),
            Kind::Python(c) => Box::new(Callables {
                f: c.f.clone_ref(py),
                jacobian: c.jacobian.clone_ref(py),
                slack: c.slack,
                raised: Arc::clone(raised),
            }),
        }
    }

    /// Error unless a system of n states and p outputs can have them.
    pub fn check(&self, n: usize, p: usize) -> PyResult<()> {
        let fits = match &self.0 {
            Kind::Linear | Kind::Python(_) => true,
            Kind::Pendulum(_) => n == 2,
            Kind::Euler(euler) => n == 3 && euler.output_radius.len() == 3 * p,
            Kind::Uncertain(uncertain) => n == uncertain.n && uncertain.rows.len() == n + p,
        };
        if fits {
            return Ok(());
        }
        Err(ShapeError::new_err(format!(
            "dynamics: expected those of a system with {n} states and {p} outputs, found {}",
            self.__repr__()
        )))
    }

    /// x as long as the dynamics have states.
    fn sized(&self, argument: &str, x: &Bound<'_, PyAny>) -> PyResult<Vec<f64>> {
        let n = match &self.0 {
            Kind::Pendulum(_) => 2,
            Kind::Euler(_) => 3,
            Kind::Uncertain(uncertain) => uncertain.n,
            Kind::Linear | Kind::Python(_) => x.len()?,
        };
        Numbers::vector(argument, x, n)
    }
}

/// f and its Jacobian as Python callables.
struct Callables {
    f: Py<PyAny>,
    jacobian: Py<PyAny>,
    slack: f64,
    raised: Raised,
}

/// What a callable raised that is no mistake of its own: KeyboardInterrupt, SystemExit.
pub type Raised = Arc<Mutex<Option<PyErr>>>;

impl Callables {
    /// The core's error for what a callable raised; an interrupt is kept, to be raised again as it
    /// came.
    fn outcome(&self, py: Python<'_>, argument: &'static str, error: PyErr) -> Error {
        let found = said(&error.to_string());
        if !error.is_instance_of::<PyException>(py) {
            *self.raised.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
        }
        Error::Value { argument, expected: "a function that returns its bounds".into(), found }
    }
}

impl Enclose for Callables {
    fn value(&self, x: &[f64], out: &mut [Interval]) -> Result<(), Error> {
        Python::attach(|py| {
            let found = self
                .f
                .call1(py, (array1(py, x),))
                .and_then(|v| Numbers::vector("f", v.bind(py), out.len()));
            let found = found.map_err(|e| self.outcome(py, "f", e))?;
            for (out, v) in out.iter_mut().zip(&found) {
                if !v.is_finite() {
                    return Err(Error::Value {
                        argument: "f",
                        expected: "finite numbers".into(),
                        found: v.to_string(),
                    });
                }
                *out = Interval::about(*v, self.slack * v.abs());
            }
            Ok(())
        })
    }

    fn jacobian(&self, x: &[Interval], out: &mut [Interval]) -> Result<(), Error> {
        Python::attach(|py| {
            let n = x.len();
            let call = || -> PyResult<Vec<Interval>> {
                let (lo, hi) = ends(py, x);
                let pair = self.jacobian.call1(py, (lo, hi))?;
                let (lo, hi): (Bound<'_, PyAny>, Bound<'_, PyAny>) = pair.extract(py)?;
                let side = |value| -> PyResult<Vec<f64>> {
                    let (data, rows, width) =
                        Numbers::matrix("jacobian", value, &format!("({n}, {n})"))?;
                    if (rows, width) == (n, n) {
                        return Ok(data);
                    }
                    Err(ShapeError::new_err(format!(
                        "jacobian: expected ({n}, {n}), found ({rows}, {width})"
                    )))
                };
                intervals("jacobian", &side(&lo)?, &side(&hi)?)
            };
            let found = call().map_err(|e| self.outcome(py, "jacobian", e))?;
            for (out, v) in out.iter_mut().zip(found) {
                *out = v + Interval { lo: -self.slack * v.mag(), hi: self.slack * v.mag() };
            }
            Ok(())
        })
    }
}
