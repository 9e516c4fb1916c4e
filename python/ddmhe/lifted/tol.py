"""Every constant of the lifted estimator with its reason."""

__all__ = [
    "BEHIND",
    "BEYOND",
    "CLOSE_TO_FLAT",
    "DEGREES",
    "FOLDS",
    "GAIN_LEAST",
    "GUARD_RANGE",
    "GUARD_STEPS",
    "HELD",
    "MOST_FOLDS",
    "MOST_MONOMIALS",
    "NIS_MOST",
    "NOISY",
    "NOVEL",
    "OUTSIDE",
    "RIDGES",
    "RIVAL_LEAST",
    "RIVAL_RATE",
    "ROUNDS",
    "SCORE_RATE",
    "SPREAD_MOST",
    "UNCERTAIN",
    "WINDOWS_EACH",
]

DEGREES = (1, 2, 3)
"""Degrees that are tried: 3 holds a sine up to a right angle to some thousandths."""
RIDGES = (1e-9, 1e-6, 1e-3)
"""Ridges that are tried, as shares of the number of samples."""
ROUNDS = 3
"""Rounds of smoothing and regression where recorded states are noisy; later ones change little."""
NOISY = 1e-4
"""Noise over spread of a recorded state from which on it is taken to be noisy."""
MOST_FOLDS = 4
"""Recordings of several that are held out in turn, the longest first."""
MOST_MONOMIALS = 300
"""Monomials beyond which a step would take longer than a window of the affine estimator."""
WINDOWS_EACH = 3
"""Samples for each monomial that a degree needs to be tried."""
FOLDS = (0.5, 0.75)
"""Ends of the first parts of the recording that are learnt from, as shares of T."""
GAIN_LEAST = 0.25
"""Mean logarithm of the errors' ratio from which on the lift is taken: a fifth less error. Two held
out ends show differences of less by chance."""
GUARD_RANGE = 0.1
"""Share of the recorded range by which an estimate may leave it before it counts as outside."""
GUARD_STEPS = 5
"""Estimates in a row outside of that range from which on the affine estimate stands."""
BEYOND = 3.0
"""Recorded ranges beyond the recorded one where estimates of a polynomial are cut off."""
SCORE_RATE = 0.05
"""Share of the newest innovation in the score: a mean over 20 samples."""
NIS_MOST = 100.0
"""Normalised innovation squared above which one sample counts no more."""
NOVEL = 2.0
"""Score above which the motion is unlike the recording: its mean is 1, its deviation of one output
.23."""
UNCERTAIN = 0.5
"""Stated deviation over the recorded spread from which on a state is uncertain."""
SPREAD_MOST = 9.0
"""Mean of the stated variances over those of the recording beyond which they grow no further."""
CLOSE_TO_FLAT = 1e-12
"""Added to the spread of a channel so that one that never moved can be divided by."""
OUTSIDE = 0.25
"""Share of the recorded range by which an estimate may leave it before it is said, as `DdMhe`
has it."""
HELD = 0.997
"""Share of the held-out errors that three stated deviations hold."""
RIVAL_RATE, RIVAL_LEAST = 0.02, 10
"""Share of the newest innovations in what is compared, a mean over 50 samples, and how many samples
there have to be."""
BEHIND = 1.3
"""Mean squared innovation over the affine estimator's from which on that one's estimates stand,
until it is below 1 again. Of 50 samples of equal estimators one in thirty is so by chance."""
