"""The live inverse in C against Python's, in double and in float."""

from __future__ import annotations

import ctypes
from pathlib import Path

import numpy as np
import pytest

from distal import LiveInverse, Rig, load_rig, simulate
from distal.errors import ExportError
from distal.export import export_c
from distal.inverse.motor_safety import OLDEST
from distal.run import samples_of
from tests.export.helpers import needs_compiler, shared_library

GLUE = """
#include "f_command.h"
static f_state filter; static f_command_state state; static int begun, stands;
int commanded(double dt, const f_real* values, const f_real* desired, int trusted, f_command_output* commands) {
  f_output out;
  int code;
  if (!begun) { f_begin(&filter, values); f_command_begin(&state); }
  code = f_step(&filter, (f_real)dt, values, &out);
  begun = 1;
  stands = f_command_step(&state, &filter, (f_real)dt, values, &out, desired, trusted, commands);
  return code;
}
int code_of_command(void) { return stands; }
"""


def built(rig: Rig, tmp_path: Path, single: bool) -> ctypes.CDLL:
    """Return the filter and the commands of a rig, compiled."""
    export_c(rig, tmp_path, single=single, name="f", command=True)
    texts = {file: (tmp_path / file).read_text() for file in ("f.c", "f_command.c")}
    strict = ["-O1", "-Wpedantic", *(["-Wdouble-promotion"] if single else [])]
    return shared_library({**texts, "glue.c": GLUE}, tmp_path, strict)


def commanded(
    rig: Rig, folder: Path, single: bool, time: np.ndarray, *rows: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the codes of commands in C, and positions, speeds and forces, (samples, 3, drives).

    Args:
        rows: samples, desired angles, and whether estimates are trusted.
    """
    real, library = np.float32 if single else np.float64, built(rig, folder, single)
    found, codes = np.zeros((len(time), 3, len(rig.drives)), dtype=real), []
    for dt, made, sample, desired, trusted in zip(
        np.diff(time, prepend=time[0]), found, *(np.asarray(each, dtype=real) for each in rows)
    ):
        arrays = (ctypes.c_void_p(array.ctypes.data) for array in (sample, desired, made))
        sample_at, desired_at, made_at = arrays
        code = library.commanded(ctypes.c_double(dt), sample_at, desired_at, int(trusted), made_at)
        assert code == 0
        codes.append(library.code_of_command())
    return np.array(codes), found


@needs_compiler
@pytest.mark.parametrize(
    ("name", "scenario", "single", "near"),
    [
        ("paper-2008-observed", "series-2", True, 2e-5),
        ("finger-2n", "finger", False, 1e-9),
        ("paper-2008-observed", "series-2", False, 1e-9),
    ],
)
def test_c_says_what_python_says(
    name: str, scenario: str, single: bool, near: float, tmp_path: Path
) -> None:
    """The same places [m]; a wanted angle that is missing, a value that is, and an estimate that is
    not trusted.
    """
    rig = load_rig(name)
    log, inverse = simulate(rig, scenario).select(slice(0, 60)), LiveInverse(rig, compiled=False)
    samples, nj = samples_of(log, inverse.channels), len(inverse.joints)
    samples[20:25, 0] = np.nan
    desired = np.tile(0.2 + 0.1 * np.sin(0.1 * np.arange(60))[:, None], nj)
    desired[::7] = np.nan
    known = [
        inverse.step(float(time - log.time[0]), want, sample)
        for time, want, sample in zip(log.time, desired, samples)
    ]
    trusted = np.array([one.reading.health not in ("bad", "dead") for one in known])
    _, found = commanded(rig, tmp_path, single, log.time, samples, desired, trusted)
    for k, (what, scale) in enumerate((("positions", 1), ("speeds", 500), ("forces", 5000))):
        expected = [getattr(one, what) for one in known]
        np.testing.assert_allclose(found[:, k], expected, rtol=0, atol=near * scale)


@needs_compiler
def test_c_sends_nothing_before_drives_are_read_and_stands_where_they_are_lost(
    tmp_path: Path,
) -> None:
    rig = load_rig("paper-2008-observed")
    log, inverse = simulate(rig, "series-2").select(slice(0, 200)), LiveInverse(rig, compiled=False)
    samples, moving = samples_of(log, inverse.channels), rig.sensors_of("position")[0]
    samples[np.r_[0, 100:160], inverse.channels.index(moving.name)] = np.nan
    desired = 0.3 * np.sin(0.05 * np.arange(200))[:, None]
    codes, found = commanded(rig, tmp_path, False, log.time, samples, desired, np.ones(200))
    positions = found[:, 0, rig.drive_names.index(moving.of)]
    assert codes[0] == 2
    assert np.isnan(found[0]).all()
    lost = 100 + round(OLDEST / (log.time[1] - log.time[0]))
    assert not codes[1 : lost - 1].any()
    assert codes[lost + 1 : 160].all()
    assert np.ptp(positions[lost + 1 : 160]) == 0.0
    assert not codes[160:].any()
    assert np.abs(np.diff(positions[1:])).max() < 3 * np.abs(np.diff(positions[1:100])).max()


def test_commands_are_for_adaptive(tmp_path: Path) -> None:
    with pytest.raises(ExportError, match="commands are by the state of adaptive"):
        export_c(load_rig("paper-2008"), tmp_path, "inextensible", command=True)
    assert not list(tmp_path.iterdir())
