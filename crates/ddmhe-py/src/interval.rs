//! `ddmhe.Zonotope` and the engine of `ddmhe.interval.IntervalObserver`.

use crate::convert::{
    DdmheError, ModelViolationError, Numbers, ShapeError, array1, array2, raise, text, whole,
};
use crate::exclusive::Exclusive;
use crate::pickle::{Made, bytes, made};
use crate::signals::{Signals, with_finished};
use ddmhe_core::observer::{
    Dynamics, Euler, Gain, Linear, Method, Options, Pendulum, System, Uncertain,
};
use ddmhe_core::snapshot::{Kind, from_bytes, to_bytes};
use ddmhe_core::{Error, Interrupt, Interval, IntervalEstimate, Reduction};
use numpy::{PyArray1, PyArray2};
use pyo3::exceptions::PyException;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyType};
use serde::{Deserialize, Serialize};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

type Ends<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>);

fn ends<'py>(py: Python<'py>, x: &[Interval]) -> Ends<'py> {
    let side = |f: fn(&Interval) -> f64| array1(py, &x.iter().map(f).collect::<Vec<_>>());
    (side(|x| x.lo), side(|x| x.hi))
}

/// Generators stored by columns as an (n, m) array.
fn columns<'py>(
    py: Python<'py>,
    generators: &[f64],
    n: usize,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let m = generators.len() / n;
    let rows: Vec<f64> = (0..n).flat_map(|i| (0..m).map(move |j| generators[j * n + i])).collect();
    if m == 0 {
        return Ok(PyArray2::zeros(py, [n, 0], false));
    }
    array2(py, rows, m)
}

