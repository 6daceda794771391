"""Angles and speeds of the joints: the first block of every state vector."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.estimators.adaptive.filter_context import FilterContext
from distal.estimators.adaptive.states.state import Prior, State
from distal.estimators.state_kinds import StateKind
from distal.rig import Joint, angle_names, speed_names

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
