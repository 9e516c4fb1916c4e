"""Settings for all dispersed satellites at once: `ddmhe.tune` on twenty targets that the campaign
does not judge, and the setting that is ranked best over all of them. Prints what stands under
`tuned` in studies/campaigns/satellite.toml, and the ranking of docs/measured/campaign.md."""

from collections import defaultdict
from pathlib import Path

import numpy as np

import ddmhe
from ddmhe import campaign
from ddmhe.campaign.data import data_of
from ddmhe.config import plain_settings, read_table
from ddmhe.report.page import markdown_table

SPEC = Path(__file__).parent / "campaigns" / "satellite.toml"
TARGETS = tuple(range(1000, 1020))
"""Seeds of the targets to tune on: the campaign has those below 1000."""


def ranks(spec, number):
    """What each setting is ranked by on one target: mean log error of what was held out."""
    data = data_of(spec, spec.scenario(number))
    found = ddmhe.tune(data.history, output_noise=data.noise.later, progress=False)
    print(f"seed {TARGETS[number]}: {found.settings or 'the default rule'}. {found.words}")
    return {
        "the default rule" if row["default"] else str(plain_settings(given)): row["rated"]
        for given, (_, row) in zip(found.candidates, found.table.iterrows(), strict=True)
    }


def main():
    spec = campaign.read_spec(read_table(SPEC) | {"seeds": list(TARGETS)})
    every = defaultdict(list)
    for number in range(len(TARGETS)):
        for setting, rated in ranks(spec, number).items():
            every[setting].append(rated)
    rule = np.array(every["the default rule"])
    tried = {name: np.array(v) - rule for name, v in every.items() if len(v) == len(TARGETS)}
    rows = [
        (name, f"{v.mean():.3f}", f"{np.median(v):.3f}", f"{v.min():.2f} to {v.max():.2f}")
        for name, v in sorted(tried.items(), key=lambda item: float(item[1].mean()))
    ]
    print(f"{len(every)} settings, {len(tried)} of them on all of {len(TARGETS)} targets")
    head = ("setting", "rank less the default rule's, mean", "median", "range")
    print("\n".join(markdown_table(head, rows)))


if __name__ == "__main__":
    main()
