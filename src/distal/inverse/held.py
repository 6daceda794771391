"""Angles at which joints come to rest with the positions that are really sent, where drives cannot
do what the desired angles ask for.

A drive is cut at the end of its range, at its force limit or at its speed limit. The joints then
rest where friction l holds the residual torque r, |r(θ, s, p)| ≤ l, at the drives' positions s.
Newton's steps find these angles, from those of the sample before and within the stops: far from
there the geometry of a tendon has other solutions.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from distal.expressions import Vector
from distal.inverse.distribution import solved
from distal.inverse.reached import SOFTEST, lacking
from distal.inverse.setpoint_function import CommandModel
from distal.kernels import Layout

ROUNDS = 12
"""Number of Newton's steps in a sample. Source: judgement."""

LARGEST = float(np.deg2rad(2.0))
"""Largest turn of a joint in one of Newton's steps [rad]. Source: judgement."""

BACK = float(np.deg2rad(5.0))
"""Distance from its desired angle within which a joint that was left behind counts as back [rad].
Source: judgement.
"""


def held_layout(model: CommandModel) -> Layout:
    """Return the layout of a sample: desired angles, drives' positions, internal state, and whether
    a drive is cut.
    """
    inside = model.kernel_state["inside"].stop - model.kernel_state["inside"].start
    return Layout(angles=model.nf, positions=model.nd, inside=inside, cut=1)


def held_kernel(model: CommandModel) -> ca.Function:
    """Return the kernel (kernel_state, x, p) → (kernel_state⁺, θ_free) of the angles at which free
    joints rest, (n_free,) [rad].

    A sample x has the layout `held_layout`; the kernel state is (θ_free, whether joints were left
    behind). As long as they were not, θ_free are the desired angles.
    """
    layout = held_layout(model)
    kernel_state = ca.MX.sym("kernel_state", model.nf + 1)
    x = ca.MX.sym("x", layout.size)
    inside = layout["inside"].stop - layout["inside"].start
    p = ca.MX.sym("p", len(model.mechanism.parameters) - inside)
    came = layout.parts(x)
    behind = kernel_state[model.nf]
    parameters = ca.vertcat(p, came["inside"]) if inside else p
    step = _step(model)
    angles = kernel_state[: model.nf]
    for _ in range(ROUNDS):
        angles = model.within_stops(
            angles + step(angles, came["positions"], parameters), parameters
        )
    away = ca.MX(0)
    for error in ca.vertsplit(ca.fabs(angles - came["angles"])):
        away = ca.logic_or(away, error > BACK)
    behind = ca.logic_or(came["cut"] > 0, ca.logic_and(behind > 0, away))
    angles = ca.if_else(behind, angles, came["angles"])
    names = ["kernel_state", "x", "p"], ["next", "y"]
    return ca.Function("held", [kernel_state, x, p], [ca.vertcat(angles, behind), angles], *names)


def _step(model: CommandModel) -> ca.Function:
    """Return the function (θ_free, s, p) → Newton's step towards rest; a joint whose residual
    torque friction holds stays, |r| ≤ l.
    """
    free = ca.SX.sym("free", model.nf)
    positions = ca.SX.sym("positions", model.nd)
    still = ca.SX.zeros(model.nf)
    none = ca.SX.zeros(model.nj)
    lacks, friction = lacking(model, free, positions, still, none)
    slopes = ca.jacobian(lacks, free) - SOFTEST * ca.SX.eye(model.nf)
    beyond = lacks - ca.fmin(ca.fmax(lacks, -friction), friction)
    change: Vector = -solved(slopes, beyond)
    limited = ca.fmin(ca.fmax(change, -LARGEST), LARGEST)
    arguments = [free, positions, model.mechanism.parameters.symbols]
    return ca.Function("step", arguments, [ca.cse(ca.densify(limited))])
