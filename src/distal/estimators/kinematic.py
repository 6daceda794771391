"""Estimates without dynamics: tendons taken as inextensible, or stretched by the measured force."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from distal.estimators.channels import Channels, channels_of, sensor_for
from distal.estimators.contract import KernelEstimator
from distal.estimators.low_pass import low_passed
from distal.kernels import Kernel
from distal.model import Mechanism
from distal.rig import Rig, angle_names, gain_of, tendon_angle_name
from distal.sensors import systematic_variance, variance

Floats = NDArray[np.float64]


def kinematic_function(
    mechanism: Mechanism, channels: Channels, tendons: tuple[int, ...], elastic: bool
) -> ca.Function:
    """Return (carry, x, p) → (carry⁺, y) of a kinematic estimator.

    Each tendon gives the angle at which its length, ℓ − l = e_0 + (F − F_0)/k, fits the drive's displacement; the joint's
    angle is the mean over them (several joints: `kinematic_chain`). `inextensible` leaves the stretch (F − F_0)/k out. e_0
    is the length at the first sample, with the joints at their `initial` angles; F is a tendon's share of its drive's pull,
    low-passed, and F_0 that at the first sample.

    Args:
        mechanism: the rig's equations.
        channels: the sensors it reads.
        tendons: those whose drive has a position sensor.
        elastic: remove the stretch.
    """
    k, nd, nj = len(tendons), mechanism.n_drives, mechanism.n_joints
    n, width = nj + k, len(channels.names)
    places = [drive.name for drive in mechanism.rig.drives]
    carry, x, p = (
        ca.SX.sym("carry", n + n * n + k + 3 * nd),
        ca.SX.sym("x", 1 + 2 * width),
        mechanism.parameters.symbols,
    )
    mean, rest = carry[:n], carry[n + n * n :]
    lengths, drives, pulls, first = ca.vertsplit(rest, [int(i) for i in np.cumsum([0, k, nd, nd, nd])])
    dt, values, mask = x[0], x[1 : 1 + width], x[1 + width :]

    positions, filtered = [drives[i] for i in range(nd)], [pulls[i] for i in range(nd)]
    for sensor in channels.positions:
        i, j = places.index(sensor.of), channels.names.index(sensor.name)
        positions[i] = ca.if_else(mask[j], values[j] - sensor.bias.value, drives[i])
    for sensor in channels.forces:
        i, j = places.index(sensor.of), channels.names.index(sensor.name)
        read = (values[j] - sensor.bias.value) / gain_of(sensor).value
        filtered[i] = ca.if_else(mask[j], low_passed(pulls[i], read, dt), pulls[i])
    q = ca.vertcat(mean[:nj], *positions)
    angles = []
    for row, tendon in enumerate(tendons):
        drive = mechanism.drive_of[tendon] - mechanism.n_joints
        length = lengths[row]
        if elastic:
            change = _share(mechanism, tendon) * (filtered[drive] - first[drive])
            length += change / mechanism.parameters[f"tendons.{tendon}.stiffness"]
        angles.append(mechanism.angle_at(tendon, length, q))
    joints = []
    for j in range(nj):
        joints.append(sum(angles) / len(angles) if angles else mean[j])
    following = ca.vertcat(
        *joints, *angles, carry[n : n + n * n], lengths, ca.vertcat(*positions), ca.vertcat(*filtered), first
    )
    return ca.Function("kinematic", [carry, x, p], [following, ca.SX.zeros(1)], ["carry", "x", "p"], ["next", "y"])


def _share(mechanism: Mechanism, tendon: int) -> ca.SX:
    """Return the tension of a tendon per unit of its drive's pull, the smallest that balances it: h_i/Σ h².

    h is a tendon's displacement per displacement of the drive: 1 for a slider, side · R for a capstan.
    """
    drive = mechanism.drive_of[tendon]
    q = ca.SX.sym("q", mechanism.n_bodies)
    levers = {
        i: ca.jacobian(mechanism.displacement(i, q), q[drive])
        for i in range(mechanism.n_tendons)
        if mechanism.drive_of[i] == drive
    }
    return levers[tendon] / sum((lever**2 for lever in levers.values()), ca.SX(0))


class KinematicEstimator(KernelEstimator):
    """Angle from the drives' displacements and the tendons' lengths; see `kinematic_function`.

    Its std knows the sensors and the initial angle only: not stretch (or, if `elastic`, not friction).

    Args:
        name: of the estimator.
        rig: the description.
        elastic: remove the stretch with the measured forces.
        compiled: compile its kernel where possible.

    Raises:
        EstimationError: the sensors do not suffice.
    """

    def __init__(self, name: str, rig: Rig, elastic: bool, compiled: bool = True) -> None:
        self._mechanism, self._channels = Mechanism(rig), channels_of(rig, name)
        measured = [sensor.of for sensor in self._channels.positions]
        self._tendons = tuple(i for i, tendon in enumerate(rig.tendons) if tendon.drive in measured)
        function = kinematic_function(self._mechanism, self._channels, self._tendons, elastic)
        q = ca.SX.sym("q", self._mechanism.n_bodies)
        p = self._mechanism.parameters
        self._lengths = ca.Function(
            "lengths", [q, p.symbols], [self._mechanism.elongations(q), self._mechanism.length_jacobian(q)]
        )
        joints = [joint.name for joint in rig.joints]
        names = (*angle_names(joints), *(tendon_angle_name(rig.tendons[i].name) for i in self._tendons))
        channels = self._channels
        super().__init__(name, rig, Kernel(function, compiled), p.values, channels.names, (), names, channels.interval)

    def _prior(self, sample: Floats) -> tuple[Floats, Floats, Floats]:
        rig, channels, m = self.rig, self._channels, self._mechanism
        initial = np.array([joint.initial.value for joint in rig.joints])
        places, pulls = np.zeros(m.n_drives), np.array([d.nominal_force.value for d in rig.drives])
        for values, sensors in ((places, channels.positions), (pulls, channels.forces)):
            for i, drive in enumerate(rig.drives):
                sensor = sensor_for(sensors, drive.name)
                read = np.nan if sensor is None else sample[channels.names.index(sensor.name)] - sensor.bias.value
                values[i] = read if np.isfinite(read) else values[i]
        q = np.concatenate([initial, places])
        lengths, jacobian = (np.array(part) for part in self._lengths(q, self._mechanism.parameters.values))
        # one zero for all tendons: its error is shared; the sensors' errors count twice, then and now
        own = []
        for i in self._tendons:
            sensor = sensor_for(channels.positions, rig.tendons[i].drive)
            error = 0.0 if sensor is None else 2.0 * (variance(sensor) + systematic_variance(sensor))
            slope = jacobian[i, m.drive_of[i]] / jacobian[i, 0]
            own.append(float(slope) ** 2 * error)
        k, joints = len(self._tendons), np.zeros(len(self._tendons), dtype=int)
        of_joint = joints[:, None] == np.arange(m.n_joints)
        mixing = np.vstack([(of_joint / np.maximum(of_joint.sum(axis=0), 1)).T, np.eye(k)])
        zeros = np.vstack([np.eye(m.n_joints), of_joint]) @ np.diag([joint.initial.std for joint in rig.joints])
        covariance = mixing @ np.diag(own) @ mixing.T + zeros @ zeros.T
        memory = np.concatenate([lengths.ravel()[list(self._tendons)], places, pulls, pulls])
        return np.concatenate([initial, initial[joints]]), covariance, memory
