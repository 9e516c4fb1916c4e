"""The command line: read, estimate, print, write. One clear line on stderr and exit code 2 for any
wrong input."""

from __future__ import annotations

import io
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import click
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import Progress

from ddmhe import demo as demo_case
from ddmhe import report
from ddmhe._core import DdMhe, DdmheError, wrapped_angle
from ddmhe._core import Log as Estimates
from ddmhe.config import READING, read_config, space_from_text, write_config
from ddmhe.files import write as write_file
from ddmhe.files import write_text
from ddmhe.logs import Log, Split, read_log
from ddmhe.recordings.oddities import far_out

Array = NDArray[np.float64]

FIGURES = (".png", ".pdf", ".svg")


def main() -> NoReturn:
    """Entry point. Exits 0 on success, 2 on wrong usage or input with one line on stderr, 130 on
    Ctrl-C."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(
                errors="replace"
            )  # a terminal that lacks a character must not end the run
    try:
        sys.exit(cli.main(prog_name="ddmhe", standalone_mode=False))
    except click.Abort:
        sys.exit(130)
    except click.UsageError as e:
        _fail(f"{e.format_message()} (see {e.ctx.command_path if e.ctx else 'ddmhe'} --help)")
    except DdmheError as e:
        _fail(str(e))
    except OSError as e:
        _fail(
            f"{e.filename or 'a file'}: expected to be able to read or write it, found: "
            f"{e.strerror or e}"
        )


def _fail(message: str) -> NoReturn:
    print("ddmhe: error:", " ".join(message.split()), file=sys.stderr)
    sys.exit(2)


def _names(ctx: click.Context, param: click.Parameter, value: str | None) -> tuple[str, ...]:
    """Column names from a comma-separated list."""
    if value is None:  # `interval pendulum` needs none
        return ()
    names = tuple(part.strip() for part in value.split(","))
    if "" in names:
        raise click.BadParameter(f"expected column names separated by commas, found {value!r}")
    return names


def _numbers(
    ctx: click.Context, param: click.Parameter, value: str | None
) -> tuple[float, ...] | None:
    """Finite numbers from a comma-separated list."""
    if value is None:
        return None
    numbers = _parsed(value)
    if not numbers or not np.isfinite(numbers).all():
        raise click.BadParameter(f"expected finite numbers separated by commas, found {value!r}")
    return numbers


def _radius(ctx: click.Context, param: click.Parameter, value: str | None) -> Array | None:
    """One number for all columns, or one a column, separated by commas."""
    if value is None:
        return None
    found = np.array(_parsed(value))
    if not found.size:
        raise click.BadParameter(
            f"expected a number, or one a column parted by commas, found {value!r}"
        )
    return found[0] if len(found) == 1 else found


def _parsed(value: str) -> tuple[float, ...]:
    """The numbers of a comma-separated list; none where one of them is no number."""
    try:
        return tuple(float(part) for part in value.split(","))
    except ValueError:
        return ()


def reading_options(required: bool) -> Callable[[Any], Any]:
    """How to read a log; `required`: whether its columns and its history must be named."""
    options: list[Callable[[Any], Any]] = [
        click.option(
            "--state",
            callback=_names,
            required=required,
            metavar="C1,C2,...",
            help="Columns of the state.",
        ),
        click.option(
            "--output",
            callback=_names,
            required=required,
            metavar="C1,C2,...",
            help="Columns of the output.",
        ),
        click.option(
            "--history",
            type=float,
            required=required,
            help="Length of the recording to learn from, s.",
        ),
        click.option("--time", metavar="NAME", help="Column of the time, s.  [default: the first]"),
        click.option(
            "--start",
            type=float,
            help="Where the recording begins, s of the log's clock.  [default: first row]",
        ),
        click.option(
            "--decimate",
            type=int,
            default=1,
            show_default=True,
            metavar="K",
            help="Keep every K-th row.",
        ),
        click.option(
            "--gaps",
            type=click.Choice(["error", "fill"]),
            default="fill",
            show_default=True,
            help="A gap in the log: take the lacking samples as not measured, or refuse the log.",
        ),
        click.option(
            "--missing",
            callback=_numbers,
            metavar="V1,V2,...",
            help="Numbers that say not measured, like -9999.",
        ),
        click.option(
            "--unwrap",
            callback=_names,
            metavar="C1,C2,...",
            help="Angles that jump by a turn: go on instead.",
        ),
    ]

    def decorate(command: Any) -> Any:
        for option in reversed(options):
            command = option(command)
        return command

    return decorate


def log_options(command: Any) -> Any:
    """The log and how to read it: what every command that takes a log has."""
    return click.argument("log", type=click.Path(path_type=Path))(
        reading_options(required=True)(command)
    )


def _read(log: Path, given: dict[str, Any]) -> tuple[Log, Split]:
    """The samples of a log and their split after the history; takes the options of `log_options`
    out of `given`.

    What sits oddly in a column is pointed out on stderr.
    """
    columns = [given.pop(name) for name in ("state", "output", "time", "start", "decimate")]
    samples = read_log(
        log, *columns, missing=given.pop("missing") or (), unwrap=given.pop("unwrap")
    )
    for sentence in _oddities(samples):
        _warn(sentence)
    samples = samples.fill_gaps() if given.pop("gaps") == "fill" else samples
    return samples, samples.split(given.pop("history"))


SHOWN = 3
"""How many values and lines a warning names."""


def _oddities(log: Log) -> Iterator[str]:
    """What sits oddly in the columns of a log, in words that name the option for it."""
    columns = dict(zip(log.names.state, log.x.T, strict=True)) | dict(
        zip(log.names.output, log.y.T, strict=True)
    )
    for name, values in columns.items():
        rows = far_out(values)
        if rows.size:
            found = [f"{v:.10g}" for v in dict.fromkeys(values[rows])]
            lines = [str(line) for line in log.lines[rows]]
            yield (
                f"{log.path}, column {name!r}: {_some(found)} in line {_some(lines)} sits more "
                "than 50 deviations out on its own; if it says not measured: --missing "
                f"{','.join(found)}"
            )
        wrapped = wrapped_angle(values)
        if wrapped is not None:
            full, row = wrapped
            yield (
                f"{log.path}, column {name!r}, line {log.lines[row]}: looks like an angle that "
                f"jumps by a full turn of {full:.6g}, which no linear motion does; use its cosine "
                f"and sine as two columns, or --unwrap {name}"
            )


def _untold(log: Log, warnings: Iterable[str]) -> Iterator[str]:
    """Warnings of an estimator without those on angles in columns that `_oddities` has named."""
    told = tuple(
        f"{kind} {index} (counted from 0) jumps by"
        for kind, columns in (("state", log.x.T), ("output", log.y.T))
        for index, values in enumerate(columns)
        if wrapped_angle(values) is not None
    )
    return (sentence for sentence in warnings if not sentence.startswith(told))


def _some(words: list[str]) -> str:
    more = f" and {len(words) - SHOWN} more" if len(words) > SHOWN else ""
    return ", ".join(words[:SHOWN]) + more


def _warn(sentence: str) -> None:
    print("ddmhe: warning:", sentence, file=sys.stderr)


@click.group(no_args_is_help=False, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="ddmhe", prog_name="ddmhe")
def cli() -> None:
    """Data-driven moving horizon estimation: the state of a system from its outputs and one
    recording, no model."""


@cli.command()
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("ddmhe-demo"),
    show_default=True,
    metavar="DIR",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Seed of the torque noise.",
)
@click.option("--noise", type=float, default=0.01, show_default=True, help="Torque noise, N m.")
def demo(out: Path, seed: int, noise: float) -> None:
    """Estimate the spin of a tumbling satellite from the braking torque alone (the paper's 3-DOF
    case).

    Records 20 s, estimates the next 100 s step by step, and writes estimate.csv and estimate.png
    into DIR."""
    console = Console()
    with Progress(console=console, disable=not console.is_terminal, transient=True) as progress:
        task = progress.add_task("estimating", total=demo_case.STEPS * len(demo_case.SETTINGS))
        recording, results = demo_case.runs(noise, seed, lambda: progress.advance(task))
    written = demo_case.write(out, recording, results)
    console.print(demo_case.summary(recording, results, noise))
    for name, result in results.items():
        _print_warnings(console, f"{name}: ", result.est.warnings)
    _print_written(console, written)


@cli.command()
@log_options
@click.option(
    "--out", type=click.Path(path_type=Path), metavar="FILE.csv|DIR", help="Where the estimates go."
)
@click.option(
    "--plot", type=click.Path(path_type=Path), metavar="FILE.png", help="Where a figure goes."
)
@click.option(
    "--config",
    type=click.Path(path_type=Path),
    metavar="FILE.toml",
    help="Settings; keys as in DdMhe.",
)
@click.option("--horizon", type=int, help="Horizon M, samples.  [default: from the recording]")
@click.option(
    "--rho", type=float, help="Discount per sample, in (0, 1).  [default: from the recording]"
)
@click.option("--mu", type=float, help="Weight on the fitted noise.  [default: from the recording]")
@click.option(
    "--space",
    metavar="auto|exact|truncated:RANK|ridge:WEIGHT",
    help="Which windows count as trajectories.",
)
@click.option(
    "--start-from",
    type=click.Choice(["auto", "recording", "state", "unknown"]),
    help="The recording's end, a state (x_prior, or the last recorded one), or anywhere.  [default: auto: recording]",
)
@click.option(
    "--warm-start/--no-warm-start",
    default=None,
    help="The old names of --start-from recording and state.",
)
def estimate(
    log: Path, out: Path | None, plot: Path | None, config: Path | None, **given: Any
) -> None:
    """Estimate the states of a CSV log from its outputs, after a history in which both were
    recorded.

    Writes the time column and one column per state, and prints the errors where the log holds the
    states."""
    csv, figure = _targets(log, out, plot)
    from_file = {} if config is None else read_config(config)
    for key in READING:
        found = from_file.pop(key, None)
        given[key] = found if given[key] is None else given[key]
    samples, split = _read(log, given)
    est = DdMhe(split.history, **_settings(from_file, given))
    at_first = list(est.warnings)
    for sentence in _untold(samples, at_first):
        _warn(sentence)
    asked = len(split.Y)
    try:
        estimates = est.run(split.Y)
    except KeyboardInterrupt as e:
        estimates = e.finished  # type: ignore[attr-defined]
        samples, split = _cut(samples, split, len(estimates.x))
    for sentence in _untold(samples, est.warnings):
        if sentence not in at_first:
            _warn(sentence)
    written = _write(csv, figure, samples, split, estimates.x)
    console = Console()
    console.print(_summary(samples, split, est, estimates))
    _print_written(console, written)
    if len(estimates.x) < asked:
        raise click.Abort


@cli.command()
@log_options
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("ddmhe-design"),
    show_default=True,
    metavar="DIR",
)
@click.option(
    "--radius",
    type=float,
    default=0.9,
    show_default=True,
    help="Disc for Algorithm 2's poles, in (0, 1).",
)
@click.option("--eta", type=float, help="Discount of the certificate, in (0, 1).  [default: 0.95]")
@click.option(
    "--condition", type=float, help="Bound on cond P; alone, it asks for the smallest eta."
)
@click.option(
    "--noise-x",
    type=float,
    default=0.0,
    help="Errors of the recorded states: a robust certificate.",
)
@click.option("--noise-y", type=float, default=0.0, help="Errors of the recorded outputs.")
@click.option("--noise-w", type=float, default=0.0, help="Process noise during the recording.")
@click.option(
    "--noise-kind", type=click.Choice(["bounded", "gaussian"]), default="bounded", show_default=True
)
def design(
    log: Path, out: Path, radius: float, eta: float | None, condition: float | None, **given: Any
) -> None:
    """Stability from a recording: Algorithm 2 with its limits, and a certificate for the estimator.

    Writes design.toml, which `estimate --config` accepts, and poles.png into DIR.
    """
    from ddmhe import design as designs
    from ddmhe.report.figures import pole_figure

    _, split = _read(log, given)
    noise = None
    if any(given[f"noise_{name}"] != 0 for name in "xyw"):
        noise = designs.RecordingNoise(
            given["noise_x"], given["noise_y"], given["noise_w"], given["noise_kind"]
        )
    model = designs.identify(split.history)
    placement = designs.pole_placement(split.history, radius)
    certificate = designs.ioss(split.history, eta, condition=condition, noise=noise)
    out.mkdir(parents=True, exist_ok=True)
    written = [out / "design.toml", out / "poles.png"]
    write_config(written[0], {"certificate": certificate})
    report.save_figure(pole_figure(model, placement), written[1])
    console = Console()
    console.print(
        report.design(f"Design from {log.name}", split.history, model, placement, certificate)
    )
    for words in (placement.words, certificate.words):
        console.print(words, markup=False, highlight=False)
    _print_written(console, written)


@cli.command()
@log_options
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("ddmhe-tune"),
    show_default=True,
    metavar="DIR",
)
@click.option("--output-noise", type=float, help="Standard deviation of the online outputs' noise.")
@click.option(
    "--rest", is_flag=True, help="x = 0, y = 0 is a rest of the system: try it as an equilibrium."
)
def tune(log: Path, out: Path, output_noise: float | None, rest: bool, **given: Any) -> None:
    """Settings from a recording alone, chosen on parts of it that the estimator has not seen.

    Prints for each state what error to expect and whether the recording shows the settings to be
    better than the default rule's. Writes tune.toml, which `estimate --config` accepts and which
    holds nothing but the start where the default rule is kept, the scores as tune.csv and tune.png
    into DIR."""
    from ddmhe.report.figures import tuning_figure
    from ddmhe.tuning import tune as tuned

    samples, split = _read(log, given)
    h = split.history
    equilibrium = (np.zeros(h.n), np.zeros(h.p)) if rest else None
    stopped = False
    try:
        found = tuned(h, output_noise=output_noise, equilibrium=equilibrium)
    except KeyboardInterrupt as e:
        if getattr(e, "finished", None) is None:
            raise
        stopped, found = True, e.finished  # type: ignore[attr-defined]
    out.mkdir(parents=True, exist_ok=True)
    written = [out / name for name in ("tune.toml", "tune.csv", "tune.png")]
    write_config(written[0], found.settings | {"start": found.start})
    write_file(written[1], lambda beside: found.table.to_csv(beside, index=False))
    report.save_figure(tuning_figure(found.table), written[2])
    console = Console()
    console.print(
        report.scores(
            f"Settings for {log.name}, the ten best of {len(found.table)}", found.table.head(10)
        )
    )
    names = samples.names.state
    console.print(report.promise("What to expect, by held-out ends of the recording", found, names))
    console.print(found.words, markup=False, highlight=False)
    _print_warnings(console, "", _untold(samples, found.warnings))
    _print_written(console, written)
    if stopped:
        raise click.Abort


@cli.command("interval")
@click.argument("log", metavar="pendulum|LOG")
@reading_options(required=False)
@click.option(
    "--w-radius",
    callback=_radius,
    metavar="R|R1,R2,...",
    help="Bound on |x(k+1) - A x(k) - e|, units of the states.",
)
@click.option(
    "--v-radius",
    callback=_radius,
    metavar="R|R1,R2,...",
    help="Bound on |y(k) - C x(k) - r|, units of the outputs.",
)
@click.option(
    "--kappa",
    type=float,
    default=1.1,
    show_default=True,
    help="Without radii: times the smallest that the log admits.",
)
@click.option("--accept-wide", is_flag=True, help="Write bounds that say little, too.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("ddmhe-interval"),
    show_default=True,
    metavar="DIR",
)
def interval_command(log: str, out: Path, **given: Any) -> None:
    """Guaranteed intervals: of the interval paper's pendulum, or of a LOG's states after its
    history.

    pendulum: gain, gains in the peak, widths of every method, both figures of the paper with ours
    beside it. LOG: an interval observer for every affine system that the history allows with the
    stated bounds on its noise, and a verdict: the width against the recorded range. Bounds wider
    than half of it are refused with exit code 2."""
    if log == "pendulum":
        _interval_pendulum(out)
    else:
        _interval_log(Path(log), out, given)


def _interval_pendulum(out: Path) -> None:
    from ddmhe.reproduce import run_experiment
    from ddmhe.reproduce.experiments import EXPERIMENTS
    from ddmhe.reproduce.pendulum import design

    console = Console(width=None if sys.stdout.isatty() else 160)
    with Progress(console=console, disable=not console.is_terminal, transient=True) as progress:
        task = progress.add_task("pendulum", total=EXPERIMENTS["pendulum"].units)
        result, written = run_experiment("pendulum", out, lambda: progress.advance(task))
    designs = {"paper (42), lambda = 0.5": design(), "exact, lambda = 0.5": design("exact")}
    designs["exact, best lambda"] = design("exact", None)
    columns = {name: report.observer_design(g) for name, g in designs.items()}
    console.print(report.table("Observer of the pendulum (60)", columns), *result.printed)
    _print_written(console, written)


def _interval_log(log: Path, out: Path, given: dict[str, Any]) -> None:
    from ddmhe.interval import from_history, judge

    radii = {f"--{end}-radius": given[f"{end}_radius"] for end in "wv"}
    if all(value is None for value in radii.values()):
        radii = dict.fromkeys(radii, "auto")
    needed = {f"--{key}": given[key] for key in ("state", "output", "history")} | radii
    for name, value in needed.items():
        if value is None or (isinstance(value, tuple) and not value):
            raise click.UsageError(f"{name}: expected with a log, found none")
    samples, split = _read(log, given)
    names = samples.names.state, samples.names.output
    model = from_history(split.history, *radii.values(), kappa=given["kappa"], names=names)
    bounds = model.observer().run(split.Y)
    if bounds.violation is not None:
        at = f"at {split.t[len(bounds)]:g} s {bounds.violation}"
        raise DdmheError(
            f"--w-radius, --v-radius: expected bounds that the whole log keeps, found {at}"
        )
    verdict = judge(bounds.lower, bounds.upper, (model.lower, model.upper), split.t, names[0])
    console = Console()
    console.print(
        report.table(f"Intervals of {log.name}", {"": _interval_rows(model, bounds, split, names)})
    )
    for words in (model.words, f"verdict: {verdict.words}"):
        console.print(words, markup=False, highlight=False, soft_wrap=True)
    if not (verdict.useful or given["accept_wide"]):
        raise DdmheError(
            "--w-radius, --v-radius: expected bounds narrower than half of the recorded range, "
            f"found {verdict.words}; nothing is written, --accept-wide writes them all the same"
        )
    out.mkdir(parents=True, exist_ok=True)
    _print_written(console, _write_intervals(out, samples, split, bounds))


def _interval_rows(
    model: Any, bounds: Any, split: Split, names: tuple[tuple[str, ...], tuple[str, ...]]
) -> Any:
    """What the table of `interval LOG` shows."""
    with np.errstate(over="ignore"):
        width = np.median(bounds.upper - bounds.lower, axis=0)
    sizes = [f"{value:.4g}" if np.isfinite(value) else "no finite bound" for value in width]
    rows = {
        f"median full width of {name}": size for name, size in zip(names[0], sizes, strict=True)
    }
    for argument, called, radius, least in (
        ("w-radius", names[0], model.w_radius, model.w_least),
        ("v-radius", names[1], model.v_radius, model.v_least),
    ):
        for name, r, low in zip(called, radius, least, strict=True):
            rows[f"{argument} of {name}"] = f"{r:.4g} (smallest admissible {low:.4g})"
    if split.x_true is not None:
        known = np.isfinite(split.x_true)
        out_of = ((split.x_true < bounds.lower) | (split.x_true > bounds.upper)) & known
        rows["samples of the log outside"] = (
            f"{int(out_of.any(axis=1).sum())} of {int(known.all(axis=1).sum())}"
        )
    return rows


def _write_intervals(out: Path, samples: Log, split: Split, bounds: Any) -> list[Path]:
    """interval.csv, with empty cells where no finite bound is known, and interval.png if there is
    anything to draw."""
    from ddmhe.report.figures import intervals_figure

    written = [out / "interval.csv"]
    names = samples.names.state
    columns = [f"{name} {end}" for name in names for end in ("lower", "upper")]
    values = np.stack([bounds.lower, bounds.upper], axis=2).reshape(len(bounds.lower), -1)
    values = np.where(np.isfinite(values), values, np.nan)
    report.write_estimates(written[0], samples.names.time, split.t, columns, values)
    with np.errstate(over="ignore"):
        drawn = np.isfinite(bounds.upper - bounds.lower).any(axis=0).all()
    if drawn:
        truth = np.full_like(bounds.lower, np.nan) if split.x_true is None else split.x_true
        labels = [f"{name} (unit of the log)" for name in names]
        figure = intervals_figure(
            split.t, truth, {"interval": (bounds.lower, bounds.upper)}, labels
        )
        written.append(out / "interval.png")
        report.save_figure(figure, written[1])
    return written


@cli.command()
@click.argument("name", metavar="NAME|all|real")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("ddmhe-reproduce"),
    show_default=True,
    metavar="DIR",
)
@click.option(
    "--data",
    type=click.Path(path_type=Path),
    help="real: where the logs are.  [default: DDMHE_DATA]",
)
def reproduce(name: str, out: Path, data: Path | None) -> None:
    """The experiments of the papers again: figures, series, and a verdict on each claim.

    NAME: bench-nominal, bench-noise, bench-disturbance, bench-both (Figs. 2 to 5), bench-mu (Fig.
    6), detumbling (Figs. 7 and 8), design (rho0 and mu0), pendulum (the interval paper), all; or
    real, every estimator on measured pendulum logs. Writes PNG, SVG, CSV, tables.md and claims.md
    into DIR."""
    from ddmhe.reproduce import (
        EXPERIMENTS,
        pendulum_logs,
        reproduce_real,
        run_experiment,
        verdicts,
        write_claims,
    )

    if name not in (*EXPERIMENTS, "all", "real"):
        raise click.BadParameter(
            f"expected one of {', '.join(EXPERIMENTS)}, all, real, found {name!r}",
            param_hint="NAME",
        )
    console = Console(width=None if sys.stdout.isatty() else 160)
    claims: list[Any] = []
    printed: list[Any] = []
    written: list[Path] = []
    logs = pendulum_logs(data) if name == "real" else []
    names = {"all": list(EXPERIMENTS), "real": []}.get(name, [name])
    stopped = False
    with Progress(console=console, disable=not console.is_terminal, transient=True) as progress:
        if logs:
            task = progress.add_task("real", total=len(logs))
            try:
                result, written = reproduce_real(logs, out, lambda: progress.advance(task))
            except KeyboardInterrupt as e:
                if getattr(e, "finished", None) is None:
                    raise
                stopped, (result, written) = True, e.finished  # type: ignore[attr-defined]
            console.print(*result.printed)
        for each in names:
            task = progress.add_task(each, total=EXPERIMENTS[each].units)
            try:
                advance = lambda task=task: progress.advance(task)  # noqa: E731
                result, paths = run_experiment(each, out, advance)
            except KeyboardInterrupt:
                stopped = True
                break
            progress.remove_task(task)
            claims += result.claims
            printed += result.printed
            written += paths
            console.print(*result.printed, "")
    if claims:
        written.append(out / "tables.md")
        write_text(written[-1], report.markdown("The tables of `ddmhe reproduce`", printed))
        written.append(out / "claims.md")
        write_claims(written[-1], claims)
        console.print(verdicts(claims))
    _print_written(console, written)
    if stopped:
        raise click.Abort


def _cut(samples: Log, split: Split, made: int) -> tuple[Log, Split]:
    """The log as if it ended with the last of `made` estimates; says so."""
    left_out = len(split.Y) - made
    if made == 0:
        raise KeyboardInterrupt
    print(f"ddmhe: stopped: {made} of {len(split.Y)} samples were estimated", file=sys.stderr)
    end = len(samples.t) - left_out
    parts = {name: getattr(samples, name)[:end] for name in ("t", "x", "y", "lines", "samples")}
    x_true = None if split.x_true is None else split.x_true[:made]
    return replace(samples, **parts), split._replace(
        Y=split.Y[:made], t=split.t[:made], x_true=x_true
    )


def _targets(log: Path, out: Path | None, plot: Path | None) -> tuple[Path | None, Path | None]:
    """Paths of the CSV and of the figure, None for none."""
    if plot is not None and plot.suffix.lower() not in FIGURES:
        wanted = ", ".join(FIGURES)
        raise click.BadParameter(
            f"expected a file ending in {wanted}, found {str(plot)!r}", param_hint="--plot"
        )
    csv = out
    if out is not None and out.suffix.lower() != ".csv":
        csv, plot = out / "estimate.csv", plot or out / "estimate.png"
    if csv is not None and csv.exists() and log.exists() and csv.samefile(log):
        raise click.BadParameter(
            f"expected a file other than the log, found {str(csv)!r}", param_hint="--out"
        )
    return csv, plot


def _settings(from_file: dict[str, Any], given: dict[str, Any]) -> dict[str, Any]:
    """Keywords of DdMhe: the file's, overridden by the options given."""
    named = dict(from_file)
    if given["start_from"] is not None or given["warm_start"] is not None:
        named = {key: value for key, value in named.items() if key not in ("start", "warm_start")}
    settings = named | {
        key: value for key, value in given.items() if value is not None and key != "start_from"
    }
    if given["start_from"] not in (None, "auto"):
        settings["start"] = given["start_from"]
    if not {"start", "warm_start", "x_prior"} & set(settings):
        settings["start"] = "recording"  # the log goes on where its history ends
    if isinstance(given["space"], str):
        settings["space"] = space_from_text(given["space"])
    return settings


