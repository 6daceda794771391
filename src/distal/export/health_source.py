"""The health of a stream in C: the function of `distal.run.health`, called by two functions of the
exported filter.
"""

from __future__ import annotations

from collections.abc import Sequence

from distal.codegen import CodeError, Emitter, Plain
from distal.errors import ExportError
from distal.estimators import KernelEstimator
from distal.export.names import angle_fields, filled
from distal.run.health import HEALTH, Health, begun, watch_of


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


def health_source(estimator: KernelEstimator, name: str, emitter: Emitter) -> dict[str, str]:
    """Return the C code of an estimator's health and the size of its memory, as blanks of the
    header's and source's templates.

    Args:
        name: prefix of the C names.
        emitter: writer of C functions, to which the health's function is added.

    Raises:
        ExportError: the function cannot be written in C.
    """
    watch = watch_of(estimator)
    dialect = emitter.dialect
    assert isinstance(dialect, Plain)
    try:
        check = emitter.add(watch.function)
    except CodeError as problem:
        raise ExportError(f"the health of '{estimator.rig.name}' has no C: {problem}") from None
    values = {
        "name": name,
        "NAME": name.upper(),
        "real": dialect.type,
        "check": check,
        "begun": ", ".join(dialect.constant(float(number)) for number in begun(watch)),
        "n_sample": str(watch.sample.size),
        "n_findings": str(watch.findings.size),
        "n": str(len(estimator.state_names)),
        "watched": ", ".join(map(str, watch.watched)) or "0",  # a list without members is not C
        "n_watched": str(len(watch.watched)),
        "stds": ", ".join(f"out->{std}" for _, std in angle_fields(estimator.rig)),
        "touched": _largest(watch.sample["touched"], estimator.touched),
        "zero": dialect.constant(0.0),
        "one": dialect.constant(1.0),
        **{f"at_{part}": str(watch.sample[part].start) for part in watch.sample.names},
    }
    return {"watching": filled(_SOURCE, values), "n_memory": str(watch.memory.size)}


def _largest(part: slice, indices: Sequence[int]) -> str:
    """Return statements that give a part of the sample, of one number or none, the largest of some
    values of the kernel state, or zero.
    """
    lines = [f"  sample[{at}] = 0;" for at in range(part.start, part.stop)]
    lines += [
        f"  if (sample[{part.start}] < state->kernel_state[{i}])\n"
        f"    sample[{part.start}] = state->kernel_state[{i}];"
        for i in indices
    ]
    return "\n".join(lines)


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
  sample[$at_first$] = watch->begun ? $zero$ : $one$;
  sample[$at_dt$] = dt;
  for (i = 0; i < $NAME$_CHANNELS; ++i) {
    sample[$at_values$ + i] = is_there(values[i]) ? values[i] : $zero$;
    sample[$at_mask$ + i] = is_there(values[i]) ? $one$ : $zero$;
  }
  for (i = 0; i < (int)(sizeof stds / sizeof *stds); ++i) sample[$at_stds$ + i] = stds[i];
  for (i = 0; i < $NAME$_MEASURED; ++i) {
    sample[$at_compared$ + i] = is_there(out->innovations[i]) ? $one$ : $zero$;
    sample[$at_innovations$ + i] = is_there(out->innovations[i]) ? out->innovations[i] : $zero$;
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
