"""The filter as an FMU: valid by the standard, the numbers of Python, two instances at once."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu
from typer.testing import CliRunner

from distal import LiveEstimator, Log, Rig, estimate, load_scenario, scenario_rig, simulate
from distal.cli.app import app
from distal.errors import ExportError, OutputError
from distal.estimators import first_values, make_estimator
from distal.export import Fmu, export_fmu
from distal.kernels import find_compiler
from distal.rig import build_rig
from distal.run import HEALTH, samples_of
from distal.run.health import word_code
from tests.export.helpers import CC, spoiled

pytestmark = pytest.mark.skipif(isinstance(CC, str), reason="no C compiler")


@pytest.fixture(scope="module")
def rig() -> Rig:
    return scenario_rig(load_scenario("series-2"))


@pytest.fixture(scope="module")
def log(rig: Rig) -> Log:
    return simulate(rig, load_scenario("series-2"), 5)


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fmu") / "rig.fmu"


@pytest.fixture(scope="module")
def made(rig: Rig, path: Path) -> Fmu:
    return export_fmu(rig, path, everywhere=False)


def simulated(path: Path, made: Fmu, log: Log) -> np.ndarray:
    """Return what fmpy records of a run over a log; a row is that of the step that ends at its
    time.
    """
    signals = np.zeros(len(log), dtype=[("time", float), *((name, float) for name in made.inputs)])
    signals["time"] = log.time
    for name, values in zip(made.inputs, samples_of(log, made.inputs).T):
        signals[name] = values
    step = made.exported.estimator.interval
    found: np.ndarray = fmpy.simulate_fmu(
        str(path),
        stop_time=float(log.time[-1]) + step,
        output_interval=step,
        input=signals,
        output=list(made.outputs),
    )
    return found


def at_the_ends(log: Log, rig: Rig, length: float = 0.01) -> np.ndarray:
    """Return angles, then stds, at the end of the step that begins with each sample: all sensors
    are missing there.
    """
    estimator = make_estimator("adaptive", rig)
    rows, found = samples_of(log, estimator.channels), []
    missing = np.full(rows.shape[1], np.nan)
    live = LiveEstimator(rig, estimator)
    for time, row in zip(log.time.tolist(), rows):
        live.step(time, row)
        end = live.clone()
        end.step(time + length, missing)
        found.append([*end.angles, *end.angle_stds])
    return np.array(found)


def test_it_is_valid_and_gives_pythons_numbers(path: Path, made: Fmu, rig: Rig, log: Log) -> None:
    assert validate_fmu(str(path)) == []
    found, known = simulated(path, made, log), at_the_ends(log, rig)
    np.testing.assert_allclose(found["angle"][1:], known[:, 0], atol=1e-9)
    np.testing.assert_allclose(found["angle_std"][1:], known[:, 1], atol=1e-9)
    assert set(found["health"]) == {word_code("untested")}  # no log taught it
    # at the end of the initialization the first sample is taken in, and the outputs are of the same
    # time
    assert found["angle"][0] == pytest.approx(estimate(log, rig).theta[0], abs=1e-9)


@pytest.mark.more
def test_a_chain(tmp_path: Path) -> None:
    scenario = load_scenario("wrist", ['duration="2 s"'])
    rig = scenario_rig(scenario)
    log, made = (
        simulate(rig, scenario, 1),
        export_fmu(rig, tmp_path / "wrist.fmu", everywhere=False),
    )
    assert validate_fmu(str(tmp_path / "wrist.fmu")) == []
    found, known = (
        simulated(tmp_path / "wrist.fmu", made, log),
        at_the_ends(log, rig, made.exported.estimator.interval),
    )
    assert made.outputs[-1] == "health"
    for k, name in enumerate(made.outputs[:6:2]):
        np.testing.assert_allclose(found[name][1:], known[:, k], atol=1e-9)
        np.testing.assert_allclose(found[f"{name}_std"][1:], known[:, 3 + k], atol=1e-9)


class Instance:
    """An instance that a tool has made, and the numbers of its variables."""

    def __init__(self, folder: str, name: str) -> None:
        said = fmpy.read_model_description(folder)
        self.which = {one.name: one.valueReference for one in said.modelVariables}
        self.inputs = [
            one.valueReference for one in said.modelVariables if one.causality == "input"
        ]
        identifier = said.coSimulation.modelIdentifier
        self.fmu = FMU3Slave(
            guid=said.guid, unzipDirectory=folder, modelIdentifier=identifier, instanceName=name
        )
        self.fmu.instantiate()

    def begin(self, values: np.ndarray) -> None:
        self.fmu.enterInitializationMode(startTime=0.0)
        self.fmu.setFloat64(self.inputs, values.tolist())
        self.fmu.exitInitializationMode()

    def step(self, time: float, values: np.ndarray) -> tuple[float, float]:
        self.fmu.setFloat64(self.inputs, values.tolist())
        self.fmu.doStep(currentCommunicationPoint=time, communicationStepSize=0.01)
        return tuple(self.fmu.getFloat64([self.which["angle"], self.which["angle_std"]]))  # type: ignore[return-value]

    def health(self) -> int:
        return int(self.fmu.getInt64([self.which["health"]])[0])


@pytest.fixture(scope="module")
def folder(path: Path, made: Fmu, tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(fmpy.extract(str(path), str(tmp_path_factory.mktemp("extracted"))))


@pytest.fixture(scope="module")
def known(rig: Rig, log: Log) -> np.ndarray:
    return at_the_ends(log, rig)


def test_two_instances_at_once_do_not_know_each_other(
    folder: str, made: Fmu, log: Log, known: np.ndarray, rig: Rig
) -> None:
    other = simulate(rig, load_scenario("series-2"), 9)
    logs, instances = (log, other), (Instance(folder, "one"), Instance(folder, "two"))
    samples = [samples_of(each, made.inputs) for each in logs]
    for one, rows in zip(instances, samples):
        one.begin(rows[0])
    found = [
        [
            one.step(float(each.time[k]), rows[k])[0]
            for one, each, rows in zip(instances, logs, samples)
        ]
        for k in range(1, 200)
    ]
    both = np.column_stack([known[1:200, 0], at_the_ends(other, rig)[1:200, 0]])
    np.testing.assert_allclose(found, both, atol=1e-9)


def test_after_a_reset_it_begins_anew(folder: str, made: Fmu, log: Log) -> None:
    rows, one = samples_of(log, made.inputs), Instance(folder, "one")
    one.begin(rows[0])
    first = one.step(float(log.time[1]), rows[1])
    for k in range(2, 50):
        one.step(float(log.time[k]), rows[k])
    one.fmu.reset()
    one.begin(rows[0])
    assert one.step(float(log.time[1]), rows[1]) == first


def test_missing_values_gaps_and_steps_between_samples(
    folder: str, rig: Rig, made: Fmu, log: Log
) -> None:
    spoilt = spoiled(log)
    rows, known = samples_of(spoilt, made.inputs), at_the_ends(spoilt, rig)
    assert np.isfinite(rows[0]).all()  # else the first value that comes fills what has no prior
    one = Instance(folder, "one")
    one.begin(first_values(rows))
    found = []
    for k in range(1, 400):
        found.append(one.step(float(spoilt.time[k]), rows[k])[0])
        # a tool that steps between the samples gives no sample
        one.step(float(spoilt.time[k]) + 0.004, rows[k] + 0.01)
    np.testing.assert_allclose(found, known[1:400, 0], atol=1e-9)
    one.step(5000.0, rows[400])
    # it began anew: the gap was too long to bridge
    assert list(HEALTH)[one.health()] == "restarted"


def test_what_cannot_be_is_refused(
    folder: str, rig: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one = Instance(folder, "one")
    for call in (
        lambda: one.fmu.setFloat64([one.which["angle"]], [1.0]),
        lambda: one.fmu.getFloat64([99]),
        lambda: one.fmu.getFloat32([1]),
    ):
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
    assert made.platforms == ()
    assert "DISTAL_COMPILE" in made.without
    assert validate_fmu(str(tmp_path / "sources.fmu")) == []
    with zipfile.ZipFile(tmp_path / "sources.fmu") as archive:
        assert not [name for name in archive.namelist() if name.startswith("binaries")]


def test_sensors_that_are_called_as_outputs_are(rig: Rig, tmp_path: Path) -> None:
    raw = rig.model_dump()
    raw["name"] = 'a <b> & "c"'
    for sensor, name in zip(raw["sensors"], ("angle", "time", "health"), strict=False):
        sensor["name"] = name
    made = export_fmu(
        build_rig(raw, "odd"), tmp_path / "odd.fmu", "elastic", "odd", everywhere=False
    )
    assert validate_fmu(str(tmp_path / "odd.fmu")) == []
    assert made.outputs == ("angle_estimate", "angle_std", "health_estimate")


@pytest.mark.parametrize("wild", [np.inf, 1e9])
def test_a_wild_value_is_a_missing_one(
    folder: str, rig: Rig, made: Fmu, log: Log, wild: float
) -> None:
    rows, one = samples_of(log, made.inputs).copy(), Instance(folder, "one")
    rows[60:, 0] = wild
    one.begin(rows[0])
    found = np.array([one.step(float(log.time[k]), rows[k]) for k in range(1, 100)])
    channels = {
        name: np.where(np.abs(log.channels[name]) > 1e7, np.nan, log.channels[name])
        for name in made.inputs
    }
    channels[made.inputs[0]][60:] = np.nan
    known = at_the_ends(
        Log(log.time, channels, log.truth, "wild", log.truth_source).select(slice(0, 100)), rig
    )
    np.testing.assert_allclose(found[:, 0], known[1:, 0], atol=1e-9)
    assert one.health() == 2  # missing


def test_time_only_goes_on(folder: str, made: Fmu, log: Log) -> None:
    rows, one = samples_of(log, made.inputs), Instance(folder, "one")
    one.begin(rows[0])
    for k in range(1, 20):
        one.step(float(log.time[k]), rows[k])
    for bad in (0.05, np.inf, np.nan):
        with pytest.raises(Exception, match="DoStep"):
            one.step(bad, rows[20])
    one.step(float(log.time[20]), rows[20])


@pytest.mark.slow  # sanitizers
def test_under_sanitizers(path: Path, made: Fmu, rig: Rig, log: Log, tmp_path: Path) -> None:
    """A program that does what a tool does, with all functions, over a log; nothing is reported."""
    with zipfile.ZipFile(path) as archive:
        archive.extractall(tmp_path)
        token = fmpy.read_model_description(str(path)).guid
    rows = samples_of(log, made.inputs)[:100]
    name, parameters = made.exported.name, ",".join(f"{value:.17g}" for value in rows.ravel())
    (tmp_path / "sources" / "main.c").write_text(f"""