def _summary(log: Log, split: Split, est: DdMhe, estimates: Estimates) -> Any:
    filled = int(np.sum(log.lines == 0))
    rows = {"history": f"T = {split.history.T} samples of {log.dt:.4g} s"}
    rows |= {"gaps filled": f"{filled} samples"} if filled else {}
    rows |= report.settings(est) | report.outcome(estimates.status, estimates.active)
    if estimates.bound is not None:
        rows["error bound"] = (
            f"{np.median(estimates.bound):.4g} median, {np.max(estimates.bound):.4g} at most"
        )
    if split.x_true is not None:
        errors = report.rmse(estimates.x - split.x_true)
        rows |= {
            f"RMSE {name}": f"{value:.4g}"
            for name, value in zip(log.names.state, errors, strict=True)
        }
        relative = report.nrmse(estimates.x, split.x_true)
        rows |= {
            f"NRMSE {name}": f"{value:.4f}"
            for name, value in zip(log.names.state, relative, strict=True)
        }
        rows["NRMSE"] = f"{report.root_mean_square(relative):.4f}"
        if len(relative) > 1 and len(set(split.history.x_units)) == 1 and split.history.x_units[0]:
            rows["NRMSE pooled"] = f"{report.pooled_nrmse(estimates.x, split.x_true):.4f}"
    return report.table(f"Estimates of {Path(log.path).name}", {"": rows})


