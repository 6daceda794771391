"""The simulated plant: the rig's equations as a kernel; of a plant whose components move in
independent groups, the function of each group, side by side in one.
"""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from distal.expressions import Scalar
from distal.kernels import (
    Kernel,
    PlacedKernel,
    function_of,
    kernel_of,
    side_by_side,
    structure_of,
)
from distal.model import Mechanism, interval_step
from distal.model.stepping import RESOLUTION
from distal.rig import Subsystem, independent_parts


def parts_of_plant(mechanism: Mechanism) -> tuple[Subsystem, ...]:
    """Return the independent parts of a plant; none if there is only one, or if the plant has an
    internal state.
    """
    parts = independent_parts(mechanism.rig)
    return () if len(parts) == 1 or mechanism.parameters.inside else parts


def plants_apart(
    mechanism: Mechanism,
    parts: tuple[Subsystem, ...],
    plant: Callable[[Mechanism], ca.Function],
    rubbing: list[int],
) -> ca.Function:
    """Return the function of a plant, see `plant_function`, put together from those of its
    independent parts.

    Args:
        plant: returns the function of a part by its equations.
        rubbing: indices of the drives with friction inside their transmission.
    """
    n = mechanism.n_bodies
    nt = mechanism.n_tendons
    nj = mechanism.n_joints
    names = mechanism.parameters.names
    kernels = []
    for part in parts:
        equations = Mechanism(part.rig, part.own_paths(mechanism.parameters.inputs), remembers=True)
        drives, tendons = (
            np.array(part.indices[kind], dtype=np.intp) for kind in ("drives", "tendons")
        )
        bodies = np.concatenate([part.indices["joints"], nj + drives]).astype(np.intp)
        frictions = np.array([rubbing.index(d) for d in drives if d in rubbing], dtype=np.intp)
        kernel_state = np.concatenate([bodies, n + bodies, 2 * n + frictions])
        x = np.concatenate([*(k * n + bodies for k in range(5)), [5 * n]])
        p = np.array(
            [names.index(part.whole_path(name)) for name in equations.parameters.names],
            dtype=np.intp,
        )
        y = np.concatenate([bodies, n + bodies, 2 * n + tendons, 2 * n + nt + bodies])
        kernels.append(PlacedKernel(plant(equations), kernel_state, x, p, y))
    return side_by_side("plant", kernels, (2 * n + len(rubbing), 5 * n + 1, len(names), 3 * n + nt))


def plant_function(mechanism: Mechanism, count: int) -> ca.Function:
    """Return the function (kernel_state, x, p) → (kernel_state⁺, y) of the plant over one interval
    of `count` sub-steps.

    The kernel state is (q, v, friction inside each drive's transmission, internal state), x is
    (effort, added inertia, servo, dt), and y is (q, v, tensions, pull on each body). The pull is
    what a load cell or torque sensor between source and body reads: U = W − (W/g) ẍ for a hung
    weight.
    """
    n = mechanism.n_bodies
    rubbing = hysteretic(mechanism)
    nx = len(mechanism.parameters.inside)
    parts = parts_of_plant(mechanism)
    if parts:
        return plants_apart(mechanism, parts, lambda part: plant_function(part, count), rubbing)
    step = interval_step(mechanism, count, with_servo=True)
    q = ca.SX.sym("q", n)
    v = ca.SX.sym("v", n)
    tensions = ca.Function(
        "tensions", [q, v, mechanism.parameters.symbols], [mechanism.tensions(q, v)]
    )
    kernel_state = ca.MX.sym("kernel_state", 2 * n + len(rubbing) + nx)
    x = ca.MX.sym("x", 5 * n + 1)
    parameters = ca.MX.sym("p", len(mechanism.parameters))
    frictions = kernel_state[2 * n : 2 * n + len(rubbing)]
    inside = kernel_state[2 * n + len(rubbing) :]
    p = ca.vertcat(parameters[: parameters.numel() - nx], inside) if nx else parameters
    before = kernel_state[n : 2 * n]
    dt = x[5 * n]
    effort = x[:n]
    added = x[n : 2 * n]
    servo = ca.reshape(x[2 * n : 5 * n], n, 3)
    force, follow = internal_friction(mechanism, rubbing)
    acting = effort + force(kernel_state[:n], frictions, p) if rubbing else effort
    q_next, v_next = step(kernel_state[:n], before, acting, added, servo, dt, p)
    acceleration = (v_next - before) / dt
    pull = (
        effort - added * acceleration + servo[:, 0] * (servo[:, 1] - q_next) - servo[:, 2] * v_next
    )
    if nx:
        inside = settled_function(mechanism)(q_next, dt, p)
        p = ca.vertcat(parameters[: parameters.numel() - nx], inside)
    y = ca.vertcat(q_next, v_next, tensions(q_next, v_next, p), pull)
    frictions = follow(kernel_state[:n], q_next, v_next, frictions, p) if rubbing else frictions
    following = ca.vertcat(q_next, v_next, frictions, inside)
    return ca.Function(
        "plant",
        [kernel_state, x, parameters],
        [following, y],
        ["kernel_state", "x", "p"],
        ["next", "y"],
    )


def plant_kernel(mechanism: Mechanism, count: int) -> Kernel:
    """Return the kernel of `plant_function`; plants of one structure share it."""
    structure = structure_of("plant", mechanism, sub_steps=count)
    return kernel_of(structure, lambda: plant_function(mechanism, count))


