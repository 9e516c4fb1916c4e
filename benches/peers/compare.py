"""The comparison: answers first, then times in rounds, then a JSON file and tables."""

import importlib.metadata
import json
import os
import platform
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from datetime import datetime, timezone
from pathlib import Path

import click
import native
import numpy as np
import others
import solvers
from cases import Array, Case, cases
from rich.console import Console
from rich.progress import track

OFF = 1e-6
"""An answer further from ddmhe's than this, relative to the largest estimate of the case, counts as
off."""


@dataclass
class Result:
    """What one contestant did on one case."""

    name: str
    case: str
    regime: str
    active: float
    """Median number of active bounds."""
    nanoseconds: list[float] = field(default_factory=list)
    rounds: list[list[float]] = field(default_factory=list)
    """The same, round by round."""
    largest_error: float | None = None
    off: float | None = None
    """Share of windows whose answer is off although success was claimed."""
    failed: float | None = None
    """Share of windows without claimed success."""
    note: str = ""


Block = Callable[[int], list[float]]
"""Round number to nanoseconds a window."""


def compared(case: Case, result: Result, solve: solvers.Solve, count: int) -> None:
    """Compare the first `count` windows with ddmhe's answers."""
    q, errors, claimed = case.reduced, [], []
    size = np.abs(q.x_hat).max()
    for k in range(count):
        t, success = solve(k)
        claimed.append(success)
        errors.append(np.inf if t is None else np.abs(q.estimate(k, t) - q.x_hat[k]).max() / size)
    judge(result, np.array(errors), np.array(claimed))


def judge(result: Result, errors: Array, claimed: Array) -> None:
    """Largest error and shares from one error and one claim a window."""
    finite = errors[np.isfinite(errors)]
    result.largest_error = float(finite.max()) if len(finite) else None
    result.off = float(np.mean(claimed & (errors > OFF)))
    result.failed = float(np.mean(~claimed))


def timed(solve: Callable[[int], object], windows: range, count: int) -> Block:
    """Time calls one by one; each round takes up where the last ended."""

    def block(number: int) -> list[float]:
        found = []
        for i in range(count):
            k = windows[(number * count + i) % len(windows)]
            start = time.perf_counter_ns()
            solve(k)
            found.append(float(time.perf_counter_ns() - start))
        return found

    return block


def own(case: Case) -> list[tuple[str, Block]]:
    """ddmhe: a step from Python, with and without a new Estimate, and a whole log in the compiled
    loop."""
    est, Y = case.estimator(), case.outputs
    x = np.empty(case.x.shape[1])

    def each(step: Callable[[Array], object]) -> Block:
        def block(_: int) -> list[float]:
            est.reset()
            times = []
            for y in Y:
                start = time.perf_counter_ns()
                step(y)
                times.append(float(time.perf_counter_ns() - start))
            return times[case.steps.start - 1 :]

        return block

    def run(_: int) -> list[float]:
        """The windows of interest alone: the log up to the first of them is subtracted."""
        first = case.steps.start - 1
        est.reset()
        est.run(Y[:first])
        start = time.perf_counter_ns()
        est.run(Y[first:])
        return [(time.perf_counter_ns() - start) / (len(Y) - first)]

    return [
        ("ddmhe: run, a step", run),
        ("ddmhe: step(out=)", each(lambda y: est.step(y, out=x))),
        ("ddmhe: step(y).x", each(lambda y: est.step(y).x)),
    ]


def daqp_library(case: Case, directory: Path) -> list[tuple[Result, Block]]:
    """DAQP's C library, warm and cold; empty with a note if it cannot be built."""
    library = native.build(directory)
    found = []
    for warm in (True, False):
        result = Result(f"DAQP (C library, 1e-11), {'warm' if warm else 'cold'}", *of(case))
        t, success, _ = native.run(library, case.reduced, warm, 1e-11)
        q = case.reduced
        errors = [np.abs(q.estimate(k, t[k]) - q.x_hat[k]).max() for k in range(len(t))]
        judge(result, np.array(errors) / np.abs(q.x_hat).max(), success)
        found.append(
            (
                result,
                lambda _, warm=warm: native.run(library, case.reduced, warm, 1e-11)[2].tolist(),
            )
        )
    return found


