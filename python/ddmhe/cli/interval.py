"""``ddmhe interval``: guaranteed intervals of the paper's pendulum or of a log."""

from __future__ import annotations

from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from ddmhe import report
from ddmhe._core import DdmheError
from ddmhe.checks import word
from ddmhe.cli.answer import Answer, answers
from ddmhe.cli.metadata import read_as
from ddmhe.cli.options import directory_option, radius, reading_options
from ddmhe.cli.page import check_page, report_option, write_page_of
from ddmhe.cli.reading import read
from ddmhe.recordings import Log, Recorded

if TYPE_CHECKING:
    from ddmhe.interval import ObserverDesign

__all__ = ["command"]


@click.command("interval", short_help="Guaranteed intervals, of a log or of the paper's pendulum.")
@click.argument("log", metavar="pendulum|LOG")
@reading_options(required=False)
@click.option(
    "--w-radius",
    callback=radius,
    metavar="R|R1,R2,...",
    help="Bound on |x(k+1) - A x(k) - e|, units of the states.",
)
@click.option(
    "--v-radius",
    callback=radius,
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
@report_option
@directory_option("ddmhe-interval")
@answers
def command(answer: Answer, log: str, out: Path, page: Path | None, **given: Any) -> None:
    """Guaranteed intervals: of the interval paper's pendulum, or of a LOG's states after its
    history.

    pendulum: gain, gains in the peak, widths of every method, both figures of the paper with ours
    beside it. LOG: an interval observer for every affine system that the history allows with the
    stated bounds on its noise, and a verdict: the width against the recorded range. Bounds wider
    than half of it are refused with exit code 2."""
    check_page(page)
    if log != "pendulum":
        _log(answer, Path(log), (out, page), given)
    elif page is None:
        _pendulum(answer, out)
    else:
        raise click.BadParameter("expected with a log, found pendulum", param_hint="--report")


def _pendulum(answer: Answer, out: Path) -> None:
    """The interval paper's pendulum."""
    from ddmhe.reproduce import run_experiment
    from ddmhe.reproduce.experiments import EXPERIMENTS
    from ddmhe.reproduce.pendulum import design

    total = EXPERIMENTS["pendulum"].units
    with answer.working("pendulum") as advance:
        done = count(1)
        result, written = run_experiment("pendulum", out, lambda: advance(next(done), total))
    designs = {"paper (42), lambda = 0.5": design(), "exact, lambda = 0.5": design("exact")}
    designs["exact, best lambda"] = design("exact", None)
    columns = {name: report.observer_design(g) for name, g in designs.items()}
    answer.show(report.table("Observer of the pendulum (60)", columns), *result.printed)
    answer.facts(observers={name: _design_facts(g) for name, g in designs.items()})
    answer.facts(tables=[report.cells(table) for table in result.printed])
    answer.wrote(written)


def _design_facts(design: ObserverDesign) -> dict[str, Any]:
    names = ("gain", "mu_w", "mu_v", "gamma", "lam", "verified", "slack")
    return {name: getattr(design, name) for name in names}


def _log(
    answer: Answer, log: Path, targets: tuple[Path, Path | None], given: dict[str, Any]
) -> None:
    """Intervals of a log, written only if they say something: to a directory and a page."""
    from ddmhe.interval import from_history, judge

    (out, page), radii, how = targets, _radii(given), read_as(given)
    samples, split = read(answer, log, given)
    names = samples.names.state, samples.names.output
    with answer.working("bounding"):
        model = from_history(split.history, *radii.values(), kappa=given["kappa"], names=names)
        observer = model.observer()
        bounds = observer.run(split.Y)
    if bounds.violation is not None:
        at = f"at {split.t[len(bounds)]:g} s {bounds.violation}"
        raise DdmheError(
            f"--w-radius, --v-radius: expected bounds that the whole log keeps, found {at}"
        )
    verdict = judge(bounds.lower, bounds.upper, (model.lower, model.upper), split.t, names[0])
    answer.show(
        report.table(f"Intervals of {word(log.name)}", {"": _rows(model, bounds, split, names)})
    )
    for words in (model.words, f"verdict: {verdict.words}"):
        answer.say(words)
    answer.facts(**_facts(model, bounds, split, names), words=model.words)
    answer.facts(verdict=verdict.words, useful=verdict.useful)
    if not (verdict.useful or given["accept_wide"]):
        answer.end()
        raise DdmheError(
            "--w-radius, --v-radius: expected bounds narrower than half of the recorded range, "
            f"found {verdict.words}; nothing is written, --accept-wide writes them all the same"
        )
    out.mkdir(parents=True, exist_ok=True)
    written = _write(out, samples, split, bounds)
    if page is not None:
        about = {"reading": how, "named": {key: given[key] for key in ("kappa",)}}
        written.append(write_page_of(page, split, (observer, bounds), about, [model.words]))
    answer.wrote(written)


def _radii(given: dict[str, Any]) -> dict[str, Any]:
    """Both radii, "auto" where none is given; UsageError where a log needs what is not given."""
    radii = {f"--{end}-radius": given[f"{end}_radius"] for end in "wv"}
    if all(value is None for value in radii.values()):
        radii = dict.fromkeys(radii, "auto")
    needed = {f"--{key}": given[key] for key in ("state", "output", "history")} | radii
    for name, value in needed.items():
        if value is None or (isinstance(value, tuple) and not value):
            raise click.UsageError(f"{name}: expected with a log, found none")
    return radii


def _rows(
    model: Any, bounds: Any, split: Recorded, names: tuple[tuple[str, ...], tuple[str, ...]]
) -> Any:
    """What the table of `interval LOG` shows."""
    with np.errstate(over="ignore"):
        width = np.median(bounds.upper - bounds.lower, axis=0)
    sizes = [f"{value:.4g}" if np.isfinite(value) else "no finite bound" for value in width]
    rows = {
        f"median full width of {name}": size for name, size in zip(names[0], sizes, strict=True)
    }
    for argument, called, bound, least in (
        ("w-radius", names[0], model.w_radius, model.w_least),
        ("v-radius", names[1], model.v_radius, model.v_least),
    ):
        for name, r, low in zip(called, bound, least, strict=True):
            rows[f"{argument} of {name}"] = f"{r:.4g} (smallest admissible {low:.4g})"
    outside = _outside(bounds, split)
    if outside is not None:
        rows["samples of the log outside"] = f"{outside[0]} of {outside[1]}"
    return rows


def _outside(bounds: Any, split: Recorded) -> tuple[int, int] | None:
    """How many logged states are outside of the bounds, and how many there are; None for none."""
    if split.x_true is None:
        return None
    known = np.isfinite(split.x_true)
    out_of = ((split.x_true < bounds.lower) | (split.x_true > bounds.upper)) & known
    return int(out_of.any(axis=1).sum()), int(known.all(axis=1).sum())


def _facts(
    model: Any, bounds: Any, split: Recorded, names: tuple[tuple[str, ...], tuple[str, ...]]
) -> dict[str, Any]:
    """Every number of the table; null where no bound is finite."""
    with np.errstate(over="ignore"):
        width = np.median(bounds.upper - bounds.lower, axis=0)
    outside = _outside(bounds, split)
    return {
        "median_width": dict(zip(names[0], width, strict=True)),
        "w_radius": dict(zip(names[0], model.w_radius, strict=True)),
        "w_least": dict(zip(names[0], model.w_least, strict=True)),
        "v_radius": dict(zip(names[1], model.v_radius, strict=True)),
        "v_least": dict(zip(names[1], model.v_least, strict=True)),
        "outside": None if outside is None else {"samples": outside[0], "of": outside[1]},
    }


def _write(out: Path, samples: Log, split: Recorded, bounds: Any) -> list[Path]:
    """interval.csv, with empty cells where no finite bound is known, and interval.png if there is
    anything to draw."""
    from ddmhe.report.figures import intervals_figure
    from ddmhe.report.style import caption

    written = [out / "interval.csv"]
    names = samples.names.state
    columns = [f"{name} {end}" for name in names for end in ("lower", "upper")]
    columns = [name + "_" * (name == samples.names.time) for name in columns]
    values = np.stack([bounds.lower, bounds.upper], axis=2).reshape(len(bounds.lower), -1)
    values = np.where(np.isfinite(values), values, np.nan)
    report.write_estimates(written[0], samples.names.time, split.stamps, columns, values)
    with np.errstate(over="ignore"):
        drawn = np.isfinite(bounds.upper - bounds.lower).any(axis=0).all()
    if drawn:
        truth = np.full_like(bounds.lower, np.nan) if split.x_true is None else split.x_true
        units = [samples.unit(name) or "unit of the log" for name in names]
        labels = [f"{caption(a)} ({caption(b)})" for a, b in zip(names, units, strict=True)]
        figure = intervals_figure(
            split.t, truth, {"interval": (bounds.lower, bounds.upper)}, labels
        )
        written.append(out / "interval.png")
        report.save_figure(figure, written[1])
    return written
