"""Memory and construction of deep windows: python benches/memory.py

Each case runs in a process of its own; memory is what the process holds beside what it held before
the estimator was made, once the window is full.
"""

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


def measure(name: str, start: str) -> None:
    """One row of the table."""
    T, units, M = CASES[name]
    motion = ddmhe.models.detumbling().simulate(90.0, 0.1, noise=0.01)
    kinds = {"x_units": "rad/s", "y_units": "N m"} if units else {}
    history = ddmhe.History(motion.x[: T + 1], motion.y[:T], dt=0.1, **kinds)
    ddmhe.DdMhe(history, horizon=5)  # libraries and their buffers
    gc.collect()
    before, begin = held(), time.perf_counter()
    estimator = ddmhe.DdMhe(history, horizon=M, start=start)
    seconds = time.perf_counter() - begin
    estimator.run(motion.y[T : T + M + 50])
    print(f"| {name} | {start} | {held() - before:.1f} | {seconds:.2f} |")


def main() -> None:
    """All cases as a table."""
    print("| | start | MB | construction, s |\n|---|---|--:|--:|", flush=True)
    for name in CASES:
        for start in STARTS:
            subprocess.run([sys.executable, __file__, name, start], check=True)


if __name__ == "__main__":
    measure(*sys.argv[1:]) if len(sys.argv) > 1 else main()
