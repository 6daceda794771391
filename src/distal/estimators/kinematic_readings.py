"""The readings of the kinematic estimators: positions of the drives, held while they are missing,
and low-passed pulls.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from distal.estimators.read_channels import Channels, sensor_for
from distal.expressions import Scalar, Vector
from distal.kernels.mask import is_read
from distal.model import Mechanism
from distal.rig import Rig, gain_of

CUT_OFF = 5.0
"""Cut-off frequency of the low-pass on measured forces in `elastic` [Hz]. Source: judgement."""


def read_drives(
    rig: Rig, channels: Channels, positions: Vector, pulls: Vector, x: Vector
) -> tuple[Vector, Vector]:
    """Return positions and low-passed pulls of the drives after a sample, (n_drives,) each.

    The low-pass is F⁺ = U + e^{−2π f dt} (F − U), f = `CUT_OFF`, of the measured pull U.

    Args:
        channels: the sensors that are read.
        positions: before the sample [m, rad], (n_drives,).
        pulls: F before the sample [N, N m], (n_drives,).
        x: the sample (dt, values, mask).
    """
    names = rig.drive_names
    width = len(channels.names)
    dt = x[0]
    values = x[1 : 1 + width]
    mask = x[1 + width :]
    forget = ca.exp(-2 * ca.pi * CUT_OFF * dt)
    held = ca.vertsplit(positions)
    filtered = ca.vertsplit(pulls)
    for sensor in channels.positions:
        i = names.index(sensor.of)
        j = channels.names.index(sensor.name)
        held[i] = ca.if_else(mask[j], values[j] - sensor.bias.value, positions[i])
    for sensor in channels.forces:
        i = names.index(sensor.of)
        j = channels.names.index(sensor.name)
        read = (values[j] - sensor.bias.value) / gain_of(sensor).value
        filtered[i] = ca.if_else(mask[j], read + forget * (pulls[i] - read), pulls[i])
    return ca.vertcat(*held), ca.vertcat(*filtered)


def first_drives(
    rig: Rig, channels: Channels, values: Vector, mask: Vector
) -> tuple[Vector, Vector]:
    """Return positions and pulls of the drives at the first sample, (n_drives,) each.

    Where nothing is read, a position is 0 and a pull is the nominal one. The sample's `values` and
    `mask` are (n_channels,).
    """
    positions = [ca.SX(0) for _ in rig.drives]
    pulls = [ca.SX(drive.nominal_force.value) for drive in rig.drives]
    for first, sensors in ((positions, channels.positions), (pulls, channels.forces)):
        for i, drive in enumerate(rig.drives):
            sensor = sensor_for(sensors, drive.name)
            if sensor is not None:
                k = channels.names.index(sensor.name)
                first[i] = ca.if_else(
                    is_read(mask[k]),
                    (values[k] - sensor.bias.value) / gain_of(sensor).value,
                    first[i],
                )
    return ca.vertcat(*positions), ca.vertcat(*pulls)


def measured_tendons(rig: Rig, channels: Channels) -> tuple[int, ...]:
    """Return the indices of the tendons whose drive has a position sensor."""
    drives = [sensor.of for sensor in channels.positions]
    return tuple(i for i, tendon in enumerate(rig.tendons) if tendon.drive in drives)


def levers_of(mechanism: Mechanism) -> list[Scalar]:
    """Return h for each tendon, its displacement per displacement of its drive: 1 for a slider,
    side · R for a capstan.
    """
    q = ca.SX.sym("q", mechanism.n_bodies)
    return [
        ca.jacobian(mechanism.displacement(i, q), q[drive])
        for i, drive in enumerate(mechanism.drive_of)
    ]


def tension_share(mechanism: Mechanism, levers: Sequence[Scalar], tendon: int) -> Scalar:
    """Return h_i/Σ h², the tension of a tendon per unit of its drive's pull.

    Of all tensions that balance the pull these are the smallest; `levers` are the h of `levers_of`.
    """
    drive = mechanism.drive_of[tendon]
    squares = (
        lever**2 for lever, pulled_by in zip(levers, mechanism.drive_of) if pulled_by == drive
    )
    return levers[tendon] / sum(squares, ca.SX(0))