def daqp_steps(case: Case, directory: Path) -> list[tuple[Result, Block]]:
    """A whole step in C around DAQP's library, warm and cold, beside ddmhe's from Rust."""
    library = native.build(directory)
    rust = Result("ddmhe: a step in Rust", *of(case))
    found = [(rust, lambda _: native.own(case, directory).tolist())]
    log = case.run()
    late = slice(case.steps.start - 1, None)
    for warm in (True, False):
        result = Result(f"DAQP: a step in C, {'warm' if warm else 'cold'}", *of(case))
        x_hat, _, success, _ = native.steps(library, case, warm, 1e-11)
        judge(
            result, np.abs(x_hat - log.x[late]).max(1) / np.abs(case.reduced.x_hat).max(), success
        )
        found.append(
            (
                result,
                lambda _, warm=warm: native.steps(library, case, warm, 1e-11)[3].tolist(),
            )
        )
    return found


def of(case: Case) -> tuple[str, str, float]:
    """Name, regime and median of active bounds."""
    return case.name, case.regime, float(np.median(case.active[case.steps.start - 1 :]))


def prepared(case: Case, directory: Path, quick: bool) -> list[tuple[Result, Block]]:
    """All contestants on one case, answers compared."""
    ready: list[tuple[Result, Block]] = [
        (Result(name, *of(case)), block) for name, block in own(case)
    ]
    absent = []
    try:
        ready += daqp_steps(case, directory) + daqp_library(case, directory)
    except Exception as error:  # whatever is missing: sources, compiler, network
        absent.append(Result("DAQP (C library, 1e-11)", *of(case), note=f"not built: {error}"))
    windows = range(len(case.reduced.lower))
    for name, prepare, count in solvers.contestants(case):
        if quick and count < 20:
            continue
        result = Result(name, *of(case))
        try:
            solve = prepare()
            if not name.startswith("NumPy"):
                compared(case, result, solve, 200 if count >= 50 else 10 if count >= 3 else 2)
            ready.append((result, timed(solve, windows, count)))
        except ImportError as error:
            absent.append(Result(name, *of(case), note=f"not installed: {error}"))
        except Exception as error:
            absent.append(
                Result(name, *of(case), note=f"failed: {type(error).__name__}: {str(error)[:80]}")
            )
    for name, build, count in (
        ("filterpy: Kalman filter", others.kalman, 100),
        ("do-mpc: MHE (IPOPT)", others.do_mpc, 3),
    ):
        if quick and count < 20:
            continue
        try:
            note = "another estimator, with an identified model"
            ready.append(
                (Result(name, *of(case), note=note), timed(build(case), case.steps, count))
            )
        except Exception as error:
            absent.append(
                Result(name, *of(case), note=f"not run: {type(error).__name__}: {str(error)[:80]}")
            )
    return ready + [(result, lambda _: []) for result in absent]


def table(results: list[Result]) -> list[str]:
    """Markdown of one case."""
    base = next(np.mean(r.nanoseconds) for r in results if r.name.startswith("ddmhe: run"))
    lines = [
        "| tool | median, µs | mean, µs | p99, µs | mean / ddmhe run | largest difference | off | "
        "failed | |",
        "|---|--:|--:|--:|--:|--:|--:|--:|---|",
    ]

    def text(value: float | None, form: str) -> str:
        return "" if value is None else format(value, form)

    for r in results:
        if not r.nanoseconds:
            lines.append(f"| {r.name} | | | | | | | | {r.note} |")
            continue
        median, mean = np.median(r.nanoseconds) / 1e3, np.mean(r.nanoseconds) / 1e3
        # run times a whole log at once: it has no distribution over steps
        p99 = (
            ""
            if r.name == "ddmhe: run, a step"
            else f"{np.percentile(r.nanoseconds, 99) / 1e3:.3g}"
        )
        lines.append(
            f"| {r.name} | {median:.3g} | {mean:.3g} | {p99} | {1e3 * mean / base:.3g} | "
            f"{text(r.largest_error, '.1e')} | {text(r.off, '.0%')} | {text(r.failed, '.0%')} | "
            f"{r.note} |"
        )
    return lines


