"""The page that an engineer hands on: a run in one HTML file."""

from ddmhe.report.web.run import Source, StepTimes
from ddmhe.report.web.written import html

__all__ = ["Source", "StepTimes", "html"]
