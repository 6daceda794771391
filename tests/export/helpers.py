"""Logs with what happens in life, and the tools of a microcontroller."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from distal import Log
from distal.kernels import find_compiler

CC = find_compiler()
STRICT = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-fno-math-errno", "-ffp-contract=off"]

ARM = ("arm-none-eabi-gcc", "arm-none-eabi-size", "arm-none-eabi-nm", "qemu-system-arm")


def missing_tools() -> str:
    """Return which of the tools for a Cortex-M are not installed."""
    return ", ".join(tool for tool in ARM if shutil.which(tool) is None)


def shared_library(
    texts: Mapping[str, str], folder: Path, options: Sequence[str] = ("-O2",)
) -> ctypes.CDLL:
    """Write sources and headers, file → text, into a folder, and return them compiled."""
    for file, text in texts.items():
        (folder / file).write_text(text)
    sources = [file for file in texts if file.endswith(".c")]
    command = [*CC.command, *STRICT, *options, "-fPIC", "-shared", *sources, "-lm", "-o", "f.so"]  # type: ignore[union-attr]
    subprocess.run(command, cwd=folder, check=True)
    return ctypes.CDLL(str(folder / "f.so"))


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
