"""Export a filter as C for microcontrollers, or as an FMU."""

from distal.export.c_source import Exported, c_filter, c_name
from distal.export.fmu import Fmu, check_ours, export_c, export_files, export_fmu

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
