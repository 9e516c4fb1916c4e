//! Arrays in, errors out: the border between NumPy and the core.

use ddmhe_core::{Bounds, Error};
use numpy::ndarray::Dimension;
use numpy::{
    IntoPyArray, PyArray, PyArray1, PyArray2, PyArrayDyn, PyArrayMethods, PyReadwriteArray, PyUntypedArrayMethods,
};
use pyo3::create_exception;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

create_exception!(ddmhe, DdmheError, PyValueError, "Base of all errors of this package: an input was wrong.");
create_exception!(ddmhe, ShapeError, DdmheError, "An array has the wrong shape.");
create_exception!(ddmhe, NotFiniteError, DdmheError, "A number that must be finite is NaN or infinite.");
create_exception!(ddmhe, RankError, DdmheError, "The recording does not hold enough information (rank condition (7)).");
create_exception!(ddmhe, InfeasibleError, DdmheError, "Stated requirements cannot be met together.");
create_exception!(ddmhe, ModelViolationError, DdmheError, "Measurements contradict the stated model or bounds.");

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
}

impl Numbers {
    /// Whatever `numpy.asarray(value, dtype=float)` understands; anything else is an error that names the argument.
    pub fn from(argument: &'static str, value: &Bound<'_, PyAny>) -> PyResult<Self> {
        let py = value.py();
        let numpy = py.import("numpy")?;
        let options = PyDict::new(py);
        options.set_item("dtype", "float64")?;
        options.set_item("order", "C")?;
        let kind_of = |a: &Bound<'_, PyAny>| {
            a.getattr("dtype").and_then(|d| d.getattr("kind")).and_then(|k| k.extract::<String>())
        };
        let wrong = |found: String| {
            ShapeError::new_err(format!("{argument}: expected an array of real numbers, found {found}"))
        };
        let plain = numpy.call_method1("asarray", (value,)).map_err(|e| wrong(e.value(py).to_string()))?;
        if !["f", "i", "u", "b"].contains(&kind_of(&plain)?.as_str()) {
            return Err(wrong(format!("one of type {}", plain.getattr("dtype")?)));
        }
        let array = numpy.call_method("asarray", (plain,), Some(&options))?;
        let array = array.cast::<PyArrayDyn<f64>>().map_err(|_| wrong("something else".into()))?.try_readonly()?;
        let data = array.as_slice().map_err(|_| wrong("a non-contiguous array".into()))?.to_vec();
        Ok(Numbers { shape: array.shape().to_vec(), data })
    }

    /// As [`from`](Self::from), two-dimensional; `shape` is how the expectation reads.
    pub fn matrix(argument: &'static str, value: &Bound<'_, PyAny>, shape: &str) -> PyResult<(Vec<f64>, usize, usize)> {
        let numbers = Numbers::from(argument, value)?;
        match numbers.shape[..] {
            [rows, columns] => Ok((numbers.data, rows, columns)),
            _ => Err(ShapeError::new_err(format!(
                "{argument}: expected a 2-D array {shape}, found {}",
                described(&numbers.shape)
            ))),
        }
    }

    /// As [`from`](Self::from), one-dimensional of length `len`; a scalar does where len is 1.
    pub fn vector(argument: &'static str, value: &Bound<'_, PyAny>, len: usize) -> PyResult<Vec<f64>> {
        let numbers = Numbers::from(argument, value)?;
        match numbers.shape[..] {
            [l] if l == len => Ok(numbers.data),
            [] if len == 1 => Ok(numbers.data),
            _ => Err(ShapeError::new_err(format!(
                "{argument}: expected {len} numbers, found {}",
                described(&numbers.shape)
            ))),
        }
    }
}

fn described(shape: &[usize]) -> String {
    match shape {
        [] => "a single number".into(),
        [n] => format!("a 1-D array of {n}"),
        _ => format!("an array of shape ({})", shape.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")),
    }
}

/// (lo, hi) with each side a scalar or `width` numbers, or for `depth` given a (depth+1, width) array.
pub fn bounds(
    argument: &'static str,
    value: &Bound<'_, PyAny>,
    width: usize,
    depth: Option<usize>,
) -> PyResult<Bounds> {
    let pair = |found: String| ShapeError::new_err(format!("{argument}: expected a pair (lo, hi), found {found}"));
    let sides: Vec<Bound<'_, PyAny>> =
        value.try_iter().map_err(|_| pair(value.get_type().to_string()))?.collect::<PyResult<_>>()?;
    let [lo, hi] = &sides[..] else { return Err(pair(format!("{} items", sides.len()))) };
    let side = |value: &Bound<'_, PyAny>| -> PyResult<Vec<f64>> {
        let numbers = Numbers::from(argument, value)?;
        let whole = depth.map(|m| (m + 1) * width);
        match numbers.shape[..] {
            [] => Ok(vec![numbers.data[0]; whole.unwrap_or(width)]),
            [l] if l == width => Ok(numbers.data.iter().copied().cycle().take(whole.unwrap_or(width)).collect()),
            [rows, columns] if columns == width && Some(rows * columns) == whole => Ok(numbers.data),
            _ => {
                let window = depth.map_or(String::new(), |m| format!(" or a ({}, {width}) array", m + 1));
                Err(ShapeError::new_err(format!(
                    "{argument}: expected a scalar, {width} numbers{window} on each side, found {}",
                    described(&numbers.shape)
                )))
            }
        }
    };
    Ok(Bounds { lo: side(lo)?, hi: side(hi)? })
}

/// A 1-D NumPy array.
pub fn array1<'py>(py: Python<'py>, data: &[f64]) -> Bound<'py, PyArray1<f64>> {
    PyArray1::from_slice(py, data)
}

/// A 2-D NumPy array with `width` columns.
pub fn array2<'py>(py: Python<'py>, data: Vec<f64>, width: usize) -> PyResult<Bound<'py, PyArray2<f64>>> {
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
            "{argument}: expected a writable float64 array of shape {shape:?} in C order, found {found}"
        ))
    };
    let kind = || value.getattr("dtype").map_or_else(|_| value.get_type().to_string(), |d| format!("one of type {d}"));
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
pub fn whole(argument: &'static str, value: &Bound<'_, PyAny>) -> PyResult<usize> {
    let wrong = || DdmheError::new_err(format!("{argument}: expected a whole number of at least 1, found {value}"));
    let number: i64 = value.extract().map_err(|_| wrong())?;
    usize::try_from(number).ok().filter(|&m| m > 0).ok_or_else(wrong)
}
