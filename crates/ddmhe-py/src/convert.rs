//! Arrays in, errors out: the border between NumPy and the core.

pub use crate::exceptions::{
    DdmheError, InfeasibleError, ModelViolationError, NotFiniteError, RankError, ShapeError,
};
use crate::words::{kind, said, shown};
use ddmhe_core::Error;
use numpy::ndarray::Dimension;
use numpy::{
    AllowTypeChange, IntoPyArray, PyArray, PyArray1, PyArray2, PyArrayDyn, PyArrayLikeDyn,
    PyArrayMethods, PyReadwriteArray, PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use pyo3::types::{PyList, PyListMethods, PyString, PyTuple};

/// The exception that belongs to a core error.
pub fn raise(error: Error) -> PyErr {
    let text = error.to_string();
    match error {
        Error::Shape { .. } => ShapeError::new_err(text),
        Error::NotFinite { .. } => NotFiniteError::new_err(text),
        Error::Rank { .. } => RankError::new_err(text),
        Error::ModelViolation { .. } => ModelViolationError::new_err(text),
        _ => DdmheError::new_err(text),
    }
}

/// Numbers of an array-like argument with its shape, in C order.
pub struct Numbers {
    pub shape: Vec<usize>,
    pub data: Vec<f64>,
    /// The first entry that says "not measured" (masked, None, pandas.NA); such entries are NaN.
    missing: Option<usize>,
}

impl Numbers {
    /// One number.
    pub fn scalar(value: f64) -> Self {
        Numbers { shape: Vec::new(), data: vec![value], missing: None }
    }

    /// Whatever `numpy.asarray(value, dtype=float)` understands, without missing entries; anything
    /// else is an error that names the argument.
    pub fn from(argument: &str, value: &Bound<'_, PyAny>) -> PyResult<Self> {
        let numbers = Numbers::measured(argument, value)?;
        let Some(entry) = numbers.missing else { return Ok(numbers) };
        let place = match numbers.shape[..] {
            [] => String::new(),
            [_] => format!(" at entry {entry}"),
            [_, columns] => format!(" in row {}, column {}", entry / columns, entry % columns),
            _ => format!(" at entry {entry} in C order"),
        };
        Err(NotFiniteError::new_err(format!(
            "{argument}: expected finite numbers, found one that is missing (masked, None or \
             NA){place}"
        )))
    }

    /// As [`from`](Self::from), with NaN for entries that are masked, None or pandas.NA: not
    /// measured.
    pub fn measured(argument: &str, value: &Bound<'_, PyAny>) -> PyResult<Self> {
        let wrong = |found: String| not_real(argument, &found);
        let (plain, mask) =
            without_mask(value).map_err(|e| wrong(said(&e.value(value.py()).to_string())))?;
        let kind: String = plain.getattr("dtype")?.getattr("kind")?.extract()?;
        if kind == "O" {
            return Numbers::of_objects(argument, &plain, mask.as_ref());
        }
        if !["f", "i", "u", "b"].contains(&kind.as_str()) {
            let text = value.cast::<PyString>().is_ok();
            return Err(wrong(if text {
                "str".into()
            } else {
                format!("one of type {}", said(&plain.getattr("dtype")?.to_string()))
            }));
        }
        let array: PyArrayLikeDyn<'_, f64, AllowTypeChange> =
            plain.extract().map_err(|_| wrong("something else".into()))?;
        let view = array.as_array();
        let mut data: Vec<f64> = match view.as_slice() {
            Some(numbers) => numbers.to_vec(), // in C order, as it lies there
            None => view.iter().copied().collect(),
        };
        let mut missing = None;
        for (k, (entry, _)) in
            data.iter_mut().zip(mask.unwrap_or_default()).enumerate().filter(|(_, (_, m))| *m)
        {
            *entry = f64::NAN;
            missing = missing.or(Some(k));
        }
        Ok(Numbers { shape: array.shape().to_vec(), data, missing })
    }

    /// The numbers of an array of Python objects.
    fn of_objects(
        argument: &str,
        array: &Bound<'_, PyAny>,
        mask: Option<&Vec<bool>>,
    ) -> PyResult<Self> {
        let shape: Vec<usize> = array.getattr("shape")?.extract()?;
        let (mut data, mut missing) = (Vec::new(), None);
        for (k, item) in array.getattr("flat")?.try_iter()?.enumerate() {
            let item = item?;
            if mask.is_some_and(|mask| mask[k]) || is_missing(&item)? {
                missing = missing.or(Some(k));
                data.push(f64::NAN);
            } else if item.cast::<PyString>().is_err()
                && let Ok(number) = item.extract::<f64>()
            {
                data.push(number);
            } else {
                return Err(not_real(argument, &shown(&item)));
            }
        }
        Ok(Numbers { shape, data, missing })
    }

    /// As [`from`](Self::from), two-dimensional; `shape` is how the expectation reads.
    pub fn matrix(
        argument: &str,
        value: &Bound<'_, PyAny>,
        shape: &str,
    ) -> PyResult<(Vec<f64>, usize, usize)> {
        Numbers::from(argument, value)?.into_matrix(argument, shape)
    }

    /// As [`from`](Self::from), one-dimensional of length `len`; a scalar does where len is 1.
    pub fn vector(argument: &str, value: &Bound<'_, PyAny>, len: usize) -> PyResult<Vec<f64>> {
        Numbers::from(argument, value)?.into_vector(argument, len)
    }

    /// The numbers, rows and columns of a two-dimensional array.
    pub fn into_matrix(self, argument: &str, shape: &str) -> PyResult<(Vec<f64>, usize, usize)> {
        match self.shape[..] {
            [rows, columns] => Ok((self.data, rows, columns)),
            _ => Err(ShapeError::new_err(format!(
                "{argument}: expected a 2-D array {shape}, found {}",
                described(&self.shape)
            ))),
        }
    }

    /// As [`into_matrix`](Self::into_matrix); one channel may be given without its second
    /// dimension.
    pub fn into_channels(
        mut self,
        argument: &str,
        shape: &str,
    ) -> PyResult<(Vec<f64>, usize, usize)> {
        if let [_] = self.shape[..] {
            self.shape.push(1);
        }
        self.into_matrix(argument, shape)
    }

    /// The numbers of a one-dimensional array of length `len`; a scalar does where len is 1.
    pub fn into_vector(self, argument: &str, len: usize) -> PyResult<Vec<f64>> {
        match self.shape[..] {
            [l] if l == len => Ok(self.data),
            [] if len == 1 => Ok(self.data),
            [] if self.missing.is_some() => {
                Err(not_real(argument, "None or another that is missing"))
            }
            _ => Err(ShapeError::new_err(format!(
                "{argument}: expected {len} numbers, found {}",
                described(&self.shape)
            ))),
        }
    }
}

fn not_real(argument: &str, found: &str) -> PyErr {
    ShapeError::new_err(format!("{argument}: expected an array of real numbers, found {found}"))
}

/// A NumPy array of what was given, and which of its entries are masked, in C order.
///
/// In a list, too: `numpy.asarray` would take what lies under the masks of its items.
fn without_mask<'py>(
    value: &Bound<'py, PyAny>,
) -> PyResult<(Bound<'py, PyAny>, Option<Vec<bool>>)> {
    let py = value.py();
    let (numpy, ma) = (py.import("numpy")?, py.import("numpy.ma")?);
    let masked = ma.getattr("MaskedArray")?;
    let mut value = value.clone();
    let list = value.cast::<PyList>().map(PyListMethods::to_tuple);
    if let Ok(items) = list.or_else(|_| value.cast::<PyTuple>().cloned()) {
        let any =
            items.iter().map(|item| item.is_instance(&masked)).collect::<PyResult<Vec<_>>>()?;
        if any.contains(&true) {
            value = ma.call_method1("stack", (items,))?;
        }
    }
    if !value.is_instance(&masked)? {
        return Ok((numpy.call_method1("asarray", (value,))?, None));
    }
    let mask = ma
        .call_method1("getmaskarray", (&value,))?
        .call_method0("ravel")?
        .call_method0("tolist")?;
    Ok((ma.call_method1("getdata", (value,))?, Some(mask.extract()?)))
}

