"""One estimator of one rig as C99: a header and a source, without malloc or global variables; the
caller owns the state.
"""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass

from distal.codegen import CodeError, Emitter, Plain
from distal.errors import ExportError
from distal.estimators import (
    LARGEST_ANGLE,
    SHORTEST,
    AdaptiveFilter,
    FullStateFilter,
    KernelEstimator,
    make_estimator,
    state_units,
)
from distal.estimators.gaps import MOST_BRIDGES, SPLIT
from distal.export.health_source import health_codes, health_source
from distal.export.names import c_name, checked_name, comment, filled, members, outputs
from distal.export.replay import replay_program
from distal.homing import homing_filter
from distal.kernels.mask import MISSING, READ
from distal.logs import LARGEST_READING
from distal.rig import Rig
from distal.run.monitor import ANYWHERE


@dataclass(frozen=True)
class Exported:
    """A filter as C.

    Args:
        name: prefix of its C names.
        estimator: name of the estimator.
        rig: title of the rig.
        single: whether numbers are float.
        channels: names of the sensors, in the order of a sample's values.
        states: names of the states, in order.
        measured: names of the channels that have an innovation.
        kernel_state: how many numbers it keeps from sample to sample.
        scratch: how many numbers a step has on the stack.
        operations: arithmetic operations of a step.
        library: name of a mathematical function → its calls in a step.
        interval: nominal time between samples [s].
        replay: text of a program that runs the filter over a CSV file.
        jumps: whether the estimate jumps where a body goes from sticking to slipping; float and
            double may do so at different samples.
    """

    name: str
    estimator: str
    rig: str
    single: bool
    _: KW_ONLY
    header: str
    source: str
    channels: tuple[str, ...]
    states: tuple[str, ...]
    measured: tuple[str, ...]
    kernel_state: int
    scratch: int
    operations: int
    library: dict[str, int]
    interval: float
    replay: str
    jumps: bool

    @property
    def state_bytes(self) -> int:
        """Size of the filter's state in C [bytes]."""
        return (4 * self.kernel_state + 4) if self.single else 8 * (self.kernel_state + 1)

    @property
    def scratch_bytes(self) -> int:
        """Size of the arrays that a step has on the stack [bytes], without what the compiler
        adds.
        """
        return (4 if self.single else 8) * self.scratch


def c_filter(
    rig: Rig,
    estimator: str = "adaptive",
    single: bool = False,
    name: str | None = None,
    home: float | None = None,
) -> Exported:
    """Return an estimator of a rig as C99.

    Args:
        estimator: name of the estimator.
        single: whether numbers are float and only float functions are called; otherwise they are
            double.
        name: prefix of all C names; by default it is made from the rig's title and the estimator.
        home: standard deviation of a joint's angle while it homes [rad]. Where it is given, samples
            have such an angle for each joint; see `distal.homing_filter`.

    Raises:
        ExportError: the name is no C identifier, the estimator cannot be written in C, or it cannot
            home.
        EstimationError: the estimator cannot run on this rig, or cannot be exported.
    """
    if home is not None and estimator != "adaptive":
        raise ExportError(f"adaptive homes while it runs, {estimator} does not; leave home out")
    chosen = (
        make_estimator(estimator, rig, compiled=False)
        if home is None
        else homing_filter(rig, home, False)
    )
    if isinstance(chosen, AdaptiveFilter):
        chosen = chosen.folded()
    name = checked_name(name if name is not None else c_name(f"{rig.name}_{estimator}"))
    prior = chosen.prior_function()
    step = chosen.kernel.function
    emitter = Emitter(Plain(single))
    try:
        begin = emitter.add(prior)
        advance = emitter.add(step, in_place=True)
    except CodeError as problem:
        raise ExportError(f"{estimator} of '{rig.name}' has no C: {problem}") from None
    cost = emitter.functions[advance].cost
    scratch = sum(written.scratch for written in emitter.functions.values())
    watching = health_source(chosen, name, emitter)
    values = _values(chosen, name, emitter, begin, advance) | watching
    values |= _beginning(len(chosen.state_names), prior.numel_out(1))
    return Exported(
        name,
        estimator,
        rig.name,
        single,
        header=filled(_HEADER, values),
        source=filled(_SOURCE, values),
        channels=chosen.channels,
        states=chosen.state_names,
        measured=chosen.measured,
        kernel_state=int(step.numel_in(0)),
        scratch=scratch,
        operations=cost.operations,
        library=dict(sorted(cost.library.items())),
        interval=chosen.interval,
        replay=replay_program(chosen, name),
        jumps=isinstance(chosen, FullStateFilter),
    )


