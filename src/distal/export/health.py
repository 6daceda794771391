"""The health of a stream in C: the words of `distal.run.monitor`, as the exported filter's second pair of functions."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from distal.codegen import Plain
from distal.estimators import KernelEstimator
from distal.export.fields import angle_fields, filled
from distal.results import LARGE_PRIOR, SMALL
from distal.rig import step_of
from distal.run import monitor
from distal.run.offline import priors_of
from distal.run.places import FAR, place_range


def spoken() -> list[monitor.Health]:
    """Return the words that a board can say, in the order of their codes; those for stamps are what a step returns."""
    words = list(monitor.HEALTH)
    return words[: words.index("restarted") + 1]


def health_codes(name: str) -> str:
    """Return the enumeration of `spoken`.

    Args:
        name: prefix of the filter's names.
    """
    lines = [f"  {name.upper()}_HEALTH_{word.upper()} = {i}," for i, word in enumerate(spoken())]
    return "\n".join(lines).removesuffix(",")


def health_source(runner: KernelEstimator, name: str, dialect: Plain) -> str:
    """Return the C of an estimator's health.

    Args:
        name: prefix of the filter's names.
    """
    sensors = {sensor.name: sensor for sensor in runner.rig.sensors}
    chosen, number = [sensors[channel] for channel in runner.channels], dialect.constant
    n = len(runner.state_names)
    means, stds = priors_of(runner)
    if means is None or stds is None:
        means, stds = np.zeros(n), np.zeros(n)
    known = [i for i in range(n) if np.isfinite(means[i]) and stds[i] > 0.0]
    # a number that no age reaches, since C has no infinity without a header
    overdue = np.minimum(monitor.overdue(chosen), 1e30).tolist()
    ranges = [place_range(runner.rig, sensor) for sensor in chosen]
    placed = [i for i, sensor in enumerate(chosen) if sensor.measures == "position"]
    arrays = {
        "overdue": overdue,
        "dead": [max(monitor.DEAD, 2 * each) for each in overdue],
        "low": [ranges[i][0] for i in placed],
        "high": [ranges[i][1] for i in placed],
        "prior_mean": [means[i] for i in known],
        "allowed": [LARGE_PRIOR * stds[i] for i in known],
    }
    counted = {
        "noisy": [int(sensor.noise > step_of(sensor) and sensor.measures != "angle") for sensor in chosen],
        "placed": placed,
        "lasting": known,
    }
    # a list without members is not C
    written = [f"static const {dialect.type} {key}[] = {{{_joined(map(number, row))}}};" for key, row in arrays.items()]
    written += [f"static const unsigned char {key}[] = {{{_joined(map(str, row))}}};" for key, row in counted.items()]
    values = {
        "name": name,
        "NAME": name.upper(),
        "real": dialect.type,
        "tables": "\n".join(written),
        "n_placed": str(len(placed)),
        "n_known": str(len(known)),
        "n": str(n),
        "stds": ", ".join(f"out->{std}" for _, std in angle_fields(runner.rig)),
        "never": number(1.01),
        "memory": number(monitor.MEMORY),
        "longest": number(monitor.LONGEST_GAP),
        "interval": number(runner.interval),
        "late": number(1.5 * runner.interval),
        "hurried": number(monitor.HURRIED),
        "capped": number(monitor.CAPPED),
        "large": number(monitor.LARGE),
        "small": number(SMALL),
        "far": number(FAR),
        "unknown": number(monitor.UNKNOWN),
        "half": number(0.5),
        "one": number(1.0),
        "two": number(2.0),
        "zero": number(0.0),
        "nan": number(float("nan")),
        "abs": "fabsf" if dialect.single else "fabs",
    }
    return filled(_SOURCE, values)


def _joined(row: Iterable[str]) -> str:
    return ", ".join(row) or "0"


_SOURCE = """\
/* when a sensor is missing and dead [s], whether it has noise; where a drive can be; numbers of the rig and 3 stds */
$tables$

