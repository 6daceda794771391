"""A torque on a joint that nobody measures, such as a hand's or a contact's."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.estimators.adaptive.context import FilterContext
from distal.estimators.adaptive.states.state import Fading, Prior, State
from distal.estimators.state_kinds import StateKind
from distal.expressions import Scalar, Vector
from distal.rig import torque_names


@dataclass(frozen=True)
class ExternalTorque(State):
    """τ_ext, a first-order Gauss–Markov process: e^{−dt/T_i} of it is left after dt.

    Args:
        context: the rig.
        joint: index of the joint.
    """

    context: FilterContext
    joint: int

    @property
    def kind(self) -> StateKind:
        """A torque from outside."""
        return StateKind.EXTERNAL_TORQUE

    @property
    def part(self) -> str:
        """The joint's name."""
        return self.context.mechanism.rig.joints[self.joint].name

    @property
    def names(self) -> tuple[str, ...]:
        """``external_torque``, with the joint's name where there are several."""
        return (torque_names([joint.name for joint in self.context.mechanism.rig.joints])[self.joint],)

    @property
    def means(self) -> Floats:
        """None is expected, [N m]."""
        return np.zeros(1)

    @property
    def stds(self) -> Floats:
        """The rig's ``external_torque.std`` [N m]."""
        return np.array([self.context.mechanism.rig.joints[self.joint].external_torque.std])

    def prior(self) -> tuple[Prior, Prior]:
        """Return zero and the std, which a fit may vary [N m]."""
        return self.means, self._std

    @property
    def _std(self) -> Scalar:
        return self.context.number(f"joints.{self.joint}.external_torque.std", float(self.stds[0]))

    def fading(self, dt: Scalar) -> Fading:
        """Return e^{−dt/T_i} and the std [N m].

        Args:
            dt: length of the interval [s].
        """
        torque = self.context.mechanism.rig.joints[self.joint].external_torque
        return Fading(ca.exp(-dt / torque.correlation_time), self._std)

    def torque(self, joint: int, own: Vector) -> Scalar:
        """Return τ_ext where it is this joint's [N m].

        Args:
            own: τ_ext.
        """
        return own[0] if joint == self.joint else 0


def external_torques(context: FilterContext) -> list[State]:
    """Return a block for each joint on which an external torque can act: one with a std."""
    joints = context.mechanism.rig.joints
    return [ExternalTorque(context, j) for j, joint in enumerate(joints) if joint.external_torque.std > 0.0]
