"""How far estimates of a tumbling body reach beyond its recording, beside the Cramér-Rao bound:
thirty random bodies and thirty held-out ones at five noise levels, 20 s recorded, 600 s from their
torque alone. Writes tables of docs/measured/reach.md and draws its figure."""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np

import ddmhe
import reach_figure
from bodies import DEG, DT, LEVELS, ONLINE, RECORDED, Case, bodies, noisy, tumbled
from bound import bound, known, sensitivities
from ddmhe.report.page import markdown_table
from reach_asked import asked, mean
from reach_page import put

HELD = "held out"
SETS = {"thirty bodies": range(1000, 1030), HELD: range(8000, 8030)}
"""Seeds. On the first thirty things may have been chosen, on the held-out ones nothing was."""
SPANS = (20, 40, 100, 600)
"""Seconds after the recording's end over which errors are taken."""
WORDS = ("none; 0.01 later", "1e-5, 0.001", "1e-4, 0.01", "1e-3, 0.01", "1e-3, 0.05")
"""Of the noise levels: of recorded rates (rad/s), of torques (N m)."""
FAR = 2.3
"""Times the bound: what counts as missed."""


@dataclass(frozen=True, eq=False)
class Found:
    """What an estimator made of a case."""

    rms: np.ndarray
    """Root-mean-square errors over SPANS (4), deg/s."""
    within: float
    """Share of errors of rates within two stated deviations."""
    trusted: float
    """Share of samples."""
    unnoticed: tuple[float, float]
    """Share of samples that are trusted while a rate errs by more than 3 and 5 deviations."""
    doubt: float
    """Seconds until an estimate is first not trusted; NaN where all are."""
    fell: bool
    """Whether an affine estimator took over."""
    size: np.ndarray
    """|error| (N), deg/s, as it grows."""


def spans(size, dt=DT):
    """Root-mean-square (4, …) of |error| (N, …) over SPANS, those beyond its end left out."""
    return np.array(
        [np.sqrt(np.mean(size[: round(s / dt)] ** 2, axis=0)) for s in SPANS
         if round(s / dt) <= len(size)]
    )  # fmt: skip


def judged(log, case: Case) -> Found:
    off = np.abs(log.x - case.truth)
    size = DEG * np.linalg.norm(off, axis=1)
    beyond = [np.any(off > k * log.std, axis=1) for k in (3, 5)]
    doubt = np.argmin(log.trusted) * case.dt if not np.all(log.trusted) else np.nan
    return Found(
        spans(size, case.dt),
        float(np.mean(off <= 2 * log.std)),
        float(np.mean(log.trusted)),
        tuple(float(np.mean(log.trusted & far)) for far in beyond),
        float(doubt),
        bool(np.any(log.status == "affine")),
        size.astype(np.float32),
    )


def stated(case: Case):
    """The noise, as `RigidBodyMhe` is told."""
    return dict(zip(("x_noise", "y_noise", "output_noise"), case.noise, strict=True))


def estimators(case: Case, more: bool) -> dict[str, Callable]:
    """What takes part, by name; `more` of it on held-out bodies."""
    history, noise = case.history, stated(case)
    made = {
        "DdMhe": lambda: ddmhe.DdMhe(history, output_noise=max(case.noise[2], 1e-9)),
        "now": lambda: ddmhe.RigidBodyMhe(history, refit="now", **noise),
        "sliced": lambda: ddmhe.RigidBodyMhe(history, refit="sliced", **noise),
    }
    if more:
        made["noise unknown"] = lambda: ddmhe.RigidBodyMhe(history)
        made["one optimum"] = lambda: ddmhe.RigidBodyMhe(history, optima=1, **noise)
    return made


def estimated(job: tuple[Case, bool]) -> dict[str, Found]:
    return {name: judged(make().run(job[0].Y), job[0]) for name, make in estimators(*job).items()}


def everywhere(work, jobs) -> Iterator:
    """`work` of each job in turn, made by all processors."""
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        yield from pool.map(work, jobs)


@dataclass(frozen=True, eq=False)
class Level:
    """All bodies of a set at one noise level."""

    bound: np.ndarray
    """|error| over time that the Cramér-Rao bound allows (N, B), deg/s."""
    known: np.ndarray
    """Of the filter that knows everything but the noise (N, B)."""
    found: dict[str, list[Found]]
    """By estimator, a body each."""

    @property
    def rigid(self) -> list[str]:
        return [name for name in self.found if name != "DdMhe"]

    def rms(self, name) -> np.ndarray:
        """Errors over SPANS (4, B), deg/s."""
        return np.array([one.rms for one in self.found[name]]).T

    def ratio(self, name) -> np.ndarray:
        """Errors over the bound (4, B)."""
        return self.rms(name) / spans(self.bound)


