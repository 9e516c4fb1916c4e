"""Which estimator a command takes, with which of its options, and what it tells of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click
import numpy as np
from numpy.typing import NDArray

from ddmhe._core import DdMhe, RigidBodyMhe
from ddmhe.cli.answer import Answer
from ddmhe.cli.in_force import BY_LOG, in_force, say_why, words_of
from ddmhe.cli.metadata import IN_FORCE
from ddmhe.recordings import Recorded

if TYPE_CHECKING:
    from ddmhe.lifted import LiftedMhe

Array = NDArray[np.float64]

__all__ = ["Chosen", "choose", "estimator_option"]

RIGID = ("output_noise", "x_bounds")
"""Settings of DdMhe that RigidBodyMhe has, too."""

OF_LIFTED = ("output_noise", "x_bounds")
"""Settings of LiftedMhe; the others are those of the DdMhe in its place."""

estimator_option = click.option(
    "--estimator",
    type=click.Choice(["dd", "rigid-body", "lifted"]),
    default="dd",
    show_default=True,
    help="dd: DdMhe. rigid-body: the three rates (rad/s) of a tumbling body that eddy currents "
    "brake, also where the motion has left the recording. lifted: a polynomial model, where ends "
    "of the recording that were held out say that it is better, else dd.",
)


@dataclass(frozen=True)
class Chosen:
    """An estimator, and the settings that were named."""

    est: DdMhe | RigidBodyMhe | LiftedMhe
    named: Mapping[str, Any]

    def step(self, Y: Array, U: Array | None, k: int) -> None:
        """Consume row k."""
        if isinstance(self.est, RigidBodyMhe):
            self.est.step(Y[k])
        else:
            self.est.step(Y[k], None if U is None else U[k])

    def runner(self, Y: Array, U: Array | None) -> Callable[[slice], Any]:
        """What makes the estimates of some rows."""
        est = self.est
        if isinstance(est, RigidBodyMhe):
            return lambda rows: est.run(Y[rows])
        return lambda rows: est.run(Y[rows], None if U is None else U[rows])

    def rows(self, givers: Mapping[str, str]) -> dict[str, str]:
        """Settings in force, as label and text."""
        if isinstance(self.est, DdMhe):
            return in_force(self.est, self.named, givers)
        if not isinstance(self.est, RigidBodyMhe):
            used = f"degree {self.est.degree}" if self.est.chosen else "not used"
            named = {
                key.replace("_", " "): f"{words_of(value)} ({givers.get(key, BY_LOG)})"
                for key, value in self.named.items()
            }
            return {"estimator": "LiftedMhe", "polynomial model": used} | named
        report = self.est.report()
        rows = {"estimator": "RigidBodyMhe", "explained": "yes" if self.est.explained else "no"}
        if report is not None and report.probabilities:
            rows["motions"] = ", ".join(f"{p:.1%}" for p in report.probabilities)
        return rows

    def say_more(self, answer: Answer) -> None:
        """Why each setting was chosen; what was found out of a body."""
        if isinstance(self.est, DdMhe):
            say_why(answer, self.est)
        elif not isinstance(self.est, RigidBodyMhe):
            return  # its warnings say what was chosen, and why
        elif (report := self.est.report()) is not None:
            for sentence in report.words:
                answer.say(sentence)

    def in_force(self) -> dict[str, Any]:
        """The same as values."""
        if isinstance(self.est, DdMhe):
            return {key: getattr(self.est.settings, key) for key in IN_FORCE}
        return {"estimator": "lifted" if not isinstance(self.est, RigidBodyMhe) else "rigid-body"}

    def facts(self) -> dict[str, Any]:
        """What is known of the system."""
        if isinstance(est := self.est, DdMhe):
            return {
                "why": est.settings.why,
                "trajectory_space": {"directions": est.rank, "ridge": est.ridge},
                "spectral_radius": est.spectral_radius,
            }
        if not isinstance(est, RigidBodyMhe):
            return {"estimator": "lifted", "chosen": est.chosen, "degree": est.degree}
        report = est.report()
        found: dict[str, Any] = {"estimator": "rigid-body", "explained": est.explained}
        if report is not None:
            found["body"] = {
                "inertia": report.inertia,
                "inertia_std": report.inertia_std,
                "unseen": report.unseen,
                "lag": report.lag,
                "lag_std": report.lag_std,
                "probabilities": report.probabilities,
                "chi": report.chi,
                "limits": report.limits,
                "words": report.words,
            }
        return found

    @property
    def promise(self) -> Array | None:
        """Promised errors, of an estimator that promises any."""
        return None if isinstance(self.est, RigidBodyMhe) else self.est.promise


def choose(kind: str, split: Recorded, named: dict[str, Any]) -> Chosen:
    """The estimator of that kind for a recording; `named`: settings as keywords of DdMhe."""
    if kind == "dd":
        return Chosen(DdMhe(split.history, **named), named)
    if kind == "lifted":
        from ddmhe.lifted import LiftedMhe  # takes longer to load than the others

        own = {key: named[key] for key in OF_LIFTED if key in named}
        rest = {key: value for key, value in named.items() if key not in OF_LIFTED}
        return Chosen(LiftedMhe(split.history, **own, fallback=rest), named)
    named.pop("start", None)  # of the kind of log
    for key in named:
        if key not in RIGID:
            option = f"--{key.replace('_', '-')}"
            raise click.BadParameter(
                "expected a setting of the rigid body's estimator "
                f"({', '.join('--' + own.replace('_', '-') for own in RIGID)}), found one of "
                "DdMhe's",
                param_hint=option,
            )
    if not split.goes_on:
        raise click.BadParameter(
            "expected a log that goes on where its recording ends with rigid-body, whose rates are "
            "followed from there; found one that begins anywhere (--history makes its beginning "
            "the last recording)",
            param_hint="--estimator",
        )
    return Chosen(RigidBodyMhe(split.history, **named), named)
