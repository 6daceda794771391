"""Export: the same filter as C for microcontrollers."""

from distal.export.project import export_c, project_files
from distal.export.source import Exported, c_filter

__all__ = ["Exported", "c_filter", "export_c", "project_files"]
