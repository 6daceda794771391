"""The FMU in a second importer, before its first sample, and its binaries for other platforms."""

from __future__ import annotations

import importlib.util
import struct
import zipfile
from collections.abc import Iterator
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmuloader.fmi3 import Fmi3Slave
from typer.testing import CliRunner

from distal import LiveEstimator, Log, Rig, load_rig, load_scenario, scenario_rig, simulate
from distal.cli.app import app
from distal.estimators import make_estimator
from distal.export import Fmu, export_fmu
from distal.export.fmu import ZIG_TARGETS, this_platform
from distal.run import samples_of
from tests.export.helpers import CC
from tests.export.test_fmu import at_the_ends
from tests.learned_maps import drawn_map

pytestmark = pytest.mark.skipif(isinstance(CC, str), reason="no C compiler")


class Imported:
    """An FMU as `fmuloader` runs it, which shares no code with fmpy; variables by their names."""

    def __init__(self, path: Path) -> None:
        said = fmpy.read_model_description(str(path))
        self.which = {one.name: one.valueReference for one in said.modelVariables}
        self.inputs = [
            one.valueReference for one in said.modelVariables if one.causality == "input"
        ]
        health = next(one for one in said.typeDefinitions if one.name == "Health")
        self.words = {int(item.value): item.name for item in health.items}
        self.slave = Fmi3Slave(path, model_identifier=said.coSimulation.modelIdentifier)
        self.slave.instantiate_co_simulation("one", instantiation_token=said.guid)

    def identified(self, *names: str) -> tuple[float, ...]:
        return tuple(self.slave.get_float64([self.which[name] for name in names]))

    @property
    def health(self) -> str:
        return self.words[self.slave.get_int64([self.which["health"]])[0]]

    def step(self, time: float, length: float, values: np.ndarray) -> None:
        self.slave.set_float64(self.inputs, values.tolist())
        self.slave.do_step(time, length)


@pytest.fixture(scope="module")
def rig() -> Rig:
    return scenario_rig(load_scenario("series-2"))


@pytest.fixture(scope="module")
def log(rig: Rig) -> Log:
    return simulate(rig, load_scenario("series-2", ['duration="4 s"']), 5)


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("importers") / "rig.fmu"


@pytest.fixture(scope="module")
def made(rig: Rig, path: Path) -> Fmu:
    return export_fmu(rig, path, everywhere=False)


@pytest.fixture
def one(path: Path, made: Fmu) -> Iterator[Imported]:
    imported = Imported(path)
    yield imported
    imported.slave.terminate()
    imported.slave.free_instance()


def test_a_second_importer_gets_the_same_numbers_at_the_current_time(
    one: Imported, made: Fmu, rig: Rig, log: Log
) -> None:
    rows = samples_of(log, made.inputs)
    one.slave.enter_initialization_mode(start_time=0.0)
    one.slave.set_float64(one.inputs, rows[0].tolist())
    one.slave.exit_initialization_mode()
    found = []
    for time, row in zip(log.time.tolist(), rows):
        one.step(time, 0.01, row)
        found.append(one.identified("time", "angle", "angle_std"))
    np.testing.assert_allclose(np.array(found)[:, 0], log.time + 0.01, atol=1e-12)
    assert found[-1][0] == pytest.approx(4.0, abs=1e-12)
    np.testing.assert_allclose(np.array(found)[:, 1:], at_the_ends(log, rig), atol=1e-9)
    assert one.health == "untested"  # no log taught it


def test_before_the_first_sample_it_says_the_prior_and_not_yet(
    one: Imported, rig: Rig, log: Log, made: Fmu
) -> None:
    missing = np.full(len(made.inputs), np.nan)
    prior = make_estimator("adaptive", rig).initial(0.0, missing)
    expected = pytest.approx((2.5, prior.mean[0], np.sqrt(prior.covariance[0, 0])), abs=1e-12)
    assert prior.covariance[0, 0] > 0.0
    one.slave.enter_initialization_mode(start_time=2.5)
    # inputs that are set before the initialization ends are no sample yet
    one.slave.set_float64(one.inputs, [0.01] * len(made.inputs))
    assert one.identified("time", "angle", "angle_std") == expected
    assert one.health == "not_yet"
    # what is not connected is no sample either
    one.slave.set_float64(one.inputs, missing.tolist())
    one.slave.exit_initialization_mode()
    assert one.identified("time", "angle", "angle_std") == expected
    one.step(2.5, 0.01, missing)
    assert one.identified("angle", "angle_std") == (expected.expected[1], expected.expected[2])
    assert (one.identified("time")[0], one.health) == (pytest.approx(2.51), "not_yet")
    one.step(2.51, 0.01, samples_of(log, made.inputs)[0])
    assert one.health != "not_yet"
    one.slave.reset()
    assert (one.health, one.identified("time")) == ("not_yet", (0.0,))


