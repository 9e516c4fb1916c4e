//! `ddmhe.History`.

use crate::convert::{DdmheError, Numbers, ShapeError, array1, array2, number, raise, whole_from};
use crate::pickle::{Made, bytes, made};
use crate::words::{kind, shown};
use ddmhe_core::snapshot::{Kind, from_bytes, to_bytes};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyType};

/// Recordings of one system: the data that stand in for its model (Liu 2026, Section III).
///
/// Parameters
/// ----------
/// x : array (T+1, n), or (T+1,) of one state
///     Recorded states, one row per sample, in any unit.
/// y : array (T, p), or (T,) of one output
///     Recorded outputs; x[k] and y[k] were taken together, x has one more sample.
/// dt : float
///     Sampling interval in seconds. Kept for reports: the method itself needs no unit of time.
/// u : array (T, m), optional
///     Known inputs at the instants of y: u[k] acts on x[k+1], and y[k] may depend on it.
/// state, output, input : list of str, optional
///     Names of columns: x is then a frame (pandas, polars, pyarrow, a mapping) that holds states,
///     outputs and inputs, read as recordings.read does: its clock is found unless dt is stated,
///     lost rows are filled. Of its last row the state counts.
/// x_units, y_units, u_units : str or list of str, optional
///     Units of the states, of the outputs and of the inputs: one for all, or one a channel.
///     States, or outputs, of one unit share a scale in the default rule; a channel whose unit is
///     unknown (None or "") has its own, and rescaling it changes nothing. Inputs each have their
///     own.
///
/// Raises
/// ------
/// ShapeError, NotFiniteError, DdmheError
///     Wrong shapes; NaN or infinity; dt <= 0.
///
/// Examples
/// --------
/// >>> import ddmhe
/// >>> record = ddmhe.models.detumbling().simulate(duration=30.0, dt=0.1, noise=0.01)
/// >>> history = ddmhe.History(record.x[:201], record.y[:200], 0.1, x_units="rad/s", y_units="N m")
/// >>> history.n, history.p, history.T
/// (3, 3, 200)
/// >>> history.rank(20).satisfied
/// True
#[pyclass(module = "ddmhe", frozen, name = "History")]
pub struct History {
    pub core: ddmhe_core::History,
}

/// Channels of a recording.
#[derive(Clone, Copy)]
pub struct Channels {
    /// States.
    pub n: usize,
    /// Outputs.
    pub p: usize,
    /// Known inputs.
    pub m: usize,
}

impl History {
    /// The History behind a Python argument.
    pub fn cast<'a>(argument: &str, value: &'a Bound<'_, PyAny>) -> PyResult<&'a Self> {
        let wrong = |_| {
            let found = kind(value);
            DdmheError::new_err(format!("{argument}: expected a History, found {found}"))
        };
        Ok(value.cast::<Self>().map_err(wrong)?.get())
    }

    /// How many channels there are.
    pub fn sizes(&self) -> Channels {
        Self::channels(&self.core)
    }

    /// The same of a History without its Python object.
    pub fn channels(core: &ddmhe_core::History) -> Channels {
        Channels { n: core.n(), p: core.p(), m: core.m() }
    }
}

/// One recording as arrays x (T_i+1, n) and y (T_i, p).
type Signals<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>);