def whole_steps(results: list[Result]) -> list[str]:
    """Markdown of ddmhe's step over a step in C around DAQP: medians over the rounds of the ratios
    of means and of 99th percentiles."""
    lines = [
        "| | mean, µs | p99, µs | mean / DAQP warm | p99 / DAQP warm | mean / DAQP cold | "
        "p99 / DAQP cold |",
        "|---|--:|--:|--:|--:|--:|--:|",
    ]
    for ours in (r for r in results if r.name == "ddmhe: a step in Rust"):
        same = [r for r in results if (r.case, r.regime) == (ours.case, ours.regime)]
        mine, ratios = each_round(ours), []
        for start in ("warm", "cold"):
            theirs = [r for r in same if r.name == f"DAQP: a step in C, {start}"]
            ratios += [np.median(mine / each_round(r), axis=0) for r in theirs]
        cells = [f"{v / 1e3:.3g}" for v in np.median(mine, axis=0)]
        cells += [f"{v:.2f}" for pair in ratios for v in pair]
        regime = "nothing active" if ours.regime == "free" else "bounds active"
        lines.append(f"| {ours.case}, {regime} | {' | '.join(cells)} |")
    return lines


def each_round(result: Result) -> Array:
    """Mean and 99th percentile of each round (rounds, 2)."""
    return np.array([[np.mean(t), np.percentile(t, 99)] for t in result.rounds])


def machine() -> str:
    """Processor and system."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        cpu = next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        cpu = platform.processor()
    return (
        f"{cpu}, {os.cpu_count()} cores, {platform.system()} {platform.machine()}, Python "
        f"{platform.python_version()}"
    )


def versions() -> dict[str, str]:
    """Installed versions of all contestants."""
    names = ["ddmhe", "numpy", "scipy"]
    names += [
        line.split("==")[0]
        for line in (Path(__file__).parent / "requirements.txt").read_text().split()
    ]
    found = {}
    for name in names:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = "not installed"
    return found


@contextmanager
def silenced() -> Iterator[None]:
    """Without the banners that some libraries write past Python."""
    sys.stdout.flush()
    kept = os.dup(1)
    with open(os.devnull, "w") as nothing:
        os.dup2(nothing.fileno(), 1)
        try:
            yield
        finally:
            sys.stdout.flush()
            os.dup2(kept, 1)
            os.close(kept)


@click.command()
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("target/peers"),
    help="Directory of peers.json.",
)
@click.option(
    "--docs", type=click.Path(path_type=Path), default=None, help="Markdown file to write."
)
@click.option("--rounds", type=click.IntRange(1), default=9, show_default=True)
@click.option("--quick", is_flag=True, help="Fast contestants only, three rounds.")
def main(out: Path, docs: Path | None, rounds: int, quick: bool) -> None:
    """Time ddmhe beside its peers."""
    warnings.simplefilter("ignore")
    out.mkdir(parents=True, exist_ok=True)
    rounds = 3 if quick else rounds
    rng = np.random.default_rng(0)
    results: list[Result] = []
    sections = []
    for case in track(cases(200), description="cases", console=Console(stderr=True)):
        with silenced():
            ready = prepared(case, out, quick)
            for number in range(rounds):
                for i in rng.permutation(len(ready)):
                    times = ready[i][1](number)
                    ready[i][0].nanoseconds += times
                    ready[i][0].rounds.append(times)
        results += (found := [result for result, _ in ready])
        active = np.percentile(case.active[case.steps.start - 1 :], [5, 50, 95])
        regime = (
            "nothing active"
            if case.regime == "free"
            else "{:.0f}/{:.0f}/{:.0f} bounds active (5/50/95 %)".format(*active)
        )
        sections += ["", f"### {case.name}, {regime}", "", *table(found)]
    facts = {
        "machine": machine(),
        "date": f"{datetime.now(timezone.utc):%Y-%m-%d}",
        "rounds": rounds,
        "versions": versions(),
    }
    (out / "peers.json").write_text(
        json.dumps({**facts, "results": [asdict(r) for r in results]}, indent=1)
    )
    body = [
        f"{facts['machine']}; {facts['date']}; {rounds} rounds, single-threaded.",
        "",
        "Versions: " + ", ".join(f"{k} {v}" for k, v in facts["versions"].items()) + ".",
        "",
        "### A whole step in Rust beside one in C around DAQP",
        "",
        *whole_steps(results),
        *sections,
    ]
    click.echo("\n".join(body))
    if docs:
        head = docs.read_text().split("<!-- peers -->")[0] if docs.exists() else "# Peers\n\n"
        docs.write_text(head + "<!-- peers -->\n" + "\n".join(body) + "\n")
