"""One estimator of one rig as C99: a header and a source, without malloc or global variables (the
caller owns the state); beside it, where it is asked for, the live inverse, which computes the
next commands of the drives from the filter's state and the desired angles.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from distal.codegen import Dialect, Emitter, Plain, unused
from distal.errors import ExportError, OutputError
from distal.estimators import (
    LARGEST_ANGLE,
    SHORTEST,
    AdaptiveFilter,
    KernelEstimator,
    external_torques_of,
    make_estimator,
    state_units,
)
from distal.estimators.estimator_protocol import MOST_BRIDGES, SPLIT
from distal.homing import homing_filter
from distal.inverse.feedforward import ROUNDS
from distal.inverse.live_inverse import LiveModel, live_parameters
from distal.inverse.motor_safety import GoalGate, columns_of, crossed_joints
from distal.kernels.layout import MISSING, READ, Layout
from distal.logs import LARGEST_READING, check_outputs, shown, write_together
from distal.logs.output_files import as_output_error
from distal.rig import Rig, Sensor, angle_names, check_scales, std_name
from distal.run.health import ANYWHERE, HEALTH, LOST, Health, Watch

DOUBLE = Plain()
"""The number type of C that most of the texts are in."""


@dataclass(frozen=True)
class Translated:
    """A model as C.

    Args:
        name: prefix of its C names, and the name of its files.
        header: text of the .h file.
        source: text of the .c file.
    """

    name: str
    header: str
    source: str

    @property
    def files(self) -> dict[str, str]:
        """Name of each file → its text."""
        return {f"{self.name}.h": self.header, f"{self.name}.c": self.source}


def filled(template: str, values: Mapping[str, object], real: Dialect = DOUBLE) -> str:
    """Return a template in which each ``$name$`` is replaced by the value of that name.

    ``$NAME$`` is the same value in capitals. Texts stand as they are, numbers are written in C and
    sequences with commas. Blanks in the values themselves are not replaced.

    Args:
        real: number type of the values that are no integers.
    """

    def value(blank: re.Match[str]) -> str:
        key = blank[1]
        return in_c(values[key], real) if key in values else str(values[key.lower()]).upper()

    return re.sub(r"\$(\w+)\$", value, template)


def in_c(value: object, real: Dialect) -> str:
    """Return a value as C: a number, or several with commas, rows of them in braces."""
    if isinstance(value, str):
        return value
    if isinstance(value, (int, np.integer)):
        return str(int(value))
    if isinstance(value, Iterable):
        items = value.tolist() if isinstance(value, np.ndarray) else value
        return ", ".join(
            f"{{{in_c(item, real)}}}" if isinstance(item, (list, tuple)) else in_c(item, real)
            for item in items
        )
    return real.constant(float(value))  # type: ignore[arg-type]


def shared_blanks(name: str, rig: Rig, emitter: Emitter) -> dict[str, object]:
    """Return the blanks that all sources of a rig have: its name, the number type, and the
    functions that were written.
    """
    return {
        "name": name,
        "rig": comment(rig.name),
        "real": emitter.dialect.type,
        "prelude": emitter.dialect.prelude(emitter.text),
        "functions": emitter.text,
    }


def comment(text: str) -> str:
    """Return a text without what would end a C comment, cut to 200 characters."""
    plain = "".join(c if c.isprintable() else " " for c in text)[:200]
    for ends, harmless in (("\\", "/"), ("??", "? ?"), ("*/", "* /"), ("/*", "/ *"), ("*/", "* /")):
        plain = plain.replace(ends, harmless)
    return " ".join(plain.split())


def numbered(parts: Iterable[str]) -> str:
    """Return lines of a C comment that list parts with their indices."""
    return "\n".join(f" *  {i:2d}  {comment(part)}" for i, part in enumerate(parts)) or " *   none"


def sensors_of(estimator: KernelEstimator) -> list[Sensor]:
    """Return the sensors that a filter reads, in the order of a sample's values."""
    sensors = {sensor.name: sensor for sensor in estimator.rig.sensors}
    return [sensors[channel] for channel in estimator.channels]


