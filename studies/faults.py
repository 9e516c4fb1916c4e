"""Which faults of outputs an estimator sees, how soon, and at what price in false alarms; outputs
that are late; what a gate is worth.

Run with `make study-faults`; writes the second half of docs/measured/evidence.md. Measured logs
take part where DDMHE_DATA names their folder. RUNS=4 makes it quick, GATE=none leaves out the
gate."""

import copy
import os
import time
from dataclasses import dataclass

import numpy as np

import real_logs
from calibration import DOUBTS
from calibration_page import verdict, write_half
from ddmhe import Reason
from ddmhe.report.page import markdown_table
from gated import gate_tables
from late_outputs import late_tables
from output_faults import Case, Fault, Faulty, cases, faults
from real_logs import Test

RUNS = int(os.environ.get("RUNS", "20"))
GATE = None if os.environ.get("GATE") == "none" else os.environ.get("GATE", "auto")
"""Of the gate's columns."""
FIRST = 40_000
"""Seeds from here on."""
KINDS = {
    "novel": Reason.NOVEL,
    "uncertain": Reason.UNCERTAIN,
    "stuck": Reason.STUCK,
    "outside": Reason.OUTSIDE,
    "any doubt": DOUBTS,
}


@dataclass(frozen=True)
class Look:
    """One run with one fault."""

    since: dict[str, float]
    """Samples from the fault to the first step with the reason; infinite for none while watched."""
    before: float
    """Share of the steps before the fault that are in doubt."""
    factor: float
    """Rms error while watched, each state over its recorded spread, over that without the fault."""
    error: float
    """The same rms error."""
    silent: float
    """The largest error over the recorded spread, root mean square over the states, at a step
    without doubt."""
    doubted: float
    """Share of the steps in doubt while watched."""
    inside: float
    """Share of the errors while watched within three stated deviations."""


def look(case: Case, test: Test, est, clean: float | None, made: Faulty) -> Look:
    """Run a copy of the estimator; `clean` is the error without a fault, None if this is that."""
    found = copy.copy(est).run(made.Y)
    watched = slice(case.start, case.start + case.watch)
    onset = case.start if made.onset is None else made.onset
    recorded = np.vstack([x for x, _ in test.log.history.recordings])
    truth = made.truth[: len(found.x)]
    error = (found.x - truth) / recorded.std(axis=0)
    size = np.sqrt(np.mean(error**2, axis=1))[watched]
    known = np.isfinite(size)
    since = {}
    for kind, reason in KINDS.items():
        steps = np.flatnonzero(found.reasons[onset : watched.stop] & reason != 0)
        since[kind] = float(steps[0]) if steps.size else np.inf
    doubted = found.reasons & DOUBTS != 0
    rms = float(np.sqrt(np.mean(size[known] ** 2)))
    inside = np.abs(found.x - truth)[watched][known] <= 3 * found.std[watched][known]
    return Look(
        since,
        float(doubted[: case.start].mean()) if case.start else 0.0,
        rms / clean if clean else 1.0,
        rms,
        float(np.max(size[known & ~doubted[watched][: len(size)]], initial=0.0)),
        float(doubted[watched].mean()),
        float(inside.mean()),
    )


def looks(case: Case) -> dict[str, list[Look]]:
    """Every fault on every test of a case."""
    found: dict[str, list[Look]] = {name: [] for name, _ in faults()}
    for i, test in enumerate(case.tests):
        est, clean = real_logs.estimator(test, **case.settings), None
        for k, (name, fault) in enumerate(faults()):
            made = with_seed(fault, case, test, FIRST + 100 * i + k)
            found[name].append(look(case, test, est, clean, made))
            clean = found["none"][i].error
    return found


def with_seed(fault: Fault, case: Case, test: Test, seed: int) -> Faulty:
    """A fault that is drawn."""
    return fault(test.log, case.start, np.random.default_rng(seed))


def cell(found: list[Look], kind: str) -> str:
    """Share of the runs in which the reason is told, and the median delay, samples."""
    since = np.array([one.since[kind] for one in found])
    told = np.isfinite(since)
    return f"{told.mean():.2f} · {np.median(since[told]):.0f}" if told.any() else "–"


def overview(by_case: dict[str, dict[str, list[Look]]]) -> list[str]:
    """One line a fault, one column a system: any doubt."""
    rows = [
        [name, *(cell(found[name], "any doubt") for found in by_case.values())]
        for name, _ in faults()
    ]
    return markdown_table(("any doubt", *by_case), rows)


def of_one(found: dict[str, list[Look]]) -> list[str]:
    """One system: reasons one by one, error, and the share within the bars."""
    rows = []
    for name, runs in found.items():
        factors = np.array([one.factor for one in runs])
        rows.append(
            [
                name,
                *(cell(runs, kind) for kind in KINDS),
                f"{np.exp(np.mean(np.log(factors))):.2f} ({factors.max():.2f})",
                f"{max(one.silent for one in runs):.2f}",
                f"{np.mean([one.doubted for one in runs]):.2f}",
                f"{np.mean([one.inside for one in runs]):.3f}",
            ]
        )
    header = ("", *KINDS, "error × (worst)", "silent error", "in doubt", "within 3 sd")
    return markdown_table(header, rows)


