"""The pages of docs/reports, made from logs that are simulated here, and one that is measured.

Run with `make example-pages`; the measured circuit takes part where the folder of `DDMHE_DATA`
is."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

import ddmhe
from ddmhe.report.web import Source

ROOT = Path(__file__).parents[1]
DATA = Path(os.environ.get("DDMHE_DATA", ROOT / "../shared/data"))
PAGES = ROOT / "docs" / "reports"


CAMPAIGN = """
name = "satellites"
seeds = 50
[systems.satellite]
integrator = "accurate"
[noise.usual]
x = 1e-4
y = 0.01
[faults.none]
[faults.rough]
missing = 0.05
spikes = 0.01
[estimators.DdMhe]
knows_noise = true
[estimators.RigidBodyMhe]
knows_noise = true
[estimators.filter]
kind = "ErrorStateKalman"
[keep]
spans = [20, 40]
"""


def frame(record: ddmhe.models.Recording, states: str, outputs: str, units: str) -> pd.DataFrame:
    """A recording with named columns, as a logger writes it: a line of units, seven digits."""
    columns = np.hstack([record.t[:, None], record.x, record.y])
    names = ["time", *states.split(","), *outputs.split(",")]
    rows = [[f"{value:.7g}" for value in row] for row in columns]
    return pd.DataFrame([units.split(","), *rows], columns=names)


def oscillator() -> pd.DataFrame:
    """A damped oscillator with bounded noise on states and output."""
    rng = np.random.default_rng(0)
    A = np.array([[0.995, 0.099], [-0.198, 0.965]])
    x = np.zeros((601, 2))
    x[0] = 1.0, 0.0
    for k in range(600):
        x[k + 1] = A @ x[k] + 0.02 * rng.uniform(-1, 1, 2)
    y = x[:, :1] + 0.01 * rng.uniform(-1, 1, (601, 1))
    columns = np.round(np.hstack([0.1 * np.arange(601)[:, None], x, y]), 7)
    return pd.DataFrame(columns, columns=["time", "position_m", "speed_m_s", "range_m"])


def run(command: str, folder: Path) -> None:
    """A command of ddmhe as a reader would type it there."""
    subprocess.run([sys.executable, "-m", "ddmhe", *command.split()], cwd=folder, check=True)


def page(command: str, log: pd.DataFrame | None, folder: Path) -> None:
    """Run a command beside its log, so that the page says what a reader would type."""
    words = command.split()
    if log is not None:
        log.to_csv(folder / words[1], index=False)
    run(command, folder)
    made = folder / words[-1]
    (PAGES / made.name).write_bytes(made.read_bytes())
    print(f"{made.name}: {made.stat().st_size / 1e3:.0f} kB")


def rigid_body(record: ddmhe.models.Recording) -> None:
    """The satellite again, by Euler's equation; of 20 s rates are recorded, to 1e-6 rad/s."""
    history = ddmhe.History(record.x[:201], record.y[:200], dt=0.1, x_units="rad/s", y_units="N m")
    est = ddmhe.RigidBodyMhe(history, x_noise=1e-6)
    log = est.run(record.y[200:-1])
    path = PAGES / "rigid-body.html"
    ddmhe.report.html(
        est,
        log,
        path,
        truth=record.x[201:],
        t=record.t[201:],
        names={"state": ["wx", "wy", "wz"], "output": ["tx", "ty", "tz"]},
        history=history,
        source=Source(log="detumbling.csv", recorded=(record.t[:201], record.x[:201])),
    )
    print(f"{path.name}: {path.stat().st_size / 1e3:.0f} kB")


def main() -> None:
    """Write every page."""
    PAGES.mkdir(exist_ok=True)
    satellite = ddmhe.models.detumbling().simulate(60.0, 0.1, noise=0.01, seed=1)
    states, outputs = "wx,wy,wz", "tx,ty,tz"
    rigid_body(satellite)
    swing = ddmhe.models.pendulum().simulate(30.0, 0.05, noise=0.01, seed=1)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        page(
            f"report detumbling.csv --state {states} --output {outputs} --history 20 "
            "--out detumbling.html",
            frame(satellite, states, outputs, "s,rad/s,rad/s,rad/s,N m,N m,N m"),
            folder,
        )
        page(
            "report pendulum.csv --state angle,rate --output measured --history 10 "
            "--out pendulum.html",
            frame(swing, "angle,rate", "measured", "s,rad,rad/s,rad"),
            folder,
        )
        page(
            "interval oscillator.csv --state position_m,speed_m_s --output range_m --history 20 "
            "--report interval.html",
            oscillator(),
            folder,
        )
        (folder / "spec.toml").write_text(CAMPAIGN)
        run("campaign run spec.toml --out satellites", folder)
        page("campaign report satellites --out campaign.html", None, folder)
        circuit = DATA / "input-logs" / "circuit.csv"
        if circuit.exists():
            page(
                "report circuit.csv --state nin2_V,neg_V,out_V --output out_V --input vin_V "
                "--history 0.0032 --out circuit.html",
                pd.read_csv(circuit),
                folder,
            )
        else:
            print(f"circuit.html: left out, no {circuit}")


if __name__ == "__main__":
    main()
