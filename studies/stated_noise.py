"""What tune makes of outputs that are noisier online than in the recording, and whether it leaves
the weights of the recording without a reason.

Run with `make study-stated-noise` (a minute); prints two tables for docs/tuning.md. Systems as in
`make study-disturbance`, other seeds for the second table; errors of all states together."""

from dataclasses import replace

import numpy as np
from rich.console import Console
from rich.table import Table

import ddmhe
from noisy_systems import Log, masses, single_axis

TIMES = (2.5, 5.0, 20.0)
"""Online noise over the recorded one."""
SEEDS = range(6)
FRESH = range(20, 40)


def louder(log: Log, times: float) -> Log:
    """The same with outputs that are noisier after the recording."""
    extra = np.sqrt(times**2 - 1) * log.R
    rng = np.random.default_rng(0)
    return replace(log, Y=log.Y + extra * rng.standard_normal(log.Y.shape), R=times * log.R)


def error(log: Log, settings: dict) -> float:
    x = ddmhe.DdMhe(log.history, start="recording", **settings).run(log.Y).x
    return float(np.sqrt(np.mean((x - log.truth) ** 2)))


def main() -> None:
    """Print how errors with tune compare with the default's."""
    systems = {
        "masses, states ± 0": lambda seed: masses(seed, 0.0),
        "masses, states ± 0.01": lambda seed: masses(seed, 0.01),
        "bench": single_axis,
    }
    table = Table("system", "noise", "handed over", "tuned / default", "scaled / default")
    for name, made in systems.items():
        for times in TIMES:
            ratios, others, handed = [], [], 0
            for seed in SEEDS:
                log = louder(made(seed), times)
                found = ddmhe.tune(log.history, output_noise=log.R, progress=False)
                handed += "process_noise" in found.settings
                default = error(log, {})
                ratios.append(error(log, found.settings) / default)
                others.append(error(log, {"weights": "scaled"}) / default)
            row = [f"{np.median(r):.2f} ({min(r):.2f} to {max(r):.2f})" for r in (ratios, others)]
            table.add_row(name, f"x {times:g}", f"{handed} of {len(SEEDS)}", *row)
    kept = Table("system, noise as recorded", "left the default", "worst tuned / default")
    for name, made in systems.items():
        logs = [made(seed) for seed in FRESH]
        found = [ddmhe.tune(log.history, progress=False).settings for log in logs]
        pairs = zip(logs, found, strict=True)
        worst = max(error(log, given) / error(log, {}) if given else 1.0 for log, given in pairs)
        left = sum(bool(given) for given in found)
        kept.add_row(name, f"{left} of {len(FRESH)}", f"{worst:.2f}")
    console = Console(width=120)
    console.print(table)
    console.print(kept)


if __name__ == "__main__":
    main()
