"""Logs: time series of sensors, read, checked and written."""

from distal.logs.frames import pandas_frame
from distal.logs.log import Log, check_stamps, frozen
from distal.logs.output import write_whole

__all__ = ["Log", "check_stamps", "frozen", "pandas_frame", "write_whole"]