def stuck_rows(everything: list[Case]) -> list[list[str]]:
    """False alarms of STUCK on all logs, and how soon it is found."""
    false, steps, soon, since = 0, 0, 0, []
    for case in everything:
        for i, test in enumerate(case.tests):
            est = real_logs.estimator(test, **case.settings)
            signals = () if test.U is None else (test.U,)
            clean = copy.copy(est).run(test.log.Y, *signals)
            alarms = clean.reasons & Reason.STUCK != 0
            false, steps = false + int(alarms.sum()), steps + len(alarms)
            start = case.start or len(test.log.Y) // 3
            fault = dict(faults())["stuck"]
            Y = fault(test.log, start, np.random.default_rng(i)).Y
            found = est.run(Y, *signals)
            told = np.flatnonzero(found.reasons[start:] & Reason.STUCK != 0)
            limit = max(10, 3 * longest_run(test))
            since.append(told[0] + 1 if told.size else np.inf)
            soon += since[-1] <= limit or limit > len(Y) - start
    count = len(since)
    words = f"{soon} of {count}, median {np.median(since):.0f} samples"
    return [
        ["stuck: false alarms", *verdict("0", f"{false} of {steps} steps", false == 0)],
        ["stuck: found within max(10, 3 r₀) samples", *verdict("all", words, soon == count)],
    ]


def longest_run(test: Test) -> int:
    """Longest run r₀ of equal values of the first output in the recordings."""
    longest = 1
    for _, y in test.log.history.recordings:
        ends = np.flatnonzero(np.diff(y[:, 0]) != 0)
        longest = max(longest, int(np.diff(np.r_[-1, ends, len(y) - 1]).max()))
    return longest


def alarm_rows(by_case: dict[str, dict[str, list[Look]]]) -> list[list[str]]:
    """Doubt before faults, on what goes on as recorded."""
    rows = []
    for name, found in by_case.items():
        share = float(np.mean([one.before for one in found["none"]]))
        linear = name.startswith(("masses", "oscillator"))
        asked, limit = ("≤ 1 %", 0.01) if linear else ("≤ 5 %", 0.05)
        rows.append(
            [
                f"{name}: steps in doubt before any fault",
                *verdict(asked, f"{share:.2%}", share <= limit),
            ]
        )
    return rows


def main() -> None:
    """Run everything, print it and write it to its half of the page."""
    begun = time.monotonic()

    def progress(words: str) -> None:
        print(f"{time.monotonic() - begun:6.0f} s  {words}", flush=True)

    by_case = {}
    for case in cases(RUNS, FIRST):
        by_case[case.name] = looks(case)
        progress(case.name)
    lines = page(
        by_case,
        stuck_rows([*cases(RUNS, FIRST), *driven_cases()]),
        late_tables(RUNS, FIRST + 1000, progress),
        gate_tables(RUNS, FIRST + 2000, GATE, progress),
        begun,
    )
    write_half("faults", lines)
    print("\n".join(lines))


def page(by_case, stuck, late, gate, bench, begun: float) -> list[str]:
    """The half of the page; of `late`, `gate`, `bench` rows of what was asked for, and lines."""
    took = (time.monotonic() - begun) / 60
    rows = [*stuck, *alarm_rows(by_case), *late[0], *gate[0], *bench[0]]
    lines = [WORDS, f"Run in {took:.1f} minutes of one core.", ""]
    lines += [
        "### Asked and measured",
        "",
        *markdown_table(("", "asked", "measured", ""), rows),
        "",
    ]
    lines += ["### Detectors", "", DETECTOR_WORDS, *overview(by_case), ""]
    for name, found in by_case.items():
        lines += [f"**{name}**", "", *of_one(found), ""]
    return [*lines, UNSEEN_WORDS, *late[1], *gate[1], *bench[1]]


def driven_cases() -> list[Case]:
    """Families of logs with inputs."""
    return [
        Case(name, tests, 0, 0, {})
        for name, tests in real_logs.with_inputs()
        if "ignored" not in name
    ]


WORDS = """\
## Second half: faults of outputs, late outputs, the gate

Printed by `make study-faults` (studies/faults.py), with seeds from 40 000 on: no limit was chosen
on them. σ is the noise that the recording shows of an output, *spread* the recorded one of its
values.
"""
DETECTOR_WORDS = """\
Share of the runs in which the reason is told while it is watched · median samples from the fault to
the first step with it. Faults are of the first output, *late*, *pace* and *spikes* of all. The
line *none* is what would have been told without a fault. Watched: masses and pendulum logs 200
samples, oscillator 100, bench 150, detumbling 60, from sample 60 on, since the motion itself leaves
its recording a little later. *error ×*: rms error of all states over that without the fault,
geometric mean and worst. *silent error*: the largest of all steps without doubt, rms over the
states, in recorded spreads. *in doubt*: share of the watched steps with any doubt.
"""
UNSEEN_WORDS = """\
**What cannot be seen, and why.** Evidence compares outputs with each other through the recorded
motions. What is such a motion itself, or nearly one, says nothing:

- *After the onset.* A fault that lasts is seen while it begins: the older outputs of a window
  contradict the newer ones. Once it fills the window, it may look like another motion. A gain of
  the only output of a linear system makes all motions larger, a late output of an undisturbed one
  is the same motion a little earlier, a bias is another place. Doubt then ends after a horizon (*in
  doubt*), and the error stays (*silent error*). A change from trust to doubt is worth a message
  even if trust comes back.
- *Where states were not recorded.* The pendulums' accelerometer sees more than the three recorded
  rates explain, held-out windows have a large V, and small faults drown in it: late outputs,
  another pace and a bias below the spread are not told there, though errors grow. What such a
  recording cannot promise is said at construction.
- *Small faults*: a bias, a gain, a pace that within a horizon moves outputs by no more than the
  recorded noise; and where bars are wide anyway (*scaled*) more than that.
- *An output that dies and keeps its noise* is not STUCK. It is NOVEL where other outputs, or the
  motion before, contradict it.
- *One spike* is in doubt for the window in which it stands. Without a gate the estimate follows it.

"""

if __name__ == "__main__":
    main()
