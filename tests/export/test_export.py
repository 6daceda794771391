"""The exported filter: the numbers of Python, on a PC with sanitizers, and what it refuses."""

from __future__ import annotations

import ctypes
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

from distal import (
    Estimate,
    Log,
    Rig,
    estimate,
    load_rig,
    load_scenario,
    make_estimator,
    read_log,
    scenario_rig,
    simulate,
)
from distal.cli.app import app
from distal.errors import EstimationError, ExportError, OutputError, RigError
from distal.estimators import first_values
from distal.export import Exported, c_filter, export_c
from distal.export.c_source import c_name
from distal.logs import write_log
from distal.rig import build_rig, set_value
from distal.run import samples_of
from distal.simulation import build_scenario
from tests.export.helpers import CC, STRICT, shared_library, spoiled
from tests.export.replay import replay_program

needs_compiler = pytest.mark.skipif(isinstance(CC, str), reason="no C compiler")


@pytest.fixture(scope="module")
def rig() -> Rig:
    return scenario_rig(load_scenario("series-2"))


@pytest.fixture(scope="module")
def plain(rig: Rig) -> Log:
    """A whole log of 8 s."""
    return simulate(rig, load_scenario("series-2"), 5)


@pytest.fixture(scope="module")
def log(plain: Log) -> Log:
    """The same with gaps, missing values and a dead sensor."""
    return spoiled(plain)


def build(made: Exported, folder: Path, *options: str) -> Path:
    """Write and compile a filter with a program that replays logs; return the program."""
    for name, text in (
        (f"{made.name}.h", made.header),
        (f"{made.name}.c", made.source),
        ("replay.c", replay_program(made.estimator, made.name)),
    ):
        (folder / name).write_text(text)
    command = [*CC.command, *STRICT, *options, "replay.c", f"{made.name}.c", "-lm", "-o", "replay"]  # type: ignore[union-attr]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder / "replay"


def by_c_and_python(
    rig: Rig, folder: Path, single: bool = False
) -> tuple[np.ndarray, Estimate, Log]:
    """Return what C and Python say of a log in which a motor goes to and fro, and the log."""
    servo = {"angle": {"amplitude": 0.5, "frequency": 0.4}, "stiffness": 20.0, "damping": 0.3}
    raw = {"rig": rig.name, "duration": 3.0, "drives": {"motor": {"servo": servo}}}
    log = simulate(rig, build_scenario(raw, "servo"), 2)
    write_log(log, rig, folder / "log.csv")
    program = build(c_filter(rig, "adaptive", single), folder, "-O0")
    return replayed(program, folder / "log.csv"), estimate(log, rig), log


def replayed(program: Path, log: Path) -> np.ndarray:
    done = subprocess.run([str(program), str(log)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert not done.stderr
    return pl.read_csv(done.stdout.encode(), infer_schema_length=None).to_numpy()


@needs_compiler
@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "single"),
    [
        pytest.param("adaptive", False, id="double-adaptive"),
        pytest.param("adaptive", True, id="float-adaptive"),
        pytest.param("ekf", False, id="double-ekf"),
    ],
)
def test_a_whole_log_under_sanitizers(
    rig: Rig, log: Log, plain: Log, name: str, single: bool, tmp_path: Path
) -> None:
    """As Python to 1e-9 in double, to 0.02° in float; no address or undefined behaviour is
    reported.
    """
    program = build(
        c_filter(rig, name, single),
        tmp_path,
        "-g",
        "-O1",
        "-fsanitize=address,undefined",
        "-fno-sanitize-recover=all",
    )
    tolerance = np.deg2rad(0.02) if single else 1e-9
    for each in (log, plain):
        write_log(each, rig, tmp_path / "log.csv")
        rows, known = replayed(program, tmp_path / "log.csv"), estimate(each, rig, name)
        np.testing.assert_allclose(rows[:, 0], each.time, atol=1e-12)
        assert np.isfinite(rows).all()
        np.testing.assert_allclose(rows[:, 1], known.theta, atol=tolerance)
        np.testing.assert_allclose(
            rows[:, 2], known.theta_std, atol=tolerance, rtol=0.01 if single else 0.0
        )


