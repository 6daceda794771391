"""The filter as an FMU: valid by the standard, and the numbers of Python in two importers that share
no code.
"""

from __future__ import annotations

import importlib.util
import subprocess
import zipfile
from collections.abc import Callable
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu
from fmuloader.fmi3 import Fmi3Slave
from typer.testing import CliRunner

from distal import LiveEstimator, Log, Rig, load_rig, load_scenario, scenario_rig, simulate
from distal.cli.app import app
from distal.errors import ExportError, OutputError
from distal.estimators import make_estimator
from distal.export import Fmu, export_fmu
from distal.export.fmu import ZIG_TARGETS, this_platform
from distal.kernels import find_compiler
from distal.rig import build_rig
from distal.run import samples_of
from tests.export.helpers import CC, STRICT, needs_compiler, spoiled
from tests.learned_maps import drawn_map

pytestmark = needs_compiler
STEP = 0.01


def case(scenario: str = "series-2") -> tuple[Rig, Log]:
    loaded = load_scenario(scenario, ['duration="4 s"'])
    rig = scenario_rig(loaded)
    return rig, simulate(rig, loaded, 5)


@pytest.fixture(scope="module")
def rig() -> Rig:
    return case()[0]


@pytest.fixture(scope="module")
def log() -> Log:
    return case()[1]


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fmu") / "rig.fmu"


@pytest.fixture(scope="module")
def made(rig: Rig, path: Path) -> Fmu:
    return export_fmu(rig, path, everywhere=False)


def at_the_ends(rig: Rig, times: np.ndarray, rows: np.ndarray, length: float = STEP) -> np.ndarray:
    """Return angles, then stds, at the end of the step that begins with each sample: all sensors
    are missing there.
    """
    live, found = LiveEstimator(rig), []
    for time, row in zip(times.tolist(), rows):
        live.step(time, row)
        end = live.clone()
        end.step(time + length, np.full(len(row), np.nan))
        found.append([*end.angles, *end.angle_stds])
    return np.array(found)


@pytest.mark.parametrize("scenario", ["series-2", pytest.param("wrist", marks=pytest.mark.more)])
def test_it_is_valid_and_gives_pythons_numbers(scenario: str, tmp_path: Path) -> None:
    rig, log = case(scenario)
    path = tmp_path / "rig.fmu"
    made = export_fmu(rig, path, everywhere=False)
    assert validate_fmu(str(path)) == []
    rows, step = samples_of(log, made.inputs), made.exported.estimator.interval
    signals = np.zeros(len(log), dtype=[(name, float) for name in ("time", *made.inputs)])
    for name, values in zip(signals.dtype.names, (log.time, *rows.T)):
        signals[name] = values
    found = fmpy.simulate_fmu(
        str(path),
        stop_time=float(log.time[-1]) + step,
        output_interval=step,
        input=signals,
        output=list(made.outputs),
    )
    known, nj = at_the_ends(rig, log.time, rows, step), len(rig.joints)
    for k, name in enumerate(made.outputs[: 2 * nj : 2]):
        np.testing.assert_allclose(found[name][1:], known[:, k], atol=1e-9)
        np.testing.assert_allclose(found[f"{name}_std"][1:], known[:, nj + k], atol=1e-9)
    # at the end of the initialization the first sample is taken in, and the outputs are of the same
    # time
    live = LiveEstimator(rig)
    live.step(0.0, rows[0])
    assert found[made.outputs[0]][0] == pytest.approx(live.angles[0], abs=1e-9)