static int worse(int health, int than) { return than > health ? than : health; }

void $name$_watch_begin($name$_watch* watch) {
  int i;
  memset(watch, 0, sizeof *watch);
  watch->pace = $one$;
  for (i = 0; i < $NAME$_CHANNELS; ++i) watch->last[i] = $nan$;
  for (i = 0; i < $NAME$_MEASURED; ++i) watch->ratio[i] = $one$;
}

int $name$_health($name$_watch* watch, const $name$_state* state, $real$ dt, const $real$* values,
                  const $name$_output* out) {
  const $real$ stds[] = {$stds$};
  const int first = !watch->begun;
  /* the share that this sample has in means over a second */
  const $real$ since = dt > $zero$ && dt < $longest$ ? dt : $interval$;
  const $real$ share = since < $memory$ ? since / $memory$ : $one$;
  int i, health = $NAME$_HEALTH_OK, any = 0, tested = 0;
  watch->begun = 1;
  if (!first) {
    const $real$ pace = dt / $interval$, weight = $interval$ < $memory$ ? $interval$ / $memory$ : $one$;
    if (dt > $late$) health = $NAME$_HEALTH_GAP;
    watch->pace += weight * ((pace < $two$ ? pace : $two$) - watch->pace);
    if (watch->pace < $hurried$) health = $NAME$_HEALTH_DISAGREES; /* unit of time? */
  }
  for (i = 0; i < $NAME$_CHANNELS; ++i) {
    const int there = is_there(values[i]), moved = there && values[i] != watch->last[i];
    any |= there;
    /* one that has not been there at all is missing from the beginning */
    watch->age[i] = there ? $zero$ : first ? $never$ * overdue[i] : watch->age[i] + dt;
    watch->same[i] = first || moved ? $zero$ : watch->same[i] + dt;
    if (there) watch->last[i] = values[i];
    if (watch->age[i] >= dead[i] || (noisy[i] && there && watch->same[i] >= dead[i]))
      health = worse(health, $NAME$_HEALTH_DEAD);
    else if (watch->age[i] > overdue[i])
      health = worse(health, $NAME$_HEALTH_MISSING);
  }
  if (!any) health = worse(health, $NAME$_HEALTH_MISSING);
  for (i = 0; i < $n_placed$; ++i) { /* a drive beyond where it can be, for most of a second or by far */
    const $real$ value = values[placed[i]], reach = high[i] - low[i];
    const int there = is_there(value), beyond = there && (value < low[i] || value > high[i]);
    watch->outside[i] += share * (($real$)beyond - watch->outside[i]);
    if (watch->outside[i] > $half$ || (there && $abs$(value - $half$ * (low[i] + high[i])) > $far$ * reach))
      health = worse(health, $NAME$_HEALTH_DISAGREES);
  }
  for (i = 0; i < $NAME$_MEASURED; ++i) {
    const $real$ innovation = out->innovations[i];
    if (is_there(innovation)) {
      const $real$ ratio = innovation * innovation / out->innovation_variances[i];
      watch->ratio[i] += share * ((ratio < $capped$ ? ratio : $capped$) - watch->ratio[i]);
    }
    tested |= watch->ratio[i] >= $small$;
    if (watch->ratio[i] > $large$) health = worse(health, $NAME$_HEALTH_DISAGREES);
  }
  if (!tested) health = worse(health, $NAME$_HEALTH_UNTESTED);
  for (i = 0; i < $n_known$; ++i) { /* a number of the rig that left its prior */
    const int k = lasting[i];
    if ($abs$(state->carry[k] - prior_mean[i]) - root(state->carry[$n$ + k * ($n$ + 1)]) > allowed[i])
      health = worse(health, $NAME$_HEALTH_DISAGREES);
  }
  for (i = 0; i < (int)(sizeof stds / sizeof *stds); ++i)
    if (stds[i] > $unknown$ && !first) health = worse(health, $NAME$_HEALTH_DISAGREES);
  return health;
}
"""
