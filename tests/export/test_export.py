"""The exported filter: the numbers of Python, on a PC with sanitizers, and what it refuses."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from distal import Log, Rig, estimate, load_rig, load_scenario, scenario_rig, simulate
from distal.cli.app import app
from distal.errors import EstimationError, OutputError
from distal.estimators import first_values
from distal.export import Exported, c_filter, export_c
from distal.run import samples_of
from distal.simulation import build_scenario
from tests.export.helpers import build, needs_compiler, replayed, run, spoiled, stepped

__all__ = ["build", "needs_compiler", "replayed"]


@pytest.fixture(scope="module")
def rig() -> Rig:
    return scenario_rig(load_scenario("series-2"))


@pytest.fixture(scope="module")
def log(rig: Rig) -> Log:
    """8 s with gaps, missing values and a dead sensor."""
    return spoiled(simulate(rig, load_scenario("series-2"), 5))


INSIDE: dict[str, Any] = {
    "joints.0.spring": {"stiffness": 0.3, "cubic": {"value": 0.2, "std": 0.05}},
    "joints.0.extension_spring": {
        "stiffness": {"value": 300.0, "std": 20.0},
        "free_length": 0.014,
        "radius": 0.009,
        "distance": 0.026,
        "line_angle": -0.9,
    },
    "joints.0.external_torque.std": 0.05,
    "drives.0.backlash.width": {"value": 4e-3, "std": 1e-3},
    "drives.0.cogging": {"periods": 21, "cosine": {"value": 0.0, "std": 2e-3}},
    "tendons.0.pretension": {"value": 0.0, "std": 0.0},
    "tendons.0.slack": {"value": 2e-4, "std": 1e-4},
    "tendons.0.creep": {"share": {"value": 0.2, "std": 0.1}, "time": {"value": 3.0, "std": 1.0}},
    "tendons.1.stiffening": {"value": 200.0, "std": 40.0},
    "tendons.1.path": {"friction": {"value": 0.1, "std": 0.03}, "wrap": 1.5, "nodes": 2},
    "sensors.motor_torque.gain": {"value": 1.0, "std": 0.02},
}
"""Springs that are not linear, a slack tendon, a torque from outside, all that moves inside."""

TITLE = 'a */ #error "b" /* \\\n ?' + "?/ $real$ $name$ é 😀"


def compare(rig: Rig, log: Log, made: Exported, folder: Path, *options: str) -> np.ndarray:
    """Compare the whole state, every innovation, angles and stds with Python's, from the prior on;
    return what else is put out. A title is anything.
    """
    found, chosen = run(build(made, folder, *options), log), made.estimator
    samples = samples_of(log, chosen.channels)
    belief = chosen.initial(log.time[0], first_values(samples))
    states, ys = chosen.advanced(belief, log.time, samples)
    tolerance, m, n = np.deg2rad(0.02) if made.real.single else 1e-9, len(chosen.measured), 2
    if not made.real.single:
        scale = np.abs(states) + 1e-6
        np.testing.assert_allclose(found.kernel_states / scale, states / scale, atol=tolerance)
        innovations, variances = chosen.innovations_of(ys, samples)
        np.testing.assert_allclose(found.innovations[:, :m], innovations, atol=tolerance)
        np.testing.assert_allclose(found.variances[:, :m], variances, rtol=tolerance)
    if chosen.name != "ekf-2008":  # it goes over a log twice
        known, n = estimate(log, rig, chosen.name), 2 * len(rig.joints)
        np.testing.assert_allclose(found.fields[:, 0:n:2], known.angles, atol=tolerance)
        np.testing.assert_allclose(found.fields[:, 1:n:2], known.angle_stds, atol=tolerance)
    return found.fields[:, n:]


@needs_compiler
@pytest.mark.parametrize("single", [False, True])
def test_a_whole_log_under_sanitizers(rig: Rig, log: Log, single: bool, tmp_path: Path) -> None:
    """No address or undefined behaviour is reported."""
    options = ["-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-Wpedantic"]
    made = c_filter(rig.model_copy(update={"name": TITLE}), "adaptive", single)
    assert not compare(rig, log, made, tmp_path, *options).size


@needs_compiler
@pytest.mark.parametrize(
    ("name", "scenario"),
    [
        ("ekf-2008", "series-2"),
        ("elastic", "wrist"),
        ("ekf", "series-2"),
        ("inextensible", "lab-bench"),
    ],
)
def test_other_estimators(name: str, scenario: str, tmp_path: Path) -> None:
    rig = scenario_rig(load_scenario(scenario))
    log = simulate(rig, load_scenario(scenario), 2).select(slice(0, 300))
    compare(rig, log, c_filter(rig, name), tmp_path, "-O0")


@needs_compiler
@pytest.mark.parametrize(
    ("name", "changes", "single"),
    [
        ("capstan-joint", INSIDE, False),
        ("capstan-joint", {}, True),
        ("da-vinci-grasper", {}, False),  # hysteresis with a considered state
    ],
    ids=["inside", "float", "grasper"],
)
def test_other_rigs(name: str, changes: dict[str, Any], single: bool, tmp_path: Path) -> None:
    """A motor goes to and fro."""
    rig = load_rig(name).with_values(changes)
    servo = {"angle": {"amplitude": 0.5, "frequency": 0.4}, "stiffness": 20.0, "damping": 0.3}
    raw = {"rig": rig.name, "duration": 3.0, "drives": {"motor": {"servo": servo}}}
    log = simulate(rig, build_scenario(raw, "servo"), 2)
    more = compare(rig, log, c_filter(rig, "adaptive", single), tmp_path, "-O0")
    assert more.any() == (rig.joints[0].external_torque.std > 0.0)
    if more.size:
        known = estimate(log, rig)
        torque = np.column_stack([known.external_torque, known.external_torque_std])
        np.testing.assert_allclose(more, torque, atol=1e-9)


@needs_compiler
def test_what_a_step_refuses(rig: Rig, log: Log, tmp_path: Path) -> None:
    """Late, repeated, too late, infinite: a code, and the state stays."""
    program = build(c_filter(rig), tmp_path, "-O1")
    good, after = samples_of(log, program.made.estimator.channels)[:2]
    refused = [
        *((dt, after, 1) for dt in (0.0, -0.01, np.nan, 1e-200, 5e-10)),
        *((dt, after, 2) for dt in (1e9, np.inf)),
        *((0.01, [0.0, 0.0, wild, 2.0], 3) for wild in (np.inf, 1e300)),
    ]
    steps, values, codes = zip((0.0, good, 0), *refused, (0.01, np.full(4, np.nan), 0))
    found = stepped(program, np.array(steps), np.vstack([good, *values]))
    np.testing.assert_array_equal(found.codes, codes)
    np.testing.assert_array_equal(np.ptp(found.kernel_states[:-1], axis=0), 0.0)


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


GOLDEN = Path(__file__).parent / "golden"


@pytest.mark.stored
def test_golden_files(request: pytest.FixtureRequest) -> None:
    """What is written is what was looked at, in every process; `pytest --update-golden` writes it
    anew.
    """
    made = c_filter(load_rig("capstan-joint"), "adaptive", True, "capstan_adaptive")
    for name, text in made.files.items():
        if request.config.getoption("--update-golden"):
            (GOLDEN / name).write_text(text)
        assert (GOLDEN / name).read_text() == text, (
            f"{name} differs; if it should, run pytest --update-golden and look at the diff"
        )


def test_what_cannot_be_exported_is_said(rig: Rig, tmp_path: Path) -> None:
    with pytest.raises(EstimationError, match="has no map of what its sensors read"):
        c_filter(rig, "regression")
    (tmp_path / "README.md").mkdir()
    with pytest.raises(OutputError, match="is a folder"):
        export_c(rig, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["README.md"]


def test_the_command(tmp_path: Path) -> None:
    words = ["export-c", "pulley-antagonist", "--out", str(tmp_path), "--float"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    stem = "pulley_antagonist_adaptive"
    assert {path.name for path in tmp_path.iterdir()} == {"README.md", f"{stem}.c", f"{stem}.h"}
    assert "1,468 bytes" in done.output
    assert "1,468 bytes" in (tmp_path / "README.md").read_text()
