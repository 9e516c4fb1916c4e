"""Quick looks: functions that take a log and axes, and return the axes."""

import subprocess
import sys

import matplotlib as mpl
import numpy as np
import pytest

mpl.use("Agg")

import ddmhe

RECORD = ddmhe.models.detumbling().simulate(60.0, 0.1, noise=0.01)
LOG = ddmhe.DdMhe(RECORD.history(200), start="recording").run(RECORD.y[200:-1])
TRUTH = RECORD.x[201:]
BARE = ddmhe.DdMhe(RECORD.history(200), evidence=False).run(RECORD.y[200:220])
CALLS = {
    "states": lambda ax: ddmhe.plot.states(LOG, ax),
    "states with the truth": lambda ax: ddmhe.plot.states(LOG, ax, truth=TRUTH),
    "errors": lambda ax: ddmhe.plot.errors(LOG, TRUTH, ax),
    "innovations": lambda ax: ddmhe.plot.innovations(LOG, ax),
    "evidence": lambda ax: ddmhe.plot.evidence(LOG, ax),
    "states without evidence": lambda ax: ddmhe.plot.states(BARE, ax),
}


@pytest.fixture
def ax():
    from matplotlib.figure import Figure

    return Figure().subplots()


@pytest.mark.parametrize("name", CALLS)
def test_axes_go_in_and_come_out(ax, name):
    assert CALLS[name](ax) is ax
    lines = ax.get_lines()
    np.testing.assert_allclose(lines[0].get_xdata()[:3], [0.1, 0.2, 0.3], rtol=1e-12)
    ax.figure.canvas.draw()
    # the legend stands above the axes and covers no data
    legend = ax.get_legend().get_window_extent()
    assert legend.y0 >= ax.get_window_extent().y1 - 1


def test_what_is_drawn_is_the_log(ax):
    ddmhe.plot.states(LOG, ax, names=["a", "b", "c"])
    drawn = {line.get_label(): line.get_ydata() for line in ax.get_lines()}
    for i, name in enumerate("abc"):
        np.testing.assert_array_equal(drawn[name], LOG.x[:, i])
    doubts = [text.get_text() for text in ax.get_legend().get_texts()]
    assert "doubt: novel" in doubts


def test_without_axes_those_of_pyplot_are_taken():
    from matplotlib import pyplot

    figure = pyplot.figure()
    assert ddmhe.plot.evidence(LOG) is figure.axes[0]
    pyplot.close(figure)


def test_what_is_no_log(ax):
    with pytest.raises(ddmhe.DdmheError, match=r"^log: expected a Log"):
        ddmhe.plot.states(LOG.x, ax)
    with pytest.raises(ddmhe.DdmheError, match=r"^names: expected 3"):
        ddmhe.plot.states(LOG, ax, names=["a"])
    with pytest.raises(ddmhe.DdmheError, match=r"^log: expected one with evidence"):
        ddmhe.plot.innovations(BARE, ax)
    with pytest.raises(ddmhe.DdmheError, match=r"^truth: expected shape"):
        ddmhe.plot.errors(LOG, TRUTH[1:], ax)


def test_the_package_lists_the_names_of_its_api_alone():
    assert set(dir(ddmhe)) == {*ddmhe.__all__, "__version__"}
    for name in dir(ddmhe):
        assert getattr(ddmhe, name) is not None
    code = "import sys, ddmhe; dir(ddmhe); print('matplotlib' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


def test_axes_are_asked_for():
    with pytest.raises(ddmhe.DdmheError, match="ax: expected Axes of matplotlib, found"):
        ddmhe.plot.states(LOG, np.array([None, None]))
