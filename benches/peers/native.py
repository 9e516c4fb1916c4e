"""DAQP's C library, compiled from the sources of its Python package, in a loop of our own without
Python."""

import ctypes
import subprocess
import sys
import tarfile
from functools import cache
from pathlib import Path

import numpy as np
from cases import Array, Reduced

HERE = Path(__file__).parent


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
    files = [str(HERE / "daqp_loop.c"), *map(str, sorted((sources / "src").glob("*.c")))]
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
