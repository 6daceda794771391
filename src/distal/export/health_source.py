"""The health of a stream in C: the function of `distal.run.health`, called by two functions of the
exported filter.
"""

from __future__ import annotations

from distal.codegen import Emitter
from distal.estimators import KernelEstimator
from distal.export.c_text import fields_of, filled, largest
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