#include "{name}_fmi3.c"
#include <stdio.h>
static const double rows[] = {{{parameters}}};
int main(void) {{
  fmi3ValueReference inputs[INPUTS], angle = INPUTS + 1;
  bool no;
  double last, value;
  fmi3Instance one;
  int i, k;
  if (fmi3InstantiateCoSimulation("a", "wrong", "", 0, 0, 0, 0, NULL, 0, NULL, NULL, NULL)) return 1;
  one = fmi3InstantiateCoSimulation("a", "{token}", "", 0, 0, 0, 0, NULL, 0, NULL, NULL, NULL);
  for (i = 0; i < INPUTS; ++i) inputs[i] = i + 1;
  fmi3EnterInitializationMode(one, 0, 0, 0, 0, 0);
  fmi3SetFloat64(one, inputs, INPUTS, rows, INPUTS);
  fmi3ExitInitializationMode(one);
  for (k = 0; k < 100; ++k) {{
    fmi3SetFloat64(one, inputs, INPUTS, rows + k * INPUTS, INPUTS);
    if (fmi3DoStep(one, 0.01 * k, 0.01, 0, &no, &no, &no, &last)) return 2;
  }}
  if (fmi3GetFloat64(one, &angle, 1, &value, 1)) return 3;
  printf("%.17g\\n", value);
  fmi3FreeInstance(one);
  return 0;
}}
""")
    flags = [
        "-std=c99",
        "-Wall",
        "-Wextra",
        "-Werror",
        "-g",
        "-fsanitize=address,undefined",
        "-fno-sanitize-recover=all",
    ]
    command = [*CC.command, *flags, "main.c", f"{name}.c", "-lm", "-o", "program"]  # type: ignore[union-attr]
    done = subprocess.run(
        command, cwd=tmp_path / "sources", capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    run = subprocess.run(
        [str(tmp_path / "sources" / "program")], capture_output=True, text=True, check=False
    )
    assert (run.returncode, run.stderr) == (0, "")
    assert abs(float(run.stdout) - at_the_ends(log, rig)[99, 0]) < 1e-9


def test_the_command(tmp_path: Path) -> None:
    done = CliRunner().invoke(
        app, ["export-fmu", "capstan-joint", "--here", "--out", str(tmp_path / "a.fmu")]
    )
    assert done.exit_code == 0, done.output
    assert "motor_angle, motor_torque" in done.output
    assert f"-{sys.platform}" in done.output
