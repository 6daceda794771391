"""A program that runs an exported filter over the CSV files that `distal estimate` reads:
`python replay.py RIG NAME [ESTIMATOR]` prints it for a filter of this name.
"""

from __future__ import annotations

import sys

from distal import load_rig
from distal.estimators import KernelEstimator, make_estimator, usual_estimator
from distal.export.c_source import fields_of, filled, sensors_of
from distal.logs import LARGEST_READING, header
from distal.rig import log_factor, log_unit, std_name
from distal.units import unit_factor


def replay_program(estimator: KernelEstimator, name: str) -> str:
    """Return the text of a C program that reads a log and writes stamps, angles and external
    torques with their standard deviations.

    Args:
        name: prefix of the filter's C names.
    """
    time = estimator.rig.log.time
    read = sensors_of(estimator)
    columns = [
        (time.column, time.unit, unit_factor(time.unit, "s")),
        *((s.log_column, log_unit(s), s.sign * log_factor(s)) for s in read),
    ]
    fields = fields_of(estimator)
    names = [
        header(column, field.unit)
        for field in fields
        for column in (field.column, std_name(field.column))
    ]
    values = {
        "header": ",".join([header("t", "s"), *names]),
        "format": ",".join(["%.17g"] * (1 + len(names))),
        "fields": [f"(double)out.{part}" for field in fields for part in (field.name, field.std)],
        "wild": LARGEST_READING,
        "name": name,
        "columns": [c_string(column) for column, _, _ in columns],
        "headers": [c_string(header(column, unit)) for column, unit, _ in columns],
        # a log may lack the angle at which a joint homes
        "needed": [1, *(sensor.measures != "angle" for sensor in read)],
        "factors": [factor for _, _, factor in columns],
    }
    return filled(_PROGRAM, values)


def c_string(text: str) -> str:
    """Return a text as a C string literal; bytes other than plain characters are escaped."""
    plain = (
        chr(b) if 32 <= b < 127 and chr(b) not in '"\\?' else f"\\{b:03o}" for b in text.encode()
    )
    return f'"{"".join(plain)}"'


_PROGRAM = """\
/* replay LOG.csv: run the filter over a log with the columns that the rig names;
 * $header$ on stdout.
 *
 * What a sample needs is in take(): values in the header's order and
 * units, NAN where one is missing. The rest reads CSV: commas, no quotes, an empty cell is missing.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "$name$.h"

#define COLUMNS (1 + $NAME$_CHANNELS)

static const char* const columns[COLUMNS] = {$columns$};
/* the same, where the header says the unit */
static const char* const headers[COLUMNS] = {$headers$};
static const double factors[COLUMNS] = {$factors$}; /* to SI, with the sensor's sign */
/* the others are missing at all times where there is no such column */
static const char needed[COLUMNS] = {$needed$};

/* Cut the next cell off a line; NULL at its end. */
static char* cell(char** rest) {
  char* start = *rest;
  if (!start) return NULL;
  *rest = strchr(start, ',');
  if (*rest) *(*rest)++ = 0;
  return start;
}

/* Read the next row and cut off its end; NULL at the end of the file. */
static char* next_row(FILE* log) {
  static char line[1 << 20];
  if (!fgets(line, sizeof line, log)) return NULL;
  line[strcspn(line, "\\r\\n")] = 0;
  return line;
}

static int fail(const char* file, long row, const char* what, const char* which) {
  fprintf(stderr, "%s: row %ld: %s%s\\n", file, row, what, which);
  return 1;
}

/* One sample, now[0] being its stamp; the first has no stamp before. */
static int take($name$_state* state, const double* now, double before, $name$_output* out) {
  $name$_real values[$NAME$_CHANNELS];
  int i;
  for (i = 1; i < COLUMNS; ++i) values[i - 1] = ($name$_real)now[i];
  return $name$_step(state, ($name$_real)(isnan(before) ? 0.0 : now[0] - before), values, out);
}

int main(int argc, char** argv) {
  static $name$_state state;
  int at[COLUMNS], i, k, width, pass;
  double now[COLUMNS], before = (double)NAN, first[COLUMNS];
  long row;
  char *rest = NULL, *text, *end;
  FILE* log = argc == 2 ? fopen(argv[1], "r") : NULL;
  if (log) rest = next_row(log);
  if (!rest) {
    fprintf(stderr, "usage: %s LOG.csv (with a header; it must be readable)\\n", argv[0]);
    return 2;
  }
  for (i = 0; i < COLUMNS; ++i) at[i] = -1;
  for (width = 0; (text = cell(&rest)); ++width)
    for (i = 0; i < COLUMNS; ++i)
      if (!strcmp(text, columns[i]) || !strcmp(text, headers[i])) at[i] = width;
  for (i = 0; i < COLUMNS; ++i)
    if (at[i] < 0 && needed[i]) return 1 + fail(argv[1], 1, "a column is missing: ", columns[i]);
  /* the first value of each channel fills what has no prior, as when a whole log is estimated */
  for (i = 0; i < COLUMNS; ++i) first[i] = now[i] = (double)NAN;
  for (pass = 0; pass < 2; ++pass) {
    if (pass) {
      $name$_real values[$NAME$_CHANNELS];
      for (i = 1; i < COLUMNS; ++i) values[i - 1] = ($name$_real)first[i];
      $name$_begin(&state, values);
      printf("$header$\\n");
    }
    rewind(log);
    for (row = 1; (rest = next_row(log)); ++row) {
      if (row == 1 || !*rest) continue;
      for (k = 0; (text = cell(&rest)); ++k)
        for (i = 0; i < COLUMNS; ++i)
          if (at[i] == k) {
            now[i] = *text ? strtod(text, &end) * factors[i] : (double)NAN;
            if (*text && (*end || isinf(now[i])))
              return fail(argv[1], row, "not a number: ", text);
            if (i && fabs(now[i]) > $wild$) now[i] = (double)NAN; /* a wild value is missing */
          }
      if (k != width) return fail(argv[1], row, "more or fewer cells than the header", "");
      if (!pass) {
        for (i = 0; i < COLUMNS; ++i)
          if (isnan(first[i])) first[i] = now[i];
      } else {
        $name$_output out;
        const int code = take(&state, now, before, &out);
        if (code == $NAME$_LATE)
          return fail(argv[1], row, "the stamp repeats, goes back, or is missing", "");
        if (code == $NAME$_GAP)
          return fail(argv[1], row, "the gap before is too long to bridge", "");
        if (code != $NAME$_OK)
          return fail(argv[1], row, "the filter left all bounds; are the units right?", "");
        before = now[0];
        printf("$format$\\n", now[0], $fields$);
      }
    }
  }
  fclose(log);
  return 0;
}
"""


if __name__ == "__main__":
    rig, name, *chosen = sys.argv[1:]
    described = load_rig(rig)
    used = make_estimator(chosen[0] if chosen else usual_estimator(described), described)
    sys.stdout.write(replay_program(used, name))
