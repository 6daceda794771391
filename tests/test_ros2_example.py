"""The example node: what it reads, what it publishes, in messages of ROS 2's own definitions;
`rclpy` has a stand-in.
"""

from __future__ import annotations

import importlib.util
import sys
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from distal import Log, estimate, load_rig, simulate
from tests.helpers import turned_capstan

rosbags = pytest.importorskip("rosbags.typesys")

NODE = Path(__file__).parents[1] / "examples" / "ros2" / "distal_ros" / "distal_ros" / "node.py"
STORE = rosbags.get_typestore(rosbags.Stores.ROS2_HUMBLE)
START = 1_700_000_000_000_000_000


class Message:
    """An object with members that are set, as a message is before it is complete."""

    def __init__(self, **members: Any) -> None:
        self.__dict__.update(members)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        self.__dict__[name] = Message()
        return self.__dict__[name]


def wire(kind: str, message: Message) -> Any:
    """Return a message after it was serialized and read again by its definition; what is not set is
    empty.
    """
    return STORE.deserialize_cdr(STORE.serialize_cdr(typed(kind, message), kind), kind)


def typed(kind: str, message: Message) -> Any:
    """Return a message of its own type; fields that the type does not have are an error."""
    fields = dict(STORE.get_msgdef(kind).fields)
    unknown = set(vars(message)) - set(fields) - {"__msgtype__"}
    assert not unknown, f"{kind} has no {unknown}"
    return STORE.types[kind](
        **{name: filled(node, vars(message).get(name)) for name, node in fields.items()}
    )


def filled(node: Any, value: Any) -> Any:
    """Return a field's value in the type of its definition."""
    sort, of = node[0].name, node[1]
    if sort == "NAME":
        return typed(of, value if value is not None else Message())
    if sort == "BASE":
        if of[0] == "string":
            return "" if value is None else value
        return 0 if value is None else value
    (inner, what), _ = of
    values = [] if value is None else value
    if inner.name == "BASE" and what[0] != "string":
        return np.array(values, dtype=what[0])
    return [filled((inner, what), one) for one in values]


class Node:
    """The stand-in of `rclpy.node.Node`."""

    parameters: dict[str, Any] = {}  # noqa: RUF012

    def __init__(self, name: str) -> None:
        self.sent: list[tuple[str, Any]] = []
        self.messages: list[str] = []
        self.calls: dict[str, Callable[[Any], None]] = {}

    def declare_parameter(self, name: str, default: Any) -> Any:
        return Message(value=self.parameters.get(name, default))

    def create_publisher(self, kind: Any, topic: str, depth: int) -> Any:
        return Message(publish=lambda message: self.sent.append((topic, wire(kind.kind, message))))

    def create_subscription(
        self, kind: Any, topic: str, call: Callable[[Any], None], depth: int
    ) -> None:
        self.calls[topic] = call

    def get_logger(self) -> Any:
        return Message(info=self.messages.append, warning=self.messages.append)


def message_class(kind: str) -> type:
    """Return a class as the generated Python of a message, with its constants."""
    constants = {name: value for name, value in vars(STORE.types[kind]).items() if name.isupper()}
    return type(kind.rsplit("/", 1)[-1], (Message,), {"kind": kind, **constants})


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Any]:
    """Return what starts a node with parameters."""
    modules: dict[str, dict[str, Any]] = {
        "rclpy": {},
        "rclpy.executors": {"ExternalShutdownException": RuntimeError},
        "rclpy.node": {"Node": Node},
        "sensor_msgs": {},
        "sensor_msgs.msg": {"JointState": message_class("sensor_msgs/msg/JointState")},
        "diagnostic_msgs": {},
        "diagnostic_msgs.msg": {
            name: message_class(f"diagnostic_msgs/msg/{name}")
            for name in ("DiagnosticArray", "DiagnosticStatus", "KeyValue")
        },
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

    def start(**parameters: Any) -> Any:
        monkeypatch.setattr(Node, "parameters", parameters)
        return module.EstimateNode()

    return start


def states(time: float, names: list[str], position: list[float], effort: list[float]) -> Any:
    """Return a message as it comes off the wire."""
    at = START + round(time * 1e9)
    stamp = Message(sec=at // 10**9, nanosec=at % 10**9)
    return wire(
        "sensor_msgs/msg/JointState",
        Message(header=Message(stamp=stamp), name=names, position=position, effort=effort),
    )


@pytest.fixture(scope="module")
def log() -> Log:
    return simulate(load_rig("capstan-joint"), turned_capstan(1.0))


def test_it_publishes_what_estimate_gives(started: Callable[..., Any], log: Log) -> None:
    node = started(rig="capstan-joint", names=["m1:motor"])
    for k, time in enumerate(log.time):
        position, effort = log.channels["motor_angle"][k], log.channels["motor_torque"][k]
        node.calls["motor_states"](states(time, ["other", "m1"], [9.0, position], [9.0, effort]))
    angles = [message.position[0] for topic, message in node.sent if topic == "joint_estimate"]
    stds, words = [], set()
    for topic, message in node.sent:
        if topic == "joint_health":
            words.add(message.status[0].message)
            stds.append(
                float(
                    {pair.key: pair.value for pair in message.status[0].values}["std of jaw [rad]"]
                )
            )
    expected = estimate(log, load_rig("capstan-joint"))
    assert words == {"untested"}
    np.testing.assert_allclose(angles, expected.theta, atol=1e-5)
    np.testing.assert_allclose(stds, expected.theta_std, rtol=1e-2)
    assert not any(len(message.effort) for topic, message in node.sent if topic == "joint_estimate")


def test_a_hand_from_two_topics_is_one_message_of_all_joints(started: Callable[..., Any]) -> None:
    rig = load_rig("hand")
    node = started(rig="hand", topics=["/thumb", "/fingers"])
    drives = [drive.name for drive in rig.drives]
    for k in range(10):
        # the second topic comes a millisecond later, at 100 Hz, and not at all with the last sample
        for topic, names, late in (("/thumb", drives[:2], 0.0), ("/fingers", drives[2:], 1e-3)):
            if k < 9 or topic == "/thumb":
                node.calls[topic](
                    states(k / 100 + late, names, [40.0 + k] * len(names), [60.0] * len(names))
                )
    node.calls["/thumb"](states(0.1, drives[:2], [50.0] * 2, [60.0] * 2))
    made = [message for topic, message in node.sent if topic == "joint_estimate"]
    words = [message.status[0].message for topic, message in node.sent if topic == "joint_health"]
    assert len(made) == 10
    assert set(words[1:9]) == {"untested"}
    assert all(list(message.name) == [joint.name for joint in rig.joints] for message in made)
    assert [message.header.stamp.nanosec for message in made] == [k * 10_000_000 for k in range(10)]


def test_what_it_cannot_read_is_said_not_raised(started: Callable[..., Any]) -> None:
    node = started(rig="capstan-joint")
    for k, (names, position) in enumerate(((["motor"], []), (["nobody"], [1.0]), ([], []))):
        node.calls["motor_states"](states(1.0 + k, names, position, []))
    words = [message.status[0].message for topic, message in node.sent if topic == "joint_health"]
    assert words == ["bad"] * 3
    assert any("['motor'] expected in a message, ['nobody'] came" in text for text in node.messages)
    with pytest.raises(
        ValueError, match=r"each is name:drive, and the rig has the drives \['motor'\]"
    ):
        started(rig="capstan-joint", names=["m1:nobody"])
