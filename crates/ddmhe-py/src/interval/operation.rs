//! Interval arithmetic for the tests, which compare it with high precision.

use crate::convert::DdmheError;
use crate::interval::ends::intervals;
use pyo3::prelude::*;

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