def _values(
    chosen: KernelEstimator, name: str, emitter: Emitter, begin: str, advance: str
) -> dict[str, str]:
    """Return the blanks of the templates with their contents."""
    dialect = emitter.dialect
    n = len(chosen.state_names)
    m = len(chosen.measured)
    assert isinstance(dialect, Plain)
    sensors = {sensor.name: sensor for sensor in chosen.rig.sensors}
    read = [sensors[channel] for channel in chosen.channels]
    channels = [f" *   {i}  {s.name}: {s.measures} of {s.of} [{s.si}]" for i, s in enumerate(read)]
    states = [
        f"{state}{f' [{unit}]' * bool(unit)}"
        for state, unit in zip(chosen.state_names, state_units(chosen))
    ]
    measured = [f" *   {i}  {c}" for i, c in enumerate(chosen.measured)]
    parameters = [dialect.constant(float(x)) for x in chosen.parameters]
    travels = [joint.travel for joint in chosen.rig.joints]
    rows = [", ".join(parameters[i : i + 6]) for i in range(0, len(parameters), 6)]
    return {
        "nan": dialect.constant(float("nan")),
        "name": name,
        "NAME": name.upper(),
        "rig": comment(chosen.rig.name),
        "estimator": chosen.name,
        "real": dialect.type,
        "channels": "\n".join(channels),
        "states": "\n".join(f" *   {i:2d}  {state}" for i, state in enumerate(states)),
        "measured": "\n".join(measured) or " *   none",
        "n_channels": str(len(chosen.channels)),
        "n_states": str(n),
        "n_measured": str(m),
        "n_innovations": str(max(m, 1)),
        "n_outputs": str(max(chosen.kernel.n_y, 2 * m, 1)),
        "n_kernel_state": str(chosen.kernel.n_kernel_state),
        "n_numbers": str(len(parameters)),
        "n_bridged": str(chosen.bridged),
        "reach": ", ".join(
            f"{{{dialect.constant(low)}, {dialect.constant(high)}}}" for low, high in travels
        ),
        "anywhere": dialect.constant(ANYWHERE**2),
        "health": health_codes(name),
        "n_joints": str(len(chosen.rig.joints)),
        "outputs": members(chosen, name),
        "angles": outputs(chosen, n),
        "numbers": ",\n  ".join(rows),
        "prelude": dialect.prelude(emitter.text),
        "functions": emitter.text,
        "begin": begin,
        "advance": advance,
        "interval": dialect.constant(chosen.interval),
        "split": dialect.constant(SPLIT * chosen.interval),
        "most": str(MOST_BRIDGES),
        "largest": dialect.constant(LARGEST_ANGLE),
        "wild": dialect.constant(LARGEST_READING),
        "shortest": dialect.constant(SHORTEST),
        "which": ", ".join(str(chosen.channels.index(c)) for c in chosen.measured) or "0",
        "zero": dialect.constant(0.0),
        "read": dialect.constant(READ),
        "missing": dialect.constant(MISSING),
        "slack": dialect.constant(1e-9 if not dialect.single else 1e-5),
        "sqrt": "sqrtf" if dialect.single else "sqrt",
    }


