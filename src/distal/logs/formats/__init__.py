"""Formats of logs, one file for each; the list of them is in `registry`."""

from distal.logs.formats.csv import write_csv
from distal.logs.formats.format import Format, Message, UndecodableError
from distal.logs.formats.registry import FORMATS, TABLES, check_is_content, format_of

__all__ = [
    "FORMATS",
    "TABLES",
    "Format",
    "Message",
    "UndecodableError",
    "check_is_content",
    "format_of",
    "write_csv",
]