@needs_compiler
@pytest.mark.parametrize(
    ("name", "single"),
    [
        pytest.param("capstan-joint", False, marks=pytest.mark.slow, id="capstan-joint-double"),
        pytest.param("capstan-joint", True, id="capstan-joint-float"),
        pytest.param("da-vinci-grasper", False, id="da-vinci-grasper-double"),
        pytest.param("da-vinci-grasper", True, marks=pytest.mark.slow, id="da-vinci-grasper-float"),
    ],
)
def test_other_rigs(name: str, single: bool, tmp_path: Path) -> None:
    """One drive, external torque, hysteresis with a considered state."""
    described = load_rig(name)
    rows, known, _ = by_c_and_python(described, tmp_path, single)
    tolerance = np.deg2rad(0.02) if single else 1e-9
    np.testing.assert_allclose(rows[:, 1], known.theta, atol=tolerance)
    np.testing.assert_allclose(rows[:, 2], known.theta_std, atol=tolerance)
    assert rows.shape[1] == (5 if described.joints[0].external_torque.std > 0.0 else 3)
    if rows.shape[1] == 5:
        np.testing.assert_allclose(rows[:, 3], known.external_torque, atol=1e-5 if single else 1e-9)
        np.testing.assert_allclose(
            rows[:, 4], known.external_torque_std, atol=1e-5 if single else 1e-9
        )


@needs_compiler
@pytest.mark.parametrize("estimator", ["inextensible", "elastic"])
@pytest.mark.parametrize("scenario", ["lab-bench", "wrist"])
def test_kinematics(estimator: str, scenario: str, tmp_path: Path) -> None:
    described = scenario_rig(load_scenario(scenario))
    made = simulate(described, load_scenario(scenario), 2).select(slice(0, 300))
    write_log(made, described, tmp_path / "log.csv")
    rows = replayed(build(c_filter(described, estimator), tmp_path, "-O0"), tmp_path / "log.csv")
    known = estimate(made, described, estimator)
    np.testing.assert_allclose(rows[:, 1::2], known.angles, atol=1e-9)
    np.testing.assert_allclose(rows[:, 2::2], known.angle_stds, atol=1e-9)


@needs_compiler
def test_what_moves_inside(tmp_path: Path) -> None:
    """Backlash, creep, a sheath, cogging, a torque sensor's gain: the same in C."""
    rig = load_rig("capstan-joint").with_values(
        {
            "drives.0.backlash.width": {"value": 4e-3, "std": 1e-3},
            "drives.0.cogging": {"periods": 21, "cosine": {"value": 0.0, "std": 2e-3}},
            "tendons.0.creep": {
                "share": {"value": 0.2, "std": 0.1},
                "time": {"value": 3.0, "std": 1.0},
            },
            "tendons.1.stiffening": {"value": 200.0, "std": 40.0},
            "tendons.1.path": {
                "friction": {"value": 0.1, "std": 0.03},
                "wrap": 1.5,
                "nodes": 2,
                "let_out": 0.8,
            },
            "sensors.motor_torque.gain": {"value": 1.0, "std": 0.02},
        }
    )
    rows, known, _ = by_c_and_python(rig, tmp_path)
    inside = {
        "backlash_motor",
        "creep_flexor",
        "sheath_extensor_0",
        "sheath_extensor_1",
        "gain_motor_torque",
    }
    assert inside <= set(known.state_names)
    np.testing.assert_allclose(rows[:, 1], known.theta, atol=1e-9)
    np.testing.assert_allclose(rows[:, 2], known.theta_std, atol=1e-9)


