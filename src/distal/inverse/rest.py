"""Angles at which joints come to rest with the drives' positions that are really sent, and their
variances: the band of an open loop.

Joints rest where friction l holds the residual torque r, |r(θ, s, p)| ≤ l, at the drives' positions
s. At the desired angles r is zero, unless a drive is cut at the end of its range, at its force
limit or at its speed limit. Then Newton's steps find θ, from the angles of the sample before and
within the stops: far from there the geometry of a tendon has other solutions.

Since r(θ, s, p) = 0 there, dθ/dp = −(∂r/∂θ)⁻¹ ∂r/∂p. The parameters p have the stds of the rig
file, and the positions those of their sensors. A joint whose friction has not turned over may rest
anywhere within the friction limit l of that.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.expressions import Matrix
from distal.inverse.distribution import solved
from distal.inverse.feedback import limited
from distal.inverse.setpoint_function import KERNEL, STEPS, CommandModel
from distal.kernels import Layout
from distal.rig import Rig

LARGEST = float(np.deg2rad(2.0))
"""Largest turn of a joint in one of Newton's steps; within it, a joint that was left behind counts
as back at its desired angle [rad]. Source: judgement.
"""

SOFTEST = 1e-9
"""Stiffness that is added to every joint, so that a joint which nothing holds has a wide but finite
band [N m/rad]. Source: rounding (division by a stiffness of zero).
"""


def rest_layout(model: CommandModel) -> Layout:
    """Return the layout of a sample: desired angles, drives' positions and their variances, the
    directions of friction, the internal state, and whether a drive is cut.
    """
    nf = model.nf
    nd = model.nd
    return Layout(angles=nf, positions=nd, variances=nd, turned=nf, inside=model.n_inside, cut=1)


def rest_kernel(model: CommandModel) -> ca.Function:
    """Return the kernel (kernel_state, x, p) → (kernel_state⁺, y) of the angles at which free
    joints rest and their variances, y = (θ_free [rad], σ² [rad²]), (2 n_free,).

    A sample x has the layout `rest_layout`; the kernel state is (θ_free, whether joints were left
    behind). As long as they were not, θ_free are the desired angles.
    """
    layout = rest_layout(model)
    kernel_state = ca.MX.sym("kernel_state", model.nf + 1)
    x = ca.MX.sym("x", layout.size)
    p = ca.MX.sym("p", model.n_parameters)
    came = layout.parts(x)
    parameters = ca.vertcat(p, came["inside"])
    step, variances = _functions(model)
    angles = kernel_state[: model.nf]
    for _ in range(STEPS):
        angles = model.within_stops(
            angles + step(angles, came["positions"], parameters), parameters
        )
    away = ca.fabs(angles - came["angles"]) > LARGEST
    was_behind = kernel_state[model.nf] > 0
    behind = ca.logic_or(came["cut"] > 0, ca.logic_and(was_behind, ca.dot(away, away) > 0))
    angles = ca.if_else(behind, angles, came["angles"])
    # friction may act either way where a drive is cut
    turned = came["turned"] * (1 - came["cut"])
    spread = variances(angles, came["positions"], turned, came["variances"], parameters)
    following = ca.vertcat(angles, behind)
    return ca.Function(
        "rest", [kernel_state, x, p], [following, ca.vertcat(angles, spread)], *KERNEL
    )


def _functions(model: CommandModel) -> tuple[ca.Function, ca.Function]:
    """Return two functions: (θ_free, s, p) → Newton's step towards rest, where a joint whose
    residual torque friction holds stays, and (θ_free, s, d, σ_s², p) → variances of θ_free [rad²].

    The variances follow from the stds of the rig's parameters, from the variances σ_s² of the
    drives' positions, and from friction that has not turned over, by its directions d.
    """
    nf = model.nf
    p = model.mechanism.parameters.symbols
    free, turned = (ca.SX.sym(name, nf) for name in ("free", "turned"))
    positions, square_stds = (ca.SX.sym(name, model.nd) for name in ("s", "variances"))
    lacks, friction = model.lacking(free, positions, ca.SX.zeros(nf))
    beyond = lacks - limited(lacks, friction)
    softer = SOFTEST * ca.SX.eye(nf)
    newton = -solved(ca.jacobian(lacks, free) - softer, beyond)
    step = ca.Function("step", [free, positions, p], [ca.cse(ca.densify(limited(newton, LARGEST)))])
    lacks, friction = model.lacking(free, positions, turned)
    slopes = ca.jacobian(lacks, free) - softer
    by_parameters = _by_parameters(model, ca.jacobian(lacks, p))
    by_positions = ca.mtimes(ca.jacobian(lacks, positions), ca.diag(ca.sqrt(square_stds)))
    # all torques within friction that has not turned over are equally likely: the variance is a
    # third of its square
    left = ca.sqrt(friction**2 * ca.fmax(1 - turned**2, 0) / 3)
    variances = ca.SX.zeros(nf)
    for column in ca.horzsplit(ca.densify(ca.horzcat(by_parameters, by_positions, ca.diag(left)))):
        variances += solved(slopes, column) ** 2
    arguments = [free, positions, turned, square_stds, p]
    return step, ca.Function("variances", arguments, [ca.cse(ca.densify(variances))])


def _by_parameters(model: CommandModel, slopes: Matrix) -> Matrix:
    """Return J R from the derivatives J by the parameters, (n, k), with R Rᵀ the covariance of the
    parameters: a column for each parameter's own error, and one for each error that several share.
    """
    parameters = model.mechanism.parameters
    p = parameters.symbols
    columns = [
        slopes[:, i] * model.number(p, [f"{parameters.names[i]}.std"])
        for i in np.flatnonzero(parameters.independent_stds > 0.0).tolist()
    ]
    columns += [
        ca.mtimes(slopes[:, members], p[members]) * model.number(p, [f"shared.{name}.std"])
        for name, (_, members) in parameters.shared.items()
    ]
    return ca.horzcat(ca.SX(slopes.size1(), 0), *columns)


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
