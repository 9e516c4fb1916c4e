"""Loops without Python: DAQP's C library, compiled from the sources of its Python package, alone
and in a whole estimator in C; and ddmhe's own step, from Rust."""

import ctypes
import subprocess
import sys
import tarfile
from functools import cache
from pathlib import Path

import numpy as np
from cases import Array, Case, Reduced

HERE = Path(__file__).parent
STEPS = HERE.parents[1] / "target/release/examples/timed_steps"
WIDTH = 8  # of the blocks in daqp_step.c


@cache
def build(directory: Path) -> ctypes.CDLL:
    """Fetch the sources, compile with -O3 -march=native and load; raises what goes wrong."""
    directory.mkdir(parents=True, exist_ok=True)
    library = directory / "libdaqp_loop.so"
    pip = [
        sys.executable,
        "-m",
        "pip",
        "download",
        "--quiet",
        "--no-deps",
        "--no-binary",
        "daqp",
        "-d",
        str(directory),
    ]
    requirement = next(
        r for r in (HERE / "requirements.txt").read_text().split() if r.startswith("daqp==")
    )
    subprocess.run([*pip, requirement], check=True, capture_output=True)
    archive = next(directory.glob("daqp-*.tar.gz"))
    with tarfile.open(archive) as tar:
        tar.extractall(directory, filter="data")
    sources = directory / archive.name.removesuffix(".tar.gz") / "csrc"
    own = [str(HERE / name) for name in ("daqp_loop.c", "daqp_step.c")]
    files = [*own, *map(str, sorted((sources / "src").glob("*.c")))]
    flags = ["-O3", "-march=native", "-shared", "-fPIC", f"-I{sources / 'include'}"]
    subprocess.run(
        ["cc", *flags, *files, "-o", str(library), "-lm"], check=True, capture_output=True
    )
    return ctypes.CDLL(str(library))


def run(
    library: ctypes.CDLL, q: Reduced, warm: bool, tolerance: float
) -> tuple[Array, Array, Array]:
    """All windows in a row: t (windows, r), whether each succeeded, nanoseconds of each."""
    count, (m, n) = len(q.lower), q.A.shape
    t, flags, times = (
        np.empty((count, n)),
        np.empty(count, dtype=np.int32),
        np.empty(count, dtype=np.int64),
    )
    lower, upper = q.lower.copy(), q.upper.copy()
    pointer = ctypes.c_void_p
    arrays = [pointer(a.ctypes.data) for a in (q.A, lower, upper, t, flags, times)]
    status = library.daqp_block(
        n,
        m,
        arrays[0],
        count,
        arrays[1],
        arrays[2],
        int(warm),
        ctypes.c_double(tolerance),
        *arrays[3:],
    )
    if status < 0:
        raise RuntimeError(f"DAQP's set-up failed with {status}")
    return t, flags == 1, times.astype(float)


class Estimator(ctypes.Structure):
    """`Estimator` of daqp_step.c."""

    _fields_ = (
        [(name, ctypes.c_int) for name in ("n", "p", "depth", "rank", "warm")]
        + [(name, ctypes.c_void_p) for name in ("A", "K_block", "A_block", "z_0", "c")]
        + [(name, ctypes.c_void_p) for name in ("lower", "upper")]
        + [("prior_weight", ctypes.c_double), ("weight", ctypes.c_void_p)]
        + [("tolerance", ctypes.c_double)]
    )


def in_blocks(M: Array) -> Array:
    """A matrix, or a vector as a column, by blocks of eight rows, column after column."""
    M = np.atleast_2d(M.T).T
    rows = -(-len(M) // WIDTH) * WIDTH
    padded = np.zeros((rows, M.shape[1]))
    padded[: len(M)] = M
    return np.ascontiguousarray(padded.reshape(-1, WIDTH, M.shape[1]).transpose(0, 2, 1))


def steps(
    library: ctypes.CDLL, case: Case, warm: bool, tolerance: float
) -> tuple[Array, Array, Array, Array]:
    """The whole step in C over all windows: x̂ (windows, n), costs, whether each succeeded,
    nanoseconds of each. All in the user's units; x̄ is the loop's own x̂."""
    q, u, M = case.reduced, case.reduced.user, case.horizon
    n, p, count = case.x.shape[1], case.y.shape[1], len(case.steps)
    rows = len(u.A)
    arrays = {
        "A": np.ascontiguousarray(u.A),
        "K_block": in_blocks(u.K),
        "A_block": in_blocks(u.A),
        "z_0": in_blocks(u.z_0),
        "c": in_blocks(u.c),
        "lower": u.lower,
        "upper": u.upper,
        "weight": u.weight,
    }
    estimator = Estimator(
        n=n,
        p=p,
        depth=M,
        rank=q.A.shape[1],
        warm=int(warm),
        prior_weight=u.prior_weight,
        tolerance=tolerance,
        **{name: array.ctypes.data for name, array in arrays.items()},
    )
    first = case.steps.start - 1
    past = np.ascontiguousarray(case.x_hat[first - M : first])
    before = np.ascontiguousarray(case.outputs[first - M : first])
    ys = np.ascontiguousarray(case.outputs[first:])
    windows, vs, costs = np.empty((count, rows)), np.empty((count, M * p)), np.empty(count)
    flags, times = np.empty(count, dtype=np.int32), np.empty(count, dtype=np.int64)
    pointer = [ctypes.c_void_p(a.ctypes.data) for a in (past, before, ys, windows, vs, costs)]
    ends = [ctypes.c_void_p(a.ctypes.data) for a in (flags, times)]
    for _ in range(2):  # the first time into the caches
        status = library.daqp_steps(
            ctypes.byref(estimator), *pointer[:2], count, *pointer[2:], *ends
        )
        if status < 0:
            raise RuntimeError(f"DAQP's set-up failed with {status}")
    x_hat = windows[:, M * n : (M + 1) * n]
    return x_hat, costs, flags == 1, times.astype(float)


def own(case: Case, directory: Path) -> Array:
    """Nanoseconds of each of ddmhe's steps in a Rust program."""
    snapshot, outputs, found = (directory / f"steps.{end}" for end in ("ddmhe", "in", "out"))
    snapshot.write_bytes(case.estimator().snapshot())
    outputs.write_bytes(np.ascontiguousarray(case.outputs, dtype="<f8").tobytes())
    arguments = [snapshot, outputs, str(case.steps.start - 1), found]
    subprocess.run([STEPS, *arguments], check=True)
    return np.fromfile(found, dtype="<u8").astype(float)