/// None, numpy.ma.masked and pandas.NA, which is told by the name of its type: pandas need not be
/// there.
fn is_missing(item: &Bound<'_, PyAny>) -> PyResult<bool> {
    let name = item.get_type().name()?;
    Ok(item.is_none() || ["NAType", "MaskedConstant"].iter().any(|other| name == *other))
}

pub fn described(shape: &[usize]) -> String {
    match shape {
        [] => "a single number".into(),
        [n] => format!("a 1-D array of {n}"),
        _ => format!(
            "an array of shape ({})",
            shape.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
        ),
    }
}

/// A 1-D NumPy array.
pub fn array1<'py>(py: Python<'py>, data: &[f64]) -> Bound<'py, PyArray1<f64>> {
    PyArray1::from_slice(py, data)
}

/// A 2-D NumPy array with `width` columns.
pub fn array2<'py>(
    py: Python<'py>,
    data: Vec<f64>,
    width: usize,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let rows = data.len() / width;
    data.into_pyarray(py).reshape([rows, width])
}

/// An array that results are written into: float64, C order, of this shape, and not read-only.
pub fn writable<'py, D: Dimension>(
    argument: &str,
    value: &Bound<'py, PyAny>,
    shape: &[usize],
) -> PyResult<PyReadwriteArray<'py, f64, D>> {
    let wrong = |found: String| {
        ShapeError::new_err(format!(
            "{argument}: expected a writable float64 array of shape {shape:?} in C order, \
             found {found}"
        ))
    };
    let kind = || {
        value
            .getattr("dtype")
            .map_or_else(|_| kind(value), |d| format!("one of type {}", said(&d.to_string())))
    };
    let array = value.cast::<PyArray<f64, D>>().map_err(|_| wrong(kind()))?;
    if array.shape() != shape {
        return Err(wrong(format!("one of shape {:?}", array.shape())));
    }
    if !array.is_c_contiguous() {
        return Err(wrong("one in another order".into()));
    }
    array.try_readwrite().map_err(|e| wrong(format!("one that is not to be written to ({e})")))
}

