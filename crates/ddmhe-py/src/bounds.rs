//! Bounds as arguments: (lo, hi), or as SciPy has them, a pair a channel or `Bounds`.

use crate::convert::{Numbers, ShapeError, described, number};
use crate::words::shown;
use ddmhe_core::Bounds;
use pyo3::prelude::*;
use pyo3::types::{PyList, PyString, PyTuple};

/// The two items of a sequence, which has an order.
pub fn pair<'py>(
    argument: &str,
    expected: &str,
    value: &Bound<'py, PyAny>,
) -> PyResult<[Bound<'py, PyAny>; 2]> {
    let items = tuple(argument, expected, value, &[2])?;
    Ok([items[0].clone(), items[1].clone()])
}

/// The items of a sequence that has as many as it may.
pub fn tuple<'py>(
    argument: &str,
    expected: &str,
    value: &Bound<'py, PyAny>,
    lengths: &[usize],
) -> PyResult<Vec<Bound<'py, PyAny>>> {
    let wrong = |found: String| {
        ShapeError::new_err(format!("{argument}: expected {expected}, found {found}"))
    };
    if value.cast::<PyString>().is_ok() || value.len().is_err() || value.get_item(0).is_err() {
        return Err(wrong(shown(value)));
    }
    let items = value.len()?;
    if !lengths.contains(&items) {
        return Err(wrong(format!("{items} items")));
    }
    (0..items).map(|k| value.get_item(k)).collect()
}

/// (lo, hi) with each side a scalar or `width` numbers, or for `depth` given a (depth+1, width)
/// array.
pub fn bounds(
    argument: &str,
    value: &Bound<'_, PyAny>,
    width: usize,
    depth: Option<usize>,
) -> PyResult<Bounds> {
    if let Some((lo, hi)) = pairs(argument, value, width)? {
        let whole = depth.map_or(width, |m| (m + 1) * width);
        let each = |side: Vec<f64>| side.into_iter().cycle().take(whole).collect();
        return Ok(Bounds { lo: each(lo), hi: each(hi) });
    }
    let [lo, hi] = sides(argument, value)?;
    let side = |numbers| side(argument, numbers, width, depth);
    Ok(Bounds { lo: side(lo)?, hi: side(hi)? })
}

/// Both sides of (lo, hi) or of `scipy.optimize.Bounds`.
pub fn sides(argument: &str, value: &Bound<'_, PyAny>) -> PyResult<[Numbers; 2]> {
    let scipy = value.getattr("lb").and_then(|lo| Ok([lo, value.getattr("ub")?])).ok();
    let of_scipy = scipy.is_some();
    let [lo, hi] = scipy.map_or_else(|| pair(argument, "a pair (lo, hi)", value), Ok)?;
    let numbers = |side: &Bound<'_, PyAny>| -> PyResult<Numbers> {
        let given = Numbers::from(argument, side)?;
        // SciPy has an array of one where the same bound holds for all
        let one = of_scipy && given.data.len() == 1;
        Ok(if one { Numbers::scalar(given.data[0]) } else { given })
    };
    Ok([numbers(&lo)?, numbers(&hi)?])
}

/// Bounds as SciPy has them, one (lo, hi) a channel, None in it for no bound; None for others. Of
/// two channels this can be read in two ways, and is asked about.
pub fn pairs(
    argument: &str,
    value: &Bound<'_, PyAny>,
    width: usize,
) -> PyResult<Option<(Vec<f64>, Vec<f64>)>> {
    let Ok(list) = value.cast::<PyList>() else { return Ok(None) };
    let pairs: Vec<_> = list.iter().filter_map(|item| item.cast_into::<PyTuple>().ok()).collect();
    let all = pairs.len() == list.len() && pairs.iter().all(|pair| pair.len() == 2);
    if width < 2 || pairs.len() != width || !all {
        return Ok(None);
    }
    let side = |k: usize, unbounded: f64| -> PyResult<Vec<f64>> {
        let one = |bound: &Bound<'_, PyAny>| match bound.is_none() {
            true => Ok(unbounded),
            false => number(argument, bound),
        };
        pairs.iter().map(|pair| one(&pair.get_item(k)?)).collect()
    };
    let (lo, hi) = (side(0, f64::NEG_INFINITY)?, side(1, f64::INFINITY)?);
    if width == 2 {
        return Err(ShapeError::new_err(format!(
            "{argument}: expected (lo, hi), found a list of two pairs, which can be read in two \
             ways; with one pair a channel write ({lo:?}, {hi:?})"
        )));
    }
    Ok(Some((lo, hi)))
}

/// One side of `bounds`.
pub fn side(
    argument: &str,
    numbers: Numbers,
    width: usize,
    depth: Option<usize>,
) -> PyResult<Vec<f64>> {
    let whole = depth.map_or(width, |m| (m + 1) * width);
    match numbers.shape[..] {
        [] => Ok(vec![numbers.data[0]; whole]),
        [l] if l == width => Ok(numbers.data.iter().copied().cycle().take(whole).collect()),
        [rows, columns] if columns == width && depth.is_some_and(|m| rows == m + 1) => {
            Ok(numbers.data)
        }
        _ => {
            let window =
                depth.map_or(String::new(), |m| format!(" or a ({}, {width}) array", m + 1));
            Err(ShapeError::new_err(format!(
                "{argument}: expected a scalar, {width} numbers{window} on each side, found {}",
                described(&numbers.shape)
            )))
        }
    }
}
