"""`ddmhe estimate --estimator rigid-body`, and what `ddmhe design` says of a body."""

import json

import numpy as np
import pandas as pd
import pytest

import ddmhe
from commands import COLUMNS, in_a_process, in_here

DT, HISTORY = 0.1, 20


@pytest.fixture(scope="module")
def tumbling(tmp_path_factory):
    """A log of rates read with noise and of torques, as a file and as arrays."""
    record = ddmhe.models.detumbling().simulate(duration=60.0, dt=DT, noise=0.01)
    x = record.x + 1e-4 * np.random.default_rng(0).standard_normal(record.x.shape)
    names = ["t", "wx", "wy", "wz", "tx", "ty", "tz"]
    rows = np.column_stack([record.t[:-1], x[:-1], record.y[: len(x) - 1]])
    path = tmp_path_factory.mktemp("logs") / "tumbling.csv"
    pd.DataFrame(rows, columns=names).to_csv(path, index=False)
    return path, x[:-1], record.y[: len(x) - 1]


def test_estimates_are_those_of_the_class(tumbling, tmp_path):
    path, x, y = tumbling
    out, page = tmp_path / "e.npz", tmp_path / "e.html"
    options = ["--history", HISTORY, "--estimator", "rigid-body", "--out", out, "--report", page]
    done = in_a_process("estimate", path, *COLUMNS, *options)
    assert done.returncode == 0, done.stderr
    assert "a rigid body explains the data" in done.stdout
    T = round(HISTORY / DT)
    history = ddmhe.History(x[: T + 1], y[:T], dt=DT)
    log = ddmhe.RigidBodyMhe(history).run(y[T:-1])
    with np.load(out) as file:
        found = np.column_stack([file[name] for name in ("wx", "wy", "wz")])
    np.testing.assert_allclose(found, log.x, rtol=0, atol=1e-9)  # dt is read off stamps
    assert "Rigid body" in page.read_text()


def test_the_body_is_in_the_numbers(tumbling):
    done = in_here(
        "estimate", tumbling[0], *COLUMNS, "--history", HISTORY, "--estimator", "rigid-body",
        "--output-noise", 0.01, "--json",
    )  # fmt: skip
    found = json.loads(done.stdout)
    assert found["explained"]
    assert np.trace(found["body"]["inertia"]) == pytest.approx(3.0)
    assert sum(found["body"]["probabilities"]) == pytest.approx(1.0)
    assert found["named"] == {"output_noise": 0.01}
    assert found["promise"] is None


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--rho", 0.9], "--rho: expected a setting of the rigid body's estimator"),
        (["--follow"], "--estimator: expected dd with --follow"),
    ],
)
def test_what_it_does_not_take_is_said(tumbling, options, words):
    done = in_here(
        "estimate", tumbling[0], *COLUMNS, "--history", HISTORY, "--estimator", "rigid-body",
        *options,
    )  # fmt: skip
    assert done.returncode == 2
    assert words in done.stderr.replace("Invalid value for ", "")


def test_a_log_elsewhere_is_refused(tumbling, tmp_path):
    done = in_here(
        "estimate", tumbling[0], *COLUMNS, "--recording", tumbling[0], "--estimator", "rigid-body"
    )
    assert done.returncode == 2
    assert "goes on where its recording ends" in done.stderr
    assert "--history" in done.stderr


def test_earlier_recordings_are_of_the_same_body(tumbling, tmp_path):
    """The log's own beginning is the last recording: there the run goes on."""
    path, x, y = tumbling
    out, T, cut = tmp_path / "e.npz", round(HISTORY / DT), 400
    options = ["--history", HISTORY, "--estimator", "rigid-body", "--recording", f"{path}:40..55"]
    done = in_here("estimate", path, *COLUMNS, *options, "--out", out)
    assert done.returncode == 0, done.stderr
    assert "a rigid body explains the data of 2 recordings" in done.stdout
    earlier = ddmhe.History(x[cut : cut + 151], y[cut : cut + 150], dt=DT)
    history = ddmhe.History.concat([earlier, ddmhe.History(x[: T + 1], y[:T], dt=DT)])
    log = ddmhe.RigidBodyMhe(history).run(y[T:-1])
    with np.load(out) as file:
        found = np.column_stack([file[name] for name in ("wx", "wy", "wz")])
    np.testing.assert_allclose(found, log.x, rtol=0, atol=1e-9)
    done = in_here(
        "design", path, *COLUMNS, *options[:2], *options[4:], "--json", "--out", tmp_path
    )
    assert "2 recordings" in json.loads(done.stdout)["rigid_body"]["words"][0]


def test_design_says_whether_a_body_explains_the_recording(tumbling, tmp_path):
    done = in_here(
        "design", tumbling[0], *COLUMNS, "--history", HISTORY, "--out", tmp_path, "--json"
    )
    found = json.loads(done.stdout)["rigid_body"]
    assert found["explained"]
    assert "--estimator rigid-body" in found["words"][-1]
