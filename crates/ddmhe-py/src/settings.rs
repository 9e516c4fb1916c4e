//! Settings of an estimator: one mapping {name: value}, one table, one conversion to [`Config`].
//!
//! `DdMhe(history, **settings)`, `validate`, a TOML file and `tune` go through [`config`]. A new
//! setting is a field of [`Config`], one row of [`TABLE`], and its name in `DdMhe`'s two signatures
//! (mhe.rs, `_core.pyi`); a test holds the three together.

use crate::bounds::{pairs, side, sides, tuple};
use crate::certificate;
use crate::convert::{DdmheError, Numbers, ShapeError, flag, number, raise, text, whole};
use crate::history::{Channels, History};
use crate::spaces;
use crate::words::{nearest, quoted, shown};
use ddmhe_core::{
    Bounds, Center, Config, Equilibrium, Gate, ProcessNoise, Soft, Start, Stuck, Weighting,
};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyDictMethods, PyTuple};

/// What makes a value part of a `Config`.
type Read = fn(&mut Config, &Given<'_, '_>) -> PyResult<()>;

/// Every setting by its name, in the order of `DdMhe`'s arguments, in which they are read.
const TABLE: [(&str, Read); 22] = [
    ("horizon", |c, v| put(&mut c.horizon, whole(v.name, v.value))),
    ("rho", |c, v| put(&mut c.rho, number(v.name, v.value))),
    ("mu", |c, v| put(&mut c.mu, number(v.name, v.value))),
    ("x_prior", |c, v| put(&mut c.x_prior, v.vector(v.value, v.n()))),
    ("x_bounds", |c, v| put(&mut c.x_bounds, v.bounds(v.n()))),
    ("x_center", |c, v| set(&mut c.x_center, v.choice(&[("history", Center::History)]))),
    ("v_bounds", |c, v| put(&mut c.v_bounds, v.bounds(v.p()))),
    ("equilibrium", |c, v| put(&mut c.equilibrium, v.rest())),
    ("warm_start", warm_start),
    ("space", |c, v| set(&mut c.space, spaces::space(v.value))),
    ("certificate", |c, v| put(&mut c.certificate, certificate::certificate(v.value, v.sizes))),
    ("disturbance", |c, v| put(&mut c.disturbance, certificate::disturbance(v.value))),
    ("weights", |c, v| set(&mut c.weights, v.choice(&WEIGHTS))),
    ("start", |c, v| set(&mut c.start, v.choice(&STARTS))),
    ("process_noise", |c, v| set(&mut c.process_noise, v.process_noise())),
    ("w_bounds", |c, v| put(&mut c.w_bounds, v.bounds(v.n()))),
    ("soft", |c, v| put(&mut c.soft, v.soft())),
    ("output_noise", |c, v| put(&mut c.output_noise, v.deviations(v.p()))),
    ("drift", |c, v| put(&mut c.drift, v.covariance())),
    ("evidence", |c, v| set(&mut c.evidence, flag(v.name, v.value))),
    ("gate", |c, v| set(&mut c.gate, v.gate())),
    ("stuck", |c, v| set(&mut c.stuck, v.choice(&STUCK))),
];

/// Settings that may be given by their place; those behind them need their names.
const POSITIONAL: usize = 12;

/// What `weights` may say.
pub const WEIGHTS: [(&str, Weighting); 4] = [
    ("auto", Weighting::Auto),
    ("paper", Weighting::Paper),
    ("scaled", Weighting::Scaled),
    ("recorded", Weighting::Recorded),
];

/// What `process_noise` may say in words.
const PROCESS_NOISE: [(&str, ProcessNoise); 3] = [
    ("auto", ProcessNoise::Auto),
    ("recorded", ProcessNoise::Recorded),
    ("residual", ProcessNoise::Residual),
];

const STARTS: [(&str, Start); 4] = [
    ("auto", Start::Auto),
    ("recording", Start::Recording),
    ("state", Start::State),
    ("unknown", Start::Unknown),
];

const STUCK: [(&str, Stuck); 2] = [("tell", Stuck::Tell), ("missing", Stuck::Missing)];

fn set<T>(place: &mut T, value: PyResult<T>) -> PyResult<()> {
    *place = value?;
    Ok(())
}

fn put<T>(place: &mut Option<T>, value: PyResult<T>) -> PyResult<()> {
    set(place, value.map(Some))
}

/// The old name of two starts. A prior, which is read before, is the state that a run starts from.
fn warm_start(config: &mut Config, given: &Given<'_, '_>) -> PyResult<()> {
    let goes_on = flag(given.name, given.value)? && config.x_prior.is_none();
    config.start = if goes_on { Start::Recording } else { Start::State };
    Ok(())
}

/// A setting's value, to be converted.
struct Given<'a, 'py> {
    name: &'static str,
    value: &'a Bound<'py, PyAny>,
    /// None where no recording is known yet: any sizes do.
    sizes: Option<Channels>,
}

