"""The simulated plant as C99: its motion between two samples, and its sensors' readings with errors
from a seed.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.codegen import Emitter, Plain
from distal.errors import ExportError
from distal.export.c_source import (
    Translated,
    checked_name,
    filled,
    numbered,
    sensor_texts,
    shared_blanks,
)
from distal.kernels import Kernel
from distal.model import Mechanism
from distal.rig import Rig, gain_of, step_of, travel_of
from distal.sensor_models import SENSOR, reading
from distal.simulation.plant import at_rest, equilibrium, input_layout, plant_function
from distal.simulation.simulate import intervals_of, moment_of


@dataclass(frozen=True)
class ExportedPlant(Translated):
    """A simulated plant as C.

    Args:
        plant: the model of the plant.
        start: coordinates at rest at the start, joints first, (n_bodies,).
        first: outputs of the kernel at the start: coordinates, velocities, tensions and pulls,
            (n_y,).
        interval: time between samples [s].
        parts: how many calls of the kernel one interval takes.
        count: sub-steps of one call.
    """

    plant: Mechanism
    start: Floats
    first: Floats
    interval: float
    parts: int
    count: int


def resting_inputs(plant: Mechanism) -> Floats:
    """Return the inputs of one sample that hold a plant at rest: the nominal forces of drives."""
    layout = input_layout(plant)
    rows = np.zeros((1, layout.size))
    pull = [0.0] * plant.n_joints + [drive.nominal_force.value for drive in plant.rig.drives]
    rows[:, layout["effort"]] = pull
    return rows


def reading_function(plant: Mechanism) -> ca.Function:
    """Return the function (y, numbers, draws) → what the sensors read, without their delays.

    The output y is that of the plant's kernel, the numbers are a column of `SENSOR` for each
    sensor, and the draws are standard normal.
    """
    sensors = plant.rig.sensors
    y = ca.SX.sym("y", 3 * plant.n_bodies + plant.n_tendons)
    parameters = ca.SX.sym("numbers", SENSOR.size, len(sensors))
    draws = ca.SX.sym("draws", len(sensors))
    moment = moment_of(plant, y)
    readings = [
        reading(moment.read(s), SENSOR.parts(parameters[:, k]), draws[k])
        for k, s in enumerate(sensors)
    ]
    read = ca.substitute(
        ca.vertcat(*readings), plant.parameters.symbols, ca.DM(plant.parameters.values)
    )
    return ca.Function("reading", [y, parameters, draws], [ca.densify(read)])


def c_plant(rig: Rig, name: str) -> ExportedPlant:
    """Return the simulated plant of a rig as C99, in double precision.

    Args:
        name: prefix of its C names.

    Raises:
        ExportError: the name is no C identifier, the rig has no sensor or a delayed one, or the
            plant cannot be written in C.
        ScenarioError: a drive has no equilibrium.
    """
    late = [sensor.name for sensor in rig.sensors if sensor.delay > 0.0]
    if not rig.sensors:
        raise ExportError(f"'{rig.name}' has no sensor: there is nothing to simulate; add one")
    if late:
        raise ExportError(
            f"'{rig.name}': the plant in C has no delayed sensors, and a delay is set for "
            f"{', '.join(late)}; set it to 0"
        )
    plant = Mechanism(rig, remembers=True)
    interval = 1.0 / max(sensor.rate for sensor in rig.sensors)
    dt, count = intervals_of(plant, interval)
    kernel = plant_function(plant, count)
    held = resting_inputs(plant)
    start = equilibrium(plant, np.array([joint.initial.value for joint in rig.joints]), held)
    kernel_state, (first,) = at_rest(plant, held, start, Kernel(kernel, False))
    emitter = Emitter(Plain())
    advance = emitter.add(kernel, in_place=True)
    reading = emitter.add(reading_function(plant))
    names = plant.parameters.names
    parts = round(interval / dt)
    values = shared_blanks(checked_name(name), rig, emitter) | {
        "bodies": numbered(body.name for body in plant.bodies),
        "sensors": numbered(sensor_texts(rig.sensors)),
        "names": numbered(names),
        "n_bodies": plant.n_bodies,
        "n_joints": plant.n_joints,
        "n_tendons": plant.n_tendons,
        "n_sensors": len(rig.sensors),
        "n_numbers": len(names),
        "n_kernel_state": len(kernel_state),
        "n_y": first.size,
        "interval": interval,
        "dt": dt,
        "parts": parts,
        "numbers": plant.parameters.values[: len(names)],
        "kernel_state": kernel_state,
        "first": first,
        "errors": [
            [gain_of(s).value, s.bias.value, s.noise, step_of(s), *travel_of(s, rig), s.linearity]
            for s in rig.sensors
        ],
        "every": [max(round(1.0 / interval / sensor.rate), 1) for sensor in rig.sensors],
        "advance": advance,
        "reading": reading,
    }
    texts = filled(_HEADER, values), filled(_SOURCE, values)
    return ExportedPlant(name, *texts, plant, start, first, interval, parts, count)


_HEADER = """\
/* $name$.h: the simulated rig "$rig$", with its sensors
 *
 * Written by `distal export-c`. C99 in double precision, no malloc, no globals: the caller owns the
 * state. All is SI.
 *
 * bodies, in this order:
$bodies$
 *
 * sensors, in this order:
$sensors$
 *
 * numbers, in this order; any may be changed between two steps:
$names$
 */
