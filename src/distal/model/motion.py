"""The motion of a mechanism at one moment, from which the sensors' readings follow."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from distal.expressions import Scalar, Vector
from distal.model.chain import Chain
from distal.model.mechanism import Mechanism
from distal.rig import Motion, Sensor, measurand_of, part_of


class Moment:
    """The motion of a mechanism at one moment.

    Args:
        q: coordinates, (n_bodies,) [rad, m].
        v: their rates, (n_bodies,).
        tensions: of the tendons, (n_tendons,) [N].
        efforts: external torques on the joints, then what the drives exert, (n_bodies,) [N m, N].
    """

    def __init__(
        self, mechanism: Mechanism, q: Vector, v: Vector, tensions: Vector, efforts: Vector
    ) -> None:
        nj = mechanism.n_joints
        links = Chain(mechanism.rig, mechanism.parameters)
        self._rig = mechanism.rig
        self._motion = Motion(
            angles=q[:nj],
            torques=efforts[:nj],
            positions=q[nj:],
            rates=v[nj:],
            efforts=efforts[nj:],
            tensions=tensions,
            turning=lambda joint: links.turning(q, v)[joint],
            falling=lambda joint: links.falling(q)[joint],
            axes=[joint.axis for joint in mechanism.rig.joints],
            unknowns={},
        )

    def read(self, sensor: Sensor, unknowns: Mapping[str, Scalar] | None = None) -> Scalar:
        """Return what a sensor without errors reads [SI]. Its parameters are those of the rig, but
        for the `unknowns`, by name.
        """
        motion = replace(self._motion, unknowns=unknowns or {})
        return measurand_of(sensor).read(sensor, motion, part_of(sensor, self._rig))
