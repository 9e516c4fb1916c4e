"""Lines of the tables of the evidence study: what was asked for beside what was measured, one line
a family, and the figure."""

from collections.abc import Iterator
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import ddmhe
from calibration import DOUBTS, Run, cannot_promise, reliability, short
from calibration_page import verdict
from ddmhe import Reason
from ddmhe.report import pooled_nrmse, save_figure
from noisy_systems import Log
from targets import AFTER

PENDULUMS = "measured pendulums"


def pooled(runs: list[Run]) -> float:
    """NRMSE over all tests of a family: root mean square over the states."""
    error, truth = (np.vstack([getattr(r, key) for r in runs]) for key in ("error", "truth"))
    relative = np.sqrt(np.mean(error**2, axis=0)) / truth.std(axis=0)
    return float(np.sqrt(np.mean(relative**2)))


REAL = ("", "weights", "NRMSE", "3 sd", "2 sd", "sd/rms", "novel", "uncertain", "outside", "said")


def real_row(name: str, runs: list[Run], error: float) -> list[str]:
    """One line on measured logs: shares over all their steps."""
    inside = [
        np.concatenate([(np.abs(r.error) <= b * r.std).ravel() for r in runs]) for b in (3, 2)
    ]
    reasons = np.concatenate([r.reasons for r in runs])
    shares = [
        f"{np.mean(reasons & reason != 0):.3f}"
        for reason in (Reason.NOVEL, Reason.UNCERTAIN, Reason.OUTSIDE)
    ]
    said = [
        i
        for i in range(len(runs[0].spread))
        if any(f"state {i} " in w for r in runs for w in r.warned if "cannot promise" in w)
    ]
    words = f"cannot promise state {', '.join(map(str, said))}" if said else "–"
    cells = [f"{v.mean():.3f}" for v in inside]
    ratio = short(float(np.median([r.ratio for r in runs])))
    return [name, runs[0].weights, f"{error:.3f}", *cells, ratio, *shares, words]


def windows_row(name: str, runs: list[Run]) -> list[str] | None:
    """How many windows are bad, and what found them; doubt in good ones."""
    bad = np.concatenate([run.bad for run in runs])
    told = {r: np.concatenate([run.told(r) for run in runs]) for r in (Reason.NOVEL, DOUBTS)}
    if not bad.size:
        return None

    def share(of: np.ndarray) -> str:
        return f"{of.mean():.3f}" if of.size else "–"

    found = [share(told[reason][bad]) for reason in told]
    return [name, f"{bad.sum()} of {bad.size}", *found, share(told[DOUBTS][~bad])]


def diagram_rows(families: dict[str, list[Run]]) -> list[list[str]]:
    """Bins of stated deviations: rms stated → rms error, and how many."""
    rows = []
    for name, runs in families.items():
        cells = []
        for count, stated, error in reliability(runs):
            cells.append("–" if np.isnan(stated) else f"{error / stated:.2f} ({count:.0e})")
        rows.append([name, *cells])
    return rows


