"""The lab's WebAssembly: plant, sensors and filters of a rig as exported C, joined by a few
functions.
"""

from __future__ import annotations

import importlib.util
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from distal.codegen import Plain
from distal.errors import EstimationError, ExportError
from distal.estimators import make_estimator
from distal.export import Exported, c_filter
from distal.export.command_source import ExportedCommand, c_command
from distal.export.names import angle_fields, filled, torque_fields
from distal.export.plant_source import ExportedPlant, c_plant
from distal.rig import Rig, std_name


@dataclass(frozen=True)
class LabModule:
    """The plant and the filters of a rig as one WebAssembly module.

    Args:
        code: the module's binary code.
        plant: the exported plant.
        filter: the exported filter.
        outputs: names of the numbers that `lab_step` leaves in the array of the estimates, in
            order.
        inextensible: whether the angles of an estimator with inextensible tendons are among them.
        commanded: indices of the joints that it can bring to desired angles; empty where the filter
            is not `adaptive`.
    """

    code: bytes
    plant: ExportedPlant
    filter: Exported
    outputs: tuple[str, ...]
    inextensible: bool
    commanded: tuple[int, ...]


def check_ziglang() -> None:
    """Raise an `ExportError` where ziglang, which compiles WebAssembly, is not installed."""
    if importlib.util.find_spec("ziglang") is None:
        raise ExportError("the lab is compiled to WebAssembly by ziglang; pip install '.[lab]'")


def lab_module(rig: Rig, estimator: str) -> LabModule:
    """Return the plant, sensors and filters of a rig as a WebAssembly module; the plant begins with
    the rig's parameters.

    Args:
        estimator: name of the filter.

    Raises:
        ExportError: ziglang is not installed or failed, or the plant or the filter cannot be
            written in C.
        EstimationError: the estimator cannot run on this rig.
    """
    check_ziglang()
    plant = c_plant(rig, "plant")
    filter_ = c_filter(rig, estimator, name="filter")
    try:
        plain: Exported | None = c_filter(rig, "inextensible", name="plain")
    except EstimationError:
        plain = None  # it needs the positions of the drives
    command = c_command(rig, "command", "filter", Plain()) if estimator == "adaptive" else None
    chosen = make_estimator(estimator, rig, compiled=False)
    pairs = [
        *angle_fields(rig),
        *((field, std_name(field)) for _, field in torque_fields(chosen)),
    ]
    names = [*(field for pair in pairs for field in pair), "health"]
    fields = [f"out.{field}" for field in names[:-1]]
    if plain is not None:
        names += [f"plain_{field}" for field, _ in angle_fields(rig)]
    source = filled(
        _GLUE,
        {
            "told": "\n".join(f"  told[{i}] = {field};" for i, field in enumerate(fields)),
            "n_told": str(len(names)),
            "health": str(len(fields)),
            "channels": _channels(plant, filter_),
            "plain": _plain(rig, plain, plant, len(fields) + 1),
            "include_plain": '#include "plain.h"' if plain is not None else "",
            "command": _COMMAND if command is not None else _NO_COMMAND,
            "include_command": '#include "command.h"' if command is not None else "",
        },
    )
    files = {"lab.c": source}
    exports: list[Exported | ExportedPlant | ExportedCommand] = [plant, filter_]
    exports += [export for export in (plain, command) if export is not None]
    for export in exports:
        files |= {f"{export.name}.h": export.header, f"{export.name}.c": export.source}
    return LabModule(
        _compiled(files),
        plant,
        filter_,
        tuple(names),
        plain is not None,
        command.joints if command else (),
    )


def _plain(rig: Rig, plain: Exported | None, plant: ExportedPlant, at: int) -> str:
    """Return the C code that estimates with inextensible tendons, or that does nothing where this
    is not possible.
    """
    if plain is None:
        return "static void follow(int begins) { (void)begins; }"
    outputs = "\n".join(
        f"  told[{at + i}] = out.{field};" for i, (field, _) in enumerate(angle_fields(rig))
    )
    return filled(_PLAIN, {"channels": _channels(plant, plain), "told": outputs})


def _channels(plant: ExportedPlant, exported: Exported) -> str:
    """Return the indices of the plant's sensors that a filter reads, as the values of an array in
    C.
    """
    return ", ".join(str(plant.sensors.index(channel)) for channel in exported.channels)


