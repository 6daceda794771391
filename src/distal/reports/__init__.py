"""Reports: figures and HTML pages on rigs, fits and studies."""

from distal.reports.fitting import FIT_PAGES, fit_report
from distal.reports.page import svg_of
from distal.reports.rig_drawing import draw_rig, rig_svg
from distal.reports.study_report import study_report

__all__ = [
    "FIT_PAGES",
    "draw_rig",
    "fit_report",
    "rig_svg",
    "study_report",
    "svg_of",
]
