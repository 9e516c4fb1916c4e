"""How often errors lie within the bars that estimates state, and how often doubt is raised.

Run with `make study-evidence` (some minutes); writes docs/evidence-study.md. The pendulum logs of
`ddmhe reproduce real` take part where DDMHE_LOGS names a folder with them. The rules were chosen on
other seeds and bodies (and on these logs)."""

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import ddmhe
from ddmhe.report.page import markdown_table
from ddmhe.reproduce.real import pendulum_task
from noisy_systems import OSCILLATOR, Log, body, kinds, linear, single_axis, tumbling

REPORT = Path(__file__).resolve().parents[1] / "docs" / "evidence-study.md"
FIRST = 9000
"""Seeds from here on."""
AFTER = 1000
"""Samples after the recording of a body."""

WORDS = """\
# How often the bars hold

Printed by `make study-evidence` (studies/evidence.py). Each row: runs of as many samples as the
recording has, from its end on (bodies 100 s). *3 sd*: share of all errors within three stated
standard deviations, in brackets that of the worst run; *2 sd* the same of two; *sd/rms*: median
over runs and states of the root mean square deviation that was stated, over that of the errors;
*NEES/n*: median over runs of the mean of eᵀΣ⁻¹e over the number of states, 1 where Σ is the errors'
covariance; *novel*, *uncertain*: share of steps with that reason. Seeds and bodies are others than
those on which the rules were chosen ([evidence.md](evidence.md)); the pendulum logs served there,
too.
"""


@dataclass(frozen=True)
class Told:
    """What one run said and what was so."""

    inside: float
    twice: float
    ratio: float
    nees: float
    novel: float
    uncertain: float


def told(log: Log, settings) -> Told:
    est = ddmhe.DdMhe(log.history, **settings)
    found = est.run(log.Y)
    error = found.x - log.truth
    known = np.isfinite(error).all(axis=1)
    error, Sigma, std = error[known], found.covariance[known], found.std[known]
    nees = np.einsum("ti,tij,tj->t", error, np.linalg.pinv(Sigma, hermitian=True), error)
    ratio = np.sqrt((std**2).mean(axis=0) / np.maximum((error**2).mean(axis=0), 1e-300))
    return Told(
        (np.abs(error) < 3 * std).mean(),
        (np.abs(error) < 2 * std).mean(),
        float(np.median(ratio)),
        float(nees.mean() / error.shape[1]),
        (found.reasons & ddmhe.Reason.NOVEL != 0).mean(),
        (found.reasons & ddmhe.Reason.UNCERTAIN != 0).mean(),
    )


def row(name, logs, settings=None):
    """One line of a table."""
    runs = [told(log, settings or {}) for log in logs]
    of = {field: np.array([getattr(run, field) for run in runs]) for field in vars(runs[0])}
    nees = np.median(of["nees"])
    return [
        name,
        str(len(runs)),
        f"{of['inside'].mean():.4f} ({of['inside'].min():.3f})",
        f"{of['twice'].mean():.3f}",
        f"{np.median(of['ratio']):.2f}",
        f"{nees:.2f}" if nees < 1e3 else f"{nees:.0e}",
        f"{of['novel'].mean():.4f}",
        f"{of['uncertain'].mean():.4f}",
    ]


HEADER = ["", "runs", "3 sd (worst)", "2 sd", "sd/rms", "NEES/n", "novel", "uncertain"]


def linear_rows(T):
    for name, is_linear, logs in kinds(FIRST, T):
        if is_linear:
            logs = logs[::5] if name == "noise-driven" else logs
            yield row(f"{name}, T = {T}, default", logs)
            yield row(f"{name}, T = {T}, scaled", logs, {"weights": "scaled"})


def exact_rows():
    """Exact recordings of an oscillation and of what decays beside it, outputs with noise after."""
    A = np.zeros((3, 3))
    A[:2, :2], A[2, 2], C = OSCILLATOR, 0.98, np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 0.5]])
    made = []
    for seed in range(20):
        rng = np.random.default_rng([FIRST + seed, 8])
        log = linear(A, C, rng.standard_normal(3), (0.0, 0.0, 0.0), 150, 200, rng)
        noisy = log.Y + 0.01 * rng.standard_normal(log.Y.shape)
        made.append(Log(log.history, noisy, log.truth))
    yield row("noise stated", made, {"output_noise": 0.01})
    yield row("noise from the run", made)


def curved_rows():
    demo = [tumbling(FIRST + s, ddmhe.models.detumbling(), 0.0, after=AFTER) for s in range(6)]
    yield row("the demo's satellite, exact states", demo)
    for read in (0.0, 1e-4, 1e-3):
        logs = [tumbling(s, body(FIRST + s), read, after=AFTER) for s in range(12)]
        yield row(f"tumbling bodies, x ± {read:g}", logs)
    bench = [single_axis(FIRST + s) for s in range(10)]
    yield row("the paper's bench, default", bench)
    yield row("the paper's bench, scaled", bench, {"weights": "scaled"})


def pendulum_rows(folder):
    tasks = [pendulum_task(path) for path in sorted(Path(folder).glob("*.csv"))]
    yield row("measured pendulums", [Log(task.history, task.Y, task.x) for task in tasks])


def main():
    rows = [line for T in (100, 200, 400) for line in linear_rows(T)]
    page = [WORDS, "## Linear systems", "", *markdown_table(HEADER, rows), ""]
    page += ["## Exact recordings", "", *markdown_table(HEADER, exact_rows()), ""]
    rows = [*curved_rows()]
    if folder := os.environ.get("DDMHE_LOGS"):
        rows += pendulum_rows(folder)
    page += ["## Curved motion", "", *markdown_table(HEADER, rows), ""]
    REPORT.write_text("\n".join(page))
    print(REPORT.read_text())


if __name__ == "__main__":
    main()
