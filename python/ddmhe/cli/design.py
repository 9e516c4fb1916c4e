"""``ddmhe design``: stability from a recording."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from ddmhe import report
from ddmhe._core import DdmheError, History, RigidBodyMhe
from ddmhe.checks import word
from ddmhe.cli.answer import Answer, answers
from ddmhe.cli.options import directory_option, log_options
from ddmhe.cli.reading import read
from ddmhe.config import write_config

if TYPE_CHECKING:
    from ddmhe.design import AffineModel, Certificate, PolePlacement

__all__ = ["command"]


@click.command("design", short_help="Algorithm 2 and a stability certificate from a recording.")
@log_options
@directory_option("ddmhe-design")
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
@answers
def command(
    answer: Answer,
    log: Path,
    out: Path,
    radius: float,
    eta: float | None,
    condition: float | None,
    **given: Any,
) -> None:
    """Stability from a recording: Algorithm 2 with its limits, and a certificate for the estimator.

    Writes design.toml, which `estimate --config` accepts, and poles.png into DIR.
    """
    from ddmhe import design as designs
    from ddmhe.report.figures import pole_figure

    _, split = read(answer, log, given)
    noise = None
    if any(given[f"noise_{name}"] != 0 for name in "xyw"):
        noise = designs.RecordingNoise(
            given["noise_x"], given["noise_y"], given["noise_w"], given["noise_kind"]
        )
    with answer.working("designing"):
        body = _as_rigid_body(split.history)
        model = designs.identify(split.history)
        placement = designs.pole_placement(split.history, radius)
        certificate = designs.ioss(split.history, eta, condition=condition, noise=noise)
    out.mkdir(parents=True, exist_ok=True)
    written = [out / "design.toml", out / "poles.png"]
    write_config(written[0], {"certificate": certificate})
    report.save_figure(pole_figure(model, placement), written[1])
    answer.show(
        report.design(f"Design from {word(log.name)}", split.history, model, placement, certificate)
    )
    for words in (placement.words, certificate.words, *([] if body is None else body["words"])):
        answer.say(words)
    answer.facts(**_facts(split.history, model, placement, certificate), rigid_body=body)
    answer.wrote(written)


def _as_rigid_body(h: History) -> dict[str, Any] | None:
    """Whether a tumbling body explains the recording, and in words; None where it is not of three
    rates."""
    rates = h.n == 3 and h.m == 0 and set(h.x_units) <= {"", "rad/s"}
    if not rates:
        return None
    try:
        est = RigidBodyMhe(h)
    except DdmheError as e:
        return {"explained": None, "words": [f"as a rigid body: {e}"]}
    found = est.report()
    words = [] if found is None else found.words[:1]
    if est.explained:
        words.append("--estimator rigid-body of `ddmhe estimate` follows it beyond the recording")
    return {"explained": est.explained, "words": words}


def _facts(
    h: History, model: AffineModel, placement: PolePlacement, certificate: Certificate
) -> dict[str, Any]:
    """Every number of the table."""
    return {
        "history": {"T": h.T, "dt": h.dt, "n": h.n, "p": h.p, "m": h.m},
        "model": {"A": model.A, "B": model.B, "e": model.e, "C": model.C, "D": model.D}
        | {"r": model.r, "poles": list(np.linalg.eigvals(model.A).astype(complex))},
        "algorithm_2": {
            "rank": placement.rank,
            "required_rank": placement.required_rank,
            "singular_values": placement.singular_values,
            "region": str(placement.region),
            "beta": placement.beta,
            "poles": list(np.asarray(placement.poles, dtype=complex)),
            "rho0": placement.rho0,
            "mu0": placement.mu0,
            "rho0_identified": placement.rho0_identified,
            "mu0_identified": placement.mu0_identified,
            "rho0_of_any_gain": placement.lower_bound,
            "certified": placement.certified,
            "words": placement.words,
        },
        "certificate": {
            "eta": certificate.eta,
            "horizon": certificate.horizon,
            "condition": certificate.condition,
            "trace_Q": np.trace(certificate.Q),
            "trace_R": np.trace(certificate.R),
            "residual": certificate.residual,
            "words": certificate.words,
        },
    }
