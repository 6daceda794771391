"""The filter as a library for Arduino and PlatformIO, with a sketch that reads encoders and analog
sensors.
"""

from __future__ import annotations

import re
from importlib.metadata import files
from math import pi
from pathlib import Path

from distal.confidence import BAND, COVERED_TEXT
from distal.errors import OutputError
from distal.export.c_text import comment, filled, sensors_of, spoken
from distal.export.filter_source import Exported, c_filter
from distal.export.project import readme, write_files
from distal.rig import Rig, log_factor, log_unit
from distal.version import __version__

SKETCH = "joint_angle"
"""Name of the example sketch and of its folder, which must be the same."""

EDITED = ("library.properties", f"examples/{SKETCH}/{SKETCH}.ino")
"""Files that a user edits; they stay as they are when the library is exported again."""


def export_arduino(
    rig: Rig,
    out: str | Path,
    estimator: str | None = None,
    *,
    name: str | None = None,
) -> Exported:
    """Write an estimator of a rig as a library for Arduino and PlatformIO, in float.

    Args:
        out: the library's folder, which is made where it does not exist. Files of an earlier export
            are replaced, except those in `EDITED`.
        estimator: name of the estimator; None: the rig's usual one.
        name: name of the library and prefix of its C names; by default it is made from the rig's
            title and the estimator.

    Raises:
        ExportError: the name is no C identifier, or the estimator cannot be written in C.
        EstimationError: the estimator cannot run on this rig.
        OutputError: the folder cannot be written, has files that no export wrote, or holds another
            library.
    """
    exported = c_filter(rig, estimator, True, name)
    texts = arduino_files(exported)
    folder = Path(out)
    for file in EDITED:
        if (folder / file).is_file():
            if f"{exported.name}.h" not in (folder / file).read_text(
                encoding="utf-8", errors="replace"
            ):
                raise OutputError(
                    f"{folder / file}: is of another library than {exported.name}; give another "
                    "folder"
                )
            del texts[file]
    write_files(folder, texts)
    return exported


def arduino_files(exported: Exported) -> dict[str, str]:
    """Return the files of a library, path → text, in the layout of the Arduino library
    specification 1.5.
    """
    rig = exported.estimator.rig
    values = {
        "name": exported.name,
        "level": COVERED_TEXT,
        "short": exported.name[:63],
        "rig": comment(rig.name),
        "estimator": exported.estimator.name,
        "version": re.match(r"\d+\.\d+\.\d+", __version__ + ".0.0")[0],  # type: ignore[index]
        "sensors": _sensors(exported),
        "prints": "".join(
            filled(
                _PRINT,
                {
                    "joint": re.sub(r"[^A-Za-z0-9 _-]", " ", field.joint),
                    "field": field.name,
                    "std": field.std,
                    "band": f"{BAND:.3g}",
                },
            )
            for field in exported.fields
            if field.unit == "rad"
        ),
        "health": [f'"{word}"' for word in spoken()],
        "micros": round(1e6 * exported.estimator.interval),
    }
    return {
        "library.properties": filled(_PROPERTIES, values),
        "LICENSE": f"For the code that `distal export-c` wrote:\n\n{_license()}",
        "README.md": readme(exported, _README),
        **{f"src/{file}": text for file, text in exported.files.items()},
        f"examples/{SKETCH}/{SKETCH}.ino": filled(_SKETCH, values),
    }


def _license() -> str:
    """Return the license of this package, which the code that it writes has too."""
    return next(file for file in files("distal") or () if file.name == "LICENSE").read_text()


def _sensors(exported: Exported) -> str:
    """Return the part of the sketch that reads the sensors: positions and angles by the counts of
    encoders, others by analog pins.

    A factor from a reading to SI that the rig does not say is an example.
    """
    texts = []
    counted = 0
    for i, sensor in enumerate(sensors_of(exported.estimator)):
        if sensor.measures in ("position", "angle"):
            template = _ENCODER
            unit = "count"
            pin = 2 + 2 * counted
            turns = sensor.si == "rad"
            factor, why = (2 * pi / 4096, "2 * pi / 4096 of a turn") if turns else (1e-5, "10 um")
            counted += 1
        else:
            template = _ANALOG
            unit = "mA"
            pin = i - counted
            factor = 1e-2
            why = f"0.01 {sensor.si}"
        why += "; SET YOURS"
        if log_unit(sensor) == unit:
            factor = sensor.sign * log_factor(sensor)
            why = f"as the rig has it, a {unit}"
        values = {
            "name": exported.name,
            "level": COVERED_TEXT,
            "i": i,
            "meaning": comment(f"{sensor.name}: {sensor.measures} of {sensor.of}"),
            "unit": sensor.si,
            "factor": f"{factor:.9g}",
            "why": why,
            "pin": pin,
            "next": pin + 1,
        }
        texts.append(filled(template, values))
    calls = "".join(f"  begin_{i}();\n" for i in range(len(texts)))
    reads = "".join(f"  values[{i}] = read_{i}();\n" for i in range(len(texts)))
    return "\n".join(
        [*texts, f"void begin_sensors() {{\n{calls}}}\n\nvoid read_sensors() {{\n{reads}}}"]
    )


