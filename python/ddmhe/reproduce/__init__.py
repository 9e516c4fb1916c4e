"""Every experiment of the papers again, with an honest verdict on every claim: `ddmhe reproduce
NAME|all`.

- `bench`: the single-axis bench, Figs. 2 to 6. `satellite`: the 3-DOF case, Figs. 7 and 8, and all
  estimators at three noise levels. `design`: the numbers of Algorithm 2. `real`: all estimators on
  measured pendulum logs; `driven`: on measured logs with known inputs.
- `montecarlo`: many noise seeds, in parallel. `claims`: what a paper says, what came out, and
  whether it holds.
"""

from ddmhe.reproduce.claims import Claim, Verdict, verdicts, write_claims
from ddmhe.reproduce.experiments import EXPERIMENTS, Result, run_experiment
from ddmhe.reproduce.measured import driven_logs, pendulum_logs, reproduce_real
from ddmhe.reproduce.real import PendulumTask, pendulum_task

__all__ = [
    "EXPERIMENTS",
    "Claim",
    "PendulumTask",
    "Result",
    "Verdict",
    "driven_logs",
    "pendulum_logs",
    "pendulum_task",
    "reproduce_real",
    "run_experiment",
    "verdicts",
    "write_claims",
]