#[pymethods]
impl History {
    #[new]
    #[pyo3(
        signature = (x, y=None, dt=None, u=None, *, x_units=None, y_units=None, u_units=None,
            state=None, output=None, input=None),
        text_signature = "(x, y=None, dt=1.0, u=None, *, x_units=None, y_units=None, \
            u_units=None, state=None, output=None, input=None)"
    )]
    #[allow(clippy::too_many_arguments)] // as many as users see
    fn new(
        x: &Bound<'_, PyAny>,
        y: Option<&Bound<'_, PyAny>>,
        dt: Option<&Bound<'_, PyAny>>,
        u: Option<&Bound<'_, PyAny>>,
        x_units: Option<&Bound<'_, PyAny>>,
        y_units: Option<&Bound<'_, PyAny>>,
        u_units: Option<&Bound<'_, PyAny>>,
        state: Option<&Bound<'_, PyAny>>,
        output: Option<&Bound<'_, PyAny>>,
        input: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let framed = || x.py().import("ddmhe.recordings.framed");
        if state.or(output).or(input).is_some() {
            let stated = (x_units, y_units, u_units);
            let arguments = (x, (y, u, dt), (state, output, input), stated);
            let found = framed()?.call_method1("recording", arguments)?;
            return Ok(History { core: History::cast("x", &found)?.core.clone() });
        }
        let Some(y) = y else {
            return Err(DdmheError::new_err(
                "y: expected outputs (T, p), or state= and output=, the names of columns of a \
                 frame, found none",
            ));
        };
        if [Some(x), Some(y), u].into_iter().flatten().any(is_frame) {
            framed()?.call_method1("check_frames", (x, y, u))?;
        }
        let dt = dt.map_or(Ok(1.0), |dt| number("dt", dt))?;
        let (x, states, n) = Numbers::from("x", x)?.into_channels("x", "(T+1, n)")?;
        let (y, outputs, p) = Numbers::from("y", y)?.into_channels("y", "(T, p)")?;
        // shapes that fit both ways are a short recording as long as they are not far from square
        let other_way = n == p + 1 && n > 2 && states < n && outputs > 0;
        if other_way && (states != outputs + 1 || n > 4 * states) {
            return Err(ShapeError::new_err(format!(
                "x, y: expected arrays (T+1, n) and (T, p), row k the sample k, found ({states}, \
                 {n}) and ({outputs}, {p}), which look transposed: x.T, y.T"
            )));
        }
        if states != outputs + 1 {
            let found =
                [("x", n == outputs + 1, (states, n)), ("y", states == p + 1, (outputs, p))];
            // where both would do, that with more samples
            let turned = found.iter().filter(|(_, fits, _)| *fits);
            if let Some((one, _, (rows, columns))) = turned.max_by_key(|(.., (_, T))| *T) {
                return Err(ShapeError::new_err(format!(
                    "{one}: expected a row for each sample, found ({rows}, {columns}), which looks \
                     transposed beside the other: {one}.T"
                )));
            }
        }
        let (x_units, y_units) = (units("x_units", x_units)?, units("y_units", y_units)?);
        let core = ddmhe_core::History::new(n, p, &x, &y, dt).map_err(raise)?;
        let core = core.with_units(&x_units, &y_units).map_err(raise)?;
        let Some(u) = u else {
            return match u_units {
                None => Ok(History { core }),
                Some(_) => Err(DdmheError::new_err("u_units: expected none without u")),
            };
        };
        let (u, _, m) = Numbers::from("u", u)?.into_channels("u", "(T, m)")?;
        let core = core.with_inputs(m, &u).map_err(raise)?;
        let u_units = units("u_units", u_units)?;
        Ok(History { core: core.with_input_units(&u_units).map_err(raise)? })
    }

    /// Join several recordings of one system; no window ever crosses a seam.
    #[staticmethod]
    fn concat(histories: &Bound<'_, PyAny>) -> PyResult<Self> {
        let mut cores = Vec::new();
        let wrong = |_| {
            ShapeError::new_err(format!(
                "histories: expected a list of History, found {}",
                kind(histories)
            ))
        };
        for item in histories.try_iter().map_err(wrong)? {
            let item = item?;
            let history = item.cast::<History>().map_err(|_| {
                ShapeError::new_err(format!(
                    "histories: expected a list of History, found {}",
                    kind(&item)
                ))
            })?;
            cores.push(history.get().core.clone());
        }
        Ok(History { core: ddmhe_core::History::concat(&cores).map_err(raise)? })
    }

    /// The recordings as bytes; see from_bytes.
    fn to_bytes<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.core.to_bytes())
    }

    /// The History that to_bytes saved; DdmheError for bytes that it did not make, or that were
    /// changed or cut off since.
    #[classmethod]
    fn from_bytes(_cls: &Bound<'_, PyType>, blob: &Bound<'_, PyAny>) -> PyResult<Self> {
        Ok(History { core: ddmhe_core::History::from_bytes(bytes(blob)?).map_err(raise)? })
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Made<'py>> {
        made::<Self>(py, "from_bytes", &self.core.to_bytes())
    }

    /// Write the recordings to a file that other programs read, too: .npz with the arrays x, y and
    /// u, one recording behind the other, the samples of each, dt and units; see load.
    fn save(slf: &Bound<'_, Self>, path: &Bound<'_, PyAny>) -> PyResult<()> {
        let file = slf.py().import("ddmhe.history_file")?;
        file.call_method1("save", (slf, path)).map(|_| ())
    }

    /// The History that save wrote; DdmheError for another file.
    #[classmethod]
    fn load<'py>(
        cls: &Bound<'py, PyType>,
        path: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        cls.py().import("ddmhe.history_file")?.call_method1("load", (path,))
    }

    /// Whether recordings, interval and units are the same.
    fn __eq__(&self, other: &Bound<'_, PyAny>) -> bool {
        other.cast::<History>().is_ok_and(|other| other.get().core == self.core)
    }

    /// Of the numbers: what is equal has the same.
    fn __hash__(&self) -> u64 {
        let mut hasher = std::hash::DefaultHasher::new();
        std::hash::Hash::hash(&self.core.to_bytes(), &mut hasher);
        std::hash::Hasher::finish(&hasher)
    }

    fn __copy__(slf: Bound<'_, Self>) -> Bound<'_, Self> {
        slf // it never changes
    }

    fn __deepcopy__<'py>(slf: Bound<'py, Self>, _memo: &Bound<'py, PyAny>) -> Bound<'py, Self> {
        slf
    }

    /// Number of states.
    #[getter]
    fn n(&self) -> usize {
        self.core.n()
    }

    /// Number of outputs.
    #[getter]
    fn p(&self) -> usize {
        self.core.p()
    }

    /// Number of known inputs; 0 for a system without.
    #[getter]
    fn m(&self) -> usize {
        self.core.m()
    }

    /// The same recordings without their inputs.
    fn without_inputs(&self) -> Self {
        History { core: self.core.without_inputs() }
    }

    /// The inputs of each recording, a list of arrays (T_i, m); copies.
    #[getter]
    fn inputs<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyArray2<f64>>>> {
        let core = &self.core;
        let array = |i| match core.m() {
            0 => Ok(PyArray2::zeros(py, [core.y(i).map_err(raise)?.len() / core.p(), 0], false)),
            m => array2(py, core.u(i).map_err(raise)?.to_vec(), m),
        };
        (0..core.recordings()).map(array).collect()
    }

    /// Units of the inputs, one a channel; "" where unknown.
    #[getter]
    fn u_units(&self) -> Vec<String> {
        self.core.u_units().to_vec()
    }

    /// Units of the states, one a channel; "" where unknown.
    #[getter]
    fn x_units(&self) -> Vec<String> {
        self.core.x_units().to_vec()
    }

    /// Units of the outputs, one a channel; "" where unknown.
    #[getter]
    fn y_units(&self) -> Vec<String> {
        self.core.y_units().to_vec()
    }

    /// Number of output samples, over all recordings.
    #[getter]
    #[allow(non_snake_case)]
    fn T(&self) -> usize {
        self.core.T()
    }

    /// Sampling interval in seconds.
    #[getter]
    fn dt(&self) -> f64 {
        self.core.dt()
    }

    /// The recordings as a list of (x, y) arrays of shapes (T_i+1, n) and (T_i, p); copies.
    #[getter]
    fn recordings<'py>(&self, py: Python<'py>) -> PyResult<Vec<Signals<'py>>> {
        let core = &self.core;
        let array = |signal: &[f64], width| array2(py, signal.to_vec(), width);
        let pair = |i| {
            Ok((
                array(core.x(i).map_err(raise)?, core.n())?,
                array(core.y(i).map_err(raise)?, core.p())?,
            ))
        };
        (0..core.recordings()).map(pair).collect()
    }

    /// The rank condition (7) for windows of `depth` outputs.
    fn rank(&self, depth: &Bound<'_, PyAny>) -> PyResult<RankReport> {
        let depth = whole_from(0, "depth", depth)?;
        Ok(RankReport { core: self.core.rank(depth).map_err(raise)? })
    }

    fn __repr__(&self) -> String {
        let (n, p, T, dt, k) =
            (self.core.n(), self.core.p(), self.core.T(), self.core.dt(), self.core.recordings());
        let joined = if k > 1 { format!(", {k} recordings") } else { String::new() };
        let inputs =
            if self.core.m() > 0 { format!(", m={}", self.core.m()) } else { String::new() };
        format!("History(n={n}, p={p}{inputs}, T={T}, dt={dt}{joined})")
    }
}

