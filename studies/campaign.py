"""The campaign of dispersed satellites: a thousand targets, each with every estimator; what
`ddmhe campaign run` makes of studies/campaigns/satellite.toml. Prints the tables of
docs/measured/campaign.md and draws its figure; a folder that is there is gone on with."""

from itertools import pairwise
from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("agg")
import matplotlib.pyplot as plt

from ddmhe import campaign
from ddmhe.campaign.data import data_of
from ddmhe.campaign.work import run_part
from ddmhe.config import read_table
from ddmhe.report.page import markdown_table
from ddmhe.report.palette import color_of

HERE = Path(__file__).parent
SPEC = HERE / "campaigns" / "satellite.toml"
OUT, FIGURE = Path("ddmhe-campaign"), HERE.parent / "docs" / "measured" / "campaign.png"
DEG = 180 / np.pi
MUCH = 0.1
"""Share of a run from which on a target counts as wrong unnoticed."""
SPREADS = (0.0, 0.01, 0.03, 0.1, 0.3, np.inf)
"""Of the recorded rates, in the direction in which they vary second most, deg/s."""


def run():
    folder = OUT / "satellite"
    there = (folder / "spec.json").exists()
    return campaign.run(SPEC, folder, resume=there, progress=lambda p: print(p.done, p.total))


def table(found):
    """Median and 95 % of the errors (deg/s), the largest, and how the bars hold."""
    rows = []
    for name, own in found.rows.groupby("estimator", sort=False):
        cells = [
            f"{np.median(v):.2g} ({np.percentile(v, 95):.2g})"
            for v in (DEG * own[f"rmse_{span}"] for span in found.spec.spans)
        ]
        worst = f"{DEG * own['rmse_all'].max():.2g}"
        told = own["within_3sd"].notna().all()
        bars = [
            f"{own['nees_all'].median():.2g}" if told else "",
            f"{own['within_3sd'].mean():.1%}" if told else "",
            f"{own['trusted'].mean():.0%}" if told else "",
            f"{own['unnoticed'].mean():.1%}" if told else "",
            str((own["unnoticed"] > MUCH).sum()) if told else "",
        ]
        rows.append((str(name), str(len(own)), *cells, worst, *bars))
    head = ("estimator", "targets", *(s if s != "all" else "100s" for s in found.spec.spans),
            "worst", "NEES", "within 3 sd", "trusted", "wrong unnoticed",
            "targets")  # fmt: skip
    return "\n".join(markdown_table(head, rows))


def figure(found):
    """Errors over time, median and 5 to 95 %, and over the share of targets."""
    made, (left, right) = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
    for i, (name, own) in enumerate(found.rows.groupby("estimator", sort=False)):
        over = DEG * np.array(own["error_over_time"].tolist())
        t = (np.arange(over.shape[1]) + 0.5) / over.shape[1] * 100
        low, middle, high = np.percentile(over, (5, 50, 95), axis=0)
        look = {"color": color_of(i), "linestyle": ("-", "--", "-", ":")[i % 4]}
        left.fill_between(t, low, high, color=color_of(i), alpha=0.15, linewidth=0)
        left.plot(t, middle, label=str(name), **look)
        errors = np.sort(DEG * own["rmse_all"])
        right.plot(100 * (np.arange(len(errors)) + 1) / len(errors), errors, **look)
    left.set(yscale="log", xlabel="time after the recording (s)", ylabel="error (deg/s)")
    right.set(yscale="log", xlabel="share of the targets (%)", ylabel="rms error of 100 s (deg/s)")
    made.legend(frameon=False, loc="outside upper center", ncols=4)
    made.savefig(FIGURE, dpi=110)


