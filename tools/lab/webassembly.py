"""The lab's WebAssembly: plant, sensors and filters of a rig as exported C, joined by a few
functions.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

from distal.codegen import Plain
from distal.errors import EstimationError, ExportError
from distal.export import Exported, c_filter
from distal.export.c_source import c_command, filled
from distal.kernels.compiler import CompileError, run_compiler, zig_compiler
from distal.model import Mechanism
from distal.rig import Rig
from tools.lab.plant_source import ExportedPlant, c_plant


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


def check_ziglang() -> list[str]:
    """Return the command that compiles WebAssembly.

    Raises:
        ExportError: ziglang, which has it, is not installed.
    """
    command = zig_compiler("wasm32-wasi")
    if command is None:
        raise ExportError("the lab is compiled to WebAssembly by ziglang; pip install '.[lab]'")
    return command


def lab_module(rig: Rig, estimator: str | None) -> LabModule:
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
    command = (
        c_command(rig, "command", "filter", Plain())
        if filter_.estimator.name == "adaptive"
        else None
    )
    outputs = [part for field in filter_.fields for part in (field.name, field.std)]
    angles = [field.name for field in plain.fields] if plain is not None else []
    values = {
        "told": _assigned(outputs, 0),
        "n_told": len(outputs) + 1 + len(angles),
        "health": len(outputs),
        "channels": _channels(rig, filter_),
        "plain_told": _assigned(angles, len(outputs) + 1),
        "plain_channels": _channels(rig, plain) if plain is not None else [],
    }
    exports = [text for text in (plant, filter_, plain, command) if text is not None]
    values["includes"] = "\n".join(f'#include "{export.name}.h"' for export in exports)
    files = {"lab.c": filled(_GLUE, values)}
    for export in exports:
        files |= export.files
    return LabModule(
        _compiled(files),
        plant,
        filter_,
        (*outputs, "health", *(f"plain_{angle}" for angle in angles)),
        plain is not None,
        tuple(Mechanism(rig).free) if command else (),
    )


def _channels(rig: Rig, exported: Exported) -> list[int]:
    """Return the indices of the plant's sensors that a filter reads."""
    return [rig.sensor_names.index(channel) for channel in exported.estimator.channels]


def _assigned(fields: list[str], first: int) -> str:
    """Return C that tells the numbers of an output, from an index on."""
    return "\n".join(f"  told[{first + i}] = out.{field};" for i, field in enumerate(fields))


def _compiled(files: dict[str, str]) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        for name, text in files.items():
            Path(folder, name).write_text(text, encoding="utf-8")
        options = (
            "-Os -std=c99 -mexec-model=reactor -fno-math-errno -ffp-contract=off -lm -o lab.wasm"
        )
        sources = sorted(name for name in files if name.endswith(".c"))
        try:
            run_compiler([*check_ziglang(), *sources, *options.split()], folder)
        except CompileError as problem:
            raise ExportError(f"ziglang: {problem}") from None
        return Path(folder, "lab.wasm").read_bytes()


_GLUE = """\
/* The lab: the plant moves, its sensors are read, dead ones left out, and the filters take the
 * sample. */
#include <math.h>

$includes$

#define EXPORTED(name) __attribute__((export_name(#name))) name

static plant_state plant;
static plant_pull pull;
static filter_state filter;
static filter_watch watch;
static double values[PLANT_SENSORS], told[$n_told$];
static unsigned char dead[PLANT_SENSORS];
static const unsigned char channels[] = {$channels$};

/* what inextensible tendons would say */
static void follow(int begins) {
#ifdef PLAIN_H
  static plain_state plain;
  static const unsigned char plain_channels[] = {$plain_channels$};
  plain_real own[PLAIN_CHANNELS];
  plain_output out;
  int i;
  for (i = 0; i < PLAIN_CHANNELS; ++i) own[i] = values[plain_channels[i]];
  if (begins) plain_begin(&plain, own);
  if (plain_step(&plain, begins ? 0 : PLANT_INTERVAL, own, &out)) return;
$plain_told$
#else
  (void)begins;
#endif
}

#ifdef COMMAND_H
static command_state command;
static command_output commands;
static double desired[COMMAND_JOINTS];

void* EXPORTED(lab_desired)(void) { return desired; }
void* EXPORTED(lab_commanded)(void) { return commands.positions; }
#endif

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
#ifdef COMMAND_H
  if (begins) command_begin(&command);
  if (code != FILTER_BAD)
    command_step(&command, &filter, dt, own, &out, desired, told[$health$] < FILTER_HEALTH_DEAD,
                 &commands);
#endif
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
