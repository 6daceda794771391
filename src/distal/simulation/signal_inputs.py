"""A scenario's signals as arrays on a time grid, one column per body."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from distal.arrays import Floats
from distal.errors import ScenarioError
from distal.model import GRAVITY, Mechanism
from distal.simulation.scenario import (
    CapstanServo,
    DriveInput,
    JointInput,
    Scenario,
    SliderLoop,
    TurningHand,
)
from distal.suggestions import did_you_mean
from distal.units import to_si

PULLS = {"slider": ("weight", "force", "servo.position"), "capstan": ("torque", "servo.angle")}
"""Kind of a drive → what may pull it."""


@dataclass(frozen=True)
class BodyInputs:
    """What acts on the bodies in each of n intervals.

    Args:
        effort: force or torque, hung weights included, (n, n_bodies) [N m, N].
        added_inertia: mass of hung weights, (n, n_bodies) [kg].
        servo: stiffness, target and damping of a spring and damper to a target, (n, n_bodies, 3).
    """

    effort: Floats
    added_inertia: Floats
    servo: Floats


def body_inputs(scenario: Scenario, mechanism: Mechanism, time: Floats) -> BodyInputs:
    """Return what a scenario's signals do to the bodies at each `time` [s], (n,), the starts of
    intervals.

    Raises:
        ScenarioError: the scenario names a joint or drive that the rig does not have, or pulls a
            drive in a way that its kind does not allow.
    """
    rig = mechanism.rig
    _check_names(scenario.joints, rig.joint_names, "joints", "joint")
    _check_names(scenario.drives, rig.drive_names, "drives", "drive")
    n = len(time)
    bodies = mechanism.n_bodies
    inputs = BodyInputs(np.zeros((n, bodies)), np.zeros((n, bodies)), np.zeros((n, bodies, 3)))
    for i, joint in enumerate(rig.joints):
        load = scenario.joints.get(joint.name, JointInput())
        if load.torque is not None:
            inputs.effort[:, i] += load.torque.at(time)
        if load.hand is not None:
            _spring(inputs, i, load.hand, load.hand.angle.at(time))
    for i, drive in enumerate(rig.drives):
        pull = scenario.drives.get(drive.name, DriveInput())
        _check_pull(pull, drive.kind, f"drives.{drive.name}")
        _drive(inputs, mechanism.n_joints + i, pull, time)
    return inputs


def _drive(inputs: BodyInputs, body: int, pull: DriveInput, time: Floats) -> None:
    for signal in (pull.force, pull.torque, pull.weight):
        if signal is not None:
            inputs.effort[:, body] += signal.at(time)
    if pull.weight is not None:
        inputs.added_inertia[:, body] = pull.weight.at(time) / GRAVITY
    if pull.servo is not None:
        target = pull.servo.position if isinstance(pull.servo, SliderLoop) else pull.servo.angle
        _spring(inputs, body, pull.servo, target.at(time))


def _spring(
    inputs: BodyInputs, body: int, spring: TurningHand | SliderLoop | CapstanServo, target: Floats
) -> None:
    inputs.servo[:, body, 0] = spring.stiffness
    inputs.servo[:, body, 2] = spring.damping
    inputs.servo[:, body, 1] = target


def _check_pull(pull: DriveInput, kind: str, where: str) -> None:
    parts = {
        "weight": pull.weight,
        "force": pull.force,
        "torque": pull.torque,
        "servo.position": pull.servo if isinstance(pull.servo, SliderLoop) else None,
        "servo.angle": pull.servo if isinstance(pull.servo, CapstanServo) else None,
    }
    for name, part in parts.items():
        if part is not None and name not in PULLS[kind]:
            allowed = ", ".join(PULLS[kind])
            raise ScenarioError(
                f"{where}.{name}: a {kind} cannot be pulled so; {allowed} are allowed"
            )


def _check_names(keys: Iterable[str], names: list[str], where: str, kind: str) -> None:
    for name in keys:
        if name not in names:
            raise ScenarioError(
                f"{where}: the rig has no {kind} '{name}'{did_you_mean(name, names)}"
            )


def initial_angles(scenario: Scenario, mechanism: Mechanism) -> Floats:
    """Return the joints' angles at the start [rad], (n_joints,): the scenario's, else the rig's
    `initial`.

    Raises:
        ScenarioError: a joint is unknown or follows another one, or its angle is none.
    """
    names = mechanism.rig.joint_names
    _check_names(scenario.initial, names, "initial", "joint")
    angles = np.array([joint.initial.value for joint in mechanism.rig.joints])
    for name, raw in scenario.initial.items():
        coupled = mechanism.rig.joints[names.index(name)].coupled
        if coupled is not None:
            raise ScenarioError(
                f"initial.{name}: it follows '{coupled.joint}'; give the angle of that joint"
            )
        try:
            angles[names.index(name)] = to_si(raw, "rad")
        except ValueError as problem:
            raise ScenarioError(f"initial.{name}: {problem}") from None
    # a coupled joint follows from the joint that it is coupled to
    placed: Floats = (
        mechanism.spread.full() @ angles[mechanism.free]
    ) + mechanism.offsets.full().ravel()
    return placed
