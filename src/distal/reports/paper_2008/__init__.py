"""The 2008 paper's test series, figures and statements, as `distal reproduce` writes them."""

from distal.reports.paper_2008.claims import GROUPS, measured, statements
from distal.reports.paper_2008.page import reproduce, steps
from distal.reports.paper_2008.series import Plant, run_series

__all__ = ["GROUPS", "Plant", "measured", "reproduce", "run_series", "statements", "steps"]
