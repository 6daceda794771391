"""Estimators of one joint without dynamics: tendons are inextensible, or the measured force
stretches them.
"""

from __future__ import annotations

import casadi as ca

from distal.estimators.estimator_protocol import KernelEstimator
from distal.estimators.kinematic_readings import (
    first_drives,
    levers_of,
    measured_tendons,
    read_drives,
    tension_share,
)
from distal.estimators.read_channels import Channels, channels_of, sensor_for
from distal.kernels import Kernel, kernel_state_layout
from distal.model import Mechanism
from distal.rig import Rig, angle_names, tendon_angle_name
from distal.sensor_errors import systematic_variance, variance


def kinematic_function(
    mechanism: Mechanism, channels: Channels, tendons: tuple[int, ...], elastic: bool
) -> ca.Function:
    """Return the function (kernel_state, x, p) → (kernel_state⁺, y) of a kinematic estimator of one
    joint (several: `kinematic_chain`).

    A tendon whose drive has a position sensor gives the angle at which its length fits the drive's
    displacement: ℓ − l = e_0 + (F − F_0)/k. The joint's angle is the mean over these tendons. e_0
    is ℓ − l at the first sample, with the joint at its `initial` angle. F is the tendon's share of
    its drive's low-passed pull, and F_0 that at the first sample.

    Args:
        mechanism: the rig's equations.
        channels: the sensors that are read.
        tendons: indices of the tendons.
        elastic: whether the stretch (F − F_0)/k counts; `inextensible` leaves it out.
    """
    k = len(tendons)
    nd = mechanism.n_drives
    nj = mechanism.n_joints
    n = nj + k
    width = len(channels.names)
    layout = kernel_state_layout(n, lengths=k, positions=nd, pulls=nd, first_pulls=nd)
    kernel_state = ca.SX.sym("kernel_state", layout.size)
    x = ca.SX.sym("x", 1 + 2 * width)
    mean, covariance, lengths = (
        layout.part(kernel_state, name) for name in ("mean", "covariance", "lengths")
    )
    drives, pulls, first = (
        layout.part(kernel_state, name) for name in ("positions", "pulls", "first_pulls")
    )
    positions, filtered = read_drives(mechanism.rig, channels, drives, pulls, x)
    q = ca.vertcat(mean[:nj], positions)
    angles = []
    levers = levers_of(mechanism)
    for row, tendon in enumerate(tendons):
        drive = mechanism.drive_of[tendon] - mechanism.n_joints
        length = lengths[row]
        if elastic:
            change = tension_share(mechanism, levers, tendon) * (filtered[drive] - first[drive])
            length += change / mechanism.parameters[f"tendons.{tendon}.stiffness"]
        angles.append(mechanism.angle_at(tendon, length, q))
    mean = ca.vertcat(sum(angles) / len(angles), *angles)
    p = mechanism.parameters.symbols
    following = layout.joined(
        mean=mean,
        covariance=covariance,
        lengths=lengths,
        positions=positions,
        pulls=filtered,
        first_pulls=first,
    )
    return ca.Function(
        "kinematic",
        [kernel_state, x, p],
        [following, ca.SX.zeros(1)],
        ["kernel_state", "x", "p"],
        ["next", "y"],
    )


class KinematicEstimator(KernelEstimator):
    """The angle of one joint from the drives' displacements and the tendons' lengths; see
    `kinematic_function`.

    Its standard deviation takes the errors of the sensors and of the initial angle into account,
    but not the stretch of the tendons (or, if `elastic`, not their friction).

    Raises:
        EstimationError: the sensors do not suffice.
    """

    def __init__(self, name: str, rig: Rig, elastic: bool, compiled: bool = True) -> None:
        self._mechanism = Mechanism(rig)
        self._channels = channels_of(rig, name)
        self._tendons = measured_tendons(rig, self._channels)
        p = self._mechanism.parameters.values
        kernel = Kernel(
            kinematic_function(self._mechanism, self._channels, self._tendons, elastic), compiled
        )
        angles = angle_names(rig.joint_names)
        names = (*angles, *(tendon_angle_name(rig.tendons[i].name) for i in self._tendons))
        super().__init__(name, rig, kernel, p, channels=self._channels, state_names=names)

    def prior_function(self) -> ca.Function:
        """Return the function (values, mask, p) → (mean, covariance, memory) before the first
        sample.
        """
        rig = self.rig
        channels = self._channels
        mechanism = self._mechanism
        values, mask = (ca.SX.sym(name, len(channels.names)) for name in ("values", "mask"))
        initial = rig.joints[0].initial.value
        std = rig.joints[0].initial.std
        positions, pulls = first_drives(rig, channels, values, mask)
        q = ca.vertcat(initial, positions)
        p = mechanism.parameters.symbols
        lengths = mechanism.elongations(q)
        jacobian = mechanism.length_jacobian(q)
        # all tendons have the same zero, whose error they share; a sensor errs twice, at the first
        # sample and at the current one
        variances = []
        for i in self._tendons:
            sensor = sensor_for(channels.positions, rig.tendons[i].drive)
            error = (
                0.0 if sensor is None else 2.0 * (variance(sensor) + systematic_variance(sensor))
            )
            variances.append((jacobian[i, mechanism.drive_of[i]] / jacobian[i, 0]) ** 2 * error)
        k = len(self._tendons)
        mixing = ca.vertcat(ca.DM.ones(1, k) / k, ca.DM.eye(k))
        covariance = ca.mtimes([mixing, ca.diag(ca.vertcat(*variances)), mixing.T]) + std**2
        memory = ca.vertcat(lengths[list(self._tendons)], positions, pulls, pulls)
        prior = [ca.SX.ones(1 + k) * initial, covariance, memory]
        return ca.Function("prior", [values, mask, p], [ca.densify(part) for part in prior])