/// Names of units: None for unknown ones, one string for all channels, or one (or None) a channel.
/// Whether it may have labels of its own, as what pandas and polars make.
fn is_frame(value: &Bound<'_, PyAny>) -> bool {
    value.hasattr("to_numpy").unwrap_or(false)
}

fn units(argument: &str, value: Option<&Bound<'_, PyAny>>) -> PyResult<Vec<String>> {
    let Some(value) = value else { return Ok(vec![String::new()]) };
    if let Ok(one) = value.extract::<String>() {
        return Ok(vec![one]);
    }
    value.extract::<Vec<Option<String>>>().map_or_else(
        |_| {
            Err(DdmheError::new_err(format!(
                "{argument}: expected a string or a list of strings, found {}",
                shown(value)
            )))
        },
        |names| Ok(names.into_iter().map(Option::unwrap_or_default).collect()),
    )
}

/// Outcome of the rank condition (7): rank [H_1(x[0..T-L]); 1ᵀ] = n + 1.
///
/// Examples
/// --------
/// >>> import ddmhe
/// >>> record = ddmhe.models.detumbling().simulate(duration=30.0, dt=0.1, noise=0.01)
/// >>> report = record.history(200).rank(depth=20)
/// >>> report.rank, report.required, report.satisfied
/// (4, 4, True)
#[pyclass(module = "ddmhe", frozen, name = "RankReport")]
pub struct RankReport {
    core: ddmhe_core::RankReport,
}

