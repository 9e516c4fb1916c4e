"""What certificates hold and cost: random systems, simulated bounds, the satellite, noisy
recordings.

Run with `make study-certificates` (about two minutes); writes docs/certificates-study.md.
"""

import sys
from pathlib import Path

import numpy as np
from rich.console import Console

import ddmhe
from ddmhe.design import RecordingNoise, ioss, pole_placement

ROOT = Path(__file__).resolve().parents[1]
REPORT = ROOT / "docs" / "certificates-study.md"
sys.path.insert(0, str(ROOT / "tests" / "python"))
from reference import largest_eigenvalue, random_system  # noqa: E402
from test_certificate import random_pair  # noqa: E402
from test_error_bounds import disturbed  # noqa: E402
from test_robust_certificate import A_TRUE, C_TRUE, rich_recording  # noqa: E402


def random_systems():
    """500 random pairs."""
    rng = np.random.default_rng(0)
    largest, conditions = -np.inf, []
    for _ in range(500):
        A, C = random_pair(rng)
        c = ioss(A=A, C=C, eta=float(rng.choice([0.5, 0.8, 0.95])))
        largest = max(largest, largest_eigenvalue(c, A, C))
        conditions.append(c.condition)
    yield (
        "500 random systems (n 1 to 6, p 1 to 8): all certified, largest eigenvalue of all "
        f"{largest:.2e},"
    )
    yield f"cond P {np.median(conditions):.3g} in the median, {max(conditions):.3g} at most."


def simulated():
    """10 000 trajectories against both bounds."""
    violations, tight = [0, 0], []
    for seed in range(50):
        rng = np.random.default_rng(seed)
        n = 1 + seed % 5
        system = random_system(rng, n, 1 + (seed // 5) % 4)
        h = ddmhe.History(*system.simulate(rng.standard_normal(n), 60))
        c = ioss(h, float(rng.choice([0.6, 0.8, 0.9])))
        sizes = 0.5, float(rng.choice([0.0, 0.02])), float(rng.choice([0.0, 0.1]))
        estimator = ddmhe.DdMhe(h, space=ddmhe.Exact(), certificate=c, disturbance=sizes)
        advance = c.error_bound(30, estimator.horizon, *sizes)[1:]
        for _ in range(200):
            x_0, offset = rng.standard_normal(n), rng.standard_normal(n)
            x, y = disturbed(system, rng, x_0, 30, *sizes[1:])
            estimator.reset(x_0 + 0.5 * offset / np.linalg.norm(offset))
            log = estimator.run(y)
            error = np.linalg.norm(log.x - x[1:], axis=1)
            for k, bound in enumerate((log.bound, advance)):
                violations[k] += bool((error > bound * (1 + 1e-9) + 1e-9).any())
            tight.append(
                [
                    np.median(log.bound / advance),
                    np.median(error / log.bound) if sizes[2] else np.nan,
                ]
            )
    ratio, share = np.nanmedian(np.array(tight), axis=0)
    yield (
        f"10 000 trajectories of 50 systems: {violations[0]} exceed the bound of the step, "
        f"{violations[1]} the one"
    )
    yield (
        f"known in advance. Medians: the bound of the step is {ratio:.2f} times the one in "
        "advance, the error"
    )
    yield f"{share:.2f} times the bound."


def satellite():
    """The paper's target."""
    yield (
        "| sampling (s) | eta | cond P | trace Q | trace R | horizon | rho0 of any gain at least |"
    )
    yield "|" + " --- |" * 7
    for dt in (0.1, 0.5):
        record = ddmhe.models.detumbling().simulate(20.0, dt)
        h = ddmhe.History(record.x, record.y[:-1], dt=dt)
        bound = pole_placement(h).lower_bound
        for eta in (0.8, 0.9, 0.95):
            c = ioss(h, eta)
            numbers = (
                f"{c.condition:.4g} | {np.trace(c.Q):.4g} | {np.trace(c.R):.4g} | {c.horizon} | "
                f"{bound:.3f}"
            )
            yield f"| {dt} | {eta} | {numbers} |"


def robust():
    """How much larger a certificate becomes with the noise that it must cover."""
    yield (
        "| noise on x and y | kind | certified | true system satisfies it | P | Q | R (ratios to "
        "nominal, medians) |"
    )
    yield "|" + " --- |" * 7
    for kind in ("bounded", "gaussian"):
        for size in (1e-4, 1e-3, 3e-3, 1e-2, 2e-2):
            rng = np.random.default_rng(0)
            noise = RecordingNoise(x=size, y=size, kind=kind)
            held, ratios, draws = 0, [], 1000 if size == 1e-3 else 100
            for _ in range(draws):
                h = rich_recording(rng, noise)
                try:
                    c, nominal = ioss(h, 0.95, noise=noise), ioss(h, 0.95)
                except ddmhe.DdmheError:
                    continue
                held += largest_eigenvalue(c, A_TRUE, C_TRUE) <= 0
                ratios.append(
                    [np.trace(getattr(c, k)) / np.trace(getattr(nominal, k)) for k in "PQR"]
                )
            P, Q, R = np.median(ratios, axis=0) if ratios else (np.nan,) * 3
            counts = f"{len(ratios)} of {draws} | {held} of {len(ratios)}"
            yield f"| {size:g} | {kind} | {counts} | {P:.3f} | {Q:.3f} | {R:.3f} |"


def main():
    """Run everything, print it and write it to REPORT."""
    console = Console()
    lines = [
        "# Certificates: what they hold and cost",
        "",
        "Printed by `make study-certificates` (studies/certificates.py).",
        "",
    ]
    for title, part in (
        ("Random systems", random_systems),
        ("Simulated errors against the bounds", simulated),
        ("The satellite", satellite),
        ("Robust certificates at eta = 0.95, states of size 1 to 3, 150 samples", robust),
    ):
        lines += [f"## {title}", "", *part(), ""]
        console.print(f"{title}: done")
    REPORT.write_text("\n".join(lines), encoding="utf-8")
    console.print("\n".join(lines), markup=False, soft_wrap=True)
    console.print(f"wrote {REPORT.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