impl<'py> Given<'_, 'py> {
    fn n(&self) -> Option<usize> {
        self.sizes.map(|sizes| sizes.n)
    }

    fn p(&self) -> Option<usize> {
        self.sizes.map(|sizes| sizes.p)
    }

    /// A vector of `len` numbers, or of any.
    fn vector(&self, value: &Bound<'py, PyAny>, len: Option<usize>) -> PyResult<Vec<f64>> {
        let numbers = Numbers::from(self.name, value)?;
        let own = numbers.shape.first().copied().unwrap_or(1);
        numbers.into_vector(self.name, len.unwrap_or(own))
    }

    /// (lo, hi), each a scalar or as `vector`.
    fn bounds(&self, len: Option<usize>) -> PyResult<Bounds> {
        let each = len.map(|len| pairs(self.name, self.value, len)).transpose()?.flatten();
        if let Some((lo, hi)) = each {
            return Ok(Bounds { lo, hi });
        }
        let [lo, hi] = sides(self.name, self.value)?;
        let side = |numbers: Numbers| {
            let own = numbers.shape.first().copied().unwrap_or(1);
            side(self.name, numbers, len.unwrap_or(own), None)
        };
        Ok(Bounds { lo: side(lo)?, hi: side(hi)? })
    }

    fn rest(&self) -> PyResult<Equilibrium> {
        let (expected, lengths): (_, &[usize]) = match self.sizes.map(|sizes| sizes.m) {
            Some(0) => ("a pair (x_e, y_e)", &[2]),
            Some(_) => ("three items (x_e, y_e, u_e), for a recording with inputs", &[3]),
            None => ("(x_e, y_e), or (x_e, y_e, u_e) with inputs", &[2, 3]),
        };
        let items = tuple(self.name, expected, self.value, lengths)?;
        let inputs = |u| self.vector(u, self.sizes.map(|sizes| sizes.m));
        Ok(Equilibrium {
            x: self.vector(&items[0], self.n())?,
            y: self.vector(&items[1], self.p())?,
            u: items.get(2).map_or(Ok(Vec::new()), inputs)?,
        })
    }

    /// One of the words, or a covariance (n, n).
    fn process_noise(&self) -> PyResult<ProcessNoise> {
        if self.value.extract::<String>().is_ok() {
            return self.choice(&PROCESS_NOISE);
        }
        self.covariance().map(ProcessNoise::Given)
    }

    /// A matrix (n, n).
    fn covariance(&self) -> PyResult<Vec<f64>> {
        let (Q, rows, columns) = Numbers::matrix(self.name, self.value, "(n, n)")?;
        let n = self.n().unwrap_or(rows);
        if (rows, columns) != (n, n) {
            let argument = self.name;
            return Err(ShapeError::new_err(format!(
                "{argument}: expected shape ({n}, {n}), found ({rows}, {columns})"
            )));
        }
        Ok(Q)
    }

    /// "auto" (or True), or a number of deviations.
    fn gate(&self) -> PyResult<Gate> {
        match self.value.extract::<bool>() {
            Ok(yes) if self.value.is_instance_of::<PyBool>() => {
                return Ok(if yes { Gate::Auto } else { Gate::None });
            }
            _ => {}
        }
        match self.value.extract::<String>() {
            Ok(_) => self.choice(&[("auto", Gate::Auto)]),
            Err(_) => number(self.name, self.value).map(Gate::At),
        }
    }

    /// A number, or one a channel.
    fn deviations(&self, channels: Option<usize>) -> PyResult<Vec<f64>> {
        match number(self.name, self.value) {
            Ok(one) => Ok(vec![one]),
            Err(_) => self.vector(self.value, channels),
        }
    }

    /// A price, or prices {"x": …, "v": …, "w": …}.
    fn soft(&self) -> PyResult<Soft> {
        let Ok(prices) = self.value.cast::<PyDict>() else {
            return number(self.name, self.value).map(Soft::all);
        };
        let mut soft = Soft::default();
        for (key, price) in prices {
            let name = text(self.name, &key)?;
            let place = match name.as_str() {
                "x" => &mut soft.x,
                "v" => &mut soft.v,
                "w" => &mut soft.w,
                _ => {
                    let argument = self.name;
                    return Err(DdmheError::new_err(format!(
                        "{argument}: expected prices by \"x\", \"v\" or \"w\", found {}",
                        quoted(&name)
                    )));
                }
            };
            *place = Some(number(self.name, &price)?);
        }
        Ok(soft)
    }

    /// What one of the known texts stands for.
    fn choice<T: Clone>(&self, known: &[(&str, T)]) -> PyResult<T> {
        let found: Option<String> = self.value.extract().ok();
        let chosen = known.iter().find(|(name, _)| Some(*name) == found.as_deref());
        chosen.map(|(_, meaning)| meaning.clone()).ok_or_else(|| {
            let names: Vec<String> = known.iter().map(|(name, _)| format!("{name:?}")).collect();
            let found = found.map_or_else(|| shown(self.value), |text| quoted(&text));
            let argument = self.name;
            DdmheError::new_err(format!("{argument}: expected {}, found {found}", either(&names)))
        })
    }
}

