"""The single-axis bench, Liu et al. 2026, Section IV-A: nominal, noise, disturbance, both, and the
sweep of μ.

Its settings are in `ddmhe.cases.bench`. Since that bench is not the paper's, every claim is judged
over FAMILY: benches that differ in decay, in C, in noise and in the jerk, all of which fit what is
printed."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddmhe._core import DdMhe, History, Truncated
from ddmhe.baselines import ErrorStateKalman, KoopmanMhe, Oracle
from ddmhe.cases.bench import (
    BOX,
    DT,
    DURATION,
    EVENT,
    FAMILY,
    HISTORY,
    LARGE_NOISE,
    MU,
    MUS,
    NOISE,
    NOMINAL,
    RHO,
    SPEED,
    Bench,
    M,
)
from ddmhe.reproduce.claims import Claim, holds_for, holds_if
from ddmhe.reproduce.montecarlo import Estimators, Trial, Trials, estimates

Array = NDArray[np.float64]

LEVELS: dict[str, Callable[[Bench], str]] = {
    "decay": lambda bench: f"{bench.decay:g} s",
    "C": lambda bench: f"{bench.C:g} N·m·s",
    "noise": lambda bench: f"× {bench.noise:g}",
    "kick": lambda bench: f"{bench.kick:g} rad/s",
}
"""How the benches differ, in words."""

MHE, DEFAULTS, FREE, KMHE, ESKF, TUNED, EKF = (
    "Dd-MHE, paper's weights",
    "Dd-MHE, defaults",
    "Dd-MHE, defaults, no box",
    "Dd-KMHE, paper's weights",
    "Dd-ESKF, Q = 1e5, R = 1e3",
    "Dd-ESKF, tuned",
    "EKF with the true model",
)
JUDGED = (MHE, KMHE, ESKF)
"""What the paper compares."""


def family(disturbed: bool) -> tuple[Bench, ...]:
    """The benches that differ for an experiment: without a disturbance the kick does not matter."""
    return tuple(bench for bench in FAMILY if disturbed or bench.kick == NOMINAL.kick)


def estimators(history: History, bench: Bench, x_0: Array, mu: float, seed: int) -> Estimators:
    """What takes part, by name; `seed` draws the centres of Dd-KMHE."""
    box: dict[str, Any] = {"x_bounds": (-BOX, BOX), "x_center": "history"}
    return {
        MHE: lambda: DdMhe(history, M, RHO, mu, space=Truncated(1), start="state", **box),
        DEFAULTS: lambda: DdMhe(history, start="state", **box),
        FREE: lambda: DdMhe(history, start="state"),
        KMHE: lambda: KoopmanMhe(history, M, RHO, mu, seed=seed),
        ESKF: lambda: ErrorStateKalman(history, 1e5, 1e3),
        TUNED: lambda: ErrorStateKalman(history),
        EKF: lambda: Oracle(bench.model, DT, x_0, bench.deviation, prior=0.05, motion=0.02),
    }


def trial(
    seed: int,
    noisy: bool = False,
    disturbed: bool = False,
    mu: float = MU,
    bench: Bench = NOMINAL,
    names: Sequence[str] | None = None,
) -> Trial:
    """One run of a bench with the estimators `names`, all by default; seed 0 also has the box of
    its figure."""
    steps, T = round(DURATION / DT), round(HISTORY / DT)
    t: Array = DT * np.arange(steps + 1, dtype=np.float64)
    kick = np.zeros((steps, 1))
    if disturbed:
        during = (t[:-1] >= EVENT[0]) & (t[:-1] < EVENT[0] + 0.2 * (EVENT[1] - EVENT[0]))
        kick[during] = bench.kick / during.sum()
    record = bench.model.simulate(DURATION, DT, disturbance=kick)
    level = np.full(steps + 1, bench.deviation)
    if noisy:
        level[(t >= EVENT[0]) & (t < EVENT[1])] *= LARGE_NOISE / NOISE
    y = record.y + level[:, None] * np.random.default_rng(seed).standard_normal(record.y.shape)
    history = History(
        record.x_recorded[: T + 1], y[:T], dt=DT, x_units=record.x_units, y_units=record.y_units
    )
    taken = estimators(history, bench, record.x_recorded[T], mu, seed)
    found = estimates(
        {name: taken[name] for name in (taken if names is None else names)}, y[T:-1], 1
    )
    center, active = box(history, y[T:-1], M, RHO, mu, 1) if seed == 0 else (None, None)
    known = t[: T + 1], record.x_recorded[: T + 1]
    return Trial(np.asarray(t[T + 1 :]), record.x[T + 1 :], y[T:-1], found, known, center, active)


def box(
    history: History, Y: Array, horizon: int, rho: float, mu: float, rank: int
) -> tuple[Array, Array]:
    """x_c(t) (N, n) and the number of active bounds (N,) of the paper's box. A box without width
    leaves x_c alone."""

    def run(width: float) -> Any:
        space, bounds = Truncated(rank), (-width, width)
        estimator = DdMhe(
            history, horizon, rho, mu, space=space, x_bounds=bounds, x_center="history"
        )
        return estimator.run(Y)

    return run(0.0).x, run(BOX).active


WHOLE, BEFORE, DURING, AFTER, LATER = (
    (0.0, math.inf),
    (0.0, 1.0),
    (1.0, 1.5),
    (1.6, 2.5),
    (1.0, 2.5),
)
"""Spans of the errors, s after the history; AFTER leaves the estimators 0.1 s to recover."""
SPANS = {"all": WHOLE, "during": DURING, "after": AFTER, "later": LATER}
"""Those of the family's series, by name."""


