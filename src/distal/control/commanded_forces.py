"""The rig's inverse as a controller: forces for the reference's own motion, and those of the gains
for what is left.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from distal.arrays import Floats
from distal.inverse import Feedback, LiveInverse
from distal.rig import Rig
from distal.run import Reading
from distal.simulation import JointControl

KEPT = 0.75
"""Share of the co-contraction below which no tension falls: a torque may take the rest of it."""


class CommandedForces:
    """`LiveInverse` for drives that follow forces: its own filter tells the angles, so that it runs
    once.

    Args:
        joints: reference and gains by joint; others stay where they are.
        co_contraction: tension of all tendons without a torque [N]; a share of it, `KEPT`, stays in
            each.
    """

    def __init__(self, rig: Rig, joints: Mapping[str, JointControl], co_contraction: float) -> None:
        feedback = {
            name: Feedback(
                0.0,
                one.deadband,
                one.proportional,
                one.integral,
                one.derivative,
                one.torque_limit or np.inf,
            )
            for name, one in joints.items()
        }
        self._inverse = LiveInverse(
            rig, least_tension=KEPT * co_contraction, feedback=feedback, compensates=True
        )
        names = rig.sensor_names
        self._at = [names.index(channel) for channel in self._inverse.channels]
        self._joints = joints
        self._drives = rig.drive_names
        self._forces: Floats = np.zeros(len(self._drives))

    def tell(self, stamp: float, values: Floats) -> Reading:
        """Return what the filter makes of the `values` of all sensors at a `stamp` [s], and find
        the commands for it.
        """
        desired = {
            name: float(one.reference.at(np.array([stamp]))[0])
            for name, one in self._joints.items()
        }
        command = self._inverse.step(stamp, desired, values[self._at])
        self._forces = command.forces
        return command.reading

    def __call__(
        self, time: float, measured: Mapping[str, float], estimate: Reading
    ) -> dict[str, float]:
        """Return the drives' forces at a time [s], by drive."""
        return dict(zip(self._drives, self._forces.tolist()))
