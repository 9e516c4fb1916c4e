"""What rejecting doubtful outputs is worth: errors with spikes, with and without a gate."""

import copy

import numpy as np

import ddmhe
import real_logs
from calibration_page import verdict
from ddmhe.report.page import markdown_table
from output_faults import Case, all_systems, no_fault, spikes
from real_logs import Test

KINDS = {
    "none": (no_fault, None),
    "1 % of 100 σ": (spikes(0.01, 100.0), (1.05, 1.3)),
    "5 % of 10 σ": (spikes(0.05, 10.0), (1.1, np.inf)),
}
"""Spikes, and the geometric mean and the worst error factor that are asked for."""
MOST_FALSE = 0.005


def error(test: Test, x_hat: np.ndarray) -> float:
    """Rms over states and samples, each state over its recorded spread."""
    recorded = np.vstack([x for x, _ in test.log.history.recordings])
    apart = (x_hat - test.log.truth) / recorded.std(axis=0)
    return float(np.sqrt(np.nanmean(apart**2)))


def run(est, test: Test, Y: np.ndarray):
    """A copy of the estimator over the outputs."""
    return copy.copy(est).run(Y) if test.U is None else copy.copy(est).run(Y, test.U)


def gated_one(test: Test, gate: str | None):
    """An estimator with a gate; None where there is to be none, or where it is refused, as for a
    recording without noise."""
    if gate is None:
        return None
    try:
        return real_logs.estimator(test, gate=gate)
    except ddmhe.DdmheError:
        return None


def factors(case: Case, gate: str | None) -> dict[str, list[tuple[float, float, float]]]:
    """By spikes, of each test: the error factor without a gate, with it, and the share of good
    outputs that it left out; NaN for what there is not."""
    found: dict[str, list] = {name: [] for name in KINDS}
    for i, test in enumerate(case.tests):
        plain = real_logs.estimator(test)
        gated = gated_one(test, gate)
        clean = error(test, run(plain, test, test.log.Y).x)
        for name, (fault, _) in KINDS.items():
            made = fault(test.log, 0, np.random.default_rng([i, 3]))
            without = error(test, run(plain, test, made.Y).x) / clean
            beside = (np.nan, np.nan)
            if gated is not None:
                ran = run(gated, test, made.Y)
                false = float(np.mean(ran.evidence.gated & ~made.hit))
                beside = (error(test, ran.x) / clean, false)
            found[name].append((without, *beside))
    return found


def cells(values: list[tuple[float, float, float]]) -> list[str]:
    """Geometric mean and worst without and with the gate, and false rejections."""
    without, with_gate, false = np.array(values).T
    said = []
    for factor in (without, with_gate):
        known = factor[np.isfinite(factor)]
        mean = f"{np.exp(np.mean(np.log(known))):.2f} ({known.max():.2f})" if known.size else "–"
        said.append(mean)
    known = false[np.isfinite(false)]
    return [*said, f"{known.mean():.4f}" if known.size else "–"]


def gate_tables(runs: int, first: int, gate: str | None, progress) -> tuple[list, list[str]]:
    """Rows of what was asked for, and the tables."""
    by_case = {}
    for case in all_systems(runs, first):
        by_case[case.name] = factors(case, gate)
        progress(f"gate, {case.name}")
    lines = ["### Spikes, and a gate", "", WORDS]
    for name in KINDS:
        rows = [[case, *cells(found[name])] for case, found in by_case.items()]
        header = (f"spikes: {name}", "plain", f"gate = {gate or '–'}", "false rejections")
        lines += [*markdown_table(header, rows), ""]
    return ([] if gate is None else asked(by_case)), lines


def asked(by_case) -> list[list[str]]:
    """With the gate, over all tests of all systems, one weight a system."""
    rows = []
    for name, (_, limits) in KINDS.items():
        if limits is None:
            continue
        few = ("masses", "oscillator", "detumbling")
        each = {}
        for case, found in by_case.items():
            factor = np.array(found[name])[:, 1]
            factor = factor[np.isfinite(factor)]
            if factor.size and ("5 %" not in name or case in few):
                each[case] = factor
        mean = float(np.exp(np.mean([np.mean(np.log(factor)) for factor in each.values()])))
        at = max(each, key=lambda case: each[case].max())
        worst = float(each[at].max())
        holds = mean <= limits[0] and worst <= limits[1]
        wanted = f"≤ {limits[0]:g}" + (f", worst ≤ {limits[1]:g}" if limits[1] < np.inf else "")
        rows.append(
            [f"gate, {name}", *verdict(wanted, f"{mean:.3f}, worst {worst:.2f} ({at})", holds)]
        )
    false = np.array(
        [one[2] for found in by_case.values() for each in found.values() for one in each]
    )
    if np.isfinite(false).any():
        share = float(np.nanmean(false))
        rows.append(
            ["gate: false rejections", *verdict("≤ 0.5 %", f"{share:.2%}", share <= MOST_FALSE)]
        )
    return rows


WORDS = """\
Errors over those without spikes and without a gate: geometric mean over the runs of a system, and
the worst. *false rejections*: outputs without a spike that the gate left out, of all outputs.
"""