#[pymethods]
impl RankReport {
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Made<'py>> {
        made::<Self>(py, "_restore", &to_bytes(Kind::RankReport, &self.core))
    }

    #[classmethod]
    fn _restore(_cls: &Bound<'_, PyType>, blob: &Bound<'_, PyAny>) -> PyResult<Self> {
        Ok(RankReport { core: from_bytes(Kind::RankReport, bytes(blob)?).map_err(raise)? })
    }

    /// Numerical rank.
    #[getter]
    fn rank(&self) -> usize {
        self.core.rank
    }

    /// n + 1.
    #[getter]
    fn required(&self) -> usize {
        self.core.required
    }

    /// Whether the condition holds.
    #[getter]
    fn satisfied(&self) -> bool {
        self.core.satisfied()
    }

    /// Singular values, largest first, with each state channel divided by its largest magnitude.
    #[getter]
    fn singular_values<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, &self.core.singular_values)
    }

    /// Threshold below which a singular value is rounding.
    #[getter]
    fn tolerance(&self) -> f64 {
        self.core.tolerance
    }

    /// σ_{n+1}/σ_1: the relative perturbation of the recording that would break the condition.
    #[getter]
    fn margin(&self) -> f64 {
        self.core.margin
    }

    fn __repr__(&self) -> String {
        format!(
            "RankReport(rank={}, required={}, satisfied={}, margin={:.3e})",
            self.core.rank,
            self.core.required,
            if self.core.satisfied() { "True" } else { "False" },
            self.core.margin
        )
    }
}

/// Standard deviations of the white noise on each channel of x (n,) and y (p,), in their units,
/// from fifth differences; 0 where no recording has more than five samples.
#[pyfunction]
pub fn noise_levels<'py>(
    py: Python<'py>,
    history: &History,
) -> (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>) {
    let (x, y) = ddmhe_core::noise_levels(&history.core);
    (array1(py, &x), array1(py, &y))
}

/// The full turn (2 pi or 360) that an angle (N,) is wrapped by and the first row after a jump, or
/// None; NaN where it was not measured.
#[pyfunction]
pub fn wrapped_angle(values: &Bound<'_, PyAny>) -> PyResult<Option<(f64, usize)>> {
    let numbers = Numbers::measured("values", values)?;
    let len = numbers.data.len();
    Ok(ddmhe_core::wrapped_angle(&numbers.into_vector("values", len)?))
}
