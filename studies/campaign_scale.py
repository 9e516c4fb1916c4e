"""What a campaign costs beside a bare loop: CPU time and wall time a case on one and two workers,
bytes a case. Prints the table of docs/measured/campaign.md."""

import os
import tempfile
import time
from pathlib import Path

from ddmhe import campaign, run_many
from ddmhe.campaign.data import data_of
from ddmhe.campaign.work import run_part
from ddmhe.report.page import markdown_table

CASES = 6000
SPEC = {
    "seeds": CASES,
    "batch": 50,
    "systems": {"bench": {}},
    "noise": {"low": {"x": 1e-3, "y": 1e-4}},
    "estimators": {"DdMhe": {}},
}


def cpu():
    """CPU time of this process and of its children that have ended, s."""
    return sum(os.times()[:4])


def timed(what):
    begin, used = time.perf_counter(), cpu()
    what()
    return time.perf_counter() - begin, cpu() - used


def in_a_loop(spec):
    for part in spec.parts:
        run_part(spec, part)


def of_run_many(spec):
    """The data, and all runs in one call; nothing measured, nothing kept."""
    made = [data_of(spec, spec.scenario(k)) for k in range(spec.scenarios)]
    run_many([data.history for data in made], [data.Y for data in made])


def main():
    os.environ["RAYON_NUM_THREADS"] = "1"
    spec = campaign.read_spec(SPEC)
    one = campaign.read_spec(SPEC | {"seeds": 1})
    rows = []
    for name, what in (
        ("run_many, one thread", of_run_many),
        ("a loop of the same cases", in_a_loop),
    ):
        rows.append((name, *timed(lambda what=what: what(spec)), 0.0, 0.0))
    with tempfile.TemporaryDirectory() as place:
        for workers in (1, 2):
            begun = timed(lambda: campaign.run(one, f"{place}/one{workers}", workers=workers))  # noqa: B023
            whole = timed(lambda: campaign.run(spec, f"{place}/all{workers}", workers=workers))  # noqa: B023
            rows.append((f"campaign, {workers} workers", *whole, *begun))
        size = sum(p.stat().st_size for p in Path(place, "all1").rglob("*") if p.is_file())
    cells = [
        (name, f"{1e3 * (used - begun_cpu) / CASES:.2f}", f"{CASES / (wall - begun):.0f}")
        for name, wall, used, begun, begun_cpu in rows
    ]
    print("\n".join(markdown_table(("", "CPU a case (ms)", "cases a second"), cells)))
    print(f"{size / CASES:.0f} bytes a case on the disk")


if __name__ == "__main__":
    main()
