"""The live inverse as C99, beside an exported filter: it computes the next commands of the drives
from the filter's state and the desired angles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from distal.codegen import Emitter, Plain
from distal.estimators import AdaptiveFilter
from distal.export.filter_source import (
    Translated,
    checked_name,
    fields_of,
    filled,
    largest,
    numbered,
    shared_blanks,
)
from distal.inverse.feedforward import ROUNDS
from distal.inverse.goal_gate import MotorReadings, columns_of, crossed_joints
from distal.inverse.live_inverse import LiveModel, live_parameters
from distal.rig import Rig
from distal.run.health import LIMITS


@dataclass(frozen=True)
class ExportedCommand(Translated):
    """The live inverse of a rig as C.

    Args:
        joints: indices of the joints that have desired angles.
    """

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
    estimator = AdaptiveFilter(rig, False, folded=True)
    layout = LiveModel(rig, estimator.states, folded=True)
    model = layout.model
    emitter = Emitter(real)
    advance = emitter.add(layout.function(), in_place=True)
    crossed = crossed_joints(rig)
    moves = crossed @ (np.array(model.mechanism.spread) != 0.0)
    together = (crossed @ crossed.T) | np.eye(model.nd, dtype=bool)
    fields = fields_of(estimator)
    state = layout.x["state"].start
    trusted = (
        f"out->{field.std} <= {real.constant(LIMITS.lost)}"
        for field in fields
        if field.unit == "rad"
    )
    values = shared_blanks(checked_name(name), rig, emitter) | {
        "filter": filter_name,
        "joints": numbered(f"{rig.joints[j].name} [rad]" for j in model.free),
        "drives": numbered(rig.drive_names),
        "n_joints": model.nf,
        "n_drives": model.nd,
        "n_states": len(estimator.states),
        "n_kernel_state": layout.kernel_state.size,
        "n_x": layout.x.size,
        "n_y": layout.y.size,
        "numbers": live_parameters(layout, estimator),
        "reported": "\n".join(
            f"  x[{state + field.state}] = out->{field.name};" for field in fields
        ),
        "touched": largest(f"x[{layout.x['touched'].start}]", "filter", estimator.touched),
        "known": " && ".join(trusted),
        "free": model.free,
        "positions": columns_of(rig, estimator.channels, "position").tolist(),
        "oldest": MotorReadings(rig).oldest,
        "moves": moves.tolist(),
        "together": together.tolist(),
        "first": ROUNDS,
        "advance": advance,
        **{f"c_{part}": layout.kernel_state[part].start for part in layout.kernel_state.names},
        **{f"x_{part}": layout.x[part].start for part in layout.x.names},
        **{f"y_{part}": layout.y[part].start for part in layout.y.names},
    }
    return ExportedCommand(
        name,
        filled(_HEADER, values, real),
        filled(_SOURCE, values, real),
        tuple(model.free),
    )


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
    state->age[i] = is_read ? 0 : state->age[i] + dt;
    lost[i] = state->age[i] > oldest[i];
  }
  if (code == $NAME$_UNREAD) {
    for (i = 0; i < $n_drives$; ++i)
      commands->positions[i] = commands->speeds[i] = commands->forces[i] = ($real$)NAN;
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
    if (desired[i] - desired[i] == 0) state->desired[i] = desired[i];
    else if (!state->begun) state->desired[i] = x[$x_state$ + joints[i]];
    x[$x_desired$ + i] = state->desired[i];
    if (rests[i]) {
      x[$x_desired$ + i] = state->kernel_state[$c_reference$ + i];
      state->kernel_state[$c_rate$ + i] = 0;
      state->kernel_state[$c_speed$ + i] = 0;
      state->kernel_state[$c_acceleration$ + i] = 0;
      state->kernel_state[$c_at_end$] = 1; /* feedback does not wind up */
    }
    x[$x_mapped$ + i] = x[$x_state$ + joints[i]] - filter->kernel_state[joints[i]];
  }
  for (i = 0; i < $n_drives$; ++i) {
    /* without a reading a drive counts as being where it was sent */
    const $real$ read = positions[i] < 0 ? state->positions[i] : values[positions[i]];
    x[$x_read$ + i] = read == read ? read : state->positions[i];
  }
$touched$
  x[$x_trusted$] = trusted && $known$ ? 1 : 0;
  x[$x_dt$] = state->begun ? dt : 0;
  for (k = state->begun ? 1 : $first$; k > 0; --k) $advance$(state->kernel_state, x, numbers, y);
  for (i = 0; i < $n_drives$; ++i) {
    if (!stands[i]) {
      state->positions[i] = y[$y_positions$ + i];
      state->forces[i] = y[$y_forces$ + i];
    }
    commands->positions[i] = state->positions[i];
    commands->forces[i] = state->forces[i];
    commands->speeds[i] = stands[i] ? 0 : y[$y_speeds$ + i];
  }
  state->begun = 1;
  return code;
}
"""