def draw(families: dict[str, list[Run]], path: Path) -> None:
    """Stated against real, one curve a family; exact bars lie on the diagonal."""
    figure, axes = plt.subplots(figsize=(6.4, 4.8), layout="constrained")
    for i, (name, runs) in enumerate(families.items()):
        points = [(s, e) for _, s, e in reliability(runs) if np.isfinite(s) and e > 0]
        style = {"marker": "osv^D"[i // 10], "markersize": 3.5, "linewidth": 1.0}
        axes.loglog(*zip(*points, strict=True), label=name, **style)
    ends = np.array([0.005, 5.0])
    axes.loglog(ends, ends, color="0.3", linewidth=0.8)
    axes.loglog(ends, 3 * ends, color="0.3", linewidth=0.8, linestyle=":")
    axes.set(xlabel="stated deviation / recorded spread", ylabel="rms error / recorded spread")
    axes.set(xlim=ends, ylim=(1e-3, 10))
    axes.legend(fontsize=6.5)
    save_figure(figure, path)
    plt.close(figure)


def demo_words(runs: list[Run], along: list[float]) -> Iterator[list[str]]:
    """What was asked of the demo, steps of a tenth of a second; `along` B, see `along_field`."""
    since, ratios = [], []
    for run in runs:
        trusted = np.flatnonzero(run.reasons & DOUBTS == 0)
        since.append((trusted[-1] + 1) / 10 if trusted.size else 0.0)
        size = [
            np.sqrt(np.mean(np.sum(v[AFTER - 10 : AFTER] ** 2, axis=1)))
            for v in (run.std, run.error)
        ]
        ratios.append(size[0] / size[1])
    least = min(ratios), min(along)
    name = "demo, worst seed:"
    yield [
        f"{name} in doubt to the end from",
        *verdict("≤ 20 s", f"{max(since):.1f} s", max(since) <= 20),
    ]
    yield [
        f"{name} stated deviation over error at 100 s",
        *verdict("≥ 0.5", f"{least[0]:.2f}", least[0] >= 0.5),
    ]
    yield [
        f"{name} deviation along B over the recorded spread at 100 s",
        *verdict("≥ 1", f"{least[1]:.2f}", least[1] >= 1),
    ]


def along_field(log: Log) -> float:
    """Stated deviation along the field, which outputs do not see, over the recorded spread, at the
    end of a run."""
    B = ddmhe.models.detumbling().B
    direction = B / np.linalg.norm(B)
    Sigma = ddmhe.DdMhe(log.history).run(log.Y).covariance[-1]
    recorded = log.history.recordings[0][0] @ direction
    return float(np.sqrt(direction @ Sigma @ direction) / recorded.std())


def coverage_row(name: str, runs: list[Run], least: float, most: float = 1.0) -> list[str]:
    """Of all errors within three deviations."""
    found = float(np.mean([run.within(3) for run in runs]))
    asked = f"≥ {least:.1%}" if most == 1.0 else f"{least:.1%} to {most:.1%}"
    return [f"{name}: 3 sd", *verdict(asked, f"{found:.2%}", least <= found <= most)]


def asked_of_lines(default: dict[str, list[Run]], exact: list[Run]) -> Iterator[list[str]]:
    """The rows on linear systems."""
    for name, runs in default.items():
        yield coverage_row(f"{name}, noisy recording, default", runs, 0.995)
    for name, runs in default.items():
        recorded = [run for run in runs if run.weights == "recorded"]
        nees = float(np.mean([run.nees.mean() for run in recorded]))
        label = f"{name}, weights of the recording ({len(recorded)} runs): mean NEES/n"
        yield [label, *verdict("0.7 to 1.7", f"{nees:.2f}", 0.7 <= nees <= 1.7)]
    yield coverage_row("exact recording, noise stated", exact, 0.994, 0.999)
    two = float(np.mean([run.within(2) for run in exact]))
    yield [
        "exact recording, noise stated: 2 sd",
        *verdict("95 % to 96.5 %", f"{two:.2%}", 0.95 <= two <= 0.965),
    ]
    doubted = float(np.mean([run.share(DOUBTS) for run in default["noise-driven"]]))
    yield [
        "noise-driven: steps in doubt",
        *verdict("≤ 1 %", f"{doubted:.2%}", doubted <= 0.01),
    ]


def asked_of_pendulums(runs: list[Run]) -> Iterator[list[str]]:
    inside = [run.within(3) for run in runs]
    mean, worst, ratio = np.mean(inside), min(inside), np.median([run.ratio for run in runs])
    name = f"{len(runs)} pendulum logs"
    yield [f"{name}: 3 sd, mean", *verdict("≥ 98.5 %", f"{mean:.2%}", mean >= 0.985)]
    yield [f"{name}: 3 sd, worst", *verdict("≥ 95 %", f"{worst:.2%}", worst >= 0.95)]
    fair = 0.6 <= ratio <= 2
    yield [f"{name}: median sd/rms", *verdict("0.6 to 2", f"{ratio:.2f}", fair)]


def asked_of_real(real: dict[str, list[Run]]) -> Iterator[list[str]]:
    """Families with their inputs, and the pendulums as one."""
    ways = {name: runs for name, runs in real.items() if "ignored" not in name}
    covered = [name for name, runs in ways.items() if np.mean([r.within(3) for r in runs]) >= 0.97]
    short_of = ", ".join(sorted(set(ways) - set(covered))) or "none"
    yield [
        "measured families: 3 sd at 97 % or more (7 of 10 of which these are some)",
        *verdict(
            "≥ 70 %",
            f"{len(covered)} of {len(ways)}; short: {short_of}",
            len(covered) >= 0.7 * len(ways),
        ),
    ]
    silent, good = [], []
    for name, runs in ways.items():
        bad = error_of(name, runs) > 0.7
        doubted = float(np.mean([run.share(DOUBTS) for run in runs]))
        if bad and doubted < 0.1 and not any(map(cannot_promise, runs)):
            silent.append(name)
        if not bad:
            good.append(doubted)
    yield [
        "measured families with NRMSE > 0.7 without a word",
        *verdict("≤ 1, named", ", ".join(silent) or "none", len(silent) <= 1),
    ]
    worst = max(good, default=0.0)
    yield [
        "measured families with NRMSE ≤ 0.7: steps in doubt, worst",
        *verdict("≤ 5 %", f"{worst:.1%}", worst <= 0.05),
    ]


def asked_of_targets(runs: list[Run], level: int) -> Iterator[list[str]]:
    name = f"{len(runs)} targets, level {level}, 100 s"
    yield coverage_row(name, runs, 0.95)
    bad, told = (
        np.concatenate(v) for v in zip(*((r.bad, r.told(DOUBTS)) for r in runs), strict=True)
    )
    found = told[bad].mean()
    yield [f"{name}: bad windows found", *verdict("≥ 85 %", f"{found:.1%}", found >= 0.85)]


def error_of(name: str, runs: list[Run]) -> float:
    """Over all axes together where they have one unit and little motion in some."""
    if name == PENDULUMS:
        return float(np.mean([pooled_nrmse(run.truth + run.error, run.truth) for run in runs]))
    return pooled(runs)
