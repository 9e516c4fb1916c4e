"""Error measures: what they leave out, and what they are relative to."""

import numpy as np
import pytest

from ddmhe.report import nrmse, pooled_nrmse, rmse, rmse_norm, root_mean_square


def test_error_measures_leave_out_what_is_unknown():
    error = np.array([[3.0, 4.0], [np.nan, 0.0], [3.0, 4.0]])
    np.testing.assert_allclose(rmse(error), [3.0, np.sqrt(32 / 3)])
    assert rmse_norm(error) == pytest.approx(5.0)
    assert np.isnan(rmse(np.full((2, 1), np.nan)))
    x = np.array([[1.0, 10.0], [3.0, np.nan], [5.0, 20.0]])
    np.testing.assert_array_equal(nrmse(x, x), [0.0, 0.0])
    assert pooled_nrmse(x, x) == 0.0
    mean = np.tile([3.0, 15.0], (3, 1))
    np.testing.assert_allclose(nrmse(mean, x), [1.0, 1.0])
    assert pooled_nrmse(mean, x) == pytest.approx(1.0)


def test_each_state_has_its_own_nrmse():
    """A large state does not hide a small one, as it does in the pooled number."""
    x = np.column_stack([1000 * np.sin(np.arange(50.0)), np.cos(np.arange(50.0)), np.ones(50)])
    x_hat = x + np.array([0.0, 2 * np.std(x[:, 1]), 0.0])
    relative = nrmse(x_hat, x)
    np.testing.assert_allclose(relative[:2], [0.0, 2.0], atol=1e-12)
    assert np.isnan(relative[2])
    assert root_mean_square(relative) == pytest.approx(np.sqrt(2.0))
    assert pooled_nrmse(x_hat, x) < 0.003