def _write(
    csv: Path | None, figure: Path | None, log: Log, split: Split, x_hat: Array
) -> list[Path]:
    """One CSV row per row of the log after the history; the figure also shows the estimates inside
    filled gaps."""
    if csv is not None:
        csv.parent.mkdir(parents=True, exist_ok=True)
        logged = log.lines[-len(split.t) :] > 0
        report.write_estimates(csv, log.names.time, split.t[logged], log.names.state, x_hat[logged])
    if figure is not None:
        from ddmhe.report.figures import estimate_figure

        figure.parent.mkdir(parents=True, exist_ok=True)
        T = len(log.t) - len(split.t) - 1
        recorded = (log.t[: T + 1], log.x[: T + 1])
        drawing = estimate_figure(
            split.t,
            x_hat,
            split.x_true,
            history=recorded,
            names=log.names.state,
            quantity="state (unit of the log)",
        )
        report.save_figure(drawing, figure)
    return [path for path in (csv, figure) if path is not None]


def _print_warnings(console: Console, prefix: str, warnings: Iterable[str]) -> None:
    for warning in warnings:
        console.print(f"warning: {prefix}{warning}", style="yellow", markup=False, soft_wrap=True)


def _print_written(console: Console, paths: list[Path]) -> None:
    for path in paths:
        console.print(f"wrote {path}", markup=False, highlight=False, soft_wrap=True)