def worst(found):
    """The worst targets of each estimator."""
    rows = []
    for name, own in found.rows.groupby("estimator", sort=False):
        for _, row in own.nlargest(3, "rmse_all").iterrows():
            told = row["nees_all"] == row["nees_all"]
            bars = [f"{row['nees_all']:.2g}", f"{row['trusted']:.0%}", f"{row['unnoticed']:.0%}"]
            rows.append((str(name), str(row["case"]), str(row["seed"]),
                         f"{DEG * row['rmse_all']:.2g}", *(bars if told else ["", "", ""]),
                         *map("{:.2g}".format, spreads(found, row["seed"]))))  # fmt: skip
    head = ("estimator", "case", "seed", "error (deg/s)", "NEES", "trusted", "wrong unnoticed",
            "spin at first", "spread of recorded rates", "second", "third")  # fmt: skip
    return "\n".join(markdown_table(head, rows))


def spreads(found, seed):
    """First spin of a target and how much its recorded rates vary in three directions, deg/s,
    without noise."""
    clean = {**found.spec.plain, "noise": {"none": {}}}
    spec = campaign.read_spec(clean)
    x = data_of(spec, spec.scenario(spec.seeds.index(seed))).history.recordings[0][0]
    varied = np.linalg.svd(x - x.mean(axis=0), compute_uv=False) / np.sqrt(len(x))
    return DEG * np.array([np.linalg.norm(x[0]), *varied])


def by(own, what, values, edges):
    """Targets at which RigidBodyMhe is wrong unnoticed, by some number of each."""
    rows = []
    for low, high in pairwise(edges):
        some = own[(low <= values) & (values < high)]
        wrong = some["unnoticed"] > MUCH
        rows.append((f"{low:g} to {high:g}", str(len(some)), str(wrong.sum()),
                     f"{wrong.mean():.1%}", str((some["nees_all"] > 9).sum()),
                     f"{DEG * some['rmse_all'].median():.2g}"))  # fmt: skip
    head = (what, "targets", "wrong unnoticed", "share", "NEES above 9", "median error (deg/s)")
    return "\n".join(markdown_table(head, rows))


def unnoticed(found):
    """How often RigidBodyMhe is wrong unnoticed, by what its recording shows; and those targets
    again, with other noise."""
    own = found.rows[found.rows["estimator"] == "RigidBodyMhe"]
    spin, _, second, _ = np.array([spreads(found, seed) for seed in own["seed"]]).T
    wrong = own[own["unnoticed"] > MUCH]
    shares = [f"{(own['unnoticed'] > share).sum()} for {share:.0%}" for share in (0.1, 0.25, 0.5)]
    errors = DEG * wrong["rmse_all"]
    print(f"wrong unnoticed for more than this of the run: {', '.join(shares)}; their error is "
          f"{errors.median():.2g} deg/s in the median, at most {np.percentile(errors, 95):.2g} for "
          "95 % of them")  # fmt: skip
    print(by(own, "second spread (deg/s)", second, SPREADS), "", sep="\n")
    print(by(own, "spin at first (deg/s)", spin, (2, 5, 10, 15, 20)), "", sep="\n")
    table = read_table(SPEC)
    usual = table["noise"]["usual"]
    tenth = {name: deviation / 10 for name, deviation in usual.items()}
    spec = campaign.read_spec(table | {
        "seeds": wrong["seed"].tolist(),
        "noise": {"usual": usual, "again": usual, "tenth": tenth},
        "estimators": {"RigidBodyMhe": {"knows_noise": True}},
    })  # fmt: skip
    told = dict.fromkeys(spec.noise, 0)
    for part in spec.parts:
        for row in run_part(spec, part).rows:
            told[row["noise"]] += row["unnoticed"] > MUCH
    print("these targets again, wrong unnoticed by noise:", told)


def pairs(found):
    """Errors of `tuned` over those of DdMhe, target by target."""
    errors = found.rows.pivot(index="seed", columns="estimator", values="rmse_all")
    ratio = errors["tuned"] / errors["DdMhe"]
    print(f"tuned over DdMhe: {ratio.median():.3f} in the median, from {ratio.quantile(0.05):.2f} "
          f"to {ratio.quantile(0.95):.2f} for 90 % of the targets, smaller at "
          f"{(ratio < 1).sum()}")  # fmt: skip


def main():
    found = run()
    print(table(found), "", worst(found), "", sep="\n")
    unnoticed(found)
    pairs(found)
    found.report(OUT / "satellite.html")
    figure(found)


if __name__ == "__main__":
    main()
