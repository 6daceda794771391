"""The live inverse in C against Python's, in double and in float."""

from __future__ import annotations

import ctypes
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from distal import LiveInverse, Rig, load_rig, simulate
from distal.codegen import Plain
from distal.errors import ExportError
from distal.export import export_c
from distal.export.c_source import c_command, c_filter
from distal.inverse.goal_gate import USUAL
from tests.export.helpers import CC, missing_tools, shared_library
from tests.export.test_microcontroller import cases, measure

needs_compiler = pytest.mark.skipif(isinstance(CC, str), reason="no C compiler")

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


@needs_compiler
@pytest.mark.parametrize(
    ("name", "scenario", "single", "near"),
    [
        ("paper-2008-observed", "series-2", False, 1e-9),
        ("paper-2008-observed", "series-2", True, 2e-5),
        pytest.param("finger-2n", "finger", False, 1e-9, marks=pytest.mark.slow),
    ],
)
def test_c_says_what_python_says(
    name: str, scenario: str, single: bool, near: float, tmp_path: Path
) -> None:
    """The same places [m]; a wanted angle that is missing, a value that is, and an estimate that is
    not trusted.
    """
    rig = load_rig(name)
    call = built(rig, tmp_path, single).commanded
    real = np.float32 if single else np.float64
    log = simulate(rig, scenario)
    inverse = LiveInverse(rig, compiled=False)
    samples = np.column_stack([log.channels[channel] for channel in inverse.channels])[:60]
    samples[20:25, 0] = np.nan
    drives, out = len(rig.drives), np.zeros(3 * len(rig.drives), dtype=real)
    for k, sample in enumerate(samples):
        desired = (
            np.full(len(inverse.joints), 0.2 + 0.1 * np.sin(0.1 * k))
            if k % 7
            else np.full(len(inverse.joints), np.nan)
        )
        expected = inverse.step(float(log.time[k] - log.time[0]), desired, sample)
        arrays = [np.ascontiguousarray(part, dtype=real) for part in (sample, desired)]
        trusted = expected.reading.health not in ("bad", "dead")
        dt = 0.0 if k == 0 else float(log.time[k] - log.time[k - 1])
        pointers = [ctypes.c_void_p(array.ctypes.data) for array in arrays]
        assert (
            call(ctypes.c_double(dt), *pointers, int(trusted), ctypes.c_void_p(out.ctypes.data))
            == 0
        )
        np.testing.assert_allclose(out[:drives], expected.positions, rtol=0, atol=near)
        np.testing.assert_allclose(
            out[drives : 2 * drives], expected.speeds, rtol=0, atol=near * 500
        )
        np.testing.assert_allclose(out[2 * drives :], expected.forces, rtol=0, atol=near * 5000)


@needs_compiler
def test_c_sends_nothing_before_drives_are_read_and_stands_where_they_are_lost(
    tmp_path: Path,
) -> None:
    rig = load_rig("paper-2008-observed")
    library, inverse = built(rig, tmp_path, False), LiveInverse(rig, compiled=False)
    log, drives = simulate(rig, "series-2"), len(rig.drives)
    samples = np.column_stack([log.channels[channel] for channel in inverse.channels])[:200]
    moving = next(sensor.of for sensor in rig.sensors_of("position"))
    at = next(i for i, drive in enumerate(rig.drives) if drive.name == moving)
    channel = inverse.channels.index(rig.sensors_of("position")[0].name)
    samples[0, channel] = np.nan
    samples[100:160, channel] = np.nan
    dt, rows, codes = float(log.time[1] - log.time[0]), [], []
    for k, sample in enumerate(samples):
        desired, out = np.array([0.3 * np.sin(0.05 * k)]), np.zeros(3 * drives)
        pointers = [ctypes.c_void_p(part.ctypes.data) for part in (sample, desired)]
        library.commanded(
            ctypes.c_double(dt if k else 0.0), *pointers, 1, ctypes.c_void_p(out.ctypes.data)
        )
        codes.append(library.code_of_command())
        rows.append(out)
    positions = np.array(rows)[:, at]
    assert codes[0] == 2
    assert np.isnan(rows[0]).all()
    lost_for = round(USUAL.oldest / dt)
    assert codes[1 : 100 + lost_for - 1] == [0] * (98 + lost_for)
    assert codes[100 + lost_for + 1 : 160] == [1] * (59 - lost_for)
    assert np.ptp(positions[100 + lost_for + 1 : 160]) == 0.0
    assert codes[160:] == [0] * 40
    assert np.abs(np.diff(positions[1:])).max() < 3 * np.abs(np.diff(positions[1:100])).max()


def test_commands_are_for_adaptive(tmp_path: Path) -> None:
    with pytest.raises(ExportError, match="commands are by the state of adaptive"):
        export_c(load_rig("paper-2008"), tmp_path, "inextensible", command=True)
    assert not list(tmp_path.iterdir())


@pytest.mark.more
@pytest.mark.slow
@pytest.mark.skipif(bool(missing_tools()), reason=f"not installed: {missing_tools()}")
def test_on_a_cortex_m4f_a_step_takes_few_instructions(tmp_path: Path) -> None:
    """Filter and commands in one step, less the filter alone: 30,000 instructions are allowed for
    one joint.
    """
    name, rig, scenario = cases()[0]
    made = c_filter(rig, "adaptive", True, "filter")
    command = c_command(rig, "command", "filter", Plain(single=True))
    body = command.header.replace('#include "filter.h"\n', "") + command.source.replace(
        '#include "command.h"\n', ""
    )
    # in one file: names of its own for what both have
    for shared in {
        word
        for word in re.findall(r"static [^(;={]*?(\w+)[(\[]", body)
        if re.search(rf"\b{word}\b", made.source)
    }:
        body = re.sub(rf"\b{shared}\b", f"own_{shared}", body)
    first, *rest = made.source.split("int filter_step(")
    both = (
        f"{first}int filter_alone(filter_state* state, float dt, const float* values, "
        f"filter_output* out);\n{body}"
    )
    both += "static command_state commanding;\nint filter_alone(" + "int filter_step(".join(rest)
    both += """
int filter_step(filter_state* state, float dt, const float* values, filter_output* out) {
  static const float wanted[COMMAND_JOINTS] = {0.1f};
  static command_output commands;
  const int code = filter_alone(state, dt, values, out);
  command_step(&commanding, state, dt, values, out, wanted, 1, &commands);
  return code;
}
"""
    means = []
    for k, one in enumerate((made, replace(made, source=both))):
        folder = tmp_path / str(k)
        folder.mkdir()
        means.append(measure(rig, scenario, "adaptive", folder, one)[0].instructions[0])
    print(f"{name}: filter {means[0]:,.0f}, commands {means[1] - means[0]:,.0f} instructions")
    assert 0 < means[1] - means[0] < 30_000
