"""Variances of the angles that joints reach by commands: the band of an open loop.

With the drives at positions s, the joints rest where their residual torque is zero, r(θ, s, p) = 0,
so that dθ/dp = −(∂r/∂θ)⁻¹ ∂r/∂p. The parameters p have the stds of the rig file, and the positions
those of their sensors. A joint whose friction has not turned over may rest anywhere within the
friction limit l of that.
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
"""Stiffness that is added to every joint, so that a joint which nothing holds has a wide but finite
band [N m/rad]. Source: rounding (division by a stiffness of zero).
"""


def spread_function(model: CommandModel) -> ca.Function:
    """Return the function (θ_free, s, d, σ_s², τ_ext, p) → variances of θ_free, (n_free,) [rad²].

    They follow from the stds of the rig's parameters, from the variances σ_s² of the drives'
    positions, (n_drives,), and from friction that has not turned over, by its directions d.
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
    # all torques within friction that has not turned over are equally likely: the variance is a
    # third of its square
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
    """Return the residual torques of joints at rest and their friction limits, (n_free,) each [N
    m].

    Args:
        model: the inverse of the rig.
        free: angles of the free joints [rad], (n_free,).
        positions: of the drives [m, rad], (n_drives,).
        turned: direction in which friction acts, −1 to 1, (n_free,).
        external: external torques on all joints [N m], (n_joints,).
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
    """Return the function (θ_free, s, p) → stiffness of each free joint while drives and other
    joints are held, (n_free,) [N m/rad].
    """
    free = ca.SX.sym("free", model.nf)
    positions = ca.SX.sym("positions", model.nd)
    lacks, _ = lacking(model, free, positions, ca.SX.zeros(model.nf), ca.SX.zeros(model.nj))
    arguments = [free, positions, model.mechanism.parameters.symbols]
    return ca.Function("stiffness", arguments, [-ca.diag(ca.jacobian(lacks, free))])


def spread_kernel(model: CommandModel) -> ca.Function:
    """Return `spread_function` without external torques as a kernel (kernel_state, x, p) →
    (kernel_state⁺, variances), x = (θ_free, s, d, σ_s², internal state).
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
    """Return R, (n_p, k), with R Rᵀ the covariance of the parameters: a column for each parameter's
    own error, and one for each error that several share.
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
    """Return the variances of the drives' positions by the zeros and the linearity of their
    sensors, (n_drives,) [m², rad²].
    """
    sensors = {sensor.of: sensor for sensor in rig.sensors_of("position")}
    found = [sensors.get(drive.name) for drive in rig.drives]
    # the largest error by a curve counts as two standard deviations, as in the filter
    return np.array(
        [0.0 if one is None else one.bias.total_std**2 + (one.linearity / 2) ** 2 for one in found]
    )
