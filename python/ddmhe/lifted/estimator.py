"""A polynomial model beside the affine estimator, used where held-out ends of the recording say
that it is better.

    x⁺ = x + Θφ(x) + Bu,   y = Ψφ(x) + Du,   φ: monomials of the scaled states up to degree 1 to 3

It takes a recording that shows the complete state in the region in which it will be estimated: a
polynomial says nothing outside of it, so the affine estimate stands from there on."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddmhe._core import (
    DdMhe,
    DdmheError,
    Estimate,
    History,
    NotFiniteError,
    check_settings,
    noise_levels,
)
from ddmhe.checks import array, channels, check_history, shown
from ddmhe.lifted.choice import Choice, Fold, choose, parts_of
from ddmhe.lifted.estimate import LiftedEstimate, LiftedEvidence, LiftedLog, log_of
from ddmhe.lifted.filter import Innovation, LiftedFilter
from ddmhe.lifted.model import LiftedModel, fit
from ddmhe.lifted.rivals import Rivals
from ddmhe.lifted.saved import packed, unpacked
from ddmhe.lifted.tol import GUARD_STEPS, NOVEL, UNCERTAIN
from ddmhe.reasons import Reason

Array = NDArray[np.float64]
Box = tuple[Array, Array]

__all__ = ["LiftedMhe"]


class LiftedMhe:
    """Estimates the state by a polynomial model of the recording, where that is better than
    `DdMhe`, and else by `DdMhe`.

    Degree and ridge are chosen on two ends of the recording, the second half and the last quarter,
    each estimated from what is before it; of several recordings on each of the four longest. The
    lift is used where its errors there are by a fifth smaller than the affine estimator's, and
    smaller in each; otherwise, and from the fifth estimate
    in a row on that is a tenth of the recorded range outside of it, the affine estimates stand, bit
    for bit those of `DdMhe`.

    Parameters
    ----------
    history : History
        The recording. Known inputs enter linearly.
    output_noise : float or (p,)
        Standard deviation of online outputs. Default: what the recording has.
    x_bounds : (lo, hi)
        Smallest and largest states, each a number or (n,).
    fallback : mapping
        Settings of `DdMhe`, by name. Default: its default rules.

    Attributes
    ----------
    degree : int
        Degree of the best lift, 1 to 3; 0 where the recording is too short for any.
    gain : float
        Mean logarithm of the affine estimator's error over the lift's in the held-out ends.

    Examples
    --------
    >>> import ddmhe
    >>> record = ddmhe.models.pendulum().simulate(40.0, 0.05, noise=0.01)
    >>> lifted = ddmhe.LiftedMhe(record.history(400))
    >>> log = lifted.run(record.y[400:500])
    >>> lifted.chosen, log.x.shape
    (True, (100, 2))
    """

    def __init__(
        self,
        history: History,
        *,
        output_noise: ArrayLike | None = None,
        x_bounds: tuple[ArrayLike, ArrayLike] | None = None,
        fallback: Mapping[str, Any] | None = None,
    ) -> None:
        """Fit and choose; DdmheError for what cannot be used."""
        check_history(history)
        self.n, self.p, self.m = history.n, history.p, history.m
        settings = _settings(fallback, output_noise, x_bounds)
        self._affine = DdMhe(history, **settings)  # checks them
        self._dt = history.dt
        noise = (
            None if output_noise is None else np.broadcast_to(output_noise, self.p).astype(float)
        )
        self._box = None if x_bounds is None else _box(x_bounds, self.n)

        def affine(fold: Fold) -> Array:
            estimator = DdMhe(fold.history, **settings)
            if fold.x_start is not None:
                estimator.reset(fold.x_start)
            return estimator.run(fold.y, fold.u if self.m else None).x

        choice = choose(history, noise, affine)
        self._take(choice, history, noise)
        self._warnings: list[str] = [_words(choice)]
        self._start_over()

    def _take(self, choice: Choice, history: History, noise: Array | None) -> None:
        """The chosen lift, fitted to all of the recording."""
        self.gain = choice.gain
        self.degree = 0 if choice.best is None else choice.best.degree
        self._promise, self._widening = choice.promise, choice.widening
        self._model: LiftedModel | None = None
        if choice.chosen and choice.best is not None:
            levels = noise_levels(history)
            self._model = fit(parts_of(history), levels, *choice.best, noise)

    @property
    def chosen(self) -> bool:
        """Whether the lift is used."""
        return self._model is not None

    @property
    def promise(self) -> Array | None:
        """Root-mean-square error (n,) in the held-out ends of the estimator that is used."""
        return self._promise.copy() if self.chosen else self._affine.promise

    @property
    def warnings(self) -> list[str]:
        """What was chosen and why, what `DdMhe` says, and since when the affine estimate stands."""
        return [*self._warnings, *self._affine.warnings]

    @property
    def t(self) -> int:
        """Number of outputs taken in since the start."""
        return self._affine.t

    def step(self, y_t: ArrayLike, u: ArrayLike | None = None) -> LiftedEstimate:
        """Consume y(t-1) (p,), NaN where not measured, and u(t-1) (m,); x̂(t)."""
        affine = self._affine.step(y_t, u)
        if self._filter is None or self._left:
            return _as_affine(affine)
        y = array("y_t", np.atleast_1d(y_t), (self.p,), missing=True)
        inputs = np.empty(0) if u is None else array("u", np.atleast_1d(u), (self.m,))
        with np.errstate(all="ignore"):
            return self._lifted(affine, y, inputs)

    def run(self, Y: ArrayLike, U: ArrayLike | None = None) -> LiftedLog:
        """Consume outputs (N, p) and inputs (N, m), one step each. A KeyboardInterrupt has the log
        so far as `finished`."""
        outputs = array("Y", channels(Y, self.p), (-1, self.p), missing=True)
        if np.isinf(outputs).any():
            raise NotFiniteError("Y: expected finite numbers or NaN, found infinity")
        inputs = self._inputs(U, len(outputs))
        estimates: list[LiftedEstimate] = []
        sizes, clock = (self.n, self.p), (self.t, self._dt)
        try:
            for y, u in zip(outputs, inputs, strict=True):
                estimates.append(self.step(y, u))
        except KeyboardInterrupt as e:
            e.finished = log_of(estimates, sizes, clock)  # type: ignore[attr-defined]
            raise
        return log_of(estimates, sizes, clock)

    def reset(self, x_prior: ArrayLike | None = None, start: str | None = None) -> None:
        """Start again: as constructed, from x_prior (n,), or as `DdMhe.reset` does for `start`."""
        self._affine.reset(x_prior, start)  # type: ignore[arg-type]
        del self._warnings[1:]
        self._start_over()
        if self._filter is not None and x_prior is not None:
            prior = array("x_prior", np.atleast_1d(x_prior), (self.n,))
            self._filter.begin(prior, np.diag(self._filter.model.x_noise**2))

    def snapshot(self) -> bytes:
        """Everything that it needs to go on, with the same bits."""
        state = {
            "degree": self.degree,
            "gain": self.gain,
            "promise": self._promise,
            "widening": self._widening,
            "affine": self._affine.snapshot(),
            "box": self._box,
            "rivals": tuple(self._rivals),
            "outside": self._outside,
            "left": self._left,
            "waits": self._waits,
            "open": self._open,
            "warnings": self._warnings,
            "dt": self._dt,
        }
        filter = self._filter
        if filter is not None:
            state |= {"x": filter.x, "P": filter.P, "score": filter.score}
            state |= {"model": filter.model.arrays()}
        return packed(state)

    @classmethod
    def restore(cls, blob: bytes) -> LiftedMhe:
        """An estimator from a snapshot; DdmheError for bytes that are none."""
        state = unpacked(blob)
        found = object.__new__(cls)
        found._affine = DdMhe.restore(state["affine"])
        found.n, found.p, found.m = found._affine.n, found._affine.p, found._affine.m
        found.degree, found.gain = int(state["degree"]), float(state["gain"])
        found._promise, found._widening = state["promise"], state["widening"]
        found._box, found._dt = state["box"], float(state.get("dt", 1.0))
        found._rivals = Rivals(*state["rivals"])
        found._outside, found._left = int(state["outside"]), bool(state["left"])
        found._waits, found._open = bool(state["waits"]), bool(state["open"])
        found._warnings = list(state["warnings"])
        found._model = found._filter = None
        if "model" in state:
            found._model = LiftedModel(**state["model"])
            found._filter = LiftedFilter(found._model, found._box)
            found._filter.begin(state["x"], state["P"])
            found._filter.score = float(state["score"])
        return found

    def __reduce__(self) -> tuple[Any, tuple[bytes]]:
        """Pickled and copied as its snapshot."""
        return type(self).restore, (self.snapshot(),)

    def __repr__(self) -> str:
        """What is used, and where it is."""
        used = f"degree {self.degree}" if self.chosen else "affine"
        return f"LiftedMhe(n={self.n}, p={self.p}, m={self.m}, {used}, t={self.t})"

    def _start_over(self) -> None:
        """At the end of the recording, or where `DdMhe` starts."""
        self._filter = None if self._model is None else LiftedFilter(self._model, self._box)
        self._rivals = Rivals()
        self._outside = 0
        self._left = False
        start = self._affine.settings.start
        self._open, self._waits = start == "auto", start == "unknown"

    def _inputs(self, U: ArrayLike | None, N: int) -> list[Array | None]:
        if U is None:
            return [None] * N  # what is missing is told by the first step
        return list(array("U", channels(U, self.m), (N, self.m)))

    def _lifted(self, affine: Estimate, y: Array, u: Array) -> LiftedEstimate:
        """The lift's estimate, or the affine one until there is a start and once it has left."""
        assert self._filter is not None
        filter = self._filter
        self._find_start()
        if self._waits:
            if self.t >= self._affine.horizon and affine.covariance is not None:
                filter.begin(affine.x, affine.covariance)
                self._waits = False
            return _as_affine(affine)
        innovation = filter.step(y, u)
        if affine.evidence is not None:
            self._compare(innovation.value, affine.evidence.innovation)
        sound = bool(np.isfinite(filter.x).all() and np.isfinite(filter.P).all())
        self._outside = 0 if sound and filter.model.near(filter.x) else self._outside + 1
        self._left = not sound or self._outside >= GUARD_STEPS
        if not self._left:
            behind = self._rivals.behind
            return _as_affine(affine) if behind else self._judged(affine, innovation)
        self._warnings.append(
            f"from step {self.t} on the estimate has left the recorded region, where a polynomial "
            "says nothing: the affine estimate stands"
        )
        return _as_affine(affine)

    def _compare(self, lifted: Array, affine: Array) -> None:
        """Which of both predicts the outputs better."""
        assert self._model is not None
        was = self._rivals.behind
        self._rivals = self._rivals.after(lifted, affine, np.sqrt(np.diag(self._model.R)))
        if self._rivals.behind and not was and len(self._warnings) == 1:
            self._warnings.append(
                f"from step {self.t} on the affine estimator predicts the outputs better: its "
                "estimates stand, until the polynomial does again"
            )

    def _find_start(self) -> None:
        """Whether `DdMhe` has found that the run goes on from nothing that was recorded."""
        if self._open:
            start = self._affine.settings.start
            self._open, self._waits = start == "auto", start == "unknown"

    def _judged(self, affine: Estimate, innovation: Innovation) -> LiftedEstimate:
        """The lift's estimate with what speaks against it."""
        assert self._filter is not None
        filter = self._filter
        model, evidence = filter.model, affine.evidence
        stuck = np.zeros(self.p, bool) if evidence is None else evidence.stuck
        reasons = Reason.NOVEL if filter.score > NOVEL else Reason(0)
        covariance = filter.P * np.outer(self._widening, self._widening)
        if np.any(np.sqrt(np.diag(covariance)) > UNCERTAIN * model.spread):
            reasons |= Reason.UNCERTAIN
        if stuck.any():
            reasons |= Reason.STUCK
        if model.outside(filter.x):
            reasons |= Reason.OUTSIDE
        none = np.zeros(self.p, bool)
        return LiftedEstimate(
            x=filter.x.copy(),
            covariance=covariance,
            status="lifted",
            trusted=reasons in (Reason(0), Reason.OUTSIDE),
            reasons=reasons,
            evidence=LiftedEvidence(
                "nis", filter.score, NOVEL, innovation.value, innovation.std, stuck, none, False
            ),
            affine=affine,
        )


