"""``ddmhe tune``: settings from a recording alone."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from ddmhe import report
from ddmhe.checks import word
from ddmhe.cli.answer import Answer, answers
from ddmhe.cli.options import directory_option, log_options
from ddmhe.cli.reading import read, untold
from ddmhe.cli.telling import in_words_of
from ddmhe.cli.values import one_or_each
from ddmhe.config import plain_settings, write_config
from ddmhe.files import write

if TYPE_CHECKING:
    from ddmhe.tuning import Tuning

__all__ = ["command"]

BEST = 10
"""Rows that are shown."""


@click.command("tune", short_help="Settings from a recording, and errors to expect.")
@log_options
@directory_option("ddmhe-tune")
@click.option(
    "--output-noise",
    callback=one_or_each,
    metavar="SD[,SD,…]",
    help="Standard deviation of the noise of later outputs.  [default: the recording's]",
)
@click.option(
    "--rest",
    is_flag=True,
    help="x = 0, y = 0 (and input 0) is a rest of the system: try it as an equilibrium.",
)
@answers
def command(
    answer: Answer, log: Path, out: Path, output_noise: Any, rest: bool, **given: Any
) -> None:
    """Settings from a recording alone, chosen on parts of it that the estimator has not seen.

    Prints for each state what error to expect and whether the recording shows the settings to be
    better than the default rule's. Writes tune.toml, which `estimate --config` accepts and which
    holds nothing but the start where the default rule is kept, the scores as tune.csv and tune.png
    into DIR."""
    from ddmhe.tuning import tune as tuned

    samples, split = read(answer, log, given)
    h = split.history
    sizes = (h.n, h.p, h.m) if h.m else (h.n, h.p)
    equilibrium = tuple(np.zeros(size) for size in sizes) if rest else None
    try:
        with answer.working("tuning") as advance:
            found = tuned(h, output_noise=output_noise, equilibrium=equilibrium, progress=advance)
    except KeyboardInterrupt as e:
        if getattr(e, "finished", None) is None:
            raise
        answer.stop()
        found = e.finished  # type: ignore[attr-defined]
    out.mkdir(parents=True, exist_ok=True)
    written = [out / name for name in ("tune.toml", "tune.csv")]
    write_config(written[0], found.settings | {"start": found.start})
    write(written[1], lambda beside: found.table.to_csv(beside, index=False))
    if not answer.stopped:  # an interrupt has no time for figures
        from ddmhe.report.figures import tuning_figure

        written.append(out / "tune.png")
        report.save_figure(tuning_figure(found.table), written[-1])
    shown = len(found.table) if answer.verbose else BEST
    best = "all" if answer.verbose else f"the {BEST} best"
    title = f"Settings for {word(log.name)}, {best} of {len(found.table)}"
    names = samples.names.state
    answer.show(
        report.scores(title, found.table.head(shown)),
        report.promise("What to expect, by held-out ends of the recording", found, names),
    )
    answer.say(found.words)
    for sentence in in_words_of(samples.names, untold(samples, found.warnings)):
        answer.warn(sentence)
    answer.facts(**_facts(found, names))
    answer.wrote(written)


def _facts(found: Tuning, names: tuple[str, ...]) -> dict[str, Any]:
    """Every number of the tables."""
    lo, hi = found.range
    expected = zip(names, found.promise, lo, hi, found.ratio, strict=True)
    return {
        "settings": plain_settings(found.settings),
        "start": found.start,
        "in_force": {"horizon": found.horizon, "rho": found.rho, "mu": found.mu},
        "score": found.score,
        "words": found.words,
        "expected": {
            name: {"rms": rms, "range": [least, most], "against_default": ratio}
            for name, rms, least, most, ratio in expected
        },
        "table": found.table.assign(
            error=np.exp(found.table["score"]), ranked_by=np.exp(found.table["rated"])
        ).to_dict("records"),
    }