def sensor_texts(sensors: Iterable[Sensor]) -> list[str]:
    """Return what each sensor measures, and its unit, in words."""
    return [f"{s.name}: {s.measures} of {s.of} [{s.si}]" for s in sensors]


def largest(to: str, home: str, states: Iterable[int]) -> str:
    """Return C that sets a number to the largest of some values of a kernel state, or to zero."""
    lines = [f"  {to} = 0;"]
    for state in states:
        value = f"{home}->kernel_state[{state}]"
        lines += [f"  if ({to} < {value}) {to} = {value};"]
    return "\n".join(lines)


class Field(NamedTuple):
    """A number that an exported filter puts out, with the standard deviation of its error.

    Args:
        name: in C.
        column: its name in a table.
        state: index of its state.
        meaning: what it is, in words.
        joint: name of the joint to which it belongs.
    """

    name: str
    column: str
    state: int
    meaning: str
    joint: str
    unit: str

    @property
    def std(self) -> str:
        """Name of the standard deviation in C."""
        return std_name(self.name)


def fields_of(estimator: KernelEstimator) -> list[Field]:
    """Return what an exported filter puts out: the angle of each joint, then external torques.

    The angle of a single joint is ``angle`` in C. All other names are those of columns, with _ for
    characters that C does not allow.
    """
    joints = estimator.rig.joint_names
    columns = angle_names(joints)
    rows = [(j, *pair, "angle of", "rad") for j, pair in enumerate(zip(joints, columns))]
    rows += [
        (state, joint, estimator.state_names[state], "torque from outside on", "N m")
        for joint, state in external_torques_of(estimator).items()
    ]
    fields: list[Field] = []
    for state, joint, column, meaning, unit in rows:
        alone = len(joints) == 1 and unit == "rad"
        plain = "angle" if alone else re.sub(r"[^A-Za-z0-9]", "_", column)
        name = unused(plain, {field.name for field in fields})
        fields.append(Field(name, column, state, f"{meaning} {joint}", joint, unit))
    return fields


def c_name(text: str) -> str:
    """Return a C identifier made from a text, which C names may begin with."""
    plain = re.sub(r"[^a-z0-9]+", "_", text.lower()).strip("_")[:100].rstrip("_")
    if not plain or not plain[0].isalpha():
        plain = f"rig_{plain}"[:100].rstrip("_")
    return plain


def checked_name(name: str) -> str:
    """Return the name unchanged, if C names and files may begin with it.

    Raises:
        ExportError: the name is no C identifier of lower-case letters, digits and _, or does not
            begin with a letter.
    """
    if not re.fullmatch(r"[a-z][a-z0-9_]{0,99}", name):
        raise ExportError(
            f"'{shown(name)}' cannot begin the names of C functions; up to 100 lower-case "
            "letters, digits and _ can, a letter first"
        )
    return name


def spoken() -> list[Health]:
    """Return the health words that the exported code can give, in the order of their codes.

    Words on stamps are missing, since the filter's step returns codes for these.
    """
    words = list(HEALTH)
    return words[: words.index("restarted") + 1]


def health_blanks(estimator: KernelEstimator, emitter: Emitter) -> dict[str, object]:
    """Return the blanks of an estimator's health, whose function is added to an emitter."""
    watch = Watch(estimator)
    return {
        "check": emitter.add(watch.function()),
        "begun": watch.begun(),
        "n_memory": watch.memory.size,
        "n_sample": watch.sample.size,
        "n_findings": watch.findings.size,
        "watched": watch.watched or [0],  # a list without members is not C
        "n_watched": len(watch.watched),
        "stds": [f"out->{field.std}" for field in fields_of(estimator) if field.unit == "rad"],
        "touched": largest(f"sample[{watch.sample['touched'].start}]", "state", estimator.touched),
        **positions("at", watch.sample),
    }