def _beginning(n: int, spread: int) -> dict[str, str]:
    """Return the blanks of the function that begins a filter.

    Args:
        n: number of states.
        spread: size of the prior's spread: n² for a covariance, n for its diagonal only.
    """
    if spread > n:
        return {"spread": f", *spread = state->kernel_state + {n}", "place": ""}
    row = f"  for (i = 0; i < {n}; ++i) state->kernel_state[{n} + i * {n + 1}] = spread[i];\n"
    return {"spread": f", spread[{n}]", "place": row}


_HEADER = """\
/* $name$.h: `$estimator$` for the rig "$rig$"
 *
 * Where a tendon-driven joint is, from what is measured at the proximal end.
 * Written by `distal export-c`. C99, no malloc, no globals: the caller owns the state.
 * All numbers are SI; NAN is a missing value.
 *
 * values, in this order:
$channels$
 *
 * states, in this order (means first in `kernel_state`, then the covariance,
 * $n_states$ x $n_states$, then what is remembered):
$states$
 *
 * innovations, in this order:
$measured$
 */
#ifndef $NAME$_H
#define $NAME$_H

#ifdef __cplusplus
extern "C" {
#endif

#define $NAME$_CHANNELS $n_channels$
#define $NAME$_STATES $n_states$
#define $NAME$_MEASURED $n_measured$
#define $NAME$_KERNEL_STATE $n_kernel_state$
#define $NAME$_INTERVAL $interval$ /* nominal time between samples [s] */

typedef $real$ $name$_real;

/* What the filter believes; copy it, keep it, restore it. */
typedef struct {
  $name$_real kernel_state[$NAME$_KERNEL_STATE];
  int samples; /* how many were taken in, at most 2 is kept */
} $name$_state;

typedef struct {
$outputs$
  /* measured minus predicted, NAN where nothing was compared */
  $name$_real innovations[$n_innovations$];
  $name$_real innovation_variances[$n_innovations$];
} $name$_output;

/* What tells whether the stream can be trusted. */
typedef struct {
  int begun;
  $name$_real memory[$n_memory$];
} $name$_watch;

/* the codes of a step */
enum {
  $NAME$_OK = 0,
  /* dt is less than a nanosecond (zero is for the first sample): nothing was changed */
  $NAME$_LATE = 1,
  $NAME$_GAP = 2,    /* dt is too long to bridge: nothing was changed, begin again */
  $NAME$_BAD = 3,    /* a value is infinite or wild, beyond 1e7: nothing was changed */
  $NAME$_LOST = 4    /* the filter left all bounds: begin again */
};

/* The health of a sample that was taken in; where several hold, the last one. Their meaning is that
 * of `distal stream`. */
enum {
$health$
};

/* Set the state to what is believed before the first sample, whose values fill what has no
 * prior. */
void $name$_begin($name$_state* state, const $name$_real* values);

/* Begin anew where the filter was: at its angles, within the joints' stops, which may be 0.5 rad
 * off. */
void $name$_restart($name$_state* state, const $name$_real* values);

/* Take in a sample, dt [s] after the last one that was taken in (0 for the first); `out` may be a
 * null pointer. */
int $name$_step($name$_state* state, $name$_real dt, const $name$_real* values, $name$_output* out);

/* Begin to watch, when the filter begins. */
void $name$_watch_begin($name$_watch* watch);

/* Say how healthy the stream is, after a step that returned $NAME$_OK, with its dt, values and
 * output. */
int $name$_health($name$_watch* watch, const $name$_state* state, $name$_real dt,
                  const $name$_real* values,
                  const $name$_output* out);

#ifdef __cplusplus
}
#endif

#endif
"""

