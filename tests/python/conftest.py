"""A log of the tumbling satellite, for tests of the command line."""

import numpy as np
import pandas as pd
import pytest

from commands import OUTPUT, STATE
from ddmhe.models import detumbling


@pytest.fixture(scope="session")
def recording():
    return detumbling().simulate(60.0, 0.1, noise=0.01, seed=1)


@pytest.fixture(scope="session")
def frame(recording):
    return pd.DataFrame(
        np.hstack([recording.t[:, None], recording.x, recording.y]), columns=["t", *STATE, *OUTPUT]
    )


@pytest.fixture(scope="session")
def log(frame, tmp_path_factory):
    path = tmp_path_factory.mktemp("logs") / "log.csv"
    frame.to_csv(path, index=False)
    return path
