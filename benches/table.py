"""What criterion measured last, in one table: `make bench` ends with it.

Criterion leaves a folder for each benchmark in target/criterion; the median with its confidence
interval is shown, and the change since the run before, where there was one.
"""

import json
import sys
from pathlib import Path

from rich.console import Console
from rich.table import Table

ROOT = Path(__file__).parents[1] / "target" / "criterion"
UNITS = ((1e9, "s"), (1e6, "ms"), (1e3, "µs"), (1.0, "ns"))


def shown(ns):
    """Nanoseconds in the largest unit that they fill."""
    size, unit = next((pair for pair in UNITS if ns >= pair[0]), UNITS[-1])
    return f"{ns / size:.3g} {unit}"


def measured():
    """(name, median, (low, high), change or None), by name."""
    for path in ROOT.glob("**/new/estimates.json"):
        median = json.loads(path.read_text())["median"]
        interval = median["confidence_interval"]
        name = json.loads((path.parent / "benchmark.json").read_text())["full_id"]
        change = path.parents[1] / "change" / "estimates.json"
        moved = None
        if change.exists():
            moved = json.loads(change.read_text())["median"]["point_estimate"]
        ends = interval["lower_bound"], interval["upper_bound"]
        yield name, median["point_estimate"], ends, moved


def main():
    """Prints the table."""
    rows = sorted(measured())
    if not rows:
        sys.exit(f"{ROOT}: expected benchmarks, found none (cargo bench)")
    table = Table(title="medians, 95 % intervals, change since the last run")
    for name, justify in (
        ("", "left"),
        ("median", "right"),
        ("between", "right"),
        ("change", "right"),
    ):
        table.add_column(name, justify=justify)
    for name, median, (low, high), moved in rows:
        change = "" if moved is None else f"{moved:+.1%}"
        table.add_row(name, shown(median), f"{shown(low)} – {shown(high)}", change)
    Console(width=None if sys.stdout.isatty() else 100).print(table)


if __name__ == "__main__":
    main()