def settled_function(mechanism: Mechanism) -> ca.Function:
    """Return the function (q, dt, p) → the internal state after an interval at whose end the bodies
    are at q.
    """
    q = ca.SX.sym("q", mechanism.n_bodies)
    dt = ca.SX.sym("dt")
    p = mechanism.parameters.symbols
    inside = [*mechanism.internal_state(q).inside, *mechanism.crept(q, dt)]
    return ca.Function("inside", [q, dt, p], [ca.densify(ca.cse(ca.vertcat(*inside)))])


def inside_function(mechanism: Mechanism) -> ca.Function:
    """Return the function (q, p) → the internal state of a plant that has long stood at q: plays
    are in the middle of their bounds, and creep is as settled as the rig says.
    """
    structure = structure_of("inside", mechanism, settled=settled_creeps(mechanism))
    return function_of(structure, lambda: _inside_function(mechanism))


def settled_creeps(mechanism: Mechanism) -> tuple[tuple[int, float], ...]:
    """Return the tendon of each creep, and how far it has settled at the start. These are numbers
    of a mechanism that remembers no internal state, and so belong to its structure.
    """
    return tuple(
        (i, tendon.creep.settled.value)
        for i, tendon in enumerate(mechanism.rig.tendons)
        if tendon.creep is not None
    )


def _inside_function(mechanism: Mechanism) -> ca.Function:
    still = Mechanism(mechanism.rig)
    at = ca.SX.sym("q", mechanism.n_bodies)
    pulls = still.pulls(at, ca.SX.zeros(mechanism.n_bodies))
    p = still.parameters
    strains = []
    for i, settled in settled_creeps(mechanism):
        stretch = (pulls.joint[i] + pulls.drive[i]) / 2 / p[f"tendons.{i}.stiffness"]
        strains.append(settled * p[f"tendons.{i}.creep.share"] * stretch)
    return ca.Function(
        "inside", [at, p.symbols], [ca.vertcat(*still.internal_state(at).inside, *strains)]
    )


def hysteretic(mechanism: Mechanism) -> list[int]:
    """Return the indices of the drives whose transmission has hysteresis."""
    return [i for i, drive in enumerate(mechanism.rig.drives) if drive.hysteresis is not None]


PRESLIDING = 20.0
"""Stiffness of the friction inside a transmission before it slips, as a multiple of the tendons'
stiffness. It is so large that friction sets in nearly at once. Source: judgement.
"""


def presliding_stiffness(mechanism: Mechanism, drive: int) -> Scalar:
    """Return the stiffness of a drive's internal friction before it slips, in the drive's
    coordinate [N/m, N m/rad].
    """
    p = mechanism.parameters
    body = mechanism.n_joints + drive
    levers = mechanism.length_jacobian(ca.SX.zeros(mechanism.n_bodies))[:, body]
    stiffness = (levers[j] ** 2 * p[f"tendons.{j}.stiffness"] for j in range(mechanism.n_tendons))
    return PRESLIDING * sum(stiffness, start=ca.SX(0))


def longest_interval(mechanism: Mechanism) -> float:
    """Return the longest interval [s] that resolves the friction inside the transmissions, infinite
    if there is none.
    """
    q = ca.SX.sym("q", mechanism.n_bodies)
    p = mechanism.parameters
    longest = float("inf")
    for i in hysteretic(mechanism):
        slopes = ca.jacobian(mechanism.stretch(i, q), q)
        square = presliding_stiffness(mechanism, i) * ca.sum2(slopes**2 / mechanism.inertias().T)
        square = ca.Function("square", [q, p.symbols], [square])(
            np.zeros(mechanism.n_bodies), p.values
        )
        longest = min(longest, RESOLUTION / float(np.sqrt(float(square))))
    return longest


def internal_friction(mechanism: Mechanism, drives: list[int]) -> tuple[ca.Function, ca.Function]:
    """Return two functions of the friction inside the transmissions of `drives`, which acts beside
    the tendons' springs: a stop operator of their stretch σ (Prandtl, 1928).

    The first is (q, f, p) → its forces on the bodies, −(∂σ/∂q)ᵀ f. The second is (q, q⁺, v⁺, f, p)
    → f⁺ = clip(f + k_s (σ⁺ − σ), −h, h). With this friction the springs' force follows the drive's
    effort by the play operator that `Hysteresis` describes. The friction is fully there after a
    stretch of h/k_s, a twentieth of the stretch at which the springs alone would bear h.
    """
    n = mechanism.n_bodies
    p = mechanism.parameters
    q = ca.SX.sym("q", n)
    after = ca.SX.sym("after", n)
    v = ca.SX.sym("v", n)
    f = ca.SX.sym("f", len(drives))
    tensions = mechanism.tensions(after, v)
    forces = ca.SX(n, 1)
    frictions = []
    for k, i in enumerate(drives):
        stretch = mechanism.stretch(i, q)
        forces -= ca.jacobian(stretch, q).T * f[k]
        limit = mechanism.hysteresis_limit(i, after, tensions)
        moved = mechanism.stretch(i, after) - stretch
        frictions.append(
            ca.fmin(ca.fmax(f[k] + presliding_stiffness(mechanism, i) * moved, -limit), limit)
        )
    force = ca.Function("internal_force", [q, f, p.symbols], [ca.densify(forces)])
    follow = ca.Function("internal_friction", [q, after, v, f, p.symbols], [ca.vertcat(*frictions)])
    return force, follow
