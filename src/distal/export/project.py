"""A folder with an exported filter: source, header and README are written together, or none."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from distal.errors import ExportError, OutputError
from distal.export.command_source import c_command
from distal.export.filter_source import Exported, c_filter, checked_name, comment, filled
from distal.logs import check_outputs, outputs_in, write_together
from distal.rig import Rig, check_scales

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
    if command and exported.estimator.name != "adaptive":
        raise ExportError(
            f"commands are by the state of adaptive, {exported.estimator.name} has another; leave "
            "command out"
        )
    texts = exported.files
    if command:
        check_scales(rig, "a command in C that keeps tendons taut", "tension")
        texts |= c_command(rig, f"{exported.name}_command", exported.name, exported.real).files
    files = {f"src/{file}" if arduino else file: text for file, text in texts.items()}
    if arduino and not (folder / PROPERTIES).is_file():
        values = {"name": exported.name, "short": exported.name[:63], "rig": comment(rig.name)}
        files[PROPERTIES] = filled(_PROPERTIES, values)
    write_files(folder, files | {"README.md": readme(exported)})
    return exported


def write_files(folder: Path, files: Mapping[str, str]) -> None:
    """Write files to a folder, all or none; missing folders are made.

    Args:
        files: path below the folder → text.

    Raises:
        OutputError: the folder cannot be written, or has a file that no export wrote.
    """
    check_outputs(outputs_in(folder, files, "the export"))
    check_ours(folder, files)
    try:
        for file in files:
            (folder / file).parent.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise OutputError(f"{folder}: cannot be written ({problem.strerror})") from None
    write_together({folder / file: text for file, text in files.items()})


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
