"""Logs with what happens in life, and the tools of a microcontroller."""

from __future__ import annotations

import shutil

import numpy as np

from distal import Log

ARM = ("arm-none-eabi-gcc", "arm-none-eabi-size", "arm-none-eabi-nm", "qemu-system-arm")


def missing_tools() -> str:
    """Return which of the tools for a Cortex-M are not installed."""
    return ", ".join(tool for tool in ARM if shutil.which(tool) is None)


def spoiled(log: Log) -> Log:
    """Return the log with two gaps, scattered missing values and a sensor that is dead for a
    while.
    """
    rng = np.random.default_rng(8)
    keep = np.ones(len(log), dtype=bool)
    keep[200:215] = keep[500:503] = False
    channels = {}
    for name, values in log.channels.items():
        values = values.copy()
        values[rng.uniform(size=len(values)) < 0.03] = np.nan
        channels[name] = values
    channels["u1"][300:340] = np.nan
    channels["x2"][620:624] = np.nan
    return Log(log.time, channels, log.truth, "spoiled", log.truth_source).select(keep)