def _as_affine(e: Estimate) -> LiftedEstimate:
    """The affine estimate in the place of the lift's."""
    assert e.covariance is not None
    assert e.reasons is not None
    assert e.evidence is not None
    status = "affine" if e.status in ("optimal", "almost_optimal") else e.status
    return LiftedEstimate(
        e.x, e.covariance, status, bool(e.trusted), Reason(e.reasons), e.evidence, e
    )


def _words(choice: Choice) -> str:
    """What was chosen, in a sentence."""
    if choice.best is None:
        return "the recording is too short for a polynomial model: the affine estimator is used"
    ratio = float(np.exp(choice.gain))
    found = f"in held-out ends a polynomial of degree {choice.best.degree} errs "
    found += f"{1 / ratio:.2g} times as much as the affine estimator"
    used = "the polynomial" if choice.chosen else "the affine estimator"
    return f"{found}: {used} is used"


def _box(bounds: tuple[ArrayLike, ArrayLike], n: int) -> Box:
    """Smallest and largest states (n,); `DdMhe` has checked them."""
    lo, hi = (np.broadcast_to(array("x_bounds", b, np.shape(b)), (n,)).copy() for b in bounds)
    return lo, hi


def _settings(
    fallback: Mapping[str, Any] | None,
    output_noise: ArrayLike | None,
    x_bounds: tuple[ArrayLike, ArrayLike] | None,
) -> dict[str, Any]:
    """Settings of the affine estimator."""
    if fallback is not None and not isinstance(fallback, Mapping):
        raise DdmheError(f"fallback: expected settings of DdMhe by name, found {shown(fallback)}")
    found = dict(fallback or {})
    check_settings(found)
    given = {"output_noise": output_noise, "x_bounds": x_bounds}
    for name, value in given.items():
        if value is not None and name in found:
            raise DdmheError(f"fallback: expected {name} once, found it in the settings as well")
        if value is not None:
            found[name] = value
    if found.get("evidence", True) is not True:
        raise DdmheError("fallback: expected settings with evidence, found evidence=False")
    return found
