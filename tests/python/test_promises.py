"""What the README promises of the defaults: the 3-DOF case and the measured pendulum logs, nothing
tuned."""

import os
from pathlib import Path

import numpy as np
import pytest

import ddmhe
from ddmhe.reproduce import pendulum_task

DATA = (
    Path(os.environ.get("DDMHE_DATA", Path(__file__).parents[3] / "shared" / "data"))
    / "repoimu-pendulum"
)
BOX = 10 * np.pi / 60


def rmse(error):
    return np.rad2deg(np.sqrt(np.mean(np.sum(error**2, axis=1))))


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("noisy_history", [True, False])
def test_detumbling_with_defaults(seed, noisy_history):
    """20 s recorded, torque noise 0.01 N·m: 0.12/0.30/2.0 deg/s over the next 20/40/100 s, every
    step optimal. That the motion is no longer like the recording's is said between 10 and 20 s."""
    model = ddmhe.models.detumbling()
    record = model.simulate(120.0, 0.1, noise=0.01, seed=seed)
    y = record.y[:200] if noisy_history else model.output(record.x[:200])
    estimator = ddmhe.DdMhe(
        ddmhe.History(record.x[:201], y, dt=0.1), x_bounds=(-BOX, BOX), x_center="history"
    )
    assert estimator.warnings == []
    log = estimator.run(record.y[200:-1])
    error = log.x - record.x[201:]
    assert (log.status == "optimal").all()
    assert all(sentence.startswith("from ") for sentence in estimator.warnings)
    novel = log.reasons & ddmhe.Reason.NOVEL != 0
    if noisy_history:  # without noise there, noise online is new from the first sample on
        assert 100 <= np.argmax(novel) < 200
    assert novel[200:].all()
    assert rmse(error[:200]) < 0.12
    assert rmse(error[:400]) < 0.30
    assert rmse(error) < 2.0


def test_a_tight_box_on_the_3_dof_case_keeps_every_step_optimal():
    """The problem on which solvers fail when (16) is written down as printed: here most steps need
    the solver."""
    record = ddmhe.models.detumbling().simulate(120.0, 0.1, noise=0.01, seed=1)
    h = ddmhe.History(record.x[:201], record.y[:200], dt=0.1)
    limits = record.x.min(0) + 0.02, record.x.max(0) - 0.02
    for horizon in (10, 50):
        log = ddmhe.DdMhe(h, horizon, x_bounds=limits).run(record.y[600:900])
        assert (log.status == "optimal").all()
        assert (log.active > 0).mean() > 0.3
        assert (log.x >= limits[0] - 1e-9).all()
        assert (log.x <= limits[1] + 1e-9).all()


@pytest.mark.skipif(
    not DATA.is_dir(), reason="no measured logs: set DDMHE_DATA to the directory of data sets"
)
def test_measured_pendulum_with_defaults():
    """Angular rate from the accelerometer alone: better than its mean on every log, NRMSE 0.36 in
    geometric mean."""
    nrmse = {}
    for path in sorted(DATA.glob("*.csv")):
        task = pendulum_task(path)
        assert task.history.T == 150
        x_hat = ddmhe.DdMhe(task.history).run(task.Y).x
        seen = np.isfinite(task.x).all(axis=1)
        truth = task.x[seen]
        nrmse[path.stem] = np.sqrt(
            np.mean((x_hat[seen] - truth) ** 2) / np.mean((truth - truth.mean(0)) ** 2)
        )
    values = np.array(list(nrmse.values()))
    assert len(values) >= 18
    assert values.max() < 1, nrmse
    assert np.exp(np.log(values).mean()) < 0.36, nrmse