#ifndef $NAME$_H
#define $NAME$_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define $NAME$_BODIES $n_bodies$
#define $NAME$_JOINTS $n_joints$
#define $NAME$_TENDONS $n_tendons$
#define $NAME$_SENSORS $n_sensors$
#define $NAME$_NUMBERS $n_numbers$
#define $NAME$_INTERVAL $interval$ /* time between samples [s] */

/* What acts on each body: a force or torque, and a spring and damper to a target. */
typedef struct {
  /* inertia is that of hung weights, added to the body's own */
  double effort[$NAME$_BODIES], inertia[$NAME$_BODIES];
  double stiffness[$NAME$_BODIES], target[$NAME$_BODIES], damping[$NAME$_BODIES];
} $name$_pull;

/* What is true after a step. */
typedef struct {
  double position[$NAME$_BODIES], velocity[$NAME$_BODIES];
  double tension[$NAME$_TENDONS], pull[$NAME$_BODIES];
} $name$_truth;

typedef struct {
  double kernel_state[$n_kernel_state$], numbers[$NAME$_NUMBERS], errors[$NAME$_SENSORS][12];
  $name$_truth truth;
  uint64_t random;
  long samples;
} $name$_state;

/* Set the plant to rest at the rig's initial angles, and read the sensors once; a seed gives their
 * errors. */
void $name$_begin($name$_state* state, uint64_t seed, double* values);

/* Move until the next sample and read the sensors, NAN where one is not due; 0 if the motion left
 * all bounds. */
int $name$_step($name$_state* state, const $name$_pull* pull, double* values);

#ifdef __cplusplus
}
#endif

#endif
"""

_SOURCE = """\
/* $name$.c: the simulated rig "$rig$"; see $name$.h. Written by `distal export-c`. */
#include "$name$.h"

#include <math.h>
#include <string.h>

static const double numbers[] = {$numbers$};
static const double resting[] = {$kernel_state$};
static const double first[] = {$first$};

/* of each sensor: gain, bias, noise, step, ends of the travel, largest deviation of its curve */
static const double errors[][7] = {$errors$};
/* each is read at every so many samples */
static const int every[] = {$every$};

$prelude$
$functions$
/* splitmix64 (Steele, Lea, Flood, OOPSLA 2014): uniform in (0, 1] */
static double uniform(uint64_t* random) {
  uint64_t z = (*random += 0x9E3779B97F4A7C15u);
  z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
  z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
  z ^= z >> 31;
  return ((double)(z >> 11) + 1.0) * 0x1p-53;
}

/* Box and Muller, 1958 */
static double normal(uint64_t* random) {
  const double length = sqrt(-2.0 * log(uniform(random)));
  return length * cos(6.283185307179586 * uniform(random));
}

/* the curve of a sensor: three harmonics over its travel, scaled to its largest deviation */
static void draw_curve(double* row, double largest, uint64_t* random) {
  double peak = 0.0;
  int i, j;
  for (j = 0; j < 3; ++j) {
    row[6 + j] = normal(random) / (j + 1);
    row[9 + j] = 6.283185307179586 * uniform(random);
  }
  for (i = 0; i <= 500; ++i) {
    double value = 0.0;
    for (j = 0; j < 3; ++j)
      value += row[6 + j] * sin(3.141592653589793 * (j + 1) * i / 500.0 + row[9 + j]);
    if (fabs(value) > peak) peak = fabs(value);
  }
  for (j = 0; j < 3; ++j) row[6 + j] *= row[5] > row[4] ? largest / peak : 0.0;
  if (!(row[5] > row[4])) row[5] = row[4] + 1.0;
}

static void read_sensors($name$_state* state, double* values) {
  double draws[$n_sensors$];
  int i;
  for (i = 0; i < $n_sensors$; ++i) draws[i] = normal(&state->random);
  $reading$((const double*)&state->truth, state->errors[0], draws, values);
  for (i = 0; i < $n_sensors$; ++i)
    if (state->samples % every[i]) values[i] = NAN;
  state->samples += 1;
}

void $name$_begin($name$_state* state, uint64_t seed, double* values) {
  int i;
  memset(state, 0, sizeof *state);
  memcpy(state->kernel_state, resting, sizeof resting);
  memcpy(state->numbers, numbers, sizeof numbers);
  memcpy(&state->truth, first, sizeof first);
  state->random = seed;
  for (i = 0; i < $n_sensors$; ++i) {
    memcpy(state->errors[i], errors[i], 6 * sizeof(double));
    draw_curve(state->errors[i], errors[i][6], &state->random);
  }
  read_sensors(state, values);
}

int $name$_step($name$_state* state, const $name$_pull* pull, double* values) {
  double x[5 * $n_bodies$ + 1];
  int i;
  memcpy(x, pull, 5 * $n_bodies$ * sizeof(double));
  x[5 * $n_bodies$] = $dt$;
  for (i = 0; i < $parts$; ++i)
    $advance$(state->kernel_state, x, state->numbers, (double*)&state->truth);
  read_sensors(state, values);
  for (i = 0; i < $n_y$; ++i)
    if (!(fabs(((const double*)&state->truth)[i]) < 1e9)) return 0;
  return 1;
}
"""
