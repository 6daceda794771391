"""A finger of three joints that two geared servos move through sheaths: their counts and currents
are all that is read.

The plant is C of its own: planar dynamics of three links, cables whose stiffness grows, with
friction along their sheaths, pulleys that are not round, servos with friction and backlash in
their gears. It shares nothing with `distal.model`.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from tests.support.compiled_hands import compiled

Floats = NDArray[np.float64]

STEP, EVERY = 2e-5, 50
"""Step of the plant [s]; its servos are told a goal every so many steps."""

JOINTS = ("mcp", "pip", "dip")
COUNTS, TORQUE_PER_AMPERE = 4096, 0.52
"""Counts of a turn of the spool; torque of a servo after its gear [N m/A]."""

SOURCE = r"""
#include <math.h>
#define N 2

static double slowed(double free, double grip) {
  return free > grip ? free - grip : free < -grip ? free + grip : 0;
}
static double tension(double stretch, double stiffness, double harder) {
  return stretch > 0 ? stiffness * stretch + harder * stretch * stretch : 0;
}

/* goals [ticks][2] rad; touch: stiffness, where the sum of angles meets, pushes on three joints,
   start; out [ticks][10]: places, torques of servos, angles, torques from outside */
void finger(long ticks, long every, double step, const double* goals, const double* touch,
            const double* made, double* out) {
  static const double length[3] = {0.044, 0.027, 0.021}, mass[3] = {0.021, 0.012, 0.008};
  static const double inertia[3] = {7e-6, 3e-6, 2e-6}, spring[3] = {0.13, 0.105, 0.085};
  static const double rest[3] = {-0.1, -0.05, 0.0}, viscous[3] = {8e-4, 6e-4, 5e-4};
  static const double arm[2][3] = {{9.1e-3, 7.2e-3, 5.1e-3}, {8.2e-3, 5.4e-3, 3.4e-3}};
  const double spool = 6.1e-3, k = 11e3 * made[0], harder = 8e5;
  const double mu = 0.09 * made[1], wrap[2] = {2.1, 2.6};
  const double drag = 25, gap = 0.006, mesh = 14, rotor = 4.5e-4;
  double place[2] = {0, 0}, speed[2] = {0, 0}, wound[2] = {0, 0}, integral[2] = {0, 0};
  double node[2][N], q[3] = {0, 0, 0}, w[3] = {0, 0, 0}, torque[2] = {0, 0};
  const double pre = 9.0, stretch = pre / k;
  for (int s = 0; s < 2; ++s) {
    wound[s] = place[s] = stretch / spool;
    for (int j = 0; j < N; ++j) node[s][j] = stretch * (N - j) / (N + 1.0);
  }
  const double start[2] = {place[0], place[1]};
  for (long tick = 0; tick < ticks; ++tick) {
    const double time = tick * every * step;
    double outside[3] = {0, 0, 0};
    for (int s = 0; s < 2; ++s) {
      double left = start[s] + goals[2 * tick + s] - place[s];
      integral[s] = fmax(-0.08, fmin(0.08, integral[s] + 12 * every * step * left));
      torque[s] = fmax(-0.7, fmin(0.7, 5.0 * left - 0.1 * speed[s] + integral[s]));
    }
    for (long i = 0; i < every; ++i) {
      double far[2], free[3], sum[3] = {q[0], q[0] + q[1], q[0] + q[1] + q[2]};
      for (int s = 0; s < 2; ++s) {
        double side = s == 0 ? 1 : -1, drawn = 0, pulls[N + 1], near, lash, push;
        for (int j = 0; j < 3; ++j)
          drawn += side * arm[s][j] * (q[j] + 0.04 * (cos(q[j] + s) - cos((double)s)));
        for (int j = 0; j <= N; ++j) {
          double a = j == 0 ? spool * wound[s] : node[s][j - 1], b = j == N ? drawn : node[s][j];
          pulls[j] = tension(a - b, k * (N + 1), harder * (N + 1) * (N + 1));
        }
        for (int j = 0; j < N; ++j) {
          double least = fmin(pulls[j], pulls[j + 1]);
          double grip = expm1(mu * wrap[s] / N) * least + 0.08;
          node[s][j] += step * slowed(pulls[j] - pulls[j + 1], grip) / drag;
        }
        near = pulls[0], far[s] = pulls[N];
        lash = place[s] - wound[s];
        push = mesh * (lash > gap / 2 ? lash - gap / 2 : lash < -gap / 2 ? lash + gap / 2 : 0);
        wound[s] += step * slowed(push - spool * near, 1e-3) / 2e-3;
        speed[s] = slowed(speed[s] + step / rotor * (torque[s] - push - 3e-3 * speed[s]),
                          step / rotor * (6e-3 + 0.06 * spool * near));
        place[s] += step * speed[s];
      }
      /* an object at the fingertip pushes back on the sum of angles; pushes on single joints */
      double beyond = sum[2] - touch[1], rate = w[0] + w[1] + w[2];
      double force = beyond > 0 ? fmin(0, -(touch[0] * beyond + 3e-4 * rate)) : 0;
      double in = fmin(fmax((time - touch[5]) / 0.1, 0), 1);
      in *= fmin(fmax((touch[5] + 3 - time) / 0.1, 0), 1);
      double lever[3] = {2.6, 1.6, 1.0};
      for (int j = 0; j < 3; ++j) outside[j] = lever[j] * force + in * touch[2 + j];
      /* mass matrix and forces of three links in a plane, gravity along the first link at rest */
      double M[3][3] = {{0}}, f[3];
      for (int j = 0; j < 3; ++j) {
        double bend = 0;
        for (int s = 0; s < 2; ++s) {
          double a = arm[s][j] * (1 - 0.04 * sin(q[j] + s));
          bend += (s == 0 ? 1 : -1) * a * far[s];
        }
        f[j] = bend - spring[j] * (q[j] - rest[j]) - viscous[j] * w[j] + outside[j];
        if (q[j] > 1.6) f[j] -= 30 * (q[j] - 1.6) + 0.01 * w[j];
        if (q[j] < -0.2) f[j] -= 30 * (q[j] + 0.2) + 0.01 * w[j];
      }
      double turn[3] = {w[0], w[0] + w[1], w[0] + w[1] + w[2]};
      for (int b = 0; b < 3; ++b) {
        double jx[3] = {0}, jy[3] = {0}, ax = 0, ay = 9.81;
        for (int l = 0; l <= b; ++l) {
          double r = l == b ? length[l] / 2 : length[l];
          for (int j = 0; j <= l; ++j) jx[j] += r * cos(sum[l]), jy[j] += r * sin(sum[l]);
          ax -= r * sin(sum[l]) * turn[l] * turn[l];
          ay += r * cos(sum[l]) * turn[l] * turn[l];
        }
        for (int i = 0; i <= b; ++i) {
          f[i] -= mass[b] * (jx[i] * ax + jy[i] * ay);
          for (int j = 0; j <= b; ++j)
            M[i][j] += mass[b] * (jx[i] * jx[j] + jy[i] * jy[j]) + inertia[b];
        }
      }
      /* friction at the axles: impulses between their limits, by sweeps */
      double a = M[0][0], b = M[0][1], c = M[0][2], d = M[1][1], e = M[1][2], g = M[2][2];
      double inverse[3][3] = {{d * g - e * e, c * e - b * g, b * e - c * d},
                              {c * e - b * g, a * g - c * c, b * c - a * e},
                              {b * e - c * d, b * c - a * e, a * d - b * b}};
      double det = a * inverse[0][0] + b * inverse[0][1] + c * inverse[0][2], grip[3] = {0, 0, 0};
      for (int i = 0; i < 3; ++i) {
        free[i] = w[i];
        for (int j = 0; j < 3; ++j) inverse[i][j] /= det, free[i] += step * inverse[i][j] * f[j];
      }
      for (int sweep = 0; sweep < 6; ++sweep)
        for (int i = 0; i < 3; ++i) {
          double most = step * (6e-4 + made[2] * 3e-4 * (far[0] + far[1]) * arm[0][i] / 7e-3);
          double now = fmax(-most, fmin(most, grip[i] - free[i] / inverse[i][i]));
          double more = now - grip[i];
          grip[i] = now;
          for (int j = 0; j < 3; ++j) free[j] += inverse[j][i] * more;
        }
      for (int i = 0; i < 3; ++i) w[i] = free[i], q[i] += step * free[i];
    }
    double row[10] = {place[0] - start[0], place[1] - start[1], torque[0], torque[1],
                      q[0], q[1], q[2], outside[0], outside[1], outside[2]};
    for (int i = 0; i < 10; ++i) out[10 * tick + i] = row[i];
  }
}
"""


@dataclass(frozen=True)
class Touch:
    """An object that meets the sum of the angles at `at` [rad] with a `stiffness` [N m/rad], and
    pushes on the joints [N m], (3,), for 3 s from `start` [s].
    """

    stiffness: float = 0.0
    at: float = 9.0
    pushes: tuple[float, float, float] = (0.0, 0.0, 0.0)
    start: float = 0.0


def postures(seed: int, duration: float, hold: float, blend: float) -> Callable[[Floats], Floats]:
    """Return goals of both servos [rad] over times, (k, 2): postures by lot, each held for `hold`
    [s] and reached within `blend` [s]; the extensor lets out what the flexor winds, but for what
    stiffens the finger.
    """
    rng = np.random.default_rng(seed)
    count = int(duration / hold) + 3
    flexed, stiff = rng.uniform(0.0, 4.2, count), rng.uniform(0.0, 0.25, count)
    flexed[0] = 0.0
    stiff[0] = 0.0

    def goals(time: Floats) -> Floats:
        k = np.minimum((time / hold).astype(int), count - 2)
        share = np.clip((time - k * hold) / blend, 0.0, 1.0)
        share = 0.5 - 0.5 * np.cos(np.pi * share)
        now = flexed[k] + share * (flexed[k + 1] - flexed[k])
        wound = stiff[k] + share * (stiff[k + 1] - stiff[k])
        return np.column_stack([now + wound, -0.75 * now + wound])

    return goals


def finger_log(
    goals: Callable[[Floats], Floats], duration: float, seed: int, touch: Touch | None = None
) -> tuple[dict[str, Floats], dict[str, Floats]]:
    """Return columns as a servo bus logs them at 100 Hz, and the truth: angles and torques."""
    ticks = round(duration / (STEP * EVERY))
    out, met = np.zeros((ticks, 10)), touch or Touch()
    wound = goals(np.arange(ticks) * STEP * EVERY)
    made = np.array([1.0, 1.0, 1.0])
    pressed = np.array([met.stiffness, met.at, *met.pushes, met.start])
    arrays = [np.ascontiguousarray(a, dtype=np.float64) for a in (wound, pressed, made, out)]
    compiled(SOURCE, "finger")(
        ctypes.c_long(ticks),
        ctypes.c_long(EVERY),
        ctypes.c_double(STEP),
        *(ctypes.c_void_p(a.ctypes.data) for a in arrays),
    )
    rows, rng = arrays[-1][::10], np.random.default_rng(seed)
    time = np.arange(len(rows)) * 10 * STEP * EVERY
    columns = {"time_s": time}
    for i, servo in enumerate(("flexor", "extensor")):
        columns[f"{servo}_ticks"] = np.floor(rows[:, i] / (2 * np.pi) * COUNTS)
        current = 1e3 * rows[:, 2 + i] / TORQUE_PER_AMPERE
        columns[f"{servo}_mA"] = (
            np.round((current + 9.0 * rng.standard_normal(len(rows))) / 2.69) * 2.69
        )
    truth = {f"theta_{joint}": rows[:, 4 + j] for j, joint in enumerate(JOINTS)}
    truth |= {f"external_torque_{joint}": rows[:, 7 + j] for j, joint in enumerate(JOINTS)}
    for joint in JOINTS:
        camera = np.rad2deg(truth[f"theta_{joint}"]) + 0.15 * rng.standard_normal(len(rows))
        columns[f"{joint}_deg"] = np.round(camera, 2)
    return columns, truth
