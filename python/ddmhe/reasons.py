"""What speaks against an estimate."""

from enum import IntFlag

__all__ = ["Reason"]


class Reason(IntFlag):
    """What speaks against an estimate; nothing: `Reason(0)`.

    `Estimate.reasons` is one of these, `Log.reasons` an array (N,) of their numbers:
    `log.reasons & ddmhe.Reason.NOVEL != 0` are the steps at which the motion was new.

    Examples
    --------
    >>> import ddmhe
    >>> record = ddmhe.models.detumbling().simulate(duration=120.0, dt=0.1, noise=0.01)
    >>> log = ddmhe.DdMhe(record.history(200)).run(record.y[200:])
    >>> bool(log.trusted[0]), bool(log.trusted[-1])  # the motion has left the recording
    (True, False)
    >>> ddmhe.Reason.NOVEL in ddmhe.Reason(int(log.reasons[-1]))
    True
    """

    NOVEL = 1
    """The motion is unlike the recording, now or at most a horizon ago; errors grow with it."""
    UNCERTAIN = 2
    """A state may be off by more than half of its recorded spread."""
    STUCK = 4
    """An output repeats one value longer than it ever did in the recording."""
    OUTSIDE = 8
    """A state or an input has left its recorded range by more than a quarter of it. It is told, and
    does not take trust away by itself: a linear system is as well estimated there."""