fn reduction(method: &str) -> PyResult<Reduction> {
    Ok(match method {
        "paper" => Reduction::Paper,
        "girard" => Reduction::Girard,
        "combastel" => Reduction::Combastel,
        "pca" => Reduction::Pca,
        _ => {
            let expected = "expected \"girard\", \"combastel\", \"pca\" or \"paper\"";
            return Err(DdmheError::new_err(format!("method: {expected}, found {method:?}")));
        }
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
#[pyclass(module = "ddmhe", name = "Zonotope", frozen)]
pub struct Zonotope(ddmhe_core::Zonotope);

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
        let wrong = |_| {
            DdmheError::new_err(format!("other: expected a Zonotope, found {}", other.get_type()))
        };
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
        let method = method.map_or(Ok("girard".into()), |method| text("method", method))?;
        self.0.reduce(whole("q", q)?, reduction(&method)?).map(Zonotope).map_err(raise)
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

fn intervals(argument: &'static str, lo: &[f64], hi: &[f64]) -> PyResult<Vec<Interval>> {
    let wrong = |k: usize| {
        let text = format!(
            "{argument}: expected lower ends not above the upper, found {} and {}",
            lo[k], hi[k]
        );
        DdmheError::new_err(text)
    };
    (0..lo.len()).map(|k| Interval::new(lo[k], hi[k]).ok_or_else(|| wrong(k))).collect()
}

/// f and its Jacobian as Python callables.
struct Callables {
    f: Py<PyAny>,
    jacobian: Py<PyAny>,
    slack: f64,
    raised: Raised,
}

/// What a callable raised that is no mistake of its own: KeyboardInterrupt, SystemExit.
type Raised = Arc<Mutex<Option<PyErr>>>;

impl Callables {
    /// The core's error for what a callable raised; an interrupt is kept, to be raised again as it
    /// came.
    fn outcome(&self, py: Python<'_>, argument: &'static str, error: PyErr) -> Error {
        let found = error.to_string();
        if !error.is_instance_of::<PyException>(py) {
            *self.raised.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
        }
        Error::Value { argument, expected: "a function that returns its bounds".into(), found }
    }
}

impl Dynamics for Callables {
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

/// What the system's `dynamics` says it is: ("linear",), ("pendulum", gain), ("euler", ratios,
/// linear, output_radius), ("uncertain", rows, offset) or ("python", f, jacobian, slack).
fn dynamics(
    value: &Bound<'_, PyAny>,
    n: usize,
    raised: &Raised,
) -> PyResult<Box<dyn Dynamics + Send + Sync>> {
    let kind: String = value.get_item(0)?.extract()?;
    let pair = |k: usize, len: usize| -> PyResult<Vec<Interval>> {
        let (lo, hi): (Bound<'_, PyAny>, Bound<'_, PyAny>) = value.get_item(k)?.extract()?;
        intervals(
            "dynamics",
            &Numbers::vector("dynamics", &lo, len)?,
            &Numbers::vector("dynamics", &hi, len)?,
        )
    };
    Ok(match kind.as_str() {
        "linear" => Box::new(Linear),
        "pendulum" => Box::new(Pendulum { gain: value.get_item(1)?.extract()? }),
        "euler" => {
            let (mut ratios, mut linear) = ([Interval::ZERO; 3], [Interval::ZERO; 9]);
            ratios.copy_from_slice(&pair(1, 3)?);
            linear.copy_from_slice(&pair(2, 9)?);
            Box::new(Euler { ratios, linear, output_radius: value.get_item(3)?.extract()? })
        }
        "uncertain" => Box::new(Uncertain {
            n,
            rows: value.get_item(1)?.extract()?,
            offset: value.get_item(2)?.extract()?,
        }),
        _ => Box::new(Callables {
            f: value.get_item(1)?.unbind(),
            jacobian: value.get_item(2)?.unbind(),
            slack: value.get_item(3)?.extract()?,
            raised: Arc::clone(raised),
        }),
    })
}

/// One step's sets.
#[pyclass(module = "ddmhe._core", name = "IntervalEstimate", frozen)]
pub struct Bounds(IntervalEstimate);

#[pymethods]
impl Bounds {
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Made<'py>> {
        made::<Self>(
            py,
            "_restore",
            &to_bytes(Kind::IntervalEstimate, &(self.0.predicted.len(), &self.0)),
        )
    }

    #[classmethod]
    fn _restore(_cls: &Bound<'_, PyType>, blob: &Bound<'_, PyAny>) -> PyResult<Self> {
        let (n, estimate): (usize, IntervalEstimate) =
            from_bytes(Kind::IntervalEstimate, bytes(blob)?).map_err(raise)?;
        if !estimate.fits(n) {
            return Err(DdmheError::new_err(
                "blob: expected a saved interval estimate, found one of other sizes",
            ));
        }
        Ok(Bounds(estimate))
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

/// All sets of a run: N rows, up to the first sample that contradicts model and bounds.
#[pyclass(module = "ddmhe._core", name = "IntervalLog", frozen)]
#[derive(Serialize, Deserialize)]
pub struct IntervalLog {
    n: usize,
    lower: Vec<f64>,
    upper: Vec<f64>,
    center: Vec<f64>,
    filtered: [Vec<f64>; 2],
    ball: [Vec<f64>; 2],
    ellipsoid: [Vec<f64>; 2],
    violation: Option<String>,
}

type Sides<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>);

impl IntervalLog {
    fn pair<'py>(&self, py: Python<'py>, sides: &[Vec<f64>; 2]) -> PyResult<Sides<'py>> {
        Ok((array2(py, sides[0].clone(), self.n)?, array2(py, sides[1].clone(), self.n)?))
    }
}

#[pymethods]
impl IntervalLog {
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Made<'py>> {
        made::<Self>(py, "_restore", &to_bytes(Kind::IntervalLog, self))
    }

    #[classmethod]
    fn _restore(_cls: &Bound<'_, PyType>, blob: &Bound<'_, PyAny>) -> PyResult<Self> {
        let log: IntervalLog = from_bytes(Kind::IntervalLog, bytes(blob)?).map_err(raise)?;
        let pairs = [&log.filtered, &log.ball, &log.ellipsoid];
        let sides = pairs.into_iter().flatten().chain([&log.upper, &log.center]);
        if log.n == 0
            || !log.lower.len().is_multiple_of(log.n)
            || sides.into_iter().any(|s| s.len() != log.lower.len())
        {
            return Err(DdmheError::new_err(
                "blob: expected a saved interval log, found one of other sizes",
            ));
        }
        Ok(log)
    }

    /// N
    fn __len__(&self) -> usize {
        self.lower.len() / self.n
    }

    /// Why the run ended before its last sample: the ModelViolationError that a step with sample N
    /// raises, or None.
    #[getter]
    fn violation<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyAny>> {
        self.violation.as_ref().map(|text| {
            ModelViolationError::new_err(text.clone()).into_value(py).into_bound(py).into_any()
        })
    }

    fn __repr__(&self) -> String {
        let end =
            self.violation.as_ref().map_or(String::new(), |text| format!(", violation={text:?}"));
        format!("IntervalLog(N={}, n={}{end})", self.__len__(), self.n)
    }

    /// Lower bounds (N, n); row k is of x(k+1).
    #[getter]
    fn lower<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        array2(py, self.lower.clone(), self.n)
    }

    /// Upper bounds (N, n); row k is of x(k+1).
    #[getter]
    fn upper<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        array2(py, self.upper.clone(), self.n)
    }

    /// Estimates (N, n) of x(k+1).
    #[getter]
    fn center<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        array2(py, self.center.clone(), self.n)
    }

    /// The estimates, as other estimators name them.
    #[getter]
    fn x<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.center(py)
    }

    /// (lo, hi), each (N, n); row k is of x(k) and uses y(k).
    #[getter]
    fn filtered<'py>(&self, py: Python<'py>) -> PyResult<Sides<'py>> {
        self.pair(py, &self.filtered)
    }

    /// (lo, hi) of the ball (44), each (N, n).
    #[getter]
    fn ball<'py>(&self, py: Python<'py>) -> PyResult<Sides<'py>> {
        self.pair(py, &self.ball)
    }

    /// (lo, hi) of the ellipsoid's box, each (N, n).
    #[getter]
    fn ellipsoid<'py>(&self, py: Python<'py>) -> PyResult<Sides<'py>> {
        self.pair(py, &self.ellipsoid)
    }
}

