"""A folder with an exported filter: source, header, build file, replay program and README are
written together or not at all.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from distal.errors import ExportError, OutputError
from distal.export.c_text import checked_name, comment, filled
from distal.export.command_source import c_command
from distal.export.filter_source import Exported, c_filter
from distal.export.plant_source import c_plant
from distal.logs import check_outputs, outputs_in, write_together
from distal.rig import Rig, check_scales

MARK = "distal export-c"
"""Text that every exported file contains; a file with it may be replaced."""


def export_c(
    rig: Rig,
    out: str | Path,
    estimator: str | None = None,
    *,
    single: bool = False,
    name: str | None = None,
    home: float | None = None,
    plant: bool = False,
    command: bool = False,
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
        plant: whether the simulated rig with its sensors is written, too, as NAME_plant.
        command: whether the live inverse is written beside `adaptive`, as NAME_command; see
            `LiveInverse`.

    Raises:
        CommandError: commands are asked for, and the rig's scale of force was taken.
        ExportError: the name is no C identifier, the estimator or the plant cannot be written in C,
            or commands are asked for beside another estimator than `adaptive`.
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
    files = project_files(exported)
    if plant:
        files |= c_plant(rig, f"{exported.name}_plant").files
    if command:
        check_scales(rig, "a command in C that keeps tendons taut", "tension")
        files |= c_command(rig, f"{exported.name}_command", exported.name, exported.real).files
    write_files(folder, files)
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


def export_files(name: str, plant: bool = False, command: bool = False) -> tuple[str, ...]:
    """Return the names of the files that `export_c` writes.

    Args:
        name: prefix of all C names.
        plant: whether the simulated rig is among them.
        command: whether the live inverse is among them.

    Raises:
        ExportError: the name is no C identifier.
    """
    parts = [checked_name(name), *[f"{name}_plant"] * plant, *[f"{name}_command"] * command]
    texts = (f"{part}.{ending}" for part in parts for ending in "hc")
    return (*texts, "replay.c", "CMakeLists.txt", "README.md")


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


def project_files(exported: Exported) -> dict[str, str]:
    """Return the files of an exported filter: name → text."""
    return exported.files | {
        "replay.c": exported.replay,
        "CMakeLists.txt": _CMAKE.replace("$name$", exported.name),
        "README.md": readme(exported, _REPLAY),
    }


def readme(exported: Exported, use: str) -> str:
    """Return the README of an exported filter: how to call it, and what it takes of memory and
    time.

    Args:
        use: template of the last part, which says what to do with the files.
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
    return filled(_README + use, values)


_CMAKE = """\
# Written by `distal export-c`
cmake_minimum_required(VERSION 3.13)
project($name$ C)

set(CMAKE_C_STANDARD 99)
set(CMAKE_C_EXTENSIONS OFF)
if(NOT CMAKE_BUILD_TYPE)
  set(CMAKE_BUILD_TYPE Release)
endif()

add_library($name$ STATIC $name$.c)
target_include_directories($name$ PUBLIC ${CMAKE_CURRENT_SOURCE_DIR})
# square roots need no errno: without it they are one instruction
target_compile_options($name$ PRIVATE -Wall -Wextra -fno-math-errno)

if(UNIX)
  target_link_libraries($name$ PUBLIC m)
endif()

# the replay program only where this is the whole project, on the machine that it runs on
if(NOT CMAKE_CROSSCOMPILING AND CMAKE_SOURCE_DIR STREQUAL CMAKE_CURRENT_SOURCE_DIR)
  add_executable(replay replay.c)
  target_link_libraries(replay $name$)
endif()
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

_REPLAY = """\

## Replay a log

```sh
cmake -B build && cmake --build build
build/replay log.csv > angle.csv
```

`log.csv` has the columns that `distal estimate` reads, separated by commas, without quotes; an
empty cell is a missing value. Without CMake:
`cc -std=c99 -O2 -fno-math-errno replay.c $name$.c -lm -o replay`.
"""
