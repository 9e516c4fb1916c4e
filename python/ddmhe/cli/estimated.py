"""What ``ddmhe estimate`` found: the table, the same as numbers, and the files."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddmhe import report
from ddmhe._core import History
from ddmhe._core import Log as Estimates
from ddmhe.checks import word
from ddmhe.frames import told
from ddmhe.recordings import Log, Recorded
from ddmhe.report.estimates_file import EstimatesFile, write_estimates_file
from ddmhe.report.trust import BARS, Trust

Array = NDArray[np.float64]

__all__ = ["facts", "summary", "write_files"]


def summary(
    log: Log,
    split: Recorded,
    promise: Array | None,
    estimates: Estimates,
    settings: Mapping[str, str],
) -> Any:
    """The table that is printed: `settings` as they are in force, how the steps ended, what is
    promised, errors where the truth is known."""
    filled = int(np.sum(log.lines == 0))
    rows = {"history": f"T = {split.history.T} samples of {log.dt:.4g} s"}
    rows |= {"gaps filled": f"{filled} samples"} if filled else {}
    rows |= {f"delay of {name}": f"{seconds:.4g} s" for name, seconds in log.delay.items()}
    rows |= dict(settings) | report.outcome(estimates.status, told(estimates, "active"))
    bound = told(estimates, "bound")
    if bound is not None:
        rows["error bound"] = f"{np.median(bound):.4g} median, {np.max(bound):.4g} at most"
    rows |= _rejected(log.names.output, estimates)
    if promise is not None:
        rows |= {
            f"promised rms {name}": "unknown" if np.isnan(value) else f"{value:.4g}"
            for name, value in zip(log.names.state, promise, strict=True)
        }
    if split.x_true is not None:
        rows |= _errors(log.names.state, split.history, estimates, split.x_true)
    return report.table(f"Estimates of {word(Path(log.path).name)}", {"": rows})


def facts(
    split: Recorded, promise: Array | None, estimates: Estimates, of_system: Mapping[str, Any]
) -> dict[str, Any]:
    """Every number of the table, and those that it leaves out."""
    log, h = split.log, split.history
    states = log.names.state
    trust = Trust.of_log(estimates)
    active, bound = told(estimates, "active"), told(estimates, "bound")
    found: dict[str, Any] = {
        "dt": log.dt,
        "filled": int(np.sum(log.lines == 0)),
        "delay": dict(log.delay),
        **of_system,
        "steps": len(estimates.x),
        "status": Counter(map(str, estimates.status)),
        "no_bound_active": None if active is None else float(np.mean(active == 0)),
        "promise": None if promise is None else dict(zip(states, promise, strict=True)),
        "trusted": None if trust is None else float(np.mean(trust.trusted)),
    }
    if bound is not None:
        found["bound"] = {"median": np.median(bound), "max": np.max(bound)}
    if estimates.evidence is not None:
        gated = estimates.evidence.gated.sum(axis=0)
        found["rejected"] = dict(zip(log.names.output, gated, strict=True))
        found["started_again"] = int(estimates.evidence.restarted.sum())
    if split.x_true is not None:
        found["errors"] = _error_facts(states, h, estimates, split.x_true)
    return found


def _error_facts(
    names: Sequence[str], history: History, estimates: Estimates, x_true: Array
) -> dict[str, Any]:
    relative = report.nrmse(estimates.x, x_true)
    trust = Trust.of_log(estimates)
    one_unit = len(relative) > 1 and len(set(history.x_units)) == 1 and history.x_units[0]
    found = {
        "rmse": dict(zip(names, report.rmse(estimates.x - x_true), strict=True)),
        "nrmse": dict(zip(names, relative, strict=True)),
        "nrmse_all": report.root_mean_square(relative),
        "nrmse_pooled": report.pooled_nrmse(estimates.x, x_true) if one_unit else None,
    }
    if trust is not None:
        shares = trust.shares(estimates.x - x_true)
        found[f"within_{BARS:g}_std"] = [
            {"of": asked, "share": share, "count": count} for asked, share, count in shares
        ]
    return found


def _rejected(names: Sequence[str], estimates: Estimates) -> dict[str, str]:
    """How many outputs a gate left out, and how often the run started again."""
    if estimates.evidence is None:
        return {}
    counts = estimates.evidence.gated.sum(axis=0)
    rows = {f"rejected {name}": str(n) for name, n in zip(names, counts, strict=True) if n}
    again = int(estimates.evidence.restarted.sum())
    return rows | ({"started again": f"{again} times"} if again else {})


def _errors(
    names: Sequence[str], history: History, estimates: Estimates, x_true: Array
) -> dict[str, str]:
    """Errors against the states of the log, and the share of them that the bars hold, as label and
    text."""
    errors = report.rmse(estimates.x - x_true)
    rows = {f"RMSE {name}": f"{value:.4g}" for name, value in zip(names, errors, strict=True)}
    relative = report.nrmse(estimates.x, x_true)
    rows |= {f"NRMSE {name}": f"{value:.4f}" for name, value in zip(names, relative, strict=True)}
    rows["NRMSE"] = f"{report.root_mean_square(relative):.4f}"
    if len(relative) > 1 and len(set(history.x_units)) == 1 and history.x_units[0]:
        rows["NRMSE pooled"] = f"{report.pooled_nrmse(estimates.x, x_true):.4f}"
    trust = Trust.of_log(estimates)
    if trust is not None:
        rows |= trust.within(estimates.x - x_true)
    return rows


def write_files(
    out: Path | None, figure: Path | None, split: Recorded, estimates: Estimates, metadata: Any
) -> list[Path]:
    """A row for every step; the figure, too."""
    written = []
    if out is not None:
        out.parent.mkdir(parents=True, exist_ok=True)
        written += write_estimates_file(out, EstimatesFile.of(split, estimates, metadata))
    if figure is not None:
        from ddmhe.report.figures import estimate_figure
        from ddmhe.report.style import labels

        log, T = split.log, len(split.log.t) - len(split.t) - 1
        states = log.names.state
        names, quantity = labels(states, [log.unit(name) for name in states])
        figure.parent.mkdir(parents=True, exist_ok=True)
        drawing = estimate_figure(
            split.t,
            estimates.x,
            split.x_true,
            history=(log.t[: T + 1], log.x[: T + 1]),
            names=names,
            quantity=quantity,
            trust=Trust.of_log(estimates),
        )
        report.save_figure(drawing, figure)
        written.append(figure)
    return written