class Imported:
    """An FMU as `fmuloader` runs it; variables by their names."""

    def __init__(self, path: Path) -> None:
        described = fmpy.read_model_description(str(path))
        self.which = {one.name: one.valueReference for one in described.modelVariables}
        inputs = (one for one in described.modelVariables if one.causality == "input")
        self.inputs = [one.valueReference for one in inputs]
        health = next(one for one in described.typeDefinitions if one.name == "Health")
        self.words = {int(item.value): item.name for item in health.items}
        self.slave = Fmi3Slave(path, model_identifier=described.coSimulation.modelIdentifier)
        self.slave.instantiate_co_simulation("one", instantiation_token=described.guid)

    def told(self, *names: str) -> tuple[float, ...]:
        return tuple(self.slave.get_float64([self.which[name] for name in names]))

    @property
    def health(self) -> str:
        return self.words[self.slave.get_int64([self.which["health"]])[0]]

    def begin(self, values: np.ndarray) -> None:
        self.slave.enter_initialization_mode(start_time=0.0)
        self.slave.set_float64(self.inputs, values.tolist())
        self.slave.exit_initialization_mode()

    def step(self, time: float, values: np.ndarray, length: float = STEP) -> tuple[float, ...]:
        """Return angle and std at the end of a step."""
        self.slave.set_float64(self.inputs, values.tolist())
        self.slave.do_step(time, length)
        return self.told("angle", "angle_std")


@pytest.fixture
def one(path: Path, made: Fmu) -> Imported:
    return Imported(path)


def test_two_instances_at_once_do_not_know_each_other(
    one: Imported, path: Path, rig: Rig, log: Log, made: Fmu
) -> None:
    """And one begins anew after a reset; times are those of the steps' ends."""
    rows, time = samples_of(log, made.inputs), log.time
    several = [(one, rows), (Imported(path), rows[::-1])]
    for _ in range(2):
        for instance, own in several:
            instance.begin(own[0])
        for k in range(100):
            for instance, own in several:
                found = instance.step(float(time[k]), own[k])
                if k in (0, 99):
                    known = at_the_ends(rig, time[: k + 1], own[: k + 1])[k]
                    assert found == pytest.approx(known, abs=1e-9)
                assert instance.told("time") == pytest.approx((time[k] + STEP,), abs=1e-12)
        assert one.health == "untested"  # no log taught it
        for instance, _ in several:
            instance.slave.reset()
            assert (instance.health, instance.told("time")) == ("not_yet", (0.0,))


def test_before_the_first_sample_it_says_the_prior_and_not_yet(
    one: Imported, rig: Rig, log: Log, made: Fmu
) -> None:
    missing = np.full(len(made.inputs), np.nan)
    prior = make_estimator("adaptive", rig).initial(0.0, missing)
    expected = pytest.approx((prior.mean[0], np.sqrt(prior.covariance[0, 0])), abs=1e-12)
    one.slave.enter_initialization_mode(start_time=2.5)
    # inputs that are set before the initialization ends are no sample yet
    one.slave.set_float64(one.inputs, [STEP] * len(made.inputs))
    assert one.told("angle", "angle_std") == expected
    # what is not connected is no sample either
    one.slave.set_float64(one.inputs, missing.tolist())
    one.slave.exit_initialization_mode()
    assert (one.told("time"), one.health) == ((2.5,), "not_yet")
    assert one.step(2.5, missing) == expected
    assert one.health == "not_yet"
    one.step(2.51, samples_of(log, made.inputs)[0])
    assert one.health != "not_yet"


def test_missing_values_gaps_and_steps_between_samples(
    one: Imported, rig: Rig, made: Fmu, log: Log
) -> None:
    """A wild value is a missing one."""
    spoilt = spoiled(log)
    rows = samples_of(spoilt, made.inputs)
    rows[0] = samples_of(log, made.inputs)[0]  # else the first value fills what has no prior
    known = at_the_ends(rig, spoilt.time, rows)
    one.begin(rows[0])
    before = one.told("angle", "angle_std")
    assert one.step(0.0, rows[0], 1e6) == before  # that is too long to predict
    for k in range(1, len(rows)):
        wild = np.where(np.isnan(rows[k]), [1e9, np.inf, -np.inf, np.nan][k % 4], rows[k])
        found = one.step(float(spoilt.time[k]), wild)
        assert found == pytest.approx(known[k], abs=1e-9)
        assert one.health in ("missing", "dead") or not np.any(np.abs(wild) > 1e8)
        # a tool that steps between the samples gives no sample
        one.step(float(spoilt.time[k]) + 0.004, rows[k] + STEP)
    one.step(5000.0, rows[-1])
    # it began anew: the gap was too long to bridge
    assert one.health == "restarted"
    for bad in (0.05, np.inf, np.nan):
        with pytest.raises(Exception, match="DoStep"):
            one.step(bad, rows[-1])


