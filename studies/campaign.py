"""The campaign of dispersed satellites: hundreds of targets, each with every estimator; what
`ddmhe campaign run` makes of studies/campaigns/*.toml. Prints the tables of
docs/measured/campaign.md and draws its figure; a folder that is there is gone on with."""

from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("agg")
import matplotlib.pyplot as plt

from ddmhe import campaign
from ddmhe.report.page import markdown_table
from ddmhe.report.palette import color_of

HERE = Path(__file__).parent
OUT, FIGURE = Path("ddmhe-campaign"), HERE.parent / "docs" / "measured" / "campaign.png"
DEG = 180 / np.pi


def run(name):
    folder = OUT / name
    spec = HERE / "campaigns" / f"{name}.toml"
    there = (folder / "spec.json").exists()
    return campaign.run(spec, folder, resume=there, progress=lambda p: print(p.done, p.total))


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
        ]
        rows.append((str(name), str(len(own)), *cells, worst, *bars))
    head = ("estimator", "targets", *(s if s != "all" else "100s" for s in found.spec.spans),
            "worst", "NEES", "within 3 sd", "trusted")  # fmt: skip
    return "\n".join(markdown_table(head, rows))


def figure(found):
    """Errors over time, median and 5 to 95 %, and over the share of targets."""
    made, (left, right) = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
    for i, (name, own) in enumerate(found.rows.groupby("estimator", sort=False)):
        over = DEG * np.array(own["error_over_time"].tolist())
        t = (np.arange(over.shape[1]) + 0.5) / over.shape[1] * 100
        low, middle, high = np.percentile(over, (5, 50, 95), axis=0)
        left.fill_between(t, low, high, color=color_of(i), alpha=0.2, linewidth=0)
        left.plot(t, middle, color=color_of(i), label=str(name))
        errors = np.sort(DEG * own["rmse_all"])
        right.plot(100 * (np.arange(len(errors)) + 1) / len(errors), errors, color=color_of(i))
    left.set(yscale="log", xlabel="time after the recording (s)", ylabel="error (deg/s)")
    right.set(yscale="log", xlabel="share of the targets (%)", ylabel="rms error of 100 s (deg/s)")
    left.legend(frameon=False)
    made.savefig(FIGURE, dpi=110)


def worst(found):
    """The worst targets of each estimator."""
    rows = []
    for name, own in found.rows.groupby("estimator", sort=False):
        for _, row in own.nlargest(3, "rmse_all").iterrows():
            trusted = f"{row['trusted']:.0%}" if row["trusted"] == row["trusted"] else ""
            nees = f"{row['nees_all']:.2g}" if row["nees_all"] == row["nees_all"] else ""
            rows.append((str(name), str(row["case"]), str(row["seed"]),
                         f"{DEG * row['rmse_all']:.2g}", nees, trusted))  # fmt: skip
    head = ("estimator", "case", "seed", "error (deg/s)", "NEES", "trusted")
    return "\n".join(markdown_table(head, rows))


def main():
    found = run("satellite")
    print(table(found), "", worst(found), "", table(run("tuned")), sep="\n")
    found.report(OUT / "satellite.html")
    figure(found)


if __name__ == "__main__":
    main()
