"""Reports: figures and pages that a person would want to read."""

from distal.reports.fitting import fit_report
from distal.reports.reproduction import make_folder, reproduce, results
from distal.reports.reproduction_figures import FIGURES

__all__ = ["FIGURES", "fit_report", "make_folder", "reproduce", "results"]