def _typical(trials: Trials, name: str, span: tuple[float, float]) -> float:
    return float(np.median(trials.rms(name, *span)))


def _scatter(trials: Trials, name: str) -> float:
    return float(np.median(trials.scatter(name, *DURING)))


def _diverged(trials: Trials, name: str, span: tuple[float, float]) -> bool:
    """An error above the initial speed says nothing about noise or disturbances any more."""
    return _typical(trials, name, span) > SPEED


def short(name: str) -> str:
    """Without the weights that the paper prints: only what departs from them is named."""
    return name.removesuffix(", paper's weights").removesuffix(", Q = 1e5, R = 1e3")


def _numbers(trials: Trials, span: tuple[float, float], names: tuple[str, ...]) -> str:
    parts = [f"{short(name)} {_typical(trials, name, span):.3g}" for name in names]
    return ", ".join(parts) + " rad/s"


Judge = Callable[[Bench, Trials], "bool | None"]
Words = Callable[[Trials], str]


@dataclass(frozen=True)
class Statement:
    """A claim about a figure, and how one bench decides it."""

    source: str
    claim: str
    judge: Judge
    """Whether it holds on a bench; None where that bench cannot tell."""
    numbers: Words
    """What the nominal bench gives."""
    why: str
    """The criterion, in words."""

    def over(self, found: Mapping[Bench, Trials]) -> Claim:
        """The verdict over all benches."""
        judged = {bench: self.judge(bench, trials) for bench, trials in found.items()}
        ours = f"{shares(judged)}; nominal bench: {self.numbers(found[NOMINAL])}"
        return Claim(self.source, self.claim, "", ours, holds_for(list(judged.values())), self.why)


def shares(judged: Mapping[Bench, bool | None]) -> str:
    """On how many benches a claim holds, and where: per value of what they differ in."""
    known = {bench: each for bench, each in judged.items() if each is not None}
    text = f"{sum(map(bool, known.values()))} of {len(known)} benches"
    if len(known) < len(judged):
        text += f" ({len(judged) - len(known)} cannot tell)"
    if not any(known.values()) or all(known.values()):
        return text
    parts = []
    for quantity, label in LEVELS.items():
        counts: dict[str, list[bool]] = {}
        for bench, each in known.items():
            counts.setdefault(label(bench), []).append(bool(each))
        if len({sum(each) / len(each) for each in counts.values()}) > 1:
            levels = ", ".join(f"{level} {sum(each)}/{len(each)}" for level, each in counts.items())
            parts.append(f"{quantity} {levels}")
    return f"{text} ({'; '.join(parts)})"