def positions(letters: str, layout: Layout) -> dict[str, object]:
    """Return the blanks ``letters_part``: where the parts of a vector begin."""
    return {f"{letters}_{part}": layout[part].start for part in layout.names}


@dataclass(frozen=True)
class Exported(Translated):
    """A filter as C.

    Args:
        estimator: the filter in Python.
        real: number type, float or double.
        scratch: how many numbers a step has on the stack.
    """

    estimator: KernelEstimator
    real: Plain
    scratch: int

    @property
    def fields(self) -> list[Field]:
        """The numbers that it puts out."""
        return fields_of(self.estimator)

    @property
    def state_bytes(self) -> int:
        """Size of the filter's state in C [bytes]: its numbers and a counter, as it is padded."""
        return self.real.size * (self.estimator.kernel.sizes.kernel_state + 1)

    @property
    def scratch_bytes(self) -> int:
        """Size of the arrays that a step has on the stack [bytes], without what the compiler
        adds.
        """
        return self.real.size * self.scratch


def c_filter(
    rig: Rig,
    estimator: str | None = None,
    single: bool = False,
    name: str | None = None,
    home: float | None = None,
) -> Exported:
    """Return an estimator of a rig as C99.

    Args:
        estimator: name of the estimator; None: the rig's usual one.
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
    if home is not None and estimator not in (None, "adaptive"):
        raise ExportError(f"adaptive homes while it runs, {estimator} does not; leave home out")
    chosen = (
        make_estimator(estimator, rig, compiled=False)
        if home is None
        else homing_filter(rig, home, False)
    )
    if isinstance(chosen, AdaptiveFilter):
        chosen = chosen.folded()
    name = checked_name(name if name is not None else c_name(f"{rig.name}_{chosen.name}"))
    real = Plain(single)
    emitter = Emitter(real)
    prior = chosen.prior_function()
    begin = emitter.add(prior)
    advance = emitter.add(chosen.kernel.function, in_place=True)
    scratch = sum(written.scratch for written in emitter.functions.values())
    health = health_blanks(chosen, emitter)
    n = len(chosen.state_names)
    m = len(chosen.measured)
    units = (f" [{unit}]" * bool(unit) for unit in state_units(chosen))
    # the prior's spread is a covariance, or its diagonal only
    is_dense = prior.numel_out(1) > n
    of_state = f"state->kernel_state[{n} + i * ({n} + 1)]"
    diagonal = f"  for (i = 0; i < {n}; ++i) {of_state} = spread[i];\n"
    values = shared_blanks(name, rig, emitter) | {
        "estimator": chosen.name,
        "channels": numbered(sensor_texts(sensors_of(chosen))),
        "states": numbered(map("".join, zip(chosen.state_names, units))),
        "measured": numbered(chosen.measured),
        "which": [chosen.channels.index(channel) for channel in chosen.measured] or [0],
        "n_channels": len(chosen.channels),
        "n": n,
        "n_states": n,
        "n_measured": m,
        "n_innovations": max(m, 1),
        "n_outputs": max(chosen.kernel.sizes.y, 2 * m, 1),
        "n_kernel_state": chosen.kernel.sizes.kernel_state,
        "n_numbers": len(chosen.parameters),
        "n_bridged": chosen.bridged,
        "n_joints": len(rig.joints),
        "reach": [joint.travel for joint in rig.joints],
        "anywhere": ANYWHERE**2,
        "health": ",\n".join(
            f"  {name.upper()}_HEALTH_{word.upper()} = {i}" for i, word in enumerate(spoken())
        ),
        "outputs": members(fields_of(chosen), name),
        "angles": outputs(chosen),
        "numbers": chosen.parameters,
        "begin": begin,
        "advance": advance,
        "interval": chosen.interval,
        "split": SPLIT * chosen.interval,
        "most": MOST_BRIDGES,
        "largest": LARGEST_ANGLE,
        "wild": LARGEST_READING,
        "shortest": SHORTEST,
        "read": READ,
        "missing": MISSING,
        "slack": 1e-5 if single else 1e-9,
        "nan": np.nan,
        "sqrt": "sqrtf" if single else "sqrt",
        "spread": f"*spread = state->kernel_state + {n}" if is_dense else f"spread[{n}]",
        "diagonal": "" if is_dense else diagonal,
        **health,
    }
    return Exported(
        name,
        filled(_HEADER, values, real),
        filled(_SOURCE, values, real),
        chosen,
        real,
        scratch,
    )


def members(fields: Iterable[Field], name: str) -> str:
    """Return the C members of the output's struct."""
    return "\n".join(
        f"  {name}_real {field.name}; /* {comment(field.meaning)} [{field.unit}] */\n"
        f"  {name}_real {field.std}; /* standard deviation of its error [{field.unit}] */"
        for field in fields
    )