@needs_compiler
def test_springs_slack_and_counts(tmp_path: Path) -> None:
    """Springs that are not linear, a slack tendon, an encoder in counts and a motor's current: the
    same in C.
    """
    changed = {
        "joints.0.spring": {"stiffness": 0.3, "cubic": {"value": 0.2, "std": 0.05}},
        "joints.0.extension_spring": {
            "stiffness": {"value": 300.0, "std": 20.0},
            "free_length": 0.014,
            "radius": 0.009,
            "distance": 0.026,
            "line_angle": -0.9,
        },
        "tendons.0.pretension": {"value": 0.0, "std": 0.0},
        "tendons.0.slack": {"value": 2e-4, "std": 1e-4},
        "sensors.motor_angle.unit": "count",
        "sensors.motor_angle.counts_per_turn": 65536,
        "sensors.motor_torque.torque_constant_motor": 0.02,
        "sensors.motor_torque.gear": 30,
        "sensors.motor_torque.unit": "mA",
    }
    raw = load_rig("capstan-joint").model_dump()
    for path, value in changed.items():
        set_value(raw, path, value, RigError)
    described = build_rig(raw, "sprung")
    rows, known, made = by_c_and_python(described, tmp_path)
    again = read_log(tmp_path / "log.csv", described)
    np.testing.assert_allclose(
        again.channels["motor_torque"], made.channels["motor_torque"], rtol=1e-12
    )
    head, rest = (tmp_path / "log.csv").read_text().split("\n", 1)
    units = {"t": "s", "motor_angle": "count", "motor_torque": "mA"}
    said = ",".join(
        f"{column} [{units[column]}]" if column in units else column for column in head.split(",")
    )
    (tmp_path / "said.csv").write_text(f"{said}\n{rest}")
    np.testing.assert_array_equal(replayed(tmp_path / "replay", tmp_path / "said.csv"), rows)
    sprung = {
        "slack of tendon flexor",
        "spring cubic of joint jaw",
        "extension spring stiffness of joint jaw",
    }
    assert sprung <= set(known.state_names)
    np.testing.assert_allclose(rows[:, 1], known.theta, atol=1e-9)
    np.testing.assert_allclose(rows[:, 2], known.theta_std, atol=1e-9)


class Library:
    """An exported filter as a shared library, called as a control loop calls it."""

    def __init__(self, made: Exported, folder: Path) -> None:
        texts = {f"{made.name}.h": made.header, f"{made.name}.c": made.source}
        self.made, self.code = made, shared_library(texts, folder)
        self.state = np.zeros(made.estimator.kernel.sizes.kernel_state + 1)
        self.out = np.zeros(2 + 2 * max(len(made.estimator.measured), 1))

    def begin(self, values: np.ndarray) -> None:
        getattr(self.code, f"{self.made.name}_begin")(self._at(self.state), self._at(values))

    def step(self, dt: float, values: np.ndarray) -> int:
        call = getattr(self.code, f"{self.made.name}_step")
        return int(
            call(self._at(self.state), ctypes.c_double(dt), self._at(values), self._at(self.out))
        )

    @staticmethod
    def _at(array: np.ndarray) -> ctypes.c_void_p:
        assert array.dtype == np.float64
        return ctypes.c_void_p(np.ascontiguousarray(array).ctypes.data)


@needs_compiler
@pytest.mark.parametrize("name", ["adaptive", "elastic", "ekf", "ekf-2008"])
def test_beliefs_and_innovations_are_pythons(rig: Rig, log: Log, name: str, tmp_path: Path) -> None:
    """The whole state and every innovation, from the prior on."""
    estimator = make_estimator(name, rig)
    samples = samples_of(log, estimator.channels)
    library = Library(c_filter(rig, name), tmp_path)
    first = first_values(samples)
    library.begin(first)
    belief = estimator.initial(log.time[0], first)
    np.testing.assert_allclose(library.state[:-1], belief.kernel_state, rtol=1e-15)
    kernel_states, ys = estimator.advanced(belief, log.time[:120], samples[:120])
    innovations, variances = estimator.innovations_of(ys, samples[:120])
    for k, kernel_state in enumerate(kernel_states):
        assert library.step(log.time[k] - log.time[k - 1] if k else 0.0, samples[k]) == 0
        scale = np.abs(kernel_state) + 1e-6
        np.testing.assert_allclose(library.state[:-1] / scale, kernel_state / scale, atol=1e-9)
        m = len(estimator.measured)
        np.testing.assert_allclose(library.out[2 : 2 + m], innovations[k], atol=1e-9)
        np.testing.assert_allclose(library.out[2 + m : 2 + 2 * m], variances[k], rtol=1e-9)


