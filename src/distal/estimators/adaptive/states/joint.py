"""Angles and speeds of the joints, the first block of every state vector, and the torques on them
that no sensor measures, such as that of a hand or a contact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.estimators.adaptive.filter_context import FilterContext
from distal.estimators.adaptive.states.state import Fading, Prior, State, ZeroMean
from distal.estimators.state_kinds import StateKind
from distal.expressions import Scalar, Vector
from distal.rig import Joint, angle_names, speed_names, torque_names

START_SPEED = 0.3
"""Standard deviation of a joint's speed at the first sample [rad/s]: a log may begin within a
motion. Source: judgement.
"""


@dataclass(frozen=True)
class JointMotion(State):
    """The angles θ of all joints, then the speeds ω of all; prediction moves them by the model, see
    `prediction`.
    """

    context: FilterContext

    @property
    def _joints(self) -> Sequence[Joint]:
        return self.context.mechanism.rig.joints

    @property
    def kinds(self) -> tuple[StateKind, ...]:
        """Kinds of the states: angles, then speeds, (2 n_joints,)."""
        n = len(self._joints)
        return (StateKind.ANGLE,) * n + (StateKind.SPEED,) * n

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of the joints, twice, (2 n_joints,)."""
        return tuple(joint.name for joint in (*self._joints, *self._joints))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of angles and speeds, (2 n_joints,)."""
        names = [joint.name for joint in self._joints]
        return (*angle_names(names), *speed_names(names))

    @property
    def means(self) -> Floats:
        """Prior means: each joint's `initial` angle [rad], then zeros for the speeds."""
        return np.array(
            [*(joint.initial.value for joint in self._joints), *(0.0 for _ in self._joints)]
        )

    @property
    def stds(self) -> Floats:
        """Prior standard deviations: those of `initial` [rad], then `START_SPEED` [rad/s]."""
        return np.array(
            [*(joint.initial.std for joint in self._joints), *(START_SPEED for _ in self._joints)]
        )

    def prior(self) -> tuple[Prior | None, Prior | None]:
        """Return the prior means as expressions of each `initial`, which a fit may vary; None for
        the standard deviations.
        """
        angles = [self.context.number(f"joints.{j}.initial") for j in range(len(self._joints))]
        return ca.vertcat(*angles, ca.SX.zeros(len(angles))), None


@dataclass(frozen=True)
class ExternalTorqueState(ZeroMean):
    """The external torque τ_ext on a joint, a first-order Gauss–Markov process: e^{−dt/T} of it is
    left after dt.

    Where the rig declares none it is zero until a touch opens its variance, (13b).
    """

    kind: ClassVar[StateKind] = StateKind.EXTERNAL_TORQUE

    context: FilterContext
    joint: int

    @property
    def part(self) -> str:
        """Name of the joint."""
        return self.context.mechanism.rig.joints[self.joint].name

    @property
    def names(self) -> tuple[str, ...]:
        """Name of the state: ``external_torque``, with the joint's name where there are several."""
        return (torque_names(self.context.mechanism.rig.joint_names)[self.joint],)

    @property
    def stds(self) -> Floats:
        """Prior standard deviation: the rig's ``external_torque.std`` [N m]."""
        return np.array([self.context.mechanism.rig.joints[self.joint].external_torque.std])

    def prior(self) -> tuple[Prior | None, Prior | None]:
        """Return the std, which a fit may vary [N m]."""
        return None, self._number("std")

    def fading(self, dt: Scalar) -> Fading:
        """Return e^{−dt/T}, and the std after a long time [N m]."""
        return Fading(ca.exp(-dt / self._number("correlation_time")), self._number("std"))

    def _number(self, key: str) -> Scalar:
        return self.context.number(f"joints.{self.joint}.external_torque.{key}")

    def torque(self, joint: int, values: Vector) -> Scalar:
        """Return τ_ext [N m] if it is that of this joint, else 0."""
        return values[0] if joint == self.joint else 0


def external_torques(context: FilterContext) -> list[State]:
    """Return a block for each joint on which a torque can act: where the rig declares one, or where
    forces may show one.
    """
    joints = context.mechanism.rig.joints
    blocks = list[State]()
    for j, joint in enumerate(joints):
        if joint.external_torque.std > 0.0 or j in context.touchable:
            blocks.append(ExternalTorqueState(context, j))
    return blocks
