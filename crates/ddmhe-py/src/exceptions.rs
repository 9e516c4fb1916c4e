//! What Python raises.

use pyo3::create_exception;
use pyo3::exceptions::PyValueError;

create_exception!(
    ddmhe,
    DdmheError,
    PyValueError,
    "Base of all errors of this package: an input was wrong.

Examples
--------
>>> import ddmhe
>>> try:
...     ddmhe.History([[0.0]], [[0.0]], dt=-1.0)
... except ddmhe.DdmheError as error:
...     print(error)
dt: expected a positive number of seconds, found -1
>>> issubclass(ddmhe.DdmheError, ValueError)
True"
);
create_exception!(
    ddmhe,
    ShapeError,
    DdmheError,
    "An array has the wrong shape.

Examples
--------
>>> import numpy as np
>>> import ddmhe
>>> try:
...     ddmhe.History(np.zeros((30, 2)), np.zeros((30, 1)), 0.1)
... except ddmhe.ShapeError as error:
...     print(error)
x: expected 31 samples, one more than y's 30, found 30 samples"
);
create_exception!(
    ddmhe,
    NotFiniteError,
    DdmheError,
    "A number that must be finite is NaN or infinite.

Examples
--------
>>> import numpy as np
>>> import ddmhe
>>> x = np.zeros((31, 1))
>>> x[7] = np.nan
>>> try:
...     ddmhe.History(x, np.zeros((30, 1)), 0.1)
... except ddmhe.NotFiniteError as error:
...     print(error)
x: expected finite numbers, found NaN at row 7, column 0"
);
create_exception!(
    ddmhe,
    RankError,
    DdmheError,
    "The recording does not hold enough information (rank condition (7)).

Examples
--------
>>> import numpy as np
>>> import ddmhe
>>> history = ddmhe.History(np.zeros((3, 2)), np.zeros((2, 1)), 0.1)
>>> try:
...     ddmhe.DdMhe(history)
... except ddmhe.RankError as error:
...     print(error)
history: expected a state x that changes, found the same x in every sample"
);
create_exception!(
    ddmhe,
    InfeasibleError,
    DdmheError,
    "Stated requirements cannot be met together."
);
create_exception!(
    ddmhe,
    ModelViolationError,
    DdmheError,
    "Measurements contradict the stated model or bounds."
);
