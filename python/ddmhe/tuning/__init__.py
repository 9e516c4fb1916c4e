"""Settings from the recording alone: `tune` tries many where the answer is known and picks one.

*Held-out quarters.* Each quarter of the recording is held out once; the estimator learns from the
rest (as two recordings, no window across the seam; the part before the quarter last, so that it
starts with a full window) and estimates the quarter from its outputs, brought to the online noise.
The score is the mean over the quarters of log(root mean square over states of rms error / spread);
states of one unit share a spread. Horizons beyond a quarter score alike: the window hardly moves.

*Rehearsals.* Quarters lie inside of the recorded region, and the estimator is to leave it. So a
quadratic surrogate of the recorded motion (`tuning.surrogate`) and others that fit as well are
recorded and run on for five times the recording, with its noise; the score is the mean log error
over one, two and five times T. They are used when the recording shows its whole state (small misfit
of the default rule) and the surrogate explains it.

*Beyond doubt or not at all.* What wins among a hundred settings looks better than it is. So the
parts that choose never judge: each quarter and each rehearsal is left out once, the best setting of
the others is picked (scores averaged over neighbouring regularisation weights: a minimum that its
neighbours do not share is luck), and its error on the part left out is compared with the default
rule's. The default rule is left only where these gains are there in every part, and their mean,
less one standard error, is more than MARGIN; quarters alone decide where there are no rehearsals,
else rehearsals decide and the quarters may not speak against it. A quarter taken out of the middle
costs more windows than its samples, long windows most. So what was picked is run once more on ends
of the recording, learnt from all before them, which took no part in the choice: they have to show
the same. Settings whose map from prior to estimate is unstable are refused. `make study-tuning`
compares the result with the best settings in hindsight.

*Promise.* The ends give the held-out error of each state; their scatter and the rehearsals give its
range."""

from ddmhe.tuning.result import Tuning
from ddmhe.tuning.search import tune

__all__ = ["Tuning", "tune"]