def test_what_cannot_be_is_refused(
    one: Imported, rig: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    refused: list[Callable[[], object]] = [
        lambda: one.slave.set_float64([one.which["angle"]], [1.0]),
        lambda: one.slave.get_float64([99]),
        lambda: one.slave.get_float32([1]),
    ]
    for call in refused:
        with pytest.raises(Exception, match="Float"):
            call()
    with pytest.raises(ExportError, match=r"ends in \.fmu"):
        export_fmu(rig, tmp_path / "rig.zip")
    with pytest.raises(OutputError, match="does not exist"):
        export_fmu(rig, tmp_path / "absent" / "rig.fmu", everywhere=False)
    monkeypatch.setenv("DISTAL_COMPILE", "0")
    find_compiler.cache_clear()
    try:
        made = export_fmu(rig, tmp_path / "sources.fmu")
    finally:
        monkeypatch.undo()
        find_compiler.cache_clear()
    assert (made.platforms, "DISTAL_COMPILE" in made.without) == ((), True)
    assert validate_fmu(str(tmp_path / "sources.fmu")) == []


def test_sensors_that_are_called_as_outputs_are(rig: Rig, tmp_path: Path) -> None:
    raw, path = rig.model_dump(), tmp_path / "odd.fmu"
    raw["name"] = 'a <b> & "c"'
    for sensor, name in zip(raw["sensors"], ("angle", "time", "health"), strict=False):
        sensor["name"] = name
    made = export_fmu(build_rig(raw, "odd"), path, "elastic", "odd", everywhere=False)
    assert validate_fmu(str(path)) == []
    assert made.outputs == ("angle_estimate", "angle_std", "health_estimate")


def test_with_a_learned_map(tmp_path: Path) -> None:
    """Before the first sample no map has spoken; a step's end is the map's too."""
    rig = load_rig("capstan-joint").with_map(filter=[drawn_map()])
    export_fmu(rig, tmp_path / "map.fmu", everywhere=False)
    one, live = Imported(tmp_path / "map.fmu"), LiveEstimator(rig)
    one.slave.enter_initialization_mode(start_time=0.0)
    prior = live.estimator.initial(0.0, np.full(2, np.nan))
    expected = (prior.mean[0], np.sqrt(prior.covariance[0, 0]))
    assert one.told("angle", "angle_std") == pytest.approx(expected, abs=1e-12)
    times = 0.005 * np.arange(20)
    rows = np.column_stack([0.3 * np.sin(20.0 * times), np.full(20, 0.02)])
    for time, row, known in zip(times, rows, at_the_ends(rig, times, rows, 0.005)):
        assert one.step(float(time), row, 0.005) == pytest.approx(known, abs=1e-9)


_MAIN = """
#include "rig_fmi3.c"
int main(void) {
  fmi3ValueReference inputs[INPUTS], angle = INPUTS + 1;
  bool no;
  double last, value, values[INPUTS] = {0};
  fmi3Instance one;
  int i;
  if (fmi3InstantiateCoSimulation("a", "wrong", "", 0, 0, 0, 0, NULL, 0, NULL, NULL, NULL)) return 1;
  one = fmi3InstantiateCoSimulation("a", TOKEN, "", 0, 0, 0, 0, NULL, 0, NULL, NULL, NULL);
  for (i = 0; i < INPUTS; ++i) inputs[i] = i + 1;
  fmi3EnterInitializationMode(one, 0, 0, 0, 0, 0);
  fmi3SetFloat64(one, inputs, INPUTS, values, INPUTS);
  fmi3ExitInitializationMode(one);
  for (i = 0; i < 100; ++i) if (fmi3DoStep(one, 0.01 * i, 0.01, 0, &no, &no, &no, &last)) return 2;
  if (fmi3GetFloat64(one, &angle, 1, &value, 1)) return 3;
  fmi3FreeInstance(one);
  return 0;
}
"""


def test_under_sanitizers(rig: Rig, tmp_path: Path) -> None:
    """A program that does what a tool does; nothing is reported."""
    path = tmp_path / "rig.fmu"
    export_fmu(rig, path, "elastic", "rig", everywhere=False)
    with zipfile.ZipFile(path) as archive:
        archive.extractall(tmp_path)
    (tmp_path / "sources" / "main.c").write_text(_MAIN)
    token = f'-DTOKEN="{fmpy.read_model_description(str(path)).guid}"'
    flags = [*STRICT, "-fsanitize=address,undefined", "-fno-sanitize-recover=all", token]
    command = [*CC.command, *flags, "main.c", "rig.c", "-lm", "-o", "program"]  # type: ignore[union-attr]
    for words in (command, ["./program"]):
        done = subprocess.run(
            words, cwd=tmp_path / "sources", capture_output=True, text=True, check=False
        )
        assert (done.returncode, done.stderr) == (0, "")


BINARIES = {
    "x86_64-linux": (".so", b"\x7fELF\x02", 18, b"\x3e\x00"),
    "aarch64-linux": (".so", b"\x7fELF\x02", 18, b"\xb7\x00"),
    "x86_64-darwin": (".dylib", b"\xcf\xfa\xed\xfe", 4, b"\x07\x00\x00\x01"),
    "aarch64-darwin": (".dylib", b"\xcf\xfa\xed\xfe", 4, b"\x0c\x00\x00\x01"),
    "x86_64-windows": (".dll", b"MZ", None, b"PE\0\0\x64\x86"),
}
"""Ending, first bytes, and where the bytes of the machine are; those of Windows say where."""


@pytest.mark.more
@pytest.mark.skipif(importlib.util.find_spec("ziglang") is None, reason="needs ziglang")
def test_binaries_for_all_platforms(tmp_path: Path, rig: Rig) -> None:
    """Each has the file format and the machine of its platform, and the names that an importer
    looks for.
    """
    made = export_fmu(rig, tmp_path / "all.fmu")
    assert made.without == ""
    assert set(made.platforms) == {*ZIG_TARGETS, this_platform()}
    with zipfile.ZipFile(tmp_path / "all.fmu") as archive:
        for name in (name for name in archive.namelist() if name.startswith("binaries/")):
            ending, first, at, machine = BINARIES[name.split("/")[1]]
            code = archive.read(name)
            at = int.from_bytes(code[60:64], "little") if at is None else at
            assert (Path(name).suffix, code[: len(first)]) == (ending, first)
            assert code[at:].startswith(machine)
            assert b"fmi3DoStep" in code


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--here"], "motor_angle, motor_torque"),
        ([], "x86_64-darwin, aarch64-darwin need ziglang: pip install ziglang"),
    ],
)
def test_the_command_without_ziglang(
    words: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    out = tmp_path / "a.fmu"
    done = CliRunner().invoke(app, ["export-fmu", "capstan-joint", "--out", str(out), *words])
    assert done.exit_code == 0, done.output
    assert said in " ".join(done.output.split())
    assert ("ziglang" in done.output) == (not words)
    with zipfile.ZipFile(out) as archive:
        names = [name.split("/") for name in archive.namelist() if "binaries/" in name]
    assert {name[1] for name in names} == {this_platform()}
