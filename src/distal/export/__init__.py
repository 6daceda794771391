"""Export: the same filter as C for microcontrollers."""

from distal.export.names import c_name
from distal.export.project import check_ours, export_c, export_files, project_files
from distal.export.source import Exported, c_filter

__all__ = ["Exported", "c_filter", "c_name", "check_ours", "export_c", "export_files", "project_files"]
