"""Exported filters as programs, logs with what happens in life, and the tools of a
microcontroller.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from distal import Log, read_log
from distal.estimators import KernelEstimator, first_values
from distal.export import Exported
from distal.export.c_source import fields_of, filled
from distal.kernels import find_compiler
from distal.run import samples_of
from distal.run.health import HEALTH

CC = find_compiler()
STRICT = ["-Wall", "-Wextra", "-Werror", "-fno-math-errno", "-ffp-contract=off"]
C99 = ["-std=c99", *STRICT]
needs_compiler = pytest.mark.skipif(isinstance(CC, str), reason="no C compiler")

ARM = ("arm-none-eabi-gcc", "arm-none-eabi-size", "arm-none-eabi-nm", "qemu-system-arm")

_PROGRAM = """
#include <stdio.h>
#include "$name$.h"
/* Begin with the first row, then take in a step and its values from each row, and write all that is
 * known after it. */
int main(void) {
  static $name$_state state;
  static $name$_output out;
  static $name$_watch watch;
  static double row[1 + $NAME$_CHANNELS];
  $name$_real values[$NAME$_CHANNELS];
  int i, begun = 0;
  while (fread(row, sizeof row, 1, stdin)) {
    for (i = 0; i < $NAME$_CHANNELS; ++i) values[i] = ($name$_real)row[1 + i];
    if (begun) {
      const int code = $name$_step(&state, ($name$_real)row[0], values, &out);
      const double health = code ? -1 : $name$_health(&watch, &state, ($name$_real)row[0], values, &out);
      const double told[] = {(double)code, health, $fields$};
      fwrite(told, sizeof told, 1, stdout);
#define WRITE(array) for (i = 0; i < (int)(sizeof array / sizeof *array); ++i) { \\
  const double one = (double)array[i]; fwrite(&one, sizeof one, 1, stdout); }
      WRITE(out.innovations)
      WRITE(out.innovation_variances)
      WRITE(state.kernel_state)
    } else {
      $name$_begin(&state, values);
      $name$_watch_begin(&watch);
      begun = 1;
    }
  }
  return 0;
}
"""


def replay_program(estimator: KernelEstimator, name: str) -> str:
    """Return the text of a program, in C and C++, that runs a filter whose C names begin so."""
    fields = [f"(double)out.{part}" for f in fields_of(estimator) for part in (f.name, f.std)]
    return filled(_PROGRAM, {"name": name, "fields": fields})


class Program(NamedTuple):
    """A compiled filter."""

    made: Exported
    path: Path


class Steps(NamedTuple):
    """What a filter says, a row for each step; `fields` are values and stds in turn."""

    codes: np.ndarray
    health: list[str]
    fields: np.ndarray
    innovations: np.ndarray
    variances: np.ndarray
    kernel_states: np.ndarray


def build(made: Exported, folder: Path, *options: str) -> Program:
    """Write and compile a filter with a program that runs it: its source as C, its header as C++
    where there is such a compiler.
    """
    plus = shutil.which("g++")
    main, compiler = ("main.cpp", [plus]) if plus else ("main.c", CC.command)  # type: ignore[union-attr]
    texts = {**made.files, main: replay_program(made.estimator, made.name)}
    for name, text in texts.items():
        (folder / name).write_text(text)
    single = ["-Wdouble-promotion"] * made.real.single
    for command in (
        [*CC.command, *C99, *single, *options, "-c", f"{made.name}.c"],  # type: ignore[union-attr]
        [*compiler, *STRICT, *options, main, f"{made.name}.o", "-lm", "-o", "replay"],
    ):
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
    return Program(made, folder / "replay")


def stepped(program: Program, steps: np.ndarray, samples: np.ndarray) -> Steps:
    """Return what a filter says that begins with the first row of samples and then takes in all
    others, each after a step in time.
    """
    rows = np.column_stack([np.append(0.0, steps), samples]).tobytes()
    done = subprocess.run([program.path], input=rows, capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (0, b"")
    made = np.frombuffer(done.stdout).reshape(len(steps), -1)
    m = max(len(program.made.estimator.measured), 1)
    ends = np.cumsum([1, 1, 2 * len(program.made.fields), m, m])
    codes, health, *others = np.split(made, ends, axis=1)
    return Steps(codes.ravel(), [list(HEALTH)[int(word)] for word in health.ravel()], *others)


def run(program: Program, log: Log) -> Steps:
    """Return what a filter says of a log."""
    samples = samples_of(log, program.made.estimator.channels)
    steps = np.diff(log.time, prepend=log.time[0])
    return stepped(program, steps, np.vstack([first_values(samples), samples]))


def replayed(program: Program, path: Path) -> np.ndarray:
    """Return stamps, values and stds of a written log."""
    log = read_log(path, program.made.estimator.rig)
    return np.column_stack([log.time, run(program, log).fields])


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
    command = [*CC.command, *C99, *options, "-fPIC", "-shared", *sources, "-lm", "-o", "f.so"]  # type: ignore[union-attr]
    subprocess.run(command, cwd=folder, check=True)
    return ctypes.CDLL(str(folder / "f.so"))


def spoiled(log: Log) -> Log:
    """Return the log with two gaps, scattered missing values and a sensor that is dead for a
    while.
    """
    rng = np.random.default_rng(8)
    keep = np.ones(len(log), dtype=bool)
    keep[200:215] = keep[500:503] = False
    channels = {
        name: np.where(rng.uniform(size=len(log)) < 0.03, np.nan, values)
        for name, values in log.channels.items()
    }
    channels["u1"][300:340] = np.nan
    channels["x2"][620:624] = np.nan
    return Log(log.time, channels, log.truth, "spoiled", log.truth_source).select(keep)
