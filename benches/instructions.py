"""Instructions of one step, counted by callgrind, against the numbers of a file: `make
instructions`.

A count is the same on every machine with the same compiler, so that a step which became slower
shows where times are too noisy. Fails when a count has grown by more than 5 %; `--write` makes
today's counts the baseline. Of the smallest windows the floor is counted, too: see floor.rs."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

BASELINE = Path(__file__).with_suffix(".json")
PROGRAM = Path("target/release/examples/instructions")
STEPS = 500
LIMIT = 1.05
FLOORS = {"free-20-3": "floor-20-3", "free-10-5": "floor-10-5", "free-50-20": "floor-50-20"}


def compiler() -> str:
    """Version of the compiler, on which the counts depend."""
    return subprocess.run(
        ["rustc", "--version"], check=True, capture_output=True, text=True
    ).stdout.split()[1]


def count(regime: str) -> int:
    """Instructions of a step."""
    command = [
        "valgrind",
        "--tool=callgrind",
        "--callgrind-out-file=/dev/null",
        "--collect-atstart=no",
    ]
    command += [f"--toggle-collect=*instructions::{of}*" for of in ("steps", "log", "floors")]
    command += [str(PROGRAM), regime]
    found = subprocess.run(command, check=True, capture_output=True, text=True)
    collected = re.search(r"Collected : (\d+)", found.stderr)
    if collected is None or int(collected[1]) == 0:
        sys.exit(f"instructions: callgrind collected nothing for {regime}:\n{found.stderr}")
    return round(int(collected[1]) / STEPS)


def main() -> None:
    """Count, compare, and write if asked to."""
    if shutil.which("valgrind") is None:
        sys.exit("instructions: valgrind is needed, not found (apt-get install valgrind)")
    baseline = json.loads(BASELINE.read_text())
    counts = {regime: count(regime) for regime in baseline["counts"]}
    if "--write" in sys.argv[1:]:
        BASELINE.write_text(json.dumps({"rustc": compiler(), "counts": counts}, indent=2) + "\n")
    same = baseline["rustc"] == compiler()
    grown = []
    for regime, instructions in counts.items():
        ratio = instructions / max(baseline["counts"][regime], 1)
        print(f"{regime:<14} {instructions:>8} instructions a step, {ratio:.3f} of the baseline")
        if ratio > LIMIT:
            grown.append(regime)
    for regime, floor in FLOORS.items():
        least = count(floor)
        print(f"{regime:<14} {counts[regime] / least:>8.2f} of its floor, {least} instructions")
    if grown and not same:
        print(
            f"instructions: another compiler ({compiler()}) than the baseline's "
            f"({baseline['rustc']}): no verdict"
        )
    elif grown and "--write" not in sys.argv[1:]:
        sys.exit(f"instructions: more than {LIMIT - 1:.0%} above the baseline: {', '.join(grown)}")


if __name__ == "__main__":
    main()
