"""The sub-steps of `servo_hands` as C, which a compiler makes 30 times as fast; without one NumPy does
them.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

SOURCE = r"""
#include <math.h>

static double clip(double x, double low, double high) { return x < low ? low : x > high ? high : x; }
static double sign(double x) { return (x > 0) - (x < 0); }
static double slowed(double free, double grip) {
  double left = fabs(free) - grip;
  return sign(free) * (left > 0 ? left : 0);
}

/* one hand: T tendons, J joints, M motors */
void advance(long T, long J, long M, long steps, double step, const double* servo,
             const double* arms, const double* spools, const double* low, const double* high,
             const double* slack, const double* stiffness, const double* sheath, const double* spring,
             const double* rest, const double* dry, const double* axle, const double* weight,
             const double* gear_friction, const double* gear_load, const double* broken,
             const double* slips, const double* limits, const double* goals,
             double* angles, double* rates, double* places, double* speeds, double* nodes,
             double* torques, double* slipped) {
  double near[T], far[T], grips[T];
  for (long t = 0; t < T; ++t) grips[t] = exp(sheath[t]);
  for (long k = 0; k < steps; ++k) {
    for (long t = 0; t < T; ++t) {
      double wound = -slack[t], drawn = 0, spring_of = 2 * stiffness[t], grip = grips[t];
      for (long m = 0; m < M; ++m) wound += spools[t * M + m] * (places[m] - slipped[m]);
      for (long j = 0; j < J; ++j) drawn += arms[t * J + j] * angles[j];
      double pulls = fmax(spring_of * (wound - nodes[t]), 0), held = fmax(spring_of * (nodes[t] - drawn), 0);
      if (wound <= drawn) nodes[t] = clip(nodes[t], wound, drawn);
      else if (pulls > grip * held) nodes[t] = (wound + grip * drawn) / (1 + grip);
      else if (grip * pulls < held) nodes[t] = (grip * wound + drawn) / (grip + 1);
      near[t] = broken[t] ? 0 : fmax(spring_of * (wound - nodes[t]), 0);
      far[t] = broken[t] ? 0 : fmax(spring_of * (nodes[t] - drawn), 0);
    }
    for (long m = 0; m < M; ++m) {
      double load = 0, left = goals[m] - places[m], inertia = 2e-4;
      for (long t = 0; t < T; ++t) load += spools[t * M + m] * near[t];
      left -= clip(left, -servo[2], servo[2]);
      torques[m] = clip(servo[0] * left - servo[1] * speeds[m], -limits[m], limits[m]);
      double free = speeds[m] + step / inertia * (torques[m] - load);
      speeds[m] = slowed(free, step / inertia * (gear_friction[m] + gear_load[m] * fabs(load)));
      places[m] += step * speeds[m];
      if (fabs(load) > slips[m]) slipped[m] += sign(load) * 0.4 * step * 20;
    }
    for (long j = 0; j < J; ++j) {
      double pull = 0, side = 0, inertia = 1e-5;
      for (long t = 0; t < T; ++t) pull += arms[t * J + j] * far[t], side += fabs(arms[t * J + j]) * far[t];
      double torque = pull - spring[j] * (angles[j] - rest[j]) - weight[j] * sin(angles[j]) - 1e-3 * rates[j];
      double over = fmax(angles[j] - high[j], 0) - fmax(low[j] - angles[j], 0);
      if (over != 0) torque -= 25.0 * over + 0.02 * rates[j];
      rates[j] = slowed(rates[j] + step / inertia * torque, step / inertia * (dry[j] + axle[j] * side));
      angles[j] += step * rates[j];
    }
  }
}
"""


@cache
def advance() -> Callable[..., None] | None:
    """Return the function of one hand, None without a compiler."""
    if shutil.which(os.environ.get("CC", "cc")) is None:
        return None
    return compiled(SOURCE, "advance")


@lru_cache(maxsize=8)
def compiled(source: str, name: str) -> Callable[..., None]:
    """Return a function of C source, compiled once and kept."""
    key = hashlib.sha256(source.encode()).hexdigest()[:16]
    folder = Path(tempfile.gettempdir()) / f"plants-{os.getuid()}"
    library = folder / f"{key}.so"
    if not library.exists():
        folder.mkdir(mode=0o700, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder) as built:
            code, made = Path(built) / "plant.c", Path(built) / "plant.so"
            code.write_text(source, encoding="utf-8")
            flags = ["-O2", "-ffp-contract=off", "-fPIC", "-shared"]
            compiler = os.environ.get("CC", "cc")
            subprocess.run([compiler, *flags, str(code), "-o", str(made), "-lm"], check=True)
            made.replace(library)
    function: Callable[..., None] = getattr(ctypes.CDLL(str(library)), name)
    return function


def called(
    function: Callable[..., None], sizes: tuple[int, ...], step: float, *arrays: Any
) -> None:
    """Call it for one hand: tendons, joints, motors and sub-steps, the step [s], its arrays."""
    held = [np.ascontiguousarray(array, dtype=np.float64) for array in arrays]
    pointers = (ctypes.c_void_p(array.ctypes.data) for array in held)
    function(*map(ctypes.c_long, sizes), ctypes.c_double(step), *pointers)


def contiguous(array: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a copy that C may change."""
    return np.array(array, dtype=np.float64, order="C")
