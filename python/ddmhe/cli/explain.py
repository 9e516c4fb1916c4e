"""``ddmhe explain``: is there enough in this recording?"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from ddmhe._core import DdMhe, DdmheError, RankError
from ddmhe.cli.answer import Answer, answers
from ddmhe.cli.estimators import Chosen
from ddmhe.cli.findings import Findings, notation, states_table
from ddmhe.cli.options import log_options
from ddmhe.cli.reading import read, untold
from ddmhe.cli.running import run
from ddmhe.cli.telling import in_words_of

__all__ = ["command"]


@click.command("explain", short_help="Whether a recording is enough, for which states, how far.")
@log_options
@answers
def command(answer: Answer, log: Path, **given: Any) -> None:
    """Whether the recording is enough, which states its outputs show, which estimator and horizon
    to take, how far to trust it.

    `-v` adds the same in the paper's notation: the rank condition (7), rho, mu and M, the poles of
    the identified model."""
    samples, split = read(answer, log, given)
    h = split.history
    try:
        with answer.working("preparing"):
            est = DdMhe(h, start="recording" if split.goes_on else "unknown")
            rank = h.rank(est.horizon)
    except RankError as e:
        answer.say(f"The recording is not enough: {in_words_of(samples.names, [str(e)])[0]}.")
        answer.facts(enough=False, sentences=[str(e)])
        return
    estimates = (
        run(answer, Chosen(est, {}).runner(split.Y, split.U), len(split.Y))
        if len(split.Y)
        else None
    )
    if estimates is not None and len(estimates) < len(split.Y):
        answer.stop()
    fresh = DdMhe(h, start="recording")  # its warnings are of the recording alone
    found = Findings.of(h, est, samples.names, estimates)
    answer.say(found.first())
    for sentence in found.sentences():
        answer.say(sentence)
    answer.show(states_table(found))
    answer.facts(**found.facts())
    try:
        table, numbers = notation(found, rank)
    except DdmheError as e:
        answer.more(f"No affine model: {e}")
    else:
        answer.facts(notation=numbers)
        if answer.verbose:
            answer.show(table)
    for sentence in in_words_of(samples.names, untold(samples, fresh.warnings)):
        answer.warn(sentence)