@needs_compiler
def test_what_a_step_refuses(rig: Rig, log: Log, tmp_path: Path) -> None:
    """Late, repeated, too late, infinite: a code, and the state stays."""
    library = Library(c_filter(rig), tmp_path)
    samples = samples_of(log, library.made.estimator.channels)
    library.begin(samples[0])
    assert library.step(0.0, samples[0]) == 0
    kept = library.state.copy()
    for dt, values, code in (
        (0.0, samples[1], 1),
        (-0.01, samples[1], 1),
        (np.nan, samples[1], 1),
        (1e-200, samples[1], 1),
        (5e-10, samples[1], 1),
        (1e9, samples[1], 2),
        (np.inf, samples[1], 2),
        (0.01, np.full(4, np.inf), 3),
        (0.01, np.array([0.0, 0.0, 1e300, 2.0]), 3),
    ):
        assert library.step(dt, np.array(values)) == code
        np.testing.assert_array_equal(library.state, kept)
    assert library.step(0.01, np.full(4, np.nan)) == 0
    assert library.step(0.01, np.array([1e6, 1e6, -9e6, 9e6])) in (0, 4)


def test_the_header_says_shapes_units_and_order(rig: Rig) -> None:
    made = c_filter(rig, "adaptive", True)
    for said in (
        "#define",
        "[m]",
        "[N]",
        " 0  theta [rad]",
        " 18  friction_right",
        "u1: force of left",
        "float",
    ):
        assert said in made.header
    assert not re.search(r"20\d\d-\d\d|\d\d:\d\d:\d\d", made.header + made.source)
    assert len(made.estimator.state_names) == 19
    assert made.state_bytes == 4 * 404 + 4


def test_float_calls_only_float_functions(rig: Rig) -> None:
    for name in ("adaptive", "elastic"):
        source = re.sub(r"/\*.*?\*/", "", c_filter(rig, name, True).source, flags=re.S)
        assert "double" not in source
        assert not re.search(
            r"\b(sqrt|exp|expm1|cos|sin|fabs|fmax|fmin|atan2|erf|pow|log)\(", source
        )
        assert not re.search(
            r"(?<![\w.])\d+\.\d+(e[+-]?\d+)?(?![\dfe])", source
        )  # every number ends in f


@pytest.mark.more
@pytest.mark.slow  # processes of their own
def test_the_text_is_the_same_in_every_process(tmp_path: Path) -> None:
    texts = set()
    for seed in ("1", "2"):
        code = (
            "from distal import load_rig; from distal.export import c_filter; m = "
            "c_filter(load_rig('capstan-joint'));"
        )
        done = subprocess.run(
            [sys.executable, "-c", code + "print(m.source, m.header)"],
            capture_output=True,
            text=True,
            check=True,
            env={
                **os.environ,
                "PYTHONHASHSEED": seed,
            },  # the whole environment: it says which copy is imported
        )
        texts.add(done.stdout)
    assert len(texts) == 1


GOLDEN = Path(__file__).parent / "golden"


@pytest.mark.stored
def test_golden_files(request: pytest.FixtureRequest) -> None:
    """What is written is what was looked at; `pytest --update-golden` writes it anew."""
    made = c_filter(load_rig("capstan-joint"), "adaptive", True, "capstan_adaptive")
    for name, text in ((f"{made.name}.h", made.header), (f"{made.name}.c", made.source)):
        path = GOLDEN / name
        if request.config.getoption("--update-golden"):
            GOLDEN.mkdir(exist_ok=True)
            path.write_text(text)
        assert path.read_text() == text, (
            f"{name} differs; if it should, run pytest --update-golden and look at the diff"
        )


def test_what_cannot_be_exported_is_said(rig: Rig, tmp_path: Path) -> None:
    with pytest.raises(EstimationError, match="has no map of what its sensors read"):
        c_filter(rig, "regression")
    with pytest.raises(ExportError, match="cannot begin the names"):
        c_filter(rig, "adaptive", False, "2fast")
    (tmp_path / "out" / "README.md").mkdir(parents=True)
    with pytest.raises(OutputError, match="is a folder"):
        export_c(rig, tmp_path / "out")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["README.md"]
    assert c_name("Nylon-tendon disk (k = 806 N/m)") == "nylon_tendon_disk_k_806_n_m"
    assert c_name("2008") == "rig_2008"


