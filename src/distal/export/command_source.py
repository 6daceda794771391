"""The live inverse as C99, beside an exported filter: it computes the next commands of the drives
from the filter's state and the desired angles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from distal.arrays import Bools
from distal.codegen import CodeError, Emitter, Plain
from distal.errors import ExportError
from distal.estimators import AdaptiveFilter
from distal.export.names import angle_fields, checked_name, comment, filled, torque_fields
from distal.inverse.goal_gate import crossed_joints
from distal.inverse.live_inverse import live_parameters
from distal.inverse.live_inverse_function import LiveModel
from distal.inverse.motor_readings import MotorReadings
from distal.inverse.setpoint_function import ROUNDS
from distal.rig import Rig
from distal.run import LOST


@dataclass(frozen=True)
class ExportedCommand:
    """The live inverse of a rig as C.

    Args:
        kernel_state: how many numbers it keeps from sample to sample.
        operations: arithmetic operations of a step.
        joints: indices of the joints that have desired angles.
    """

    name: str
    header: str
    source: str
    kernel_state: int
    operations: int
    joints: tuple[int, ...]


def c_command(rig: Rig, name: str, filter_name: str, real: Plain) -> ExportedCommand:
    """Return the live inverse of a rig as C99; its results are those of `LiveInverse`.

    Args:
        name: prefix of its C names.
        filter_name: name under which the filter `adaptive` of the same rig is exported.
        real: number type, double or float, which must be that of the filter.

    Raises:
        ExportError: the name is no C identifier, or the inverse cannot be written in C.
        EstimationError: the filter cannot run on this rig.
    """
    checked_name(name)
    estimator = AdaptiveFilter(rig, False, folded=True)
    layout = LiveModel(rig, estimator.states, folded=True)
    model = layout.model
    emitter = Emitter(real)
    try:
        advance = emitter.add(layout.function(), in_place=True)
    except CodeError as problem:
        raise ExportError(f"the inverse of '{rig.name}' has no C: {problem}") from None
    parameters = live_parameters(layout, estimator)
    at = {sensor.of: estimator.channels.index(sensor.name) for sensor in rig.sensors_of("position")}
    crossed = crossed_joints(rig)
    moves = crossed @ (np.array(model.mechanism.spread) != 0.0)
    together = (crossed @ crossed.T) | np.eye(model.nd, dtype=bool)
    at_touched = layout.x["touched"].start
    reported = [(j, field) for j, (field, _) in enumerate(angle_fields(rig))]
    reported += [
        (estimator.state_names.index(state), field) for state, field in torque_fields(estimator)
    ]
    values = {
        "name": name,
        "NAME": name.upper(),
        "filter": filter_name,
        "rig": comment(rig.name),
        "real": real.type,
        "joints": "\n".join(
            f" *   {i}  {comment(rig.joints[j].name)} [rad]" for i, j in enumerate(model.free)
        ),
        "drives": "\n".join(
            f" *   {i}  {comment(drive.name)}" for i, drive in enumerate(rig.drives)
        ),
        "n_joints": str(model.nf),
        "n_drives": str(model.nd),
        "n_states": str(len(estimator.states)),
        "n_kernel_state": str(layout.kernel_state.size),
        "n_x": str(layout.x.size),
        "n_y": str(layout.y.size),
        "numbers": ", ".join(real.constant(float(number)) for number in parameters),
        "reported": "\n".join(
            f"  x[{layout.x['state'].start + i}] = out->{field};" for i, field in reported
        ),
        "touched": "\n".join(
            f"  if (x[{at_touched}] < filter->kernel_state[{i}])\n"
            f"    x[{at_touched}] = filter->kernel_state[{i}];"
            for i in estimator.touched
        ),
        "known": " && ".join(
            f"out->{std} <= {real.constant(LOST)}" for _, std in angle_fields(rig)
        ),
        "free": ", ".join(map(str, model.free)),
        "positions": ", ".join(str(at.get(drive.name, -1)) for drive in rig.drives),
        "oldest": ", ".join(real.constant(float(age)) for age in MotorReadings(rig).oldest),
        "moves": _matrix(moves),
        "together": _matrix(together),
        **{
            f"c_{part}": str(layout.kernel_state[part].start)
            for part in ("reference", *MOVING, "at_end")
        },
        "zero": real.constant(0.0),
        "one": real.constant(1.0),
        "first": str(ROUNDS),
        "prelude": real.prelude(emitter.text),
        "functions": emitter.text,
        "advance": advance,
        **{f"x_{part}": str(layout.x[part].start) for part in layout.x.names},
        **{f"y_{part}": str(layout.y[part].start) for part in layout.y.names},
    }
    operations = emitter.functions[advance].cost.operations
    header = filled(_HEADER, values)
    source = filled(_SOURCE, values)
    return ExportedCommand(
        name, header, source, layout.kernel_state.size, operations, tuple(model.free)
    )


MOVING = ("rate", "speed", "acceleration")
"""Blocks of the kernel state that are set to zero for a joint that must rest."""


def _matrix(values: Bools) -> str:
    return ", ".join(f"{{{', '.join(str(int(value)) for value in row)}}}" for row in values)


_HEADER = """\
/* $name$.h: what the drives of the rig "$rig$" do next,
 * from the filter of $filter$.h and desired angles
 *
 * Written by `distal export-c`. C99, no malloc, no globals: the caller owns the state.
 * All numbers are SI.
 *
 * desired, in this order (NAN: as before):
$joints$
 *
 * drives, in this order:
$drives$
 */
#ifndef $NAME$_H
#define $NAME$_H

#include "$filter$.h"

