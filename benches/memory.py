"""Memory and construction of deep windows: python benches/memory.py

Each case runs in a process of its own; memory is what the process holds beside what it held before
the estimator was made, once the window is full: resident, and without what the C library's
allocator keeps for later (in use; glibc only).
"""

import ctypes
import gc
import subprocess
import sys
import time
from pathlib import Path

import ddmhe

# name, samples recorded, of one unit each, horizon
CASES = {
    "n = p = 3, T = 400, M = 100": (400, True, 100),
    "n = p = 3, T = 210, M = 50": (210, False, 50),
    "n = p = 3, T = 210, M = 100": (210, False, 100),
}
STARTS = ("recording", "state", "unknown")


def held() -> float:
    """Memory of this process in megabytes."""
    pages = Path("/proc/self/statm").read_text().split()[1]
    return int(pages) * 4096 / 1e6


class Allocated(ctypes.Structure):
    """What glibc's mallinfo2 tells, in bytes."""

    _fields_ = [
        (name, ctypes.c_size_t)
        for name in (
            "arena",
            "ordblks",
            "smblks",
            "hblks",
            "hblkhd",
            "usmblks",
            "fsmblks",
            "uordblks",
            "fordblks",
            "keepcost",
        )
    ]


def in_use() -> float:
    """What was allocated and not given back, in megabytes; NaN without glibc 2.33."""
    mallinfo2 = getattr(ctypes.CDLL(None), "mallinfo2", None)
    if mallinfo2 is None:
        return float("nan")
    mallinfo2.restype = Allocated
    allocated = mallinfo2()
    return (allocated.uordblks + allocated.hblkhd) / 1e6


def measure(name: str, start: str) -> None:
    """One row of the table."""
    T, units, M = CASES[name]
    motion = ddmhe.models.detumbling().simulate(90.0, 0.1, noise=0.01)
    kinds = {"x_units": "rad/s", "y_units": "N m"} if units else {}
    history = ddmhe.History(motion.x[: T + 1], motion.y[:T], dt=0.1, **kinds)
    ddmhe.DdMhe(history, horizon=5)  # libraries and their buffers
    gc.collect()
    before, used, begin = held(), in_use(), time.perf_counter()
    estimator = ddmhe.DdMhe(history, horizon=M, start=start)
    seconds = time.perf_counter() - begin
    estimator.run(motion.y[T : T + M + 50])
    memory = f"{held() - before:.1f} | {in_use() - used:.1f}"
    print(f"| {name} | {start} | {memory} | {seconds:.2f} |")


def main() -> None:
    """All cases as a table."""
    print(
        "| | start | resident, MB | in use, MB | construction, s |\n|---|---|--:|--:|--:|",
        flush=True,
    )
    for name in CASES:
        for start in STARTS:
            subprocess.run([sys.executable, __file__, name, start], check=True)


if __name__ == "__main__":
    measure(*sys.argv[1:]) if len(sys.argv) > 1 else main()
