"""Formats of logs, one file for each; the list of them is in `registry`."""

from distal.logs.formats.format import Message, UndecodableError
from distal.logs.formats.registry import (
    FORMATS,
    TABLES,
    check_format,
    check_is_content,
    file_of,
    format_of,
)

__all__ = [
    "FORMATS",
    "TABLES",
    "Message",
    "UndecodableError",
    "check_format",
    "check_is_content",
    "file_of",
    "format_of",
]
