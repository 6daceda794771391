"""The example node, with stand-ins for rclpy and its messages: what it reads, what it publishes."""

from __future__ import annotations

import importlib.util
import sys
import types
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from distal import Log, estimate, load_rig, scenario_rig, simulate
from distal.simulation import build_scenario

NODE = Path(__file__).parents[1] / "examples" / "ros2" / "distal_ros" / "distal_ros" / "node.py"


class StandIn:
    """Any object with any members."""

    OK, WARN, ERROR = 0, 1, 2

    def __init__(self, **members: Any) -> None:
        self.__dict__.update(members)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        self.__dict__[name] = StandIn()
        return self.__dict__[name]


class Node(StandIn):
    parameters: dict[str, Any] = {}  # noqa: RUF012

    def __init__(self, name: str) -> None:
        super().__init__(sent=[], messages=[])

    def declare_parameter(self, name: str, default: Any) -> StandIn:
        return StandIn(value=self.parameters.get(name, default))

    def create_publisher(self, kind: type, topic: str, depth: int) -> StandIn:
        return StandIn(publish=lambda message: self.sent.append((topic, message)))

    def create_subscription(self, kind: type, topic: str, call: Any, depth: int) -> None:
        self.call = call

    def get_logger(self) -> StandIn:
        return StandIn(info=self.messages.append, warning=self.messages.append)


@pytest.fixture
def node(monkeypatch: pytest.MonkeyPatch) -> Any:
    modules = {
        "rclpy": {},
        "rclpy.executors": {"ExternalShutdownException": RuntimeError},
        "rclpy.node": {"Node": Node},
        "sensor_msgs": {},
        "diagnostic_msgs": {},
    }
    modules |= {
        "sensor_msgs.msg": {"JointState": StandIn},
        "diagnostic_msgs.msg": {"DiagnosticStatus": StandIn, "KeyValue": StandIn},
    }
    for name, members in modules.items():
        made = types.ModuleType(name)
        made.__dict__.update(members)
        monkeypatch.setitem(sys.modules, name, made)
    spec = importlib.util.spec_from_file_location("distal_ros_node", NODE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(Node, "parameters", {"rig": "capstan-joint", "motor": "m1"})
    return module.EstimateNode()


@pytest.fixture(scope="module")
def log() -> Log:
    servo = {"angle": {"amplitude": 0.5, "frequency": 0.4}, "stiffness": 20.0, "damping": 0.3}
    scenario = build_scenario({"rig": "capstan-joint", "duration": 1.0, "drives": {"motor": {"servo": servo}}}, "s")
    return simulate(scenario_rig(scenario), scenario)


def test_it_publishes_what_estimate_gives(node: Any, log: Log) -> None:
    for k, time in enumerate(log.time):
        at = round((1.7e9 + time) * 1e9)
        stamp = StandIn(sec=at // 10**9, nanosec=at % 10**9)
        position, effort = log.channels["motor_angle"][k], log.channels["motor_torque"][k]
        node.call(
            StandIn(header=StandIn(stamp=stamp), name=["other", "m1"], position=[9.0, position], effort=[9.0, effort])
        )
    angles = [message.position[0] for topic, message in node.sent if topic == "joint_estimate"]
    words = {message.message for topic, message in node.sent if topic == "joint_health"}
    assert words == {"ok"}
    np.testing.assert_allclose(angles, estimate(log, load_rig("capstan-joint")).theta, atol=1e-5)


def test_what_it_cannot_read_is_said_not_raised(node: Any, log: Log) -> None:
    for name, position in ((["m1"], []), (["nobody"], [1.0]), ([], [])):
        stamp = StandIn(sec=1, nanosec=0)
        node.call(StandIn(header=StandIn(stamp=stamp), name=name, position=position, effort=[]))
    assert [message.message for _, message in node.sent] == ["bad"] * 3
    assert any("['m1'] expected in one message, ['nobody'] came" in text for text in node.messages)
