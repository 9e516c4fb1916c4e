"""Recordings and logs from files and frames: `read` gives what an estimator needs, `read_log` a
checked `Log` that splits into a history and the outputs that follow."""

from ddmhe.recordings.csv_log import read_log
from ddmhe.recordings.errors import LogError, Names
from ddmhe.recordings.log import Gap, Log, Split
from ddmhe.recordings.reading import Recorded, read

__all__ = ["Gap", "Log", "LogError", "Names", "Recorded", "Split", "read", "read_log"]
