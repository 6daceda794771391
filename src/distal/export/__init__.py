"""Export a filter as C for microcontrollers, or as an FMU."""

from distal.export.filter_source import Exported, c_filter, c_name
from distal.export.fmu import Fmu, export_fmu
from distal.export.project import check_ours, export_c, export_files

__all__ = [
    "Exported",
    "Fmu",
    "c_filter",
    "c_name",
    "check_ours",
    "export_c",
    "export_files",
    "export_fmu",
]
