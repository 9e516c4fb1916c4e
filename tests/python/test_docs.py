"""The README's code does what it says."""

import re
from pathlib import Path

README = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")


def test_python_example_runs(capsys):
    blocks = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    assert len(blocks) == 3
    exec(compile("\n".join(blocks), "README.md", "exec"), {})
    printed = capsys.readouterr().out
    assert "optimal (2, 3)" in printed  # one output in: a window of two states
    assert "['optimal']" in printed
    assert "Guaranteed for every system" in printed
    assert float(re.search(r"largest error (\S+)", printed)[1]) < 1e-6  # of speeds of size 1