_SOURCE = """\
/* $name$.c: `$estimator$` for the rig "$rig$"; see $name$.h. Written by `distal export-c`. */
#include "$name$.h"

#include <math.h>
#include <string.h>

/* the rig's parameters and the noise, as the filter takes them */
static const $real$ numbers[$n_numbers$] = {
  $numbers$
};

$prelude$
$functions$
/* which of the values each innovation is of */
static const unsigned char measured[$n_innovations$] = {$which$};

static int is_there($real$ value) { return value == value; }

static $real$ root($real$ variance) { return variance <= $zero$ ? $zero$ : $sqrt$(variance); }

void $name$_begin($name$_state* state, const $real$* values) {
  $real$ known[$n_channels$], mask[$n_channels$]$spread$;
  int i;
  for (i = 0; i < $n_channels$; ++i) {
    mask[i] = is_there(values[i]) ? $read$ : $missing$;
    known[i] = is_there(values[i]) ? values[i] : $zero$;
  }
  memset(state, 0, sizeof *state);
  $begin$(known, mask, numbers, state->kernel_state, spread,
          state->kernel_state + $n_states$ + $n_states$ * $n_states$);
$place$}

void $name$_restart($name$_state* state, const $real$* values) {
  static const $real$ reach[][2] = {$reach$};
  $real$ angles[$n_joints$];
  int i, known = 1;
  for (i = 0; i < $n_joints$; ++i) {
    const $real$ angle = state->kernel_state[i];
    known &= angle >= -$largest$ && angle <= $largest$;
    angles[i] = angle < reach[i][0] ? reach[i][0] : angle > reach[i][1] ? reach[i][1] : angle;
  }
  known &= state->samples > 0;
  $name$_begin(state, values);
  for (i = 0; i < $n_joints$; ++i) {
    $real$* variance = &state->kernel_state[$n_states$ + i * ($n_states$ + 1)];
    if (known) state->kernel_state[i] = angles[i];
    if (*variance < $anywhere$) *variance = $anywhere$;
  }
}

int $name$_step($name$_state* state, $real$ dt, const $real$* values, $name$_output* out) {
  $real$ x[1 + 2 * $n_channels$], y[$n_outputs$];
  long parts, k;
  int i, wild = 0;
  if (!(dt >= $shortest$) && !(dt == $zero$ && state->samples == 0)) return $NAME$_LATE;
  if (!(dt <= $most$ * $split$)) return $NAME$_GAP;
  for (i = 0; i < $n_channels$; ++i) wild |= values[i] > $wild$ || values[i] < -$wild$;
  if (wild) return $NAME$_BAD;
  /* a long interval is bridged by several predictions, so that sub-steps stay short */
  parts = (long)(dt / ($split$));
  if (($real$)parts < dt / ($split$) - $slack$) parts += 1;
  if (parts < 1) parts = 1;
  x[0] = dt / ($real$)parts;
  for (k = parts; k > 0; --k) {
    for (i = 0; i < $n_channels$; ++i) {
      const int last = k == 1, led = i < $n_bridged$;
      const int there = is_there(values[i]);
      /* displacements cross a gap in a straight line to the reading that ends it */
      x[1 + i] = there && (last || led) ? values[i] : $zero$;
      x[1 + $n_channels$ + i] = !there ? $missing$ : last ? $read$ : led ? -($real$)k : $missing$;
    }
    $advance$(state->kernel_state, x, numbers, y);
  }
  if (state->samples < 2) state->samples += 1;
  if (out) {
$angles$
    for (i = 0; i < $n_measured$; ++i) {
      out->innovations[i] = is_there(values[measured[i]]) ? y[i] : $nan$;
      out->innovation_variances[i] = y[$n_measured$ + i];
    }
  }
  for (i = 0; i < $n_states$; ++i) {
    /* neither infinite nor undefined, and no negative variance */
    if (!(state->kernel_state[i] - state->kernel_state[i] == $zero$)) return $NAME$_LOST;
    if (!(state->kernel_state[$n_states$ + i * ($n_states$ + 1)] >= $zero$)) return $NAME$_LOST;
  }
  for (i = 0; i < $n_joints$; ++i)
    if (!(state->kernel_state[i] >= -$largest$ && state->kernel_state[i] <= $largest$))
      return $NAME$_LOST;
  return $NAME$_OK;
}

$watching$"""