/// The compiled part of `ddmhe.interval.IntervalObserver`, which checks and documents.
#[pyclass(module = "ddmhe._core", frozen, name = "ObserverCore")]
pub struct ObserverCore {
    core: Exclusive<Observer>,
    raised: Raised,
}

type Observer = ddmhe_core::IntervalObserver<Box<dyn Dynamics + Send + Sync>>;

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
    #[pyo3(signature = (kind, matrices, gain, x0_center, x0_radius, order, method, reduce))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        kind: &Bound<'_, PyAny>,
        matrices: &Bound<'_, PyAny>,
        gain: &Bound<'_, PyAny>,
        x0_center: Vec<f64>,
        x0_radius: Vec<f64>,
        order: &Bound<'_, PyAny>,
        method: &Bound<'_, PyAny>,
        reduce: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let (method, reduce) = (text("method", method)?, text("reduction", reduce)?);
        let flat = |value: Bound<'_, PyAny>| Numbers::from("system", &value).map(|v| v.data);
        let part = |name: &str| flat(matrices.get_item(name)?);
        let of = |name: &str| -> PyResult<f64> { gain.get_item(name)?.extract() };
        let system = System {
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
        };
        let gain = Gain {
            L: flat(gain.get_item("L")?)?,
            P: flat(gain.get_item("P")?)?,
            lambda: of("lam")?,
            gamma: of("gamma")?,
            mu_w: of("mu_w")?,
            mu_v: of("mu_v")?,
            weights: flat(gain.get_item("weights")?)?,
        };
        let method = match method.as_str() {
            "tight" => Method::Tight,
            "paper" => Method::Paper,
            _ => {
                let text = format!("method: expected \"tight\" or \"paper\", found {method:?}");
                return Err(DdmheError::new_err(text));
            }
        };
        let options =
            Options { order: whole("order", order)?, method, reduction: reduction(&reduce)? };
        let raised = Raised::default();
        let dynamics = dynamics(kind, x0_center.len(), &raised)?;
        let core = ddmhe_core::IntervalObserver::new(
            dynamics, system, gain, &x0_center, &x0_radius, options,
        );
        Ok(ObserverCore { core: Exclusive::new(core.map_err(raise)?), raised })
    }

    /// Where the observer stands, for resume.
    fn present<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        Ok(PyBytes::new(py, &self.core()?.present()))
    }

    /// Continues from where an observer with the same arguments stood.
    fn resume(&self, blob: &Bound<'_, PyAny>) -> PyResult<()> {
        self.core()?.resume(bytes(blob)?).map_err(raise)
    }

    fn step(&self, y: &Bound<'_, PyAny>, u: Option<&Bound<'_, PyAny>>) -> PyResult<Bounds> {
        let mut core = self.core()?;
        let y = Numbers::measured("y", y)?.into_vector("y", core.p())?;
        let u = u.map(|u| Numbers::vector("u", u, core.inputs())).transpose()?.unwrap_or_default();
        core.step(&y, &u).map(|e| Bounds(e.clone())).map_err(|e| self.raise(e))
    }

    fn run(
        &self,
        py: Python<'_>,
        y: &Bound<'_, PyAny>,
        u: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<IntervalLog> {
        let mut core = self.core()?;
        let core = &mut *core;
        let (n, p, inputs) = (core.n(), core.p(), core.inputs());
        let (Y, rows, width) = Numbers::measured("Y", y)?.into_matrix("Y", &format!("(N, {p})"))?;
        if width != p {
            return Err(ShapeError::new_err(format!("Y: expected {p} columns, found {width}")));
        }
        let U = u.map(|u| Numbers::matrix("U", u, &format!("({rows}, {inputs})"))).transpose()?;
        if U.as_ref().is_some_and(|(_, r, w)| (*r, *w) != (rows, inputs)) {
            return Err(ShapeError::new_err(format!(
                "U: expected ({rows}, {inputs}), found another shape"
            )));
        }
        let U = U.map(|(data, ..)| data).unwrap_or_default();
        let side = || Vec::with_capacity(rows * n);
        let pair = || [side(), side()];
        let (lower, upper, center) = (side(), side(), side());
        let mut log = IntervalLog {
            n,
            lower,
            upper,
            center,
            filtered: pair(),
            ball: pair(),
            ellipsoid: pair(),
            violation: None,
        };
        let mut signals = Signals::default();
        let found = py.detach(|| {
            let mut stop = || signals.raised();
            let mut interrupt = Interrupt::new(&mut stop);
            for k in 0..rows {
                if interrupt.stopped() {
                    break;
                }
                let u = if U.is_empty() { &[][..] } else { &U[k * inputs..(k + 1) * inputs] };
                let e = match core.step(&Y[k * p..(k + 1) * p], u) {
                    Err(e @ Error::ModelViolation { .. }) => {
                        log.violation = Some(e.to_string());
                        break;
                    }
                    step => step?,
                };
                log.lower.extend(e.predicted.iter().map(|x| x.lo));
                log.upper.extend(e.predicted.iter().map(|x| x.hi));
                log.center.extend(&e.center);
                for (sides, x) in [
                    (&mut log.filtered, &e.filtered),
                    (&mut log.ball, &e.ball),
                    (&mut log.ellipsoid, &e.ellipsoid),
                ] {
                    sides[0].extend(x.iter().map(|x| x.lo));
                    sides[1].extend(x.iter().map(|x| x.hi));
                }
            }
            Ok::<_, Error>(())
        });
        let words = format!("{} of {rows} steps were made", log.lower.len() / n);
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

/// Outward-rounded interval arithmetic on arrays of ends, for tests: op on (lo, hi), and (lo2, hi2)
/// where it takes two. An empty result is (nan, nan).
#[pyfunction]
pub fn interval_operation(op: &str, x: (f64, f64), y: (f64, f64)) -> PyResult<(f64, f64)> {
    let (a, b) = (&intervals("x", &[x.0], &[x.1])?[0], &intervals("y", &[y.0], &[y.1])?[0]);
    let found = match op {
        "add" => Some(*a + *b),
        "sub" => Some(*a - *b),
        "mul" => Some(*a * *b),
        "div" => Some(*a / *b),
        "sqr" => Some(a.sqr()),
        "sqrt" => a.sqrt(),
        "sin" => Some(a.sin()),
        "cos" => Some(a.cos()),
        "exp" => Some(a.exp()),
        _ => {
            return Err(DdmheError::new_err(format!(
                "op: expected the name of an operation, found {op:?}"
            )));
        }
    };
    Ok(found.map_or((f64::NAN, f64::NAN), |x| (x.lo, x.hi)))
}