#ifdef __cplusplus
extern "C" {
#endif

#define $NAME$_JOINTS $n_joints$
#define $NAME$_DRIVES $n_drives$

#define $NAME$_MOVES 0  /* all drives get what is desired */
/* a drive was not read for too long: it, and those that move the same joints, stand */
#define $NAME$_STANDS 1
#define $NAME$_UNREAD 2 /* a drive was never read: nothing is to be sent, all commands are NAN */

typedef struct {
  $real$ kernel_state[$n_kernel_state$];
  $real$ desired[$NAME$_JOINTS];
  $real$ positions[$NAME$_DRIVES];
  $real$ forces[$NAME$_DRIVES];
  $real$ age[$NAME$_DRIVES];
  int begun;
} $name$_state;

typedef struct {
  $real$ positions[$NAME$_DRIVES]; /* as the drives' sensors would read them [m, rad] */
  $real$ speeds[$NAME$_DRIVES]; /* for drives that follow speeds [m/s, rad/s] */
  $real$ forces[$NAME$_DRIVES]; /* [N, N m] */
} $name$_output;

/* Forget everything, when the filter begins. */
void $name$_begin($name$_state* state);

/* Say what the drives do next, after a step of the filter that returned OK, with its dt, values and
 * output. Where the estimate is not `trusted` (its health is bad or dead) or its std is large, the
 * correction by feedback stays as it was. Drives that stand keep the last command. Returns one of
 * the numbers above; how long drives may stand, the caller says. */
int $name$_step($name$_state* state, const $filter$_state* filter, $real$ dt, const $real$* values,
                const $filter$_output* out, const $real$* desired, int trusted,
                $name$_output* commands);

#ifdef __cplusplus
}
#endif

#endif
"""

_SOURCE = """\
/* $name$.c: what the drives of the rig "$rig$" do next; see $name$.h.
 * Written by `distal export-c`. */
#include "$name$.h"

#include <math.h>
#include <string.h>

/* gains, and the rig's parameters as the filter takes them */
static const $real$ numbers[] = {$numbers$};

$prelude$
$functions$
void $name$_begin($name$_state* state) { memset(state, 0, sizeof *state); }

int $name$_step($name$_state* state, const $filter$_state* filter, $real$ dt, const $real$* values,
                const $filter$_output* out, const $real$* desired, int trusted,
                $name$_output* commands) {
  static const int joints[] = {$free$}, positions[] = {$positions$};
  static const int moves[][$n_joints$] = {$moves$}, together[][$n_drives$] = {$together$};
  static const $real$ oldest[] = {$oldest$};
  int lost[$n_drives$], stands[$n_drives$] = {0}, rests[$n_joints$] = {0};
  $real$ x[$n_x$], y[$n_y$];
  int i, j, k, code = $NAME$_MOVES;
  for (i = 0; i < $n_drives$; ++i) {
    const int is_read = positions[i] < 0 || values[positions[i]] == values[positions[i]];
    if (!is_read && !state->begun) code = $NAME$_UNREAD;
    state->age[i] = is_read ? $zero$ : state->age[i] + dt;
    lost[i] = state->age[i] > oldest[i];
  }
  if (code == $NAME$_UNREAD) {
    for (i = 0; i < $n_drives$; ++i) {
      commands->positions[i] = ($real$)NAN;
      commands->speeds[i] = ($real$)NAN;
      commands->forces[i] = ($real$)NAN;
    }
    return code;
  }
  for (i = 0; i < $n_drives$; ++i) {
    for (j = 0; j < $n_drives$; ++j) stands[i] |= together[i][j] && lost[j];
    for (j = 0; j < $n_joints$; ++j) rests[j] |= moves[i][j] && stands[i];
    if (stands[i]) code = $NAME$_STANDS;
  }
  memcpy(x + $x_state$, filter->kernel_state, $n_states$ * sizeof *x);
$reported$
  for (i = 0; i < $n_joints$; ++i) {
    if (desired[i] - desired[i] == $zero$) state->desired[i] = desired[i];
    else if (!state->begun) state->desired[i] = x[$x_state$ + joints[i]];
    x[$x_desired$ + i] = state->desired[i];
    if (rests[i]) {
      x[$x_desired$ + i] = state->kernel_state[$c_reference$ + i];
      state->kernel_state[$c_rate$ + i] = $zero$;
      state->kernel_state[$c_speed$ + i] = $zero$;
      state->kernel_state[$c_acceleration$ + i] = $zero$;
      state->kernel_state[$c_at_end$] = $one$; /* feedback does not wind up */
    }
    x[$x_mapped$ + i] = x[$x_state$ + joints[i]] - filter->kernel_state[joints[i]];
  }
  for (i = 0; i < $n_drives$; ++i) {
    /* without a reading a drive counts as being where it was sent */
    const $real$ read = positions[i] < 0 ? state->positions[i] : values[positions[i]];
    x[$x_read$ + i] = read == read ? read : state->positions[i];
  }
  x[$x_touched$] = $zero$;
$touched$
  x[$x_trusted$] = trusted && $known$ ? $one$ : $zero$;
  x[$x_dt$] = state->begun ? dt : $zero$;
  for (k = state->begun ? 1 : $first$; k > 0; --k) $advance$(state->kernel_state, x, numbers, y);
  for (i = 0; i < $n_drives$; ++i) {
    if (!stands[i]) {
      state->positions[i] = y[$y_positions$ + i];
      state->forces[i] = y[$y_forces$ + i];
    }
    commands->positions[i] = state->positions[i];
    commands->forces[i] = state->forces[i];
    commands->speeds[i] = stands[i] ? $zero$ : y[$y_speeds$ + i];
  }
  state->begun = 1;
  return code;
}
"""