def _compiled(files: dict[str, str]) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        for name, text in files.items():
            Path(folder, name).write_text(text, encoding="utf-8")
        command = [
            sys.executable,
            "-m",
            "ziglang",
            "cc",
            "-target",
            "wasm32-wasi",
            "-Os",
            "-s",
            "-std=c99",
        ]
        command += ["-mexec-model=reactor", "-fno-math-errno", "-ffp-contract=off"]
        command += [*sorted(name for name in files if name.endswith(".c")), "-lm", "-o", "lab.wasm"]
        try:
            done = subprocess.run(
                command, cwd=folder, capture_output=True, text=True, errors="replace", timeout=600
            )
        except (OSError, subprocess.SubprocessError) as problem:
            raise ExportError(f"ziglang did not run ({type(problem).__name__})") from None
        if done.returncode != 0:
            lines = done.stderr.strip().splitlines() or ["no message"]
            raise ExportError(
                f"ziglang failed: {next((line for line in lines if 'error' in line), lines[0])}"
            )
        return Path(folder, "lab.wasm").read_bytes()


_PLAIN = """\
static plain_state plain;
static const unsigned char plain_channels[] = {$channels$};

static void follow(int begins) {
  plain_real own[PLAIN_CHANNELS];
  plain_output out;
  int i;
  for (i = 0; i < PLAIN_CHANNELS; ++i) own[i] = values[plain_channels[i]];
  if (begins) plain_begin(&plain, own);
  if (plain_step(&plain, begins ? 0 : PLANT_INTERVAL, own, &out)) return;
$told$
}"""

_COMMAND = """\
static command_state command;
static command_output commands;
static double desired[COMMAND_JOINTS];

static void bring(int begins, double dt, const filter_real* own, const filter_output* out,
                  int trusted) {
  if (begins) command_begin(&command);
  command_step(&command, &filter, dt, own, out, desired, trusted, &commands);
}

void* EXPORTED(lab_desired)(void) { return desired; }
void* EXPORTED(lab_commanded)(void) { return commands.positions; }
"""

_NO_COMMAND = """\
static void bring(int begins, double dt, const filter_real* own, const filter_output* out,
                  int trusted) {
  (void)begins, (void)dt, (void)own, (void)out, (void)trusted;
}
"""

_GLUE = """\
/* The lab: the plant moves, its sensors are read, dead ones left out, and the filters take the
 * sample. */
#include <math.h>

#include "filter.h"
#include "plant.h"
$include_plain$
$include_command$

#define EXPORTED(name) __attribute__((export_name(#name))) name

static plant_state plant;
static plant_pull pull;
static filter_state filter;
static filter_watch watch;
static double values[PLANT_SENSORS], told[$n_told$];
static unsigned char dead[PLANT_SENSORS];
static const unsigned char channels[] = {$channels$};

$plain$
$command$
static void estimate(int begins) {
  filter_real own[FILTER_CHANNELS];
  filter_output out;
  double dt = begins ? 0.0 : PLANT_INTERVAL;
  int i, code;
  for (i = 0; i < PLANT_SENSORS; ++i)
    if (dead[i]) values[i] = NAN;
  for (i = 0; i < FILTER_CHANNELS; ++i) own[i] = values[channels[i]];
  if (begins) filter_begin(&filter, own), filter_watch_begin(&watch);
  code = filter_step(&filter, dt, own, &out);
  if (code == FILTER_OK) {
    told[$health$] = filter_health(&watch, &filter, dt, own, &out);
  } else if (code != FILTER_BAD) {
    filter_restart(&filter, own);
    filter_watch_begin(&watch);
    filter_step(&filter, 0, own, &out);
    told[$health$] = FILTER_HEALTH_RESTARTED;
  }
  if (code != FILTER_BAD) bring(begins, dt, own, &out, told[$health$] < FILTER_HEALTH_DEAD);
$told$
  follow(begins);
}

void EXPORTED(lab_begin)(unsigned seed) {
  plant_begin(&plant, seed, values);
  estimate(1);
}

/* 0 if the motion left all bounds */
int EXPORTED(lab_step)(void) {
  const int moved = plant_step(&plant, &pull, values);
  estimate(0);
  return moved;
}

void* EXPORTED(lab_numbers)(void) { return plant.numbers; }
void* EXPORTED(lab_pull)(void) { return &pull; }
void* EXPORTED(lab_truth)(void) { return &plant.truth; }
void* EXPORTED(lab_values)(void) { return values; }
void* EXPORTED(lab_dead)(void) { return dead; }
void* EXPORTED(lab_told)(void) { return told; }
"""
