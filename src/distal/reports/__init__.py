"""Reports: figures and HTML pages on rigs and studies."""

from distal.reports.page import svg_of
from distal.reports.rig_drawing import draw_rig, rig_svg
from distal.reports.study_report import study_report

__all__ = [
    "draw_rig",
    "rig_svg",
    "study_report",
    "svg_of",
]
