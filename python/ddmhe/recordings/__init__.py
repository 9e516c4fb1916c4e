"""Recordings and logs from files: a CSV of samples in, a checked `Log` out, and its split into a
history and the outputs that follow."""

from ddmhe.recordings.csv_log import read_log
from ddmhe.recordings.log import Gap, Log, LogError, Names, Split

__all__ = ["Gap", "Log", "LogError", "Names", "Split", "read_log"]
