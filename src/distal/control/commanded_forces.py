"""The rig's inverse as a controller: it adds the forces that the reference's own motion needs and
those of the gains for the remaining error.
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
"""Share of the co-contraction below which no tension falls; a torque may use the rest. Source:
judgement.
"""


class CommandedForces:
    """A controller by `LiveInverse` for drives that follow forces. The inverse has a filter of its
    own, which also tells the angles, so that no second one runs.

    Args:
        joints: reference and gains by joint; other joints stay where they are.
        co_contraction: tension of all tendons without a torque [N]; each tendon keeps at least the
            share `KEPT` of it.
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
        """Return the filter's estimate from the `values` of all sensors [SI] at a `stamp` [s], and
        compute the forces to be commanded.
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
        """Return the forces by drive that `tell` has computed last [N or N m]. The arguments are
        those of every controller: the `time` [s], what is `measured`, and the estimate; they are
        not used.
        """
        return dict(zip(self._drives, self._forces.tolist()))