_ENCODER = """\
/* $meaning$: an encoder with two channels; per count [$unit$]: $why$ */
const $name$_real PER_COUNT_$i$ = $factor$;
const int A_$i$ = $pin$, B_$i$ = $next$;
volatile long counts_$i$;
void counted_$i$() { counts_$i$ += digitalRead(A_$i$) == digitalRead(B_$i$) ? 1 : -1; }
void begin_$i$() {
  pinMode(A_$i$, INPUT_PULLUP);
  pinMode(B_$i$, INPUT_PULLUP);
  attachInterrupt(digitalPinToInterrupt(A_$i$), counted_$i$, CHANGE);
}
$name$_real read_$i$() {
  noInterrupts();
  const long counted = counts_$i$;
  interrupts();
  return PER_COUNT_$i$ * counted;
}
"""

_ANALOG = """\
/* $meaning$: a voltage at an analog pin; per step of the converter [$unit$]: $why$ */
const $name$_real PER_STEP_$i$ = $factor$;
const int ZERO_$i$ = 0; /* what the pin reads without a force */
void begin_$i$() {}
$name$_real read_$i$() { return PER_STEP_$i$ * (analogRead(A$pin$) - ZERO_$i$); }
"""

_PRINT = """
    Serial.print("$joint$ ");
    Serial.print(DEGREES * out.$field$);
    Serial.print(" +- ");
    Serial.print($band$ * DEGREES * out.$std$);
    Serial.print(" deg, ");"""

_PROPERTIES = """\
name=$short$
version=$version$
author=distal export-c
maintainer=distal export-c
sentence=Angle and standard deviation of the joints of "$rig$", without a sensor in a joint.
paragraph=A Kalman filter ($estimator$), no malloc, no globals. Written by `distal export-c`.
category=Sensors
url=https://example.org
architectures=*
includes=$name$.h
"""

_README = """
## Use it

Copy this folder into the `libraries` folder of your sketchbook, or into `lib` of a PlatformIO
project, and open the example `joint_angle`. It reads each position by an encoder and each force by
an analog pin; set the factors and pins of your board. Before you publish the library, put your own
name and page into `library.properties`.
"""

_SKETCH = """\
/* Prints the joints' angles and their $level$ bands, from sensors at the motors.
 * Written by `distal export-c`. */
#include <$name$.h>

static $name$_state state;
static $name$_watch watch;
static $name$_real values[$NAME$_CHANNELS];
static bool begun = false;
static unsigned long last_sample = 0, last_line = 0;

const unsigned long INTERVAL = $micros$; /* between samples [us], as the rig has it */
const float DEGREES = 57.2957795f;
const char* const HEALTH[] = {$health$}; /* as `distal stream` says it */

$sensors$

void setup() {
  Serial.begin(115200);
  begin_sensors();
}

void loop() {
  const unsigned long now = micros();
  if (begun && now - last_sample < INTERVAL) return;
  read_sensors();
  /* a step that takes longer than the interval makes dt longer: the filter then bridges samples
   * that were not taken */
  const $name$_real dt = begun ? 1e-6f * (now - last_sample) : 0;
  if (!begun) {
    $name$_begin(&state, values);
    $name$_watch_begin(&watch);
  }
  $name$_output out;
  int code = $name$_step(&state, dt, values, &out);
  if (code == $NAME$_GAP || code == $NAME$_LOST) { /* it begins anew where it was */
    $name$_restart(&state, values);
    $name$_watch_begin(&watch);
    code = $name$_step(&state, 0, values, &out);
  }
  begun = begun || code == $NAME$_OK;
  if (code != $NAME$_OK) return; /* a wild value: the sample is left out */
  last_sample = now;
  const int health = $name$_health(&watch, &state, dt, values, &out);
  if (now - last_line > 100000) { /* ten lines a second */
    last_line = now;$prints$
    Serial.println(HEALTH[health]);
  }
}
"""
