"""What the exported texts of C share: templates and their blanks, comments, the pair of files, the
numbers that a filter puts out, the health of its stream, and the names that C functions may have.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from distal.codegen import Dialect, Emitter, Plain, unused
from distal.errors import ExportError
from distal.estimators import KernelEstimator, external_torques_of
from distal.logs import shown
from distal.rig import Rig, Sensor, angle_names, std_name
from distal.run.health import HEALTH, Health, begun, watch_of

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
        items = np.asarray(value).tolist() if isinstance(value, np.ndarray) else value
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


def health_codes(name: str) -> str:
    """Return the members of the C enumeration of the words of `spoken`."""
    return ",\n".join(
        f"  {name.upper()}_HEALTH_{word.upper()} = {i}" for i, word in enumerate(spoken())
    )


def health_source(estimator: KernelEstimator, name: str, emitter: Emitter) -> dict[str, object]:
    """Return the C code of an estimator's health and the size of its memory, as blanks of the
    header's and source's templates.

    Args:
        name: prefix of the C names.
        emitter: writer of C functions, to which the health's function is added.
    """
    watch = watch_of(estimator)
    values: dict[str, object] = {
        "name": name,
        "real": emitter.dialect.type,
        "check": emitter.add(watch.function),
        "begun": begun(watch),
        "n_sample": watch.sample.size,
        "n_findings": watch.findings.size,
        "n": len(estimator.state_names),
        "watched": watch.watched or [0],  # a list without members is not C
        "n_watched": len(watch.watched),
        "stds": [f"out->{field.std}" for field in fields_of(estimator) if field.unit == "rad"],
        "touched": largest(f"sample[{watch.sample['touched'].start}]", "state", estimator.touched),
        **{f"at_{part}": watch.sample[part].start for part in watch.sample.names},
    }
    text = filled(_SOURCE, values, emitter.dialect)
    return {"watching": text, "n_memory": watch.memory.size}


_SOURCE = """\
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
