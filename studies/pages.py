"""How large pages on long runs are, and how long they take to write.

Run with `make study-pages` (half a minute); prints the table of docs/report.md."""

import tempfile
import time
from pathlib import Path

import ddmhe


def main() -> None:
    """Print a row for each length."""
    print("| samples | run, s | page, MB | to write it, s |")
    print("|---|---|---|---|")
    for samples in (1000, 10_000, 100_000, 1_000_000):
        record = ddmhe.models.detumbling().simulate(22 + 0.1 * samples, 0.1, noise=0.01, seed=2)
        history = ddmhe.History(
            record.x[:201], record.y[:200], dt=0.1, x_units="rad/s", y_units="N m"
        )
        est = ddmhe.DdMhe(history)
        begin = time.perf_counter()
        log = est.run(record.y[200 : 200 + samples])
        ran = time.perf_counter()
        after = slice(201, 201 + samples)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "page.html"
            ddmhe.report.html(
                est, log, path, truth=record.x[after], t=record.t[after], history=history
            )
            took, size = time.perf_counter() - ran, path.stat().st_size / 1e6
        print(f"| {samples} | {ran - begin:.1f} | {size:.2f} | {took:.1f} |")


if __name__ == "__main__":
    main()
