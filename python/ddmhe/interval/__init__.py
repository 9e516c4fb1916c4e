"""Guaranteed intervals around the state of a system with a bounded Jacobian, or of one known from a
recording only.

`System` states what is known, `design_observer` finds the gain and proves its bound,
`IntervalObserver` runs:

>>> import ddmhe
>>> s = ddmhe.interval.pendulum()
>>> g = ddmhe.interval.design_observer(s, lam=0.5)
>>> o = ddmhe.interval.IntervalObserver(
...     s, g, [0.98, 0.02], [0.1, 1.0], w_radius=0.006, v_radius=0.01
... )
>>> b = o.step([1.0])   # b.lower <= x(1) <= b.upper for every motion that the bounds allow

`from_history` needs no model: bounds on the noise of a recording do. Source: the paper "Interval
Estimation for Bounded Jacobian Nonlinear Systems by Zonotope Analysis", cited by its equation
numbers."""

from ddmhe.interval.data import DataModel, from_history, smallest_radii
from ddmhe.interval.observer import IntervalObserver
from ddmhe.interval.observer_design import ObserverDesign, design_observer, fixed_gain, kalman_gain
from ddmhe.interval.systems import System, detumbling, linear, pendulum, van_der_pol
from ddmhe.interval.verdict import Verdict, judge

__all__ = [
    "DataModel",
    "IntervalObserver",
    "ObserverDesign",
    "System",
    "Verdict",
    "design_observer",
    "detumbling",
    "fixed_gain",
    "from_history",
    "judge",
    "kalman_gain",
    "linear",
    "pendulum",
    "smallest_radii",
    "van_der_pol",
]
