"""The step of LeRobot's processors, on the real package where it is installed and else on its bare
interface.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from distal import LiveEstimator, load_rig
from distal.rig import edited_text

COLUMNS = {
    "sensors.motor_angle.column": "observation.state.motor.pos",
    "sensors.motor_torque.column": "observation.state.motor.current",
}


class Step:
    """What a step of LeRobot inherits: it is called with a transition."""

    def __call__(self, transition: dict[str, Any]) -> dict[str, Any]:
        return transition | {"observation": self.observation(dict(transition["observation"]))}


class Registry:
    """Keeps steps by name."""

    @classmethod
    def register(cls, name: str) -> Any:
        assert name == "distal_joint_angles"
        return lambda step: step


@pytest.fixture
def module(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """The bridge with LeRobot, or with its interface where that is not installed."""
    is_there = find_spec("lerobot") is not None
    if not is_there:
        kinds = SimpleNamespace(ACTION="ACTION", OBSERVATION="OBSERVATION")
        types = {
            "FeatureType": SimpleNamespace(STATE="STATE"),
            "PipelineFeatureType": kinds,
            "PolicyFeature": SimpleNamespace,
        }
        steps = {"ObservationProcessorStep": Step, "ProcessorStepRegistry": Registry}
        for name, content in (("configs", {}), ("configs.types", types), ("processor", steps)):
            made = ModuleType(f"lerobot.{name}")
            vars(made).update(content)
            monkeypatch.setitem(sys.modules, f"lerobot.{name}", made)
        monkeypatch.setitem(sys.modules, "lerobot", ModuleType("lerobot"))
    yield import_module("distal.bridges.lerobot_step")
    if not is_there:
        sys.modules.pop("distal.bridges.lerobot_step")


@pytest.fixture
def path(tmp_path: Path) -> str:
    file = tmp_path / "rig.toml"
    settings = [f'{key}="{value}"' for key, value in COLUMNS.items()]
    file.write_text(edited_text("capstan-joint", settings), encoding="utf-8")
    return str(file)


def test_the_angles_are_those_of_a_live_estimator(
    module: ModuleType, path: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    stamps = 5.0 + np.arange(40) / 200.0
    clock = iter([5.0, *stamps])
    monkeypatch.setattr(time, "monotonic", lambda: next(clock))
    step = module.JointAngles(path, unit="rad")
    live = LiveEstimator(load_rig(path))
    assert live.channels == ("motor_angle", "motor_torque")
    for stamp in stamps:
        position = 0.3 * np.sin(4.0 * stamp)
        torque = 0.02 * np.cos(4.0 * stamp)
        seen = {"motor.pos": position, "motor.current": torque, "camera": b"picture"}
        found = step({"observation": seen})["observation"]
        angle = live.step(stamp - 5.0, np.array([position, torque]))
        assert {key: found[key] for key in seen} == seen
        assert found["jaw.angle"] == pytest.approx(angle, abs=1e-12)
        assert found["jaw.angle_std"] == pytest.approx(live.angle_std, abs=1e-12)


def test_what_it_adds_is_described_and_what_makes_it_is_kept(module: ModuleType, path: str) -> None:
    step = module.JointAngles(path)
    assert type(step)(**step.get_config()).get_config() == {"rig": path, "unit": "deg"}
    observed = module.PipelineFeatureType.OBSERVATION
    action = module.PipelineFeatureType.ACTION
    described = step.transform_features({observed: {"motor.pos": 1}, action: {"a": 2}})
    assert set(described[observed]) == {"motor.pos", "jaw.angle", "jaw.angle_std"}
    assert described[action] == {"a": 2}


def test_an_episode_begins_anew_and_a_motor_may_be_missing(module: ModuleType, path: str) -> None:
    step = module.JointAngles(path)
    seen = {"observation": {"motor.pos": 0.1, "motor.current": 0.0}}
    first = step(seen)["observation"]
    in_radians = module.JointAngles(path, unit="rad")(seen)["observation"]
    for what in ("jaw.angle", "jaw.angle_std"):
        assert first[what] == pytest.approx(np.rad2deg(in_radians[what]))
    assert first["jaw.angle_std"] > 0.1
    step({"observation": {"motor.pos": 0.9}})
    step.reset()
    assert step(seen)["observation"] == first