def studied(seeds, more) -> list[Level]:
    group = bodies(seeds)
    x, y = tumbled(group)
    levels = [
        [noisy(x[:, k], y[:, k], seed, level) for k, seed in enumerate(seeds)]
        for level in range(len(LEVELS))
    ]
    by_unknowns = sensitivities(group, RECORDED + ONLINE)
    bounds = [DEG * bound(*by_unknowns, cases, RECORDED) for cases in levels]
    del by_unknowns
    logs = everywhere(estimated, [(case, more) for cases in levels for case in cases])
    made = []
    for cases, limit in zip(levels, bounds, strict=True):
        truth = np.stack([case.truth for case in cases], 1)
        off = DEG * np.linalg.norm(known(group, cases) - truth, axis=2)
        found = [next(logs) for _ in cases]
        by_name = {name: [one[name] for one in found] for name in found[0]}
        made.append(Level(limit, off, by_name))
    return made


def errors(levels):
    """The median error of all bodies (deg/s), in brackets the largest."""
    rows = []
    for words, level in zip(WORDS, levels, strict=True):
        parts = {"bound": spans(level.bound), "everything known": spans(level.known)}
        parts |= {name: level.rms(name) for name in level.found}
        for name, rms in parts.items():
            if name != "bound" or words != WORDS[0]:
                shown = f"RigidBodyMhe, {name}" if name in level.rigid else name
                rows.append((words, shown, *(f"{np.median(v):.2g} ({v.max():.2g})" for v in rms)))
    return markdown_table(("noise", "estimator", *(f"{s} s" for s in SPANS)), rows)


def ratios(sets):
    """Errors over the bound: geometric mean, in brackets the largest, and the share up to FAR."""
    rows = []
    for title, levels in sets.items():
        for name in levels[0].rigid:
            own = [(w, level.ratio(name)) for w, level in zip(WORDS[1:], levels[1:], strict=True)]
            own.append(("all", np.hstack([ratio for _, ratio in own])))
            for words, ratio in own:
                cells = [f"{mean(v):.2f} ({v.max():.3g})" for v in ratio]
                rows.append((title, name, words, *cells, f"{np.mean(ratio <= FAR):.0%}"))
    head = ("bodies", "fits", "noise", *(f"{s} s" for s in SPANS), f"up to {FAR}")
    return markdown_table(head, rows)


def bars(sets):
    """How the stated deviations hold over 600 s, and what is trusted."""
    rows = []
    for title, levels in sets.items():
        for name in levels[0].rigid:
            for words, level in zip(WORDS, levels, strict=True):
                own = level.found[name]
                within = np.array([one.within for one in own])
                three, five = np.array([one.unnoticed for one in own]).T
                rows.append(
                    (title, name, words, f"{within.mean():.2f} ({within.min():.2f})",
                     f"{np.mean([one.trusted for one in own]):.1%}",
                     f"{three.mean():.1%} ({three.max():.0%})",
                     f"{five.mean():.1%} ({five.max():.0%})")
                )  # fmt: skip
    head = ("bodies", "fits", "noise", "within 2 sd", "trusted", "unnoticed, 3 sd", "5 sd")
    return markdown_table(head, rows)


def missed(sets):
    """The cases with noise in which an error of "now" is more than FAR times the bound."""
    rows = []
    for title, levels in sets.items():
        seeds, group = SETS[title], bodies(SETS[title])
        for words, level in zip(WORDS[1:], levels[1:], strict=True):
            made = {name: level.ratio(name) for name in ("now", "sliced")}
            worst = made["now"].max(axis=0)
            for k in np.flatnonzero(worst > FAR):
                moments = np.linalg.eigvalsh(group.J[k])
                spin = DEG * np.linalg.norm(group.w[k])
                cells = [" ".join(f"{v:.3g}" for v in ratio[:, k]) for ratio in made.values()]
                within = [f"{level.found[name][k].within:.2f}" for name in made]
                rows.append((title, words, str(seeds[k]), f"{spin:.1f}",
                             f"{moments[-1] / moments[0]:.2f}", *cells,
                             " ".join(within)))  # fmt: skip
    head = ("bodies", "noise", "seed", "spin (deg/s)", "Jmax/Jmin", "now", "sliced", "within 2 sd")
    return markdown_table(head, rows)


def main():
    """All cases; the tables; the figure."""
    sets = {title: studied(seeds, title == HELD) for title, seeds in SETS.items()}
    put("asked", asked(sets))
    put("errors", errors(sets[HELD]))
    put("ratios", ratios(sets))
    put("bars", bars(sets))
    put("missed", missed(sets))
    reach_figure.draw(sets[HELD][2])


if __name__ == "__main__":
    main()