/// a, b or c
fn either(names: &[String]) -> String {
    match names {
        [most @ .., last] if !most.is_empty() => format!("{} or {last}", most.join(", ")),
        _ => names.concat(),
    }
}

/// The name of a start.
pub fn start_name(start: Start) -> &'static str {
    STARTS.iter().find(|(_, known)| *known == start).map_or("state", |(name, _)| name)
}

/// A start by its name.
pub fn start(value: &Bound<'_, PyAny>) -> PyResult<Start> {
    Given { name: "start", value, sizes: None }.choice(&STARTS)
}

/// Settings by their names, with those that a call gave by their place, as Python binds them.
pub fn bound<'py>(
    call: &str,
    places: &Bound<'py, PyTuple>,
    names: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyDict>> {
    let settings = names.map_or_else(|| Ok(PyDict::new(places.py())), PyDictMethods::copy)?;
    if let Some(unknown) = unknown(&settings)? {
        return Err(PyTypeError::new_err(format!("{call}: {unknown}")));
    }
    if places.len() > POSITIONAL {
        let found = places.len();
        return Err(PyTypeError::new_err(format!(
            "{call}: expected at most {POSITIONAL} settings without a name, found {found}"
        )));
    }
    for ((name, _), value) in TABLE.iter().zip(places) {
        if settings.contains(name)? {
            return Err(PyTypeError::new_err(format!("{call}: expected one {name}, found two")));
        }
        settings.set_item(name, value)?;
    }
    Ok(settings)
}

/// The `Config` of a mapping {name: value} whose names are [known](check_names); None as a value
/// says "not given", but of `process_noise`, where it says that there is none; no `sizes` where no
/// recording is known yet: any sizes do.
pub fn config(settings: &Bound<'_, PyDict>, sizes: Option<Channels>) -> PyResult<Config> {
    let given = |name: &str| Ok::<_, PyErr>(settings.get_item(name)?.filter(|v| !v.is_none()));
    if given("start")?.is_some() && given("warm_start")?.is_some() {
        return Err(DdmheError::new_err(
            "warm_start: expected none beside start, of which it is the old name, found both",
        ));
    }
    let mut config = Config::default();
    for (name, read) in TABLE {
        if let Some(value) = given(name)? {
            read(&mut config, &Given { name, value: &value, sizes })?;
        }
    }
    if settings.get_item("process_noise")?.is_some_and(|value| value.is_none()) {
        config.process_noise = ProcessNoise::None;
    }
    let asked = given("start")?.is_some() && config.start == Start::Auto;
    if asked && (!config.evidence || config.disturbance.is_some()) {
        let found = if config.evidence { "disturbance beside it" } else { "evidence=False" };
        return Err(DdmheError::new_err(format!(
            "start: expected evidence and no disturbance beside \"auto\", found {found}"
        )));
    }
    Ok(config)
}

/// An error for the first name that is no setting.
pub fn check_names(argument: &str, settings: &Bound<'_, PyDict>) -> PyResult<()> {
    match unknown(settings)? {
        Some(unknown) => Err(DdmheError::new_err(format!("{argument}: {unknown}"))),
        None => Ok(()),
    }
}

/// What is wrong with the first name that is no setting.
fn unknown(settings: &Bound<'_, PyDict>) -> PyResult<Option<String>> {
    for key in settings.keys() {
        let name = text("settings", &key)?;
        if !TABLE.iter().any(|(known, _)| *known == name) {
            let near = nearest(settings.py(), &name, TABLE.map(|(known, _)| known).as_slice())?;
            return Ok(Some(format!("expected a setting of DdMhe, found {}{near}", quoted(&name))));
        }
    }
    Ok(None)
}

/// Names of DdMhe's settings, in the order of its arguments.
#[pyfunction]
pub fn setting_names() -> Vec<&'static str> {
    TABLE.iter().map(|(name, _)| *name).collect()
}

/// Settings of DdMhe, checked as it checks them: alone, or for a recording.
///
/// Raises what DdMhe raises; without a recording, vectors and matrices may have any size.
#[pyfunction]
#[pyo3(signature = (settings, history=None))]
pub fn check_settings(
    settings: &Bound<'_, PyDict>,
    history: Option<&Bound<'_, PyAny>>,
) -> PyResult<()> {
    check_names("settings", settings)?;
    let Some(history) = history else { return config(settings, None).map(drop) };
    let history = History::cast("history", history)?;
    config(settings, Some(history.sizes()))?.check(&history.core).map_err(raise)
}