def outputs(estimator: KernelEstimator, stepped: bool = True) -> str:
    """Return the C lines that fill the `members` from the kernel state.

    Args:
        stepped: whether a sample was taken in; before the first one, learned maps change nothing.
    """
    lines = []
    report = estimator.report
    n = len(estimator.state_names)
    for field in fields_of(estimator):
        estimate = f"state->kernel_state[{field.state}]"
        variance = f"state->kernel_state[{n + field.state * (n + 1)}]"
        if stepped and field.state in report.states:  # a learned map speaks of it
            k = report.states.index(field.state)
            gain = f"y[{report.gains[k]}]"
            estimate = f"y[{report.values[k]}]"
            variance = f"{gain} * {gain} * {variance} + y[{report.variances[k]}]"
        lines += [
            f"    out->{field.name} = {estimate};",
            f"    out->{field.std} = root({variance});",
        ]
    return "\n".join(lines)


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

static $real$ root($real$ variance) { return variance <= 0 ? 0 : $sqrt$(variance); }

void $name$_begin($name$_state* state, const $real$* values) {
  $real$ known[$n_channels$], mask[$n_channels$], $spread$;
  int i;
  for (i = 0; i < $n_channels$; ++i) {
    mask[i] = is_there(values[i]) ? $read$ : $missing$;
    known[i] = is_there(values[i]) ? values[i] : 0;
  }
  memset(state, 0, sizeof *state);
  $begin$(known, mask, numbers, state->kernel_state, spread,
          state->kernel_state + $n_states$ + $n_states$ * $n_states$);
$diagonal$}

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
  if (!(dt >= $shortest$) && !(dt == 0 && state->samples == 0)) return $NAME$_LATE;
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
      x[1 + i] = there && (last || led) ? values[i] : 0;
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
    if (!(state->kernel_state[i] - state->kernel_state[i] == 0)) return $NAME$_LOST;
    if (!(state->kernel_state[$n_states$ + i * ($n_states$ + 1)] >= 0)) return $NAME$_LOST;
  }
  for (i = 0; i < $n_joints$; ++i)
    if (!(state->kernel_state[i] >= -$largest$ && state->kernel_state[i] <= $largest$))
      return $NAME$_LOST;
  return $NAME$_OK;
}

void $name$_watch_begin($name$_watch* watch) {
  static const $real$ begun[] = {$begun$};
  memcpy(watch->memory, begun, sizeof begun);
  watch->begun = 0;
}

