"""Angles and speeds of the joints: the first block of every state vector."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from distal.estimators.adaptive.states.state import State
from distal.rig import Joint, angle_names, speed_names

Floats = NDArray[np.float64]

START_SPEED = 0.3
"""Standard deviation of a joint's speed at the first sample [rad/s]: a log may begin within a motion."""


@dataclass(frozen=True)
class JointMotion(State):
    """θ of all joints, then ω of all: prediction moves them by the model, see `prediction`.

    Args:
        joints: of the rig.
    """

    joints: Sequence[Joint]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of angles and speeds, (2 n_joints,)."""
        names = [joint.name for joint in self.joints]
        return (*angle_names(names), *speed_names(names))

    @property
    def means(self) -> Floats:
        """Each joint's `initial` angle [rad], at rest."""
        return np.array([*(joint.initial.value for joint in self.joints), *(0.0 for _ in self.joints)])

    @property
    def stds(self) -> Floats:
        """The std of `initial` [rad], and `START_SPEED` [rad/s]."""
        return np.array([*(joint.initial.std for joint in self.joints), *(START_SPEED for _ in self.joints)])
