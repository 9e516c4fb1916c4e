//! Ctrl-C in the middle of long work: the work stops, and what was finished is kept.

use pyo3::IntoPyObjectExt;
use pyo3::prelude::*;

/// What a signal's handler, or a callback, raised while the core was at work.
#[derive(Default)]
pub struct Signals(Option<PyErr>);

impl Signals {
    /// Whether a handler raised; asked by the calling thread, without the GIL. Only Python's main
    /// thread runs handlers.
    #[allow(clippy::redundant_closure_for_method_calls)] // the method holds for one lifetime only
    pub fn raised(&mut self) -> bool {
        self.raised_by(|py| py.check_signals())
    }

    /// The same for any question that may raise.
    pub fn raised_by(&mut self, ask: impl FnOnce(Python<'_>) -> PyResult<()>) -> bool {
        if self.0.is_none() {
            // no answer: the interpreter is ending, and this work with it
            let Some(answer) = Python::try_attach(ask) else { return true };
            self.0 = answer.err();
        }
        self.0.is_some()
    }

    /// What was found, or the exception that ended the work, with it as its `finished`.
    pub fn outcome<'py, T: IntoPyObject<'py>>(
        self,
        py: Python<'py>,
        found: T,
        words: &str,
    ) -> PyResult<T> {
        match self.0 {
            None => Ok(found),
            Some(raised) => Err(with_finished(py, raised, found, words)),
        }
    }
}

/// The exception with `finished` as its attribute and `words` as a note.
pub fn with_finished<'py>(
    py: Python<'py>,
    raised: PyErr,
    finished: impl IntoPyObject<'py>,
    words: &str,
) -> PyErr {
    let value = raised.value(py);
    // An exception that takes no attributes, or no notes (before Python 3.11), is raised all the
    // same.
    if let Ok(finished) = finished.into_bound_py_any(py) {
        drop(value.setattr("finished", finished));
    }
    drop(
        value.call_method1(
            "add_note",
            (format!("{words}; see the exception's attribute finished"),),
        ),
    );
    raised
}
