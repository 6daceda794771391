"""Reports: figures and pages that a person would want to read."""

from distal.reports.fitting import FIT_PAGES, fit_report
from distal.reports.reproduction import REPRODUCTION_FILES, make_folder, reproduce, results
from distal.reports.reproduction_figures import FIGURES
from distal.reports.rig_drawing import draw_rig, rig_svg
from distal.reports.view import check_plotly, view_page

__all__ = [
    "FIGURES",
    "FIT_PAGES",
    "REPRODUCTION_FILES",
    "check_plotly",
    "draw_rig",
    "fit_report",
    "make_folder",
    "reproduce",
    "results",
    "rig_svg",
    "view_page",
]
