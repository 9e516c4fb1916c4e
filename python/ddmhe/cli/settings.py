"""Every setting of the estimator as an option, and what of them is in force."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import click

from ddmhe.checks import file_words, shown
from ddmhe.cli import values
from ddmhe.config import READING, read_config, space_from_text
from ddmhe.recordings import Names

__all__ = ["OF_ESTIMATOR", "setting_options", "settings_from_file", "settings_of"]


def gate(ctx: click.Context, param: click.Parameter, value: str | None) -> float | str | None:
    """A number of deviations, or "auto"."""
    if value is None or value == "auto":
        return value
    try:
        return float(value)
    except ValueError:
        raise click.BadParameter(f"expected auto or a number, found {shown(value)}") from None


_BOX = "LO:HI[,LO:HI,…]|NAME=LO:HI,…"
_OPTIONS: list[Callable[[Any], Any]] = [
    click.option(
        "--config",
        type=click.Path(path_type=Path),
        metavar="FILE.toml",
        help="Settings; keys as in DdMhe. Options here count more.",
    ),
    click.option("--horizon", type=int, help="Horizon M, samples.  [default: by rule]"),
    click.option("--rho", type=float, help="Discount per sample, in (0, 1).  [default: by rule]"),
    click.option("--mu", type=float, help="Weight on the fitted noise.  [default: by rule]"),
    click.option(
        "--weights",
        type=click.Choice(["auto", "paper", "scaled", "recorded"]),
        help="What weights are meant in: units of the log, spreads, or the recording's own noise.  "
        "[default: auto]",
    ),
    click.option(
        "--space",
        metavar="auto|exact|truncated:RANK|ridge:WEIGHT",
        help="Which windows count as trajectories.  [default: auto]",
    ),
    click.option(
        "--start-from",
        type=click.Choice(["auto", "recording", "state", "unknown"]),
        help="Where the run starts: the recording's end, a state (--x-prior, or the last recorded "
        "one), or anywhere; auto finds out whether it goes on from the recording.  "
        "[default: auto]",
    ),
    click.option(
        "--warm-start/--no-warm-start",
        default=None,
        help="The old names of --start-from recording and state.",
    ),
    click.option(
        "--x-prior", callback=values.numbers, metavar="X1,X2,…", help="State at the start."
    ),
    click.option(
        "--x-bounds",
        callback=values.bounds,
        metavar=_BOX,
        help="Bounds on the states; an end left out is none.  [default: none]",
    ),
    click.option(
        "--x-center",
        type=click.Choice(["history"]),
        help="Bounds are about the window that the recording alone suggests.  [default: absolute]",
    ),
    click.option(
        "--v-bounds",
        callback=values.bounds,
        metavar=_BOX,
        help="Bounds on the fitted noise of the outputs.  [default: none]",
    ),
    click.option(
        "--w-bounds",
        callback=values.bounds,
        metavar=_BOX,
        help="Bounds on the fitted disturbance of the states.  [default: none]",
    ),
    click.option(
        "--soft",
        callback=values.price,
        metavar="PRICE|x=PRICE,v=PRICE,w=PRICE",
        help="Bounds may be left at that price.  [default: hard]",
    ),
    click.option(
        "--process-noise",
        callback=values.matrix,
        metavar="auto|none|recorded|residual|Q1,Q2,…",
        help="The disturbance that is fitted, or its variances.  [default: auto]",
    ),
    click.option(
        "--output-noise",
        callback=values.one_or_each,
        metavar="SD[,SD,…]",
        help="Standard deviation of the noise of later outputs.  [default: the recording's]",
    ),
    click.option(
        "--drift",
        callback=values.matrix,
        metavar="D1,D2,…",
        help="Variance that a sample adds to the error of each state that no output shows.  "
        "[default: none]",
    ),
    click.option(
        "--equilibrium",
        callback=values.equilibrium,
        metavar="X1,…:Y1,…[:U1,…]",
        help="A known rest of states, outputs and inputs.  [default: none]",
    ),
    click.option(
        "--certificate",
        type=click.Path(path_type=Path),
        metavar="FILE.toml",
        help="What `ddmhe design` wrote, in the place of rho and mu.  [default: none]",
    ),
    click.option(
        "--disturbance",
        callback=values.numbers,
        metavar="INITIAL,W,V",
        help="Sizes of the initial error, of w and of v, for an error bound.  [default: none]",
    ),
    click.option(
        "--gate",
        callback=gate,
        metavar="auto|K",
        help="Reject outputs that are K deviations from what all others say they are, and start "
        "again where the state has jumped.  [default: none]",
    ),
    click.option(
        "--stuck",
        type=click.Choice(["tell", "missing"]),
        help="What becomes of an output that repeats one value too long.  [default: tell]",
    ),
    click.option(
        "--evidence/--no-evidence",
        default=None,
        help="Whether to say how far to trust each estimate.  [default: evidence]",
    ),
]
OF_ESTIMATOR = (
    *("horizon", "rho", "mu", "weights", "space", "start_from", "warm_start", "x_prior"),
    *("x_bounds", "x_center", "v_bounds", "w_bounds", "soft", "process_noise", "output_noise"),
    *("drift", "equilibrium", "certificate", "disturbance", "gate", "stuck", "evidence"),
)
"""Their names in `given`, without the settings file."""


def setting_options(command: Any) -> Any:
    """All settings of DdMhe, and a file of them."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def settings_from_file(config: Path | None, given: dict[str, Any]) -> dict[str, Any]:
    """Settings of a file; those that say how to read a log become options."""
    from_file = {} if config is None else read_config(config)
    for key in READING:
        found = from_file.pop(key, None)
        given[key] = found if given[key] is None else given[key]
    return from_file


def settings_of(
    from_file: Mapping[str, Any], given: Mapping[str, Any], names: Names, goes_on: bool
) -> dict[str, Any]:
    """Keywords of DdMhe: the file's, overridden by the options given; `goes_on`: the log goes on
    where the recording ends."""
    settings = dict(from_file)
    if given["start_from"] is not None or given["warm_start"] is not None:
        settings = {k: v for k, v in settings.items() if k not in ("start", "warm_start")}
    named = {key: given[key] for key in OF_ESTIMATOR if given[key] is not None}
    settings |= {key: _setting(key, value, names) for key, value in named.items()}
    if "start_from" in settings:
        settings["start"] = settings.pop("start_from")
    known = {"start", "warm_start", "x_prior"} & set(settings)
    if not known and not goes_on:
        settings["start"] = "unknown"  # another log than the recorded one begins anywhere
    elif not known and (settings.get("evidence") is False or "disturbance" in settings):
        settings["start"] = "recording"  # the log goes on where its history ends
    return settings


def _setting(key: str, value: Any, names: Names) -> Any:
    if key in ("x_bounds", "w_bounds", "v_bounds"):
        columns = names.output if key == "v_bounds" else names.state
        return values.resolved(f"--{key.replace('_', '-')}", value, columns)
    if key == "space":
        return space_from_text(value)
    if key == "process_noise" and isinstance(value, str):
        return None if value == "none" else value
    if key == "certificate":
        found = read_config(value).get("certificate")
        if found is None:
            raise click.BadParameter(
                f"expected a file with a certificate, found none in '{file_words(value)}'",
                param_hint="--certificate",
            )
        return found
    return value
