"""Log files: `read_log` and what it returns; they live in `ddmhe.recordings`."""

from ddmhe.recordings import Gap, Log, LogError, Names, Split, read_log

__all__ = ["Gap", "Log", "LogError", "Names", "Split", "read_log"]
