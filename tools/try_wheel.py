"""A wheel in an empty environment, outside of the sources: it estimates, and its command runs.

    python tools/try_wheel.py dist/ddmhe-….whl
    python tools/try_wheel.py --core free/ddmhe-….whl

`--core` installs NumPy alone beside it and leaves the command out: not every dependency has wheels
for a Python without its global lock.
"""

import argparse
import os
import subprocess
import tempfile
import venv
import zipfile
from pathlib import Path

ESTIMATE = """
import sys
import numpy as np
import ddmhe

x = np.zeros((61, 1))
for k in range(60):
    x[k + 1] = 0.9 * x[k] + 1.0
history = ddmhe.History(x[:31], 2.0 * x[:30], 0.1)
log = ddmhe.DdMhe(history, start="recording").run(2.0 * x[30:60])
assert abs(log.x - x[31:]).max() < 1e-9
lock = getattr(sys, "_is_gil_enabled", lambda: True)()
python = sys.version.split()[0] + ("" if lock else ", free-threaded")
print(f"ddmhe {ddmhe.__version__} estimates on Python {python}")
"""


def main() -> None:
    """Installs the wheel and uses it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("wheel", type=Path)
    parser.add_argument("--core", action="store_true", help="with NumPy alone")
    options = parser.parse_args()
    wheel = options.wheel.resolve()
    names = zipfile.ZipFile(wheel).namelist()
    licences = (".dist-info/licenses/LICENSE", "/report/web/uplot/LICENSE")
    for part in (".dist-info/sboms/", *licences, "ddmhe/py.typed"):
        if not any(part in name for name in names):
            raise SystemExit(f"{wheel.name}: expected {part} in it")
    with tempfile.TemporaryDirectory() as folder:
        venv.create(Path(folder, "venv"), with_pip=True)
        programs = Path(folder, "venv", "Scripts" if os.name == "nt" else "bin")
        python = str(programs / "python")
        install = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
        packages = ["--no-deps", str(wheel)] if options.core else [str(wheel)]
        if options.core:
            subprocess.run([*install, "numpy"], check=True, cwd=folder)
        subprocess.run([*install, *packages], check=True, cwd=folder)
        subprocess.run([python, "-c", ESTIMATE], check=True, cwd=folder)
        if not options.core:
            command = [str(programs / "ddmhe"), "demo", "--quiet", "--out", "demo"]
            subprocess.run(command, check=True, cwd=folder)
            if not Path(folder, "demo", "estimate.csv").exists():
                raise SystemExit("ddmhe demo: expected demo/estimate.csv")
    print(f"{wheel.name} works in an empty environment")


if __name__ == "__main__":
    main()