def _converges(name: str) -> Statement:
    return Statement(
        "IV-A2, Fig. 2",
        f"{short(name)} converges in the nominal experiment",
        lambda _, trials: _typical(trials, name, WHOLE) < 0.03 * SPEED,
        lambda trials: _numbers(trials, WHOLE, (name,)),
        "criterion: median RMSE over the 2.5 s after the history below 3 % of the initial speed",
    )


def _better(source: str) -> Statement:
    """The summary of Section V on one experiment."""
    return Statement(
        f"V, with {source}",
        "Dd-MHE performs better than Dd-KMHE and Dd-ESKF",
        lambda _, trials: all(
            _typical(trials, MHE, WHOLE) < _typical(trials, name, WHOLE) for name in (KMHE, ESKF)
        ),
        lambda trials: _numbers(trials, WHOLE, JUDGED),
        "criterion: the smallest median RMSE of the three over the 2.5 s after the history",
    )


def _recovers(name: str) -> Statement:
    return Statement(
        "IV-A2, Fig. 3",
        f"Under large noise {short(name)} is off, and comes back quickly once it ends",
        lambda _, trials: (
            _typical(trials, name, AFTER) < 0.5 * _typical(trials, name, DURING)
            or _typical(trials, name, AFTER) < 0.01 * SPEED
        ),
        lambda trials: (
            f"during {_numbers(trials, DURING, (name,))}, after {_numbers(trials, AFTER, (name,))}"
        ),
        "criterion: from 0.1 s after the noise the error is below half of that during it, or below "
        "1 % of the initial speed",
    )


def _less_noisy(bench: Bench, trials: Trials) -> bool | None:
    if any(_diverged(trials, name, DURING) for name in (MHE, KMHE)):
        return None
    return _scatter(trials, MHE) > _scatter(trials, KMHE)


def _follows(name: str, bench: Bench, trials: Trials) -> bool:
    return _typical(trials, name, AFTER) < 0.1 * bench.kick


def _scatters(trials: Trials, names: tuple[str, ...]) -> str:
    return (
        ", ".join(f"{short(name)} {_scatter(trials, name):.3g}" for name in names)
        + " rad/s of scatter"
    )


STATEMENTS: dict[str, tuple[Statement, ...]] = {
    "nominal": (*map(_converges, JUDGED), _better("Fig. 2")),
    "noise": (
        *map(_recovers, (MHE, KMHE)),
        Statement(
            "IV-A2, Figs. 3-5",
            "Dd-MHE is more contaminated by noise than Dd-KMHE",
            _less_noisy,
            lambda trials: _scatters(trials, (MHE, KMHE)),
            "criterion: scatter about the estimates' own cubic trend during the noise, larger for "
            "Dd-MHE; a bench on which one of them has left the initial speed behind cannot tell",
        ),
        Statement(
            "IV-A2, Fig. 3",
            "Dd-ESKF with Q = 1e5, R = 1e3 is strongly robust against noise",
            lambda _, trials: _scatter(trials, ESKF) < 0.5 * _scatter(trials, MHE),
            lambda trials: _scatters(trials, (MHE, ESKF, TUNED)),
            "criterion: less than half of Dd-MHE's scatter during the noise. How far Q = 1e5 "
            "against R = 1e3 trusts the model is a matter of C²Q/R, and so of units: 2.5e-5 to "
            "0.25 in the family",
        ),
        _better("Fig. 3"),
    ),
    "disturbance": (
        Statement(
            "IV-A2, Fig. 4",
            "Dd-ESKF (Q = 1e5, R = 1e3) cannot follow the disturbance",
            lambda bench, trials: _typical(trials, ESKF, AFTER) > 0.25 * bench.kick,
            lambda trials: _numbers(trials, AFTER, (ESKF, TUNED)),
            "criterion: more than a quarter of the kick is missed from 0.1 s after the event on; "
            "as for Fig. 3, a matter of C²Q/R: the paper prints no C",
        ),
        Statement(
            "IV-A2, Fig. 4",
            "Dd-MHE follows the disturbance quickly",
            lambda bench, trials: _follows(MHE, bench, trials),
            lambda trials: _numbers(trials, AFTER, (MHE, DEFAULTS)),
            "criterion: less than a tenth of the kick is missed from 0.1 s after the event on",
        ),
        Statement(
            "IV-A2, Fig. 4",
            "Dd-KMHE adapts less well to the disturbance than Dd-MHE",
            lambda _, trials: _typical(trials, KMHE, AFTER) > 1.2 * _typical(trials, MHE, AFTER),
            lambda trials: _numbers(trials, AFTER, (MHE, KMHE)),
            "criterion: at least 1.2 times Dd-MHE's error from 0.1 s after the event on",
        ),
        _better("Fig. 4"),
    ),
    "both": (
        Statement(
            "IV-A2, Fig. 5",
            "With noise and disturbance Dd-KMHE deviates unacceptably",
            lambda bench, trials: _typical(trials, KMHE, LATER) > 0.5 * bench.kick,
            lambda trials: _numbers(trials, LATER, (KMHE,)),
            "criterion: RMSE above half of the kick, from the event on",
        ),
        Statement(
            "IV-A2, Fig. 5",
            "With noise and disturbance Dd-MHE does well",
            lambda bench, trials: _typical(trials, MHE, LATER) < 0.25 * bench.kick,
            lambda trials: _numbers(trials, LATER, (MHE, DEFAULTS, EKF)),
            "criterion: RMSE below a quarter of the kick, from the event on",
        ),
        _better("Fig. 5"),
    ),
}
"""By experiment."""