int $name$_health($name$_watch* watch, const $name$_state* state, $real$ dt, const $real$* values,
                  const $name$_output* out) {
  static const unsigned char watched[] = {$watched$};
  const $real$ stds[] = {$stds$};
  $real$ memory[sizeof watch->memory / sizeof *watch->memory];
  $real$ sample[$n_sample$], findings[$n_findings$];
  int i;
  sample[$at_first$] = watch->begun ? 0 : 1;
  sample[$at_dt$] = dt;
  for (i = 0; i < $NAME$_CHANNELS; ++i) {
    sample[$at_values$ + i] = is_there(values[i]) ? values[i] : 0;
    sample[$at_mask$ + i] = is_there(values[i]) ? 1 : 0;
  }
  for (i = 0; i < (int)(sizeof stds / sizeof *stds); ++i) sample[$at_stds$ + i] = stds[i];
  for (i = 0; i < $NAME$_MEASURED; ++i) {
    sample[$at_compared$ + i] = is_there(out->innovations[i]) ? 1 : 0;
    sample[$at_innovations$ + i] = is_there(out->innovations[i]) ? out->innovations[i] : 0;
    sample[$at_variances$ + i] = out->innovation_variances[i];
  }
  for (i = 0; i < $n_watched$; ++i) { /* numbers of the rig */
    sample[$at_watched$ + i] = state->kernel_state[watched[i]];
    sample[$at_watched_variances$ + i] = state->kernel_state[$n$ + watched[i] * ($n$ + 1)];
  }
$touched$
  $check$(watch->memory, sample, memory, findings);
  memcpy(watch->memory, memory, sizeof memory);
  watch->begun = 1;
  return (int)findings[0];
}
"""


def c_command(rig: Rig, name: str, filter_name: str, real: Plain) -> Translated:
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
    moves = crossed_joints(rig) @ (np.array(model.mechanism.spread) != 0.0)
    gate = GoalGate(rig)
    fields = fields_of(estimator)
    state = layout.x["state"].start
    trusted = (
        f"out->{field.std} <= {real.constant(LOST)}" for field in fields if field.unit == "rad"
    )
    values = shared_blanks(checked_name(name), rig, emitter) | {
        "filter": filter_name,
        "joints": numbered(f"{rig.joint_names[j]} [rad]" for j in model.free),
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
        "oldest": gate.oldest,
        "moves": moves.tolist(),
        "together": gate.together.tolist(),
        "first": ROUNDS,
        "advance": advance,
        **positions("c", layout.kernel_state),
        **positions("x", layout.x),
        **positions("y", layout.y),
    }
    return Translated(
        name, filled(_COMMAND_HEADER, values, real), filled(_COMMAND_SOURCE, values, real)
    )


_COMMAND_HEADER = """\
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

_COMMAND_SOURCE = """\
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


MARK = "distal export-c"
"""Text that every exported file contains; a file with it may be replaced."""


PROPERTIES = "library.properties"
"""File that makes a folder a library for Arduino; it is the user's once it is there."""


def export_c(
    rig: Rig,
    out: str | Path,
    estimator: str | None = None,
    *,
    single: bool = False,
    name: str | None = None,
    home: float | None = None,
    command: bool = False,
    arduino: bool = False,
) -> Exported:
    """Write an estimator of a rig as C99 to a folder.

    Args:
        out: the folder, which is made where it does not exist. Files of an earlier export are
            replaced, other files stay.
        estimator: name of the estimator; None: the rig's usual one.
        single: whether numbers are float and only float functions are called; otherwise they are
            double.
        name: prefix of all C names; by default it is made from the rig's title and the estimator.
        home: standard deviation of a joint's angle while it homes [rad]; by default the filter does
            not home while it runs.
        command: whether the live inverse is written beside `adaptive`, as NAME_command; see
            `LiveInverse`.
        arduino: whether the folder is laid out as a library for Arduino and PlatformIO.

    Raises:
        CommandError: commands are asked for, and the rig's scale of force was taken.
        ExportError: the name is no C identifier, the estimator cannot be written in C, or commands
            are asked for beside another estimator than `adaptive`.
        EstimationError: the estimator cannot run on this rig.
        OutputError: the folder cannot be written, or has files that no export wrote.
    """
    folder = Path(out)
    exported = c_filter(rig, estimator, single, name, home)
    texts = exported.files
    if command:
        if exported.estimator.name != "adaptive":
            raise ExportError(
                f"commands are by the state of adaptive, {exported.estimator.name} has another; "
                "leave command out"
            )
        check_scales(rig, "a command in C that keeps tendons taut", "tension")
        texts |= c_command(rig, f"{exported.name}_command", exported.name, exported.real).files
    names = export_files(exported.name, command, arduino)
    files = dict(zip(names, [*texts.values(), readme(exported)]))
    if arduino and not (folder / PROPERTIES).is_file():
        values = {"name": exported.name, "short": exported.name[:63], "rig": comment(rig.name)}
        files[PROPERTIES] = filled(_PROPERTIES, values)
    check_outputs([folder / file for file in files], makes_folder=True)
    check_ours(folder, files)
    with as_output_error(folder):
        for file in files:
            (folder / file).parent.mkdir(parents=True, exist_ok=True)
    write_together({folder / file: text for file, text in files.items()})
    return exported


