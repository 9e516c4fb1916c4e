"""Files are whole or not there, and an error says which and why."""

import os
import resource
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest

from ddmhe import DdmheError, config, files, models, report

FULL = "/dev/full"


def writers():
    """Everything that this package writes, as (name, call with a path)."""
    from ddmhe.report.figures import estimate_figure
    from ddmhe.reproduce.claims import write_claims

    t, x = np.arange(5000.0), np.random.default_rng(0).standard_normal((5000, 2))
    figure = estimate_figure(
        t, x, None, history=(t[:3] - 9, x[:3]), names=["a", "b"], quantity="x (1)"
    )
    return {
        "a.csv": lambda path: report.write_estimates(path, "t", t, ["a", "b"], x),
        "a.png": lambda path: report.save_figure(figure, path),
        "a.svg": lambda path: report.save_figure(figure, path),
        "a.toml": lambda path: config.write_config(path, {"x_prior": list(map(float, x.ravel()))}),
        "a.md": lambda path: write_claims(path, []),
        "a.txt": lambda path: files.write_text(path, "words " * 9999),
    }


@pytest.mark.skipif(not os.path.exists(FULL), reason="no /dev/full on this system")
@pytest.mark.parametrize("name", ["a.csv", "a.png", "a.svg", "a.toml", "a.md", "a.txt"])
def test_a_full_disk_is_named_and_leaves_no_half_file(name, tmp_path):
    """The device that every write fails on for want of space; through a link, so that endings are
    as usual."""
    link = tmp_path / name
    link.symlink_to(FULL)
    with pytest.raises(DdmheError, match=rf"{name}: .* No space left on device") as e:
        writers()[name](link)
    assert "\n" not in str(e.value)
    assert os.listdir(tmp_path) == [name]
    assert os.path.exists(FULL)
    assert not os.path.isfile(FULL)


@pytest.mark.parametrize("name", ["a.csv", "a.png", "a.svg", "a.toml", "a.txt"])
def test_what_was_there_stays_until_the_new_file_is_whole(name, tmp_path):
    """The system stops the writing in the middle (a limit on the size of files, as a quota
    does)."""
    path = tmp_path / name
    path.write_text("old")
    write, limits = writers()[name], resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (5000, limits[1]))
    try:
        with pytest.raises(
            DdmheError,
            match=rf"{name}: expected to be able to write this file, found: File too large",
        ):
            write(path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == [name]
    write(path)
    assert path.stat().st_size > 5000
    assert os.listdir(tmp_path) == [name]


def test_the_command_line_says_which_file_and_why(tmp_path):
    record = models.spin_down().simulate(4.0, 0.02, noise=0.001)
    frame = pd.DataFrame({"t": record.t, "w": record.x[:, 0], "q": record.y[:, 0]})
    frame.to_csv(tmp_path / "log.csv", index=False)
    command = [
        "ddmhe",
        "estimate",
        "log.csv",
        "--state",
        "w",
        "--output",
        "q",
        "--history",
        "2",
        "--out",
        "est.csv",
    ]
    code = (
        "import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (900, 900))\n"
        f"sys.argv = {command}\nfrom ddmhe.cli import main\nmain()"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path, timeout=120
    )
    assert result.returncode == 2, result.stderr
    assert (
        result.stderr
        == "ddmhe: error: est.csv: expected to be able to write this file, found: File too large\n"
    )
    assert sorted(os.listdir(tmp_path)) == ["log.csv"]


def test_links_and_modes_are_those_of_usual_files(tmp_path):
    (tmp_path / "there").mkdir()
    (tmp_path / "link.txt").symlink_to(tmp_path / "there" / "file.txt")
    files.write_text(tmp_path / "link.txt", "new")
    assert (tmp_path / "link.txt").is_symlink()
    assert (tmp_path / "there" / "file.txt").read_text() == "new"
    (tmp_path / "usual.txt").write_text("")
    assert (tmp_path / "there" / "file.txt").stat().st_mode == (
        tmp_path / "usual.txt"
    ).stat().st_mode


@pytest.mark.parametrize("path", ["no/such/directory/a.txt", "a\0b", None, 3.5])
def test_paths_that_cannot_be_written(path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(DdmheError, match="expected"):
        files.write_text(path, "words")
