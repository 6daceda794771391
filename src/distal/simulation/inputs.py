"""A scenario's signals as arrays on a time grid, one column per body."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from distal.arrays import Floats
from distal.errors import ScenarioError, did_you_mean
from distal.model import GRAVITY, Mechanism
from distal.simulation.scenario import CapstanServo, DriveInput, JointInput, Scenario, SliderServo
from distal.units import to_si


@dataclass(frozen=True)
class BodyInputs:
    """What acts on the bodies in each interval of a grid.

    Args:
        effort: force or torque, hung weights included, (n, n_bodies).
        added_inertia: mass of the hung weights, (n, n_bodies).
        servo: stiffness, target and damping of a spring to a target, (n, n_bodies, 3).
    """

    effort: Floats
    added_inertia: Floats
    servo: Floats


def body_inputs(scenario: Scenario, mechanism: Mechanism, time: Floats) -> BodyInputs:
    """Return the scenario's signals at `time` [s], (n,).

    Args:
        time: start of each interval [s], (n,).

    Raises:
        ScenarioError: the scenario names a joint or drive that the rig does not have, or pulls one in a way it cannot be.
    """
    rig = mechanism.rig
    _known(scenario.joints, [joint.name for joint in rig.joints], "joints", "joint")
    _known(scenario.drives, [drive.name for drive in rig.drives], "drives", "drive")
    n, bodies = len(time), mechanism.n_bodies
    inputs = BodyInputs(np.zeros((n, bodies)), np.zeros((n, bodies)), np.zeros((n, bodies, 3)))
    for i, joint in enumerate(rig.joints):
        _joint(inputs, i, scenario.joints.get(joint.name, JointInput()), time)
    for i, drive in enumerate(rig.drives):
        given = scenario.drives.get(drive.name, DriveInput())
        _check(given, drive.kind, f"drives.{drive.name}")
        _drive(inputs, mechanism.n_joints + i, given, time)
    return inputs


def _joint(inputs: BodyInputs, body: int, given: JointInput, time: Floats) -> None:
    if given.torque is not None:
        inputs.effort[:, body] += given.torque.at(time)
    if given.hand is not None:
        inputs.servo[:, body, 0] = given.hand.stiffness
        inputs.servo[:, body, 1] = given.hand.angle.at(time)
        inputs.servo[:, body, 2] = given.hand.damping


def _drive(inputs: BodyInputs, body: int, given: DriveInput, time: Floats) -> None:
    for signal in (given.force, given.torque, given.weight):
        if signal is not None:
            inputs.effort[:, body] += signal.at(time)
    if given.weight is not None:
        inputs.added_inertia[:, body] = given.weight.at(time) / GRAVITY
    if given.servo is not None:
        target = given.servo.position if isinstance(given.servo, SliderServo) else given.servo.angle
        inputs.servo[:, body, 0] = given.servo.stiffness
        inputs.servo[:, body, 1] = target.at(time)
        inputs.servo[:, body, 2] = given.servo.damping


def _check(given: DriveInput, kind: str, where: str) -> None:
    wrong = {
        "slider": {"torque": given.torque is not None, "servo.angle": isinstance(given.servo, CapstanServo)},
        "capstan": {
            "force": given.force is not None,
            "weight": given.weight is not None,
            "servo.position": isinstance(given.servo, SliderServo),
        },
    }[kind]
    allowed = {"slider": "weight, force, servo.position", "capstan": "torque, servo.angle"}[kind]
    for name, came in wrong.items():
        if came:
            raise ScenarioError(f"{where}.{name}: a {kind} cannot be pulled so; {allowed} are allowed")


def _known(given: Iterable[str], names: list[str], where: str, kind: str) -> None:
    for name in given:
        if name not in names:
            raise ScenarioError(f"{where}: the rig has no {kind} '{name}'{did_you_mean(name, names)}")


def initial_angles(scenario: Scenario, mechanism: Mechanism) -> Floats:
    """Return the joints' angles at the start [rad], (n_joints,): the scenario's, else the rig's `initial`.

    Raises:
        ScenarioError: an unknown joint, or no angle.
    """
    names = [joint.name for joint in mechanism.rig.joints]
    _known(scenario.initial, names, "initial", "joint")
    angles = np.array([joint.initial.value for joint in mechanism.rig.joints])
    for name, raw in scenario.initial.items():
        coupled = mechanism.rig.joints[names.index(name)].coupled
        if coupled is not None:
            raise ScenarioError(f"initial.{name}: it follows '{coupled.joint}'; give the angle of that joint")
        try:
            angles[names.index(name)] = to_si(raw, "rad")
        except ValueError as problem:
            raise ScenarioError(f"initial.{name}: {problem}") from None
    # coupled joints stand where the others say
    placed: Floats = (mechanism.spread.full() @ angles[mechanism.free]) + mechanism.offsets.full().ravel()
    return placed