def export_files(name: str, command: bool = False, arduino: bool = False) -> tuple[str, ...]:
    """Return the paths below the folder of the files that `export_c` replaces.

    Args:
        name: prefix of all C names.
        command: whether the live inverse is among them.
        arduino: whether the folder is a library for Arduino.

    Raises:
        ExportError: the name is no C identifier.
    """
    parts = [checked_name(name), *[f"{name}_command"] * command]
    folder = "src/" if arduino else ""
    return (*(f"{folder}{part}.{ending}" for part in parts for ending in "hc"), "README.md")


def check_ours(folder: Path, names: Iterable[str]) -> None:
    """Raise where a file that would be replaced was not written by an export.

    Args:
        names: paths below the folder.

    Raises:
        OutputError: a file that exists was not written by an export, or cannot be read.
    """
    for path in (folder / name for name in names):
        if path.is_file() and MARK not in path.read_text(encoding="utf-8", errors="replace"):
            raise OutputError(
                f"{path}: was not written by export-c; give another folder, so that it is not "
                "replaced"
            )


def readme(exported: Exported) -> str:
    """Return the README of an exported filter: how to call it, and what it takes of memory and
    time.
    """
    real = exported.real
    estimator = exported.estimator
    channels = enumerate(estimator.channels)
    values = {
        "name": exported.name,
        "rig": comment(estimator.rig.name),
        "estimator": estimator.name,
        "real": real.type,
        "channels": "\n".join(f"| {i} | `{channel}` |" for i, channel in channels),
        "n_states": len(estimator.state_names),
        "state_bytes": f"{exported.state_bytes:,}",
        "scratch_bytes": f"{exported.scratch_bytes:,}",
        "kernel_state": f"{estimator.kernel.sizes.kernel_state} x {real.size}",
    }
    return filled(_README, values)


_PROPERTIES = """\
name=$short$
version=1.0.0
author=distal export-c
maintainer=distal export-c
sentence=Angle and standard deviation of the joints of "$rig$", without a sensor in a joint.
paragraph=A Kalman filter, no malloc, no globals.
category=Sensors
url=https://example.org
architectures=*
includes=$name$.h
"""


_README = """\
# $name$

Written by `distal export-c`: `$estimator$` for the rig "$rig$", in C99 with `$real$`. No malloc, no
globals: the caller owns the state.

```c
#include "$name$.h"

static $name$_state state;
static int begun;

/* for every sample, dt seconds after the last one that was taken in */
void control($name$_real dt, const $name$_real values[$NAME$_CHANNELS]) {
  $name$_output out;
  if (!begun) $name$_begin(&state, values);
  if ($name$_step(&state, begun ? dt : 0, values, &out) == $NAME$_OK) {
    begun = 1; /* out.angle, with a std of out.angle_std [rad] */
  } /* else: see the header */
}
```

| | values, SI, NAN where missing |
|---|---|
$channels$

`values` may lack any sensor at any time. A gap is bridged by one prediction per nominal interval,
and takes that many times as long as a step; `$NAME$_LATE` says that a stamp did not rise, and
nothing is changed.

| | |
|---|---|
| states | $n_states$ |
| state, the caller's | $state_bytes$ bytes ($kernel_state$ and a counter) |
| arrays on the stack in a step | $scratch_bytes$ bytes, and what the compiler spills |
"""
