"""The 2008 paper's test series, figures and statements, as `distal reproduce` writes them."""

from distal.reports.paper_2008.page import (
    GROUPS,
    Plant,
    measured,
    reproduce,
    run_series,
    statements,
    steps,
)

__all__ = ["GROUPS", "Plant", "measured", "reproduce", "run_series", "statements", "steps"]
