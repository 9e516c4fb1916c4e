//! What pickle and copy make objects from: a blob with a checksum, see `ddmhe_core::snapshot`.

use crate::convert::DdmheError;
use crate::words::kind;
use pyo3::PyTypeInfo;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

/// A class method with its argument, as `__reduce__` returns them.
pub type Made<'py> = (Bound<'py, PyAny>, (Bound<'py, PyBytes>,));

/// (cls.`method`, (blob,))
pub fn made<'py, T: PyTypeInfo>(py: Python<'py>, method: &str, blob: &[u8]) -> PyResult<Made<'py>> {
    Ok((py.get_type::<T>().getattr(method)?, (PyBytes::new(py, blob),)))
}

/// The bytes of the argument `blob`.
pub fn bytes<'a>(blob: &'a Bound<'_, PyAny>) -> PyResult<&'a [u8]> {
    let wrong = |_| {
        DdmheError::new_err(format!(
            "blob: expected bytes, as they were made, found {}",
            kind(blob)
        ))
    };
    Ok(blob.cast::<PyBytes>().map_err(wrong)?.as_bytes())
}
