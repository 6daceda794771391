"""A folder with an exported filter: source, header, build file, replay program and README, all or none."""

from __future__ import annotations

from pathlib import Path

from distal.errors import ExportError, OutputError
from distal.export.source import Exported, c_filter
from distal.logs import write_whole
from distal.rig import Rig


def export_c(
    rig: Rig, out: str | Path, estimator: str = "adaptive", single: bool = False, name: str | None = None
) -> Exported:
    """Write an estimator of a rig as C99 to a folder.

    Args:
        rig: the description.
        out: the folder; made if it is not there. Files of the same names are replaced, others left.
        estimator: its name.
        single: float and float functions only, else double.
        name: prefix of all names; default from the rig's title and the estimator.

    Raises:
        ExportError: the name is no C identifier, or the estimator has no C.
        EstimationError: the estimator cannot run on this rig.
        OutputError: the folder cannot be written.
    """
    made, folder = c_filter(rig, estimator, single, name), Path(out)
    if folder.exists() and not folder.is_dir():
        raise OutputError(f"{folder}: is a file; give the name of a folder")
    files = project_files(made)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise OutputError(f"{folder}: cannot be made ({problem.strerror})") from None
    for file in files:
        if (folder / file).is_dir():
            raise OutputError(f"{folder / file}: is a folder; move it away, a file of this name is to be written")
    for file, text in files.items():
        write_whole(folder / file, text.encode())
    return made


def project_files(made: Exported) -> dict[str, str]:
    """Return the files of a project, name → text.

    Args:
        made: the filter.
    """
    if made.name in ("replay",):
        raise ExportError("'replay' is the name of the program beside the filter; give another one (--name)")
    return {
        f"{made.name}.h": made.header,
        f"{made.name}.c": made.source,
        "replay.c": made.replay,
        "CMakeLists.txt": _CMAKE.replace("$name$", made.name),
        "README.md": readme(made),
    }


def readme(made: Exported) -> str:
    """Return what a user of the filter should know.

    Args:
        made: the filter.
    """
    kind, size = ("float", 4) if made.single else ("double", 8)
    calls = ", ".join(f"{count} {name}{'f' if made.single else ''}" for name, count in made.library.items()) or "none"
    return (
        _README.replace("$name$", made.name)
        .replace("$NAME$", made.name.upper())
        .replace("$rig$", made.rig)
        .replace("$estimator$", made.estimator)
        .replace("$real$", kind)
        .replace("$channels$", "\n".join(f"| {i} | `{channel}` |" for i, channel in enumerate(made.channels)))
        .replace("$n_states$", str(len(made.states)))
        .replace("$state_bytes$", f"{made.state_bytes:,}")
        .replace("$scratch_bytes$", f"{made.scratch_bytes:,}")
        .replace("$carry$", f"{made.carry} x {size}")
        .replace("$operations$", f"{made.operations:,}")
        .replace("$calls$", calls)
    )


_CMAKE = """\
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

if(NOT CMAKE_CROSSCOMPILING)
  add_executable(replay replay.c)
  target_link_libraries(replay $name$ m)
endif()
"""

_README = """\
# $name$

`$estimator$` for the rig "$rig$", in C99 with `$real$`. No malloc, no globals: the caller owns the state.

```c
#include "$name$.h"

static $name$_state state;

/* once, with the first sample */
$name$_begin(&state, values);
$name$_step(&state, 0, values, &out);

/* then for every sample, dt seconds after the one before */
if ($name$_step(&state, dt, values, &out) != $NAME$_OK) { /* see the header */ }
/* out.angle +- 1.96 out.angle_std [rad] */
```

| | values, SI, NAN where missing |
|---|---|
$channels$

`values` may lack any sensor at any time. A gap is bridged by one prediction per nominal interval, and takes that
many times as long as a step; `$NAME$_LATE` says that a stamp did not rise, and nothing is changed.

| | |
|---|---|
| states | $n_states$ |
| state, the caller's | $state_bytes$ bytes ($carry$ and a counter) |
| arrays on the stack in a step | $scratch_bytes$ bytes, and what the compiler spills |
| arithmetic operations in a step | $operations$ |
| calls of the mathematics library in a step | $calls$ |

## Replay a log

```sh
cmake -B build && cmake --build build
build/replay log.csv > angle.csv     # the CSV that `distal estimate` reads
```

Or without CMake: `cc -std=c99 -O2 -fno-math-errno replay.c $name$.c -lm -o replay`.
"""