/// A whole number of at least 1.
pub fn whole(argument: &str, value: &Bound<'_, PyAny>) -> PyResult<usize> {
    whole_from(1, argument, value)
}

/// A whole number of at least `least`; True and False are none.
pub fn whole_from(least: usize, argument: &str, value: &Bound<'_, PyAny>) -> PyResult<usize> {
    let wrong = || {
        DdmheError::new_err(format!(
            "{argument}: expected a whole number of at least {least}, found {}",
            shown(value)
        ))
    };
    if is_bool(value)? {
        return Err(wrong());
    }
    let number: i64 = value.extract().map_err(|_| wrong())?;
    usize::try_from(number).ok().filter(|&m| m >= least).ok_or_else(wrong)
}

/// A real number, which may be infinite or NaN; True, False and texts are none.
pub fn number(argument: &str, value: &Bound<'_, PyAny>) -> PyResult<f64> {
    let wrong = || {
        DdmheError::new_err(format!("{argument}: expected a real number, found {}", shown(value)))
    };
    if is_bool(value)? || is_missing(value)? {
        return Err(wrong());
    }
    value.extract().map_err(|_| wrong())
}

/// True or False.
pub fn flag(argument: &str, value: &Bound<'_, PyAny>) -> PyResult<bool> {
    let wrong = || {
        DdmheError::new_err(format!("{argument}: expected True or False, found {}", shown(value)))
    };
    value.extract().map_err(|_| wrong())
}

/// A text.
pub fn text(argument: &str, value: &Bound<'_, PyAny>) -> PyResult<String> {
    let wrong =
        || DdmheError::new_err(format!("{argument}: expected a text, found {}", shown(value)));
    value.extract().map_err(|_| wrong())
}

/// Python's True and False and NumPy's.
fn is_bool(value: &Bound<'_, PyAny>) -> PyResult<bool> {
    let name = value.get_type().name()?;
    Ok(name == "bool" || name == "bool_")
}

/// Real numbers of any shape as a float64 array, for the Python side: NaN where missing if
/// `missing` allows it.
///
/// Raises ShapeError or NotFiniteError naming the argument.
#[pyfunction]
#[pyo3(signature = (argument, value, missing=false))]
pub fn numbers<'py>(
    py: Python<'py>,
    argument: &str,
    value: &Bound<'py, PyAny>,
    missing: bool,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let found =
        if missing { Numbers::measured(argument, value) } else { Numbers::from(argument, value) }?;
    found.data.into_pyarray(py).reshape(found.shape)
}
