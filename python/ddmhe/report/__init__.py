"""What a run leaves behind: error measures, tables for the terminal, Markdown pages, CSV files,
figure files, and one page that holds it all.

Figures are drawn by `ddmhe.report.figures`, which is not imported here: matplotlib takes longer to
load than an estimator to build."""

from ddmhe.report.measures import nrmse, pooled_nrmse, rmse, rmse_norm, root_mean_square
from ddmhe.report.page import cells, markdown
from ddmhe.report.saving import save_figure, write_estimates
from ddmhe.report.tables import design, observer_design, outcome, promise, scores, settings, table
from ddmhe.report.viewer import rerun
from ddmhe.report.web import html

__all__ = [
    "cells",
    "design",
    "html",
    "markdown",
    "nrmse",
    "observer_design",
    "outcome",
    "pooled_nrmse",
    "promise",
    "rerun",
    "rmse",
    "rmse_norm",
    "root_mean_square",
    "save_figure",
    "scores",
    "settings",
    "table",
    "write_estimates",
]
