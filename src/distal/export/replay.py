"""The program beside an exported filter: it runs over the same CSV files as `distal estimate`."""

from __future__ import annotations

import json

from distal.estimators import KernelEstimator
from distal.rig import log_factor
from distal.units import unit_factor


def replay_program(runner: KernelEstimator, name: str) -> str:
    """Return a C program that reads a log and writes t, theta and theta_std.

    Args:
        runner: the estimator.
        name: prefix of the filter's names.
    """
    sensors = {sensor.name: sensor for sensor in runner.rig.sensors}
    read = [sensors[channel] for channel in runner.channels]
    columns = [runner.rig.log.time.column, *(sensor.log_column for sensor in read)]
    factors = [unit_factor(runner.rig.log.time.unit, "s"), *(sensor.sign * log_factor(sensor) for sensor in read)]
    return (
        _PROGRAM.replace("$name$", name)
        .replace("$NAME$", name.upper())
        .replace("$columns$", ", ".join(json.dumps(column) for column in columns))
        .replace("$factors$", ", ".join(f"{factor:.17g}" for factor in factors))
    )


_PROGRAM = """\
/* replay LOG.csv: run the filter over a log with the columns that the rig names; t, theta, theta_std on stdout.
 *
 * What a sample needs is in main(): values in the header's order and units, NAN where one is missing. The rest reads CSV.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "$name$.h"

#define COLUMNS (1 + $NAME$_CHANNELS)

static const char* const columns[COLUMNS] = {$columns$};
static const double factors[COLUMNS] = {$factors$}; /* to SI, with the sensor's sign */

/* Cut the next cell off a line; NULL at its end. */
static char* cell(char** rest) {
  char* start = *rest;
  if (!start) return NULL;
  start[strcspn(start, "\\r\\n")] = 0;
  *rest = strchr(start, ',');
  if (*rest) *(*rest)++ = 0;
  return start;
}

int main(int argc, char** argv) {
  static char line[65536];
  static $name$_state state;
  int at[COLUMNS], i, k, begun = 0;
  double now[COLUMNS], before = 0.0, first[COLUMNS];
  long row = 1;
  char *rest = line, *text;
  FILE* log = argc == 2 ? fopen(argv[1], "r") : NULL;
  if (!log || !fgets(line, sizeof line, log)) {
    fprintf(stderr, "usage: %s LOG.csv (with a header; it must be readable)\\n", argv[0]);
    return 2;
  }
  for (i = 0; i < COLUMNS; ++i) at[i] = -1;
  for (k = 0; (text = cell(&rest)); ++k)
    for (i = 0; i < COLUMNS; ++i)
      if (!strcmp(text, columns[i])) at[i] = k;
  for (i = 0; i < COLUMNS; ++i)
    if (at[i] < 0) {
      fprintf(stderr, "%s: column '%s' is missing\\n", argv[1], columns[i]);
      return 2;
    }
  /* the first value of each channel fills what has no prior, as when a whole log is estimated */
  for (i = 0; i < COLUMNS; ++i) first[i] = NAN;
  for (begun = 0; begun < 2; ++begun) {
    if (begun) {
      $name$_real values[$NAME$_CHANNELS];
      for (i = 1; i < COLUMNS; ++i) values[i - 1] = ($name$_real)first[i];
      $name$_begin(&state, values);
      printf("t,theta,theta_std\\n");
    }
    rewind(log);
    for (row = 1; fgets(line, sizeof line, log); ++row) {
      if (row == 1) continue;
      rest = line;
      for (i = 0; i < COLUMNS; ++i) now[i] = NAN;
      for (k = 0; (text = cell(&rest)); ++k)
        for (i = 0; i < COLUMNS; ++i)
          if (at[i] == k) {
            char* end;
            const double value = strtod(text, &end);
            if (end != text && *end == 0) now[i] = value * factors[i];
          }
      if (!begun) {
        for (i = 0; i < COLUMNS; ++i)
          if (isnan(first[i])) first[i] = now[i];
        continue;
      }
      {
        $name$_real values[$NAME$_CHANNELS];
        $name$_output out;
        int code;
        for (i = 1; i < COLUMNS; ++i) values[i - 1] = ($name$_real)now[i];
        code = $name$_step(&state, ($name$_real)(row == 2 ? 0.0 : now[0] - before), values, &out);
        if (code) {
          fprintf(stderr, "%s: row %ld: code %d, see $name$.h\\n", argv[1], row, code);
          return 1;
        }
        before = now[0];
        printf("%.17g,%.17g,%.17g\\n", now[0], (double)out.angle, (double)out.angle_std);
      }
    }
  }
  fclose(log);
  return 0;
}
"""