@needs_compiler
def test_replay_reads_what_estimate_reads(rig: Rig, plain: Log, tmp_path: Path) -> None:
    """Any order of columns, ends and empty lines; and refuses what it refuses, with the row."""
    short = plain.select(slice(0, 60))
    write_log(short, rig, tmp_path / "log.csv")
    rows = [line.split(",")[:5] for line in (tmp_path / "log.csv").read_text().splitlines()]
    program = build(c_filter(rig, "elastic"), tmp_path, "-O1")
    known = estimate(short, rig, "elastic").theta
    good = {
        "ends": "\r\n".join(",".join(row) for row in rows) + "\n\n\n",
        "order": "\n".join(
            ",".join([*row[::-1], "NA"]) if i else ",".join([*row[::-1], "x"])
            for i, row in enumerate(rows)
        ),
    }
    for name, text in good.items():
        (tmp_path / name).write_text(text)
        np.testing.assert_allclose(replayed(program, tmp_path / name)[:, 1], known, atol=1e-9)
    lines = [",".join(row) for row in rows]
    bad = {
        "row 31: not a number: oops": [
            *lines[:30],
            lines[30].replace(rows[30][1], "oops"),
            *lines[31:],
        ],
        "row 31: more or fewer cells": [*lines[:30], lines[30] + ",3", *lines[31:]],
        "row 32: the stamp repeats": [*lines[:31], lines[30], *lines[31:]],
        "a column is missing: x1": [lines[0].replace("x1", "y1"), *lines[1:]],
    }
    for said, text in bad.items():
        (tmp_path / "bad.csv").write_text("\n".join(text))
        done = subprocess.run(
            [str(program), str(tmp_path / "bad.csv")], capture_output=True, text=True, check=False
        )
        assert done.returncode != 0, said
        assert said in done.stderr


@needs_compiler
def test_names_that_would_break_the_text(rig: Rig, plain: Log, tmp_path: Path) -> None:
    """Titles and columns are anything; what is written compiles, and reads those columns."""
    title = 'a */ #error "b" /* \\\n ?' + "?/ $real$ $name$ é 😀"
    column = 'x"1" \\ ?' + "?/ $factors$ 😀 é"
    raw = rig.model_dump()
    raw["name"] = title
    raw["sensors"][0]["column"] = column
    odd = build_rig(raw, "odd")
    made = c_filter(odd, "elastic", name="odd")
    write_log(plain.select(slice(0, 50)), odd, tmp_path / "log.csv")
    text = (tmp_path / "log.csv").read_text()
    (tmp_path / "log.csv").write_text(text.replace('"' + column.replace('"', '""') + '"', column))
    rows = replayed(build(made, tmp_path, "-O1", "-Wpedantic"), tmp_path / "log.csv")
    np.testing.assert_allclose(
        rows[:, 1], estimate(plain.select(slice(0, 50)), odd, "elastic").theta, atol=1e-9
    )
    export_c(odd, tmp_path, "elastic", name="odd")
    assert "$real$ $name$" in (tmp_path / "README.md").read_text()


def test_the_command(tmp_path: Path) -> None:
    out = tmp_path / "firmware"
    done = CliRunner().invoke(app, ["export-c", "pulley-antagonist", "--out", str(out), "--float"])
    assert done.exit_code == 0, done.output
    names = sorted(path.name for path in out.iterdir())
    stem = "pulley_antagonist_adaptive"
    assert names == sorted(["README.md", f"{stem}.c", f"{stem}.h"])
    assert "1,468 bytes" in done.output
    assert "1,468 bytes" in (out / "README.md").read_text()


@needs_compiler
@pytest.mark.skipif(shutil.which("g++") is None, reason="g++ is not installed")
def test_from_cpp(rig: Rig, tmp_path: Path) -> None:
    """The header in C++, the source in C, linked."""
    made = c_filter(rig, "elastic", name="finger")
    program = """#include "finger.h"
int main() {
  finger_state state;
  const finger_real values[FINGER_CHANNELS] = {0, 0, 2, 2};
  finger_output out;
  finger_begin(&state, values);
  return finger_step(&state, 0, values, &out) == FINGER_OK ? 0 : 1;
}
"""
    for name, text in (("finger.h", made.header), ("finger.c", made.source), ("main.cpp", program)):
        (tmp_path / name).write_text(text)
    for command in (
        [*CC.command, *STRICT, "-c", "finger.c"],  # type: ignore[union-attr]
        ["g++", "-Wall", "-Wextra", "-Werror", "main.cpp", "finger.o", "-lm", "-o", "program"],
        ["./program"],
    ):
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