def test_a_step_that_is_too_long_to_predict_keeps_the_last_outputs(
    one: Imported, made: Fmu, log: Log
) -> None:
    row = samples_of(log, made.inputs)[0]
    one.slave.enter_initialization_mode(start_time=0.0)
    one.slave.set_float64(one.inputs, row.tolist())
    one.slave.exit_initialization_mode()
    before = one.identified("angle", "angle_std")
    one.step(0.0, 1e6, row)
    assert one.identified("time", "angle", "angle_std") == (1e6, *before)


def test_with_a_learned_map(tmp_path: Path) -> None:
    """Before the first sample no map has spoken; a step's end is the map's too."""
    rig = load_rig("capstan-joint").with_map(filter=[drawn_map()])
    export_fmu(rig, tmp_path / "map.fmu", everywhere=False)
    one, live = Imported(tmp_path / "map.fmu"), LiveEstimator(rig)
    one.slave.enter_initialization_mode(start_time=0.0)
    prior = live.estimator.initial(0.0, np.full(2, np.nan))
    assert one.identified("angle", "angle_std") == pytest.approx(
        (prior.mean[0], np.sqrt(prior.covariance[0, 0])), abs=1e-12
    )
    for k in range(20):
        time, row = 0.005 * k, np.array([0.3 * np.sin(0.1 * k), 0.02])
        live.step(time, row)
        end = live.clone()
        end.step(time + 0.005, np.full(2, np.nan))
        one.step(time, 0.005, row)
        assert one.identified("angle", "angle_std") == pytest.approx(
            (end.angle, end.angle_stds[0]), abs=1e-9
        )
    one.slave.free_instance()


@pytest.mark.more
@pytest.mark.skipif(importlib.util.find_spec("ziglang") is None, reason="needs ziglang")
@pytest.mark.slow  # ziglang builds its own C libraries the first time
def test_binaries_for_all_platforms(tmp_path: Path, rig: Rig) -> None:
    """Each has the file format and the machine of its platform, and the names that an importer
    looks for.
    """
    made = export_fmu(rig, tmp_path / "all.fmu")
    assert made.without == ""
    assert set(made.platforms) == {*ZIG_TARGETS, this_platform()}
    with zipfile.ZipFile(tmp_path / "all.fmu") as archive:
        found = {
            name.split("/")[1]: archive.read(name)
            for name in archive.namelist()
            if name.startswith("binaries/")
        }
        suffixes = {
            name.split("/")[1]: Path(name).suffix
            for name in archive.namelist()
            if "binaries/" in name
        }
    for platform, code in found.items():
        machine, system = platform.split("-")
        assert b"fmi3DoStep" in code
        if system == "linux":
            assert code[:5] == b"\x7fELF\x02"
            assert struct.unpack_from("<H", code, 18)[0] == {"x86_64": 62, "aarch64": 183}[machine]
        elif system == "darwin":
            kind = {"x86_64": 0x01000007, "aarch64": 0x0100000C}[machine]
            assert struct.unpack_from("<II", code) == (0xFEEDFACF, kind)
        else:
            at = struct.unpack_from("<I", code, 60)[0]
            assert code[:2] + code[at : at + 4] == b"MZPE\0\0"
            assert struct.unpack_from("<H", code, at + 4)[0] == 0x8664
        assert suffixes[platform] == {"linux": ".so", "darwin": ".dylib", "windows": ".dll"}[system]


def test_without_ziglang_the_command_says_what_is_lacking_and_how_to_get_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    done = CliRunner().invoke(
        app, ["export-fmu", "capstan-joint", "--out", str(tmp_path / "a.fmu")]
    )
    said = " ".join(done.output.split())
    assert done.exit_code == 0, done.output
    assert "x86_64-windows, x86_64-darwin, aarch64-darwin need ziglang: pip install ziglang" in said
    with zipfile.ZipFile(tmp_path / "a.fmu") as archive:
        assert {name.split("/")[1] for name in archive.namelist() if "binaries/" in name} == {
            this_platform()
        }
