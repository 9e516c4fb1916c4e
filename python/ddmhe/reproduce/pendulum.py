"""The interval paper's example: the pendulum (60), its two figures, and every method side by
side."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from ddmhe import interval
from ddmhe.baselines import TahirIntervalObserver
from ddmhe.cases.pendulum import CENTER, LAM, LATE, ORDER, PRINTED_PHI, RADIUS, START, STEPS, V, W
from ddmhe.reproduce import interval_theory
from ddmhe.reproduce.claims import Claim, holds_if

Array = NDArray[np.float64]

__all__ = [
    "MEASURES",
    "PAPER",
    "TIGHT",
    "Sets",
    "claims",
    "design",
    "measures",
    "trial",
    "widths",
]

BALL, ELLIPSOID = "peak-to-peak ball (44)", "peak-to-peak ellipsoid"
PRINTED_BALL = "ball (44) with the printed φ0"
PAPER, ZONOTOPE = "paper, both intersected (59)", "paper, zonotope (50)"
GIRARD, TIGHT, FILTERED = "tight, Girard", "tight, PCA", "tight, PCA, with y(k)"
TAHIR = "mixed-monotone (reconstruction)"


@dataclass(frozen=True, eq=False)
class Sets:
    """One trajectory."""

    x: Array
    """True states x(0) to x(N), (N+1, 2)."""
    bounds: dict[str, tuple[Array, Array]]
    """(lower, upper) of x(1) to x(N) of each method, (N, 2) each; FILTERED: of x(0) to x(N-1)."""
    printed: tuple[Array, Array]
    """The ball that belongs to the printed φ0, which is no bound, about x̂(1) to x̂(N)."""

    def violations(self, name: str) -> int:
        """Samples outside."""
        lower, upper = self.bounds[name]
        x = self.x[:-1] if name == FILTERED else self.x[1:]
        return int(((x < lower) | (x > upper)).any(axis=1).sum())


@cache
def design(
    lmi: interval.observer_design.Lmi = "paper", lam: float | None = LAM
) -> interval.ObserverDesign:
    """The gain for the pendulum."""
    return interval.design_observer(interval.pendulum(), lam, lmi=lmi)


@cache
def _baseline() -> TahirIntervalObserver:
    return TahirIntervalObserver(interval.pendulum(), CENTER, RADIUS, W, V)


def disturbances(seed: int) -> tuple[Array, Array, Array]:
    """x(0) (2,), w (N, 2), v (N, 1): uniform, extreme, constant or switching in turn; seed 0 has
    the paper's x(0)."""
    rng = np.random.default_rng(seed)
    kind = seed % 4
    if kind == 0:
        w, v = rng.uniform(-1, 1, (STEPS, 2)), rng.uniform(-1, 1, (STEPS, 1))
    elif kind == 1:
        w, v = rng.choice([-1.0, 1.0], (STEPS, 2)), rng.choice([-1.0, 1.0], (STEPS, 1))
    else:
        period = STEPS if kind == 2 else int(rng.integers(2, 20))
        sign = np.where((np.arange(STEPS) // period) % 2, 1.0, -1.0)[:, None]
        w, v = sign * rng.choice([-1, 1], 2), sign * rng.choice([-1, 1], 1)
    return START if seed == 0 else CENTER + RADIUS * rng.uniform(-1, 1, 2), W * w, V * v


def trial(seed: int) -> Sets:
    """Every method on one trajectory."""
    s, (x_0, w, v) = interval.pendulum(), disturbances(seed)
    x = [x_0]
    for k in range(STEPS):
        x.append(s.A @ x[-1] + (np.zeros(2) if s.f is None else np.asarray(s.f(x[-1]))) + w[k])
    truth = np.array(x)
    Y = truth[:-1] @ s.C.T + v @ s.D2.T
    found: dict[str, tuple[Array, Array]] = {}

    def observer(method: str, reduction: str = "pca") -> interval.IntervalObserver:
        return interval.IntervalObserver(
            s, design(), CENTER, RADIUS, W, V, ORDER, method, reduction
        )

    o = observer("paper")
    hulls = []
    for y in Y:
        hulls.append(o.step(y).zonotope.interval_hull())
    found[ZONOTOPE] = np.array([h[0] for h in hulls]), np.array([h[1] for h in hulls])
    log = observer("paper").run(Y)
    found |= {BALL: log.ball, ELLIPSOID: log.ellipsoid, PAPER: (log.lower, log.upper)}
    log = observer("tight", "girard").run(Y)
    found[GIRARD] = log.lower, log.upper
    log = observer("tight").run(Y)
    found |= {TIGHT: (log.lower, log.upper), FILTERED: log.filtered}
    _baseline().reset()
    steps = _baseline().run(Y)
    found[TAHIR] = steps.lower, steps.upper
    middle = 0.5 * (log.ball[0] + log.ball[1])
    phi = radii(V0_of(PRINTED_PHI))[1:, None]
    return Sets(truth, found, (middle - phi, middle + phi))


def power(v: float = V) -> float:
    """w̄ᵀw̄ + v̄ᵀv̄ of (44), for μw = μv."""
    return 2 * W**2 + v**2


def radii(V0: float) -> Array:
    """φ_0 to φ_N of (44), (N+1,)."""
    g = design()
    decay = (1 - g.lam) ** np.arange(STEPS + 1)
    return np.asarray(np.sqrt(g.mu * (g.lam * decay * V0 + g.mu_w * power())))


def V0_of(phi_0: float) -> float:
    """The V0 that belongs to a φ_0."""
    g = design()
    return (phi_0**2 / g.mu - g.mu_w * power()) / g.lam


def worst_V0() -> float:
    """max e0ᵀ P e0 over the initial box, at one of its vertices."""
    return max(float(e @ design().P @ e) for e in (RADIUS, RADIUS * [1, -1]))


def from_start(trial: Sets, name: str) -> tuple[Array, Array]:
    """(lower, upper) of x(0) to x(N), (N+1, 2): with the initial box, or the ball about it, before
    the first output."""
    lower, upper = trial.printed if name == PRINTED_BALL else trial.bounds[name]
    balls = {BALL: radii(worst_V0())[0], PRINTED_BALL: PRINTED_PHI}
    half = np.full(2, balls[name]) if name in balls else RADIUS
    return np.vstack([CENTER - half, lower]), np.vstack([CENTER + half, upper])


MEASURES = ("x1 (rad)", "x2 (rad/s)")


def measures(trials: list[Sets]) -> dict[str, Array]:
    """Full widths (seeds, N, 2) of each method."""
    return {
        name: np.array([t.bounds[name][1] - t.bounds[name][0] for t in trials])
        for name in trials[0].bounds
    }


def widths(found: Mapping[str, Array]) -> dict[str, Array]:
    """Mean full width of each method over LATE and the seeds, (2,)."""
    return {name: np.asarray(values[:, LATE].mean(axis=(0, 1))) for name, values in found.items()}


def left_the_ball(V0: float) -> float:
    """Share of 200 disturbed runs from the worst vertex of the box that leave the ball (44) of this
    V0."""
    s, g = interval.pendulum(), design()
    f = s.f if s.f is not None else np.zeros_like
    phi = radii(V0)
    left = 0
    for seed in range(200):
        _, w, v = disturbances(seed)
        x, x_hat = CENTER + RADIUS * [1, -1], CENTER
        out = bool(np.linalg.norm(x - x_hat) > phi[0])
        for k in range(20):
            y = s.C @ x + s.D2 @ v[k]
            x_hat = s.A @ x_hat + np.asarray(f(x_hat)) + g.gain @ (y - s.C @ x_hat)
            x = s.A @ x + np.asarray(f(x)) + w[k]
            out = out or bool(np.linalg.norm(x - x_hat) > phi[k + 1])
        left += out
    return left / 200


def claims(trials: list[Sets]) -> list[Claim]:
    """Sections 2 to 4 of the interval paper, and its appendix."""
    mean = widths(measures(trials))
    return [
        *interval_theory.claims(PRINTED_PHI),
        *_design_claims(),
        *_initial_claims(),
        *_figure_1(trials, mean),
        *_figure_2(trials, mean),
        Claim(
            "Beyond the interval paper",
            "One interval matrix, and a box contracted with the measurements, are tighter still",
            "",
            f"full width x1/x2: predicted {_pair(mean, TIGHT)}, with y(k) {_pair(mean, FILTERED)}, "
            f"paper {_pair(mean, PAPER)}",
            holds_if(bool((mean[TIGHT] < mean[PAPER]).all())),
            "our own method, guaranteed under the same assumptions",
        ),
    ]


SOURCE = "Interval paper, 4"


def _pair(mean: Mapping[str, Array], name: str) -> str:
    return f"{mean[name][0]:.4f}/{mean[name][1]:.4f}"


def _design_claims() -> list[Claim]:
    g, exact, best = design(), design("exact"), design("exact", None)
    L = g.gain.ravel()
    return [
        Claim(
            SOURCE,
            "The design (42) gives this gain",
            "L = (1.503, 7.737)",
            f"L = ({L[0]:.4f}, {L[1]:.4f})",
            holds_if(bool(np.allclose(L, [1.503, 7.737], rtol=1e-3))),
            "with U n×n; as printed (n×p) the dimensions do not fit",
        ),
        Claim(
            SOURCE,
            "… and these peak-to-peak gains",
            "μw = μv = 15.7",
            f"μw = {g.mu_w:.4f}, μv = {g.mu_v:.4f}, γ = {g.gamma:.4f}",
            holds_if(abs(g.mu_w - 15.75) < 0.06),
            "15.7526 cut after one decimal. Verified by eigenvalues at every vertex",
        ),
        Claim(
            "Interval paper, 3.1",
            "(42) gives the optimal performance μw + μv",
            "μw = μv = 15.7 at λ = 0.5",
            f"vertex inequality at λ = 0.5: {exact.mu_w:.4f}; λ = {best.lam:.3f}: {best.mu_w:.3f}",
            "holds with …" if best.mu_w < exact.mu_w < g.mu_w else "holds",
            "minimal for its own sufficient condition and λ = 0.5; the exact vertex inequality is "
            f"{100 * (1 - exact.mu_w / g.mu_w):.1f} % lower, the best λ "
            f"{100 * (1 - best.mu_w / g.mu_w):.0f} %",
        ),
    ]


def _initial_claims() -> list[Claim]:
    """φ0: where the printed number comes from, and what it is worth."""
    g, V0 = design(), worst_V0()
    radius = float(RADIUS @ g.P @ RADIUS)
    phi, scaled = (
        float(np.sqrt(g.mu * (g.lam * radius + g.mu_w * power(v))))
        for v in (V, abs(interval.pendulum().D2[0, 0]) * V)
    )
    sound = float(radii(V0)[0])
    left = left_the_ball(V0_of(PRINTED_PHI))
    return [
        Claim(
            SOURCE,
            "φ0 is the value of (44) at k = 0",
            "φ0 = 1.15",
            f"V0 of the radius vector (0.1, 1): {radius:.4f}, φ0 = {phi:.4g}; with D2 v̄ for v̄: "
            f"{scaled:.4g}",
            "holds with …"
            if abs(scaled - PRINTED_PHI) < 0.01
            else holds_if(abs(phi - PRINTED_PHI) < 0.01),
            "with V0 of the radius vector and the noise bound taken after D2, cut after two "
            "decimals",
        ),
        Claim(
            SOURCE,
            "The initial bound holds for every start in the box",
            "φ0 = 1.15",
            f"φ0 = {sound:.4f} (V0 = {V0:.4f} at (0.1, -1))",
            holds_if(sound <= PRINTED_PHI),
            f"V0 must be the worst over the box. With 1.15, {100 * left:.0f} % of runs from the "
            "worst vertex leave the bound that is called guaranteed",
        ),
    ]


def _figure_1(trials: list[Sets], mean: Mapping[str, Array]) -> list[Claim]:
    """Zonotope and bounded error, from k = 0."""
    wrong = sum(t.violations(name) for t in trials for name in t.bounds)
    half = {
        name: np.mean([0.5 * np.subtract(*from_start(t, name)[::-1])[:, 1] for t in trials], axis=0)
        for name in (ZONOTOPE, BALL, PRINTED_BALL)
    }
    first = {
        name: int(np.sum(half[name][:10] < half[ZONOTOPE][:10])) for name in (BALL, PRINTED_BALL)
    }

    def early(name: str) -> str:
        return "/".join(f"{value:.3f}" for value in half[name][1:4])

    return [
        Claim(
            "Interval paper, 3.2",
            "The state stays within its bounds",
            "",
            f"{wrong} samples outside, {len(trials)} trajectories, {len(mean)} methods",
            holds_if(wrong == 0),
            "with the sound φ0; disturbances uniform, extreme, constant, switching",
        ),
        Claim(
            f"{SOURCE}, Fig. 1",
            "Zonotopes give tighter intervals than the bounded error in the long run",
            "",
            f"full width x1/x2: zonotope {_pair(mean, ZONOTOPE)}, ball {_pair(mean, BALL)}, "
            f"ellipsoid {_pair(mean, ELLIPSOID)}",
            holds_if(bool((mean[ZONOTOPE] < mean[BALL]).all())),
            "mean over steps 51 to 100. The ellipsoid's box, from the same P, is "
            f"{mean[BALL][0] / mean[ELLIPSOID][0]:.0f} times tighter than the ball on x1",
        ),
        Claim(
            f"{SOURCE}, Fig. 1",
            "The bounded error converges faster on x2",
            "",
            f"half width of x2 at k = 1/2/3: zonotope {early(ZONOTOPE)}, ball {early(BALL)}, with "
            f"the printed φ0 {early(PRINTED_BALL)}; tighter at {first[BALL]} and "
            f"{first[PRINTED_BALL]} of the first 10 samples",
            holds_if(True)
            if first[BALL]
            else ("holds with …" if first[PRINTED_BALL] else "does not hold"),
            "with the unsound φ0 = 1.15 alone, as printed; with the sound one the zonotope is "
            "never looser on x2",
        ),
    ]


def _figure_2(trials: list[Sets], mean: Mapping[str, Array]) -> list[Claim]:
    """Comprehensive method against the interval observer of Tahir & Açıkmeşe, a reconstruction."""

    def width(name: str) -> Array:
        return np.asarray(
            np.mean([np.subtract(*t.bounds[name][::-1])[:, 1] for t in trials], axis=0)
        )

    cut = [
        np.minimum(t.printed[1], t.bounds[ZONOTOPE][1])
        - np.maximum(t.printed[0], t.bounds[ZONOTOPE][0])
        for t in trials
    ]
    with_printed = np.mean(cut, axis=0)[:, 1]
    paper, rival = width(PAPER), width(TAHIR)
    quicker, unsound = bool(paper[0] < rival[0]), bool(with_printed[0] < rival[0])
    tighter = bool((mean[PAPER] < mean[TAHIR]).all())
    return [
        Claim(
            "Interval paper, 3.3",
            "The intersection (59) is tighter than either bound",
            "",
            f"full width x1/x2: (59) {_pair(mean, PAPER)}, zonotope {_pair(mean, ZONOTOPE)}",
            holds_if(True)
            if bool((mean[PAPER] < 0.999 * mean[ZONOTOPE]).all())
            else "holds with …",
            "never looser; with the sound φ0 it is the zonotope alone",
        ),
        Claim(
            f"{SOURCE}, Fig. 2",
            "More precise than the interval observer of Tahir & Açıkmeşe",
            "",
            f"full width x1/x2: (59) {_pair(mean, PAPER)}, mixed-monotone {_pair(mean, TAHIR)}, in "
            "the system's own coordinates no gain bounds its widths; tight over mixed-monotone "
            f"{mean[TIGHT][0] / mean[TAHIR][0]:.2f}/{mean[TIGHT][1] / mean[TAHIR][1]:.2f}",
            holds_if(tighter),
            "against a reconstruction (two cases, as in arXiv 2011.04093): their paper was not at "
            "hand. Mean over steps 51 to 100",
        ),
        Claim(
            f"{SOURCE}, Fig. 2",
            "Quicker convergence than the interval observer of Tahir & Açıkmeşe",
            "",
            f"full width of x2 at k = 1/2/3: (59) {_three(paper)}, with the printed φ0 "
            f"{_three(with_printed)}, mixed-monotone {_three(rival)}",
            "holds" if quicker else ("holds with …" if unsound else "does not hold"),
            "with the unsound φ0 = 1.15 alone. Criterion: tighter at the first sample of x2, "
            "against a reconstruction",
        ),
    ]


def _three(width: Array) -> str:
    return "/".join(f"{value:.2f}" for value in width[:3])
