"""The 2008 paper's test series, figures and statements, as `distal reproduce` writes them."""

from distal.reports.paper_2008.claims import GROUPS, Plant, measured, run_series, statements
from distal.reports.paper_2008.page import reproduce, steps

__all__ = ["GROUPS", "Plant", "measured", "reproduce", "run_series", "statements", "steps"]