def claims(experiment: str, found: Mapping[Bench, Trials]) -> list[Claim]:
    """Verdicts on "nominal" (Fig. 2), "noise" (3), "disturbance" (4) or "both" (5) over a family of
    benches."""
    return [statement.over(found) for statement in STATEMENTS[experiment]]


def claims_mu(found: Mapping[Bench, Mapping[float, Trials]]) -> list[Claim]:
    """Fig. 6: errors over the sweep of μ on each bench."""
    spread: dict[Bench, dict[str, tuple[float, float]]] = {}
    for bench, sweep in found.items():
        errors = {
            name: [_typical(trials, name, WHOLE) for trials in sweep.values()]
            for name in (MHE, KMHE)
        }
        spread[bench] = {name: (min(each), max(each)) for name, each in errors.items()}
    ratio = {
        bench: {name: hi / lo for name, (lo, hi) in each.items()} for bench, each in spread.items()
    }
    here = ratio[NOMINAL]
    ratios = f"largest over smallest median RMSE: Dd-MHE {here[MHE]:.3g}, Dd-KMHE {here[KMHE]:.3g}"
    rows = []
    for name in (MHE, KMHE):
        lo, hi = spread[NOMINAL][name]
        rows.append(
            (
                "IV-A2, Fig. 6",
                f"The estimates of {short(name)} are stable for every μ",
                {bench: each[name][1] < SPEED for bench, each in spread.items()},
                f"{lo:.3g} to {hi:.3g} rad/s",
                f"criterion: no median RMSE above the initial speed for μ from {MUS[0]:g} to "
                f"{MUS[-1]:g}",
            )
        )
    rows.append(
        (
            "IV-A2, Fig. 6",
            "Dd-KMHE is much more sensitive to μ than Dd-MHE",
            {bench: each[KMHE] > 2 * each[MHE] for bench, each in ratio.items()},
            ratios,
            "criterion: twice the ratio of largest to smallest median RMSE over the sweep",
        )
    )
    rows.append(
        (
            "V, with Fig. 6",
            "Dd-MHE is less sensitive to the parameter",
            {bench: each[KMHE] > each[MHE] for bench, each in ratio.items()},
            ratios,
            "criterion: the smaller ratio. Dd-ESKF has no μ",
        )
    )
    return [
        *(
            Claim(
                source,
                claim,
                "",
                f"{shares(judged)}; nominal bench: {ours}",
                holds_for(list(judged.values())),
                why,
            )
            for source, claim, judged, ours, why in rows
        ),
        Claim(
            "IV-A1, (33)",
            "ρ = 0.9 and M = 20 satisfy 4ρ^M < 1",
            "",
            f"4·0.9^20 = {4 * RHO**M:.3g}",
            holds_if(4 * RHO**M < 1),
            "arithmetic",
        ),
    ]
