"""How far the joints may be from where commands should bring them: the band of an open loop.

A drive at s holds the joints where they lack nothing, r(θ, s, p) = 0, so that dθ/dp = −(∂r/∂θ)⁻¹
∂r/∂p. The numbers p have the stds of the rig file, and positions those of their sensors; a joint
whose friction has not turned over rests anywhere within l of that.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.expressions import Matrix, Vector
from distal.inverse.distribution import solved
from distal.inverse.setpoint_function import CommandModel
from distal.rig import Rig

SOFTEST = 1e-9
"""Stiffness of a joint that nothing holds, so that its band is wide and finite [N m/rad]."""


def spread_function(model: CommandModel) -> ca.Function:
    """Return (θ_free, s, d, σ_s², τ_ext, p) → variances of θ_free, (n_free,) [rad²], by the stds of
    the rig's numbers.

    Positions of drives err by variances σ_s², (n_drives,), of their own.
    """
    nf = model.nf
    p = model.mechanism.parameters.symbols
    free = ca.SX.sym("free", nf)
    positions = ca.SX.sym("positions", model.nd)
    turned = ca.SX.sym("turned", nf)
    position_variances = ca.SX.sym("place_variances", model.nd)
    external = ca.SX.sym("tau", model.nj)
    lacks, friction = lacking(model, free, positions, turned, external)
    slopes = ca.jacobian(lacks, free) - SOFTEST * ca.SX.eye(nf)
    by_parameters = ca.mtimes(ca.jacobian(lacks, p), covariance_root(model))
    by_positions = ca.mtimes(ca.jacobian(lacks, positions), ca.diag(ca.sqrt(position_variances)))
    variances = ca.SX.zeros(nf)
    for column in ca.horzsplit(ca.densify(ca.horzcat(by_parameters, by_positions))):
        variances += solved(slopes, column) ** 2
    # within the friction that has not turned over any position is alike likely: a third of its
    # square
    left = friction**2 * ca.fmax(1 - turned**2, 0) / 3
    for j in range(nf):
        unit = ca.SX.zeros(nf)
        unit[j] = 1
        variances += solved(slopes, unit) ** 2 * left[j]
    return ca.Function(
        "variances",
        [free, positions, turned, position_variances, external, p],
        [ca.cse(ca.densify(variances))],
    )


def lacking(
    model: CommandModel, free: Vector, positions: Vector, turned: Vector, external: Vector
) -> tuple[Vector, Vector]:
    """Return what joints at rest lack, (n_free,) [N m], and their friction limits.

    Args:
        free: angles of free joints [rad], (n_free,).
        positions: of the drives [m, rad], (n_drives,).
        turned: which way friction acts, −1 to 1, (n_free,).
        external: torques on all joints from outside [N m], (n_joints,).
    """
    mechanism = model.mechanism
    zeros = ca.SX.zeros(model.nf)
    joints = ca.mtimes(ca.SX(mechanism.spread), free) + mechanism.offsets
    needed, friction = model.needed(
        free, zeros, zeros, positions, turned, external, mechanism.parameters.symbols
    )
    forces = mechanism.pulls(
        ca.vertcat(joints, positions), ca.SX.zeros(mechanism.n_bodies), settled=True
    ).forces
    return ca.mtimes(ca.SX(mechanism.spread).T, forces[: model.nj]) - needed, friction


def stiffness_function(model: CommandModel) -> ca.Function:
    """Return (θ_free, s, p) → stiffness of each joint, drives and other joints held, (n_free,) [N
    m/rad].
    """
    free = ca.SX.sym("free", model.nf)
    positions = ca.SX.sym("positions", model.nd)
    lacks, _ = lacking(model, free, positions, ca.SX.zeros(model.nf), ca.SX.zeros(model.nj))
    arguments = [free, positions, model.mechanism.parameters.symbols]
    return ca.Function("stiffness", arguments, [-ca.diag(ca.jacobian(lacks, free))])


def spread_kernel(model: CommandModel) -> ca.Function:
    """Return the same as a kernel (kernel_state, x, p) → (kernel_state⁺, variances), x = (θ_free,
    s, d, σ_s², what is inside).
    """
    inside = model.kernel_state["inside"].stop - model.kernel_state["inside"].start
    ends = np.cumsum([0, model.nf, model.nd, model.nf, model.nd, inside]).tolist()
    kernel_state = ca.MX.sym("kernel_state", 1)
    x = ca.MX.sym("x", ends[-1])
    p = ca.MX.sym("p", len(model.mechanism.parameters) - inside)
    free, positions, turned, position_variances, within = ca.vertsplit(x, ends)
    variances = spread_function(model)(
        free, positions, turned, position_variances, ca.DM.zeros(model.nj), ca.vertcat(p, within)
    )
    return ca.Function(
        "spread",
        [kernel_state, x, p],
        [kernel_state, variances],
        ["kernel_state", "x", "p"],
        ["next", "y"],
    )


def covariance_root(model: CommandModel) -> Matrix:
    """Return R of the numbers' covariance R Rᵀ, (n_p, k): a column for each, and one for what
    several err by together.
    """
    parameters = model.mechanism.parameters
    p = model.mechanism.parameters.symbols
    columns = list[Vector]()
    for i in np.flatnonzero(parameters.independent_stds > 0.0).tolist():
        column = ca.SX(len(parameters), 1)
        column[i] = model.number(p, [f"{parameters.names[i]}.std"])
        columns.append(column)
    for name, (_, members) in parameters.shared.items():
        column = ca.SX(len(parameters), 1)
        column[members] = model.number(p, [f"shared.{name}.std"]) * p[members]
        columns.append(column)
    return ca.horzcat(ca.SX(len(parameters), 0), *columns)


def position_variances(rig: Rig) -> Floats:
    """Return how unsure the positions of drives are by their sensors, (n_drives,) [m², rad²]: zeros
    and linearity.
    """
    sensors = {sensor.of: sensor for sensor in rig.sensors_of("position")}
    found = [sensors.get(drive.name) for drive in rig.drives]
    # the largest error by a curve counts as two standard deviations, as in the filter
    return np.array(
        [0.0 if one is None else one.bias.total_std**2 + (one.linearity / 2) ** 2 for one in found]
    )
