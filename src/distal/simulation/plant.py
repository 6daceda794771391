"""The simulated plant: the rig's equations as a kernel, and the equilibrium from which it
starts.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.errors import ScenarioError
from distal.expressions import Scalar
from distal.kernels import Feed, Kernel, advance, function_of, kernel_of, structure_of
from distal.model import Mechanism, interval_step
from distal.simulation.independent_plants import parts_of_plant, plants_apart
from distal.simulation.signal_inputs import BodyInputs


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
    structure = structure_of("inside", mechanism, settled=_settled(mechanism))
    return function_of(structure, lambda: _inside_function(mechanism))


def _settled(mechanism: Mechanism) -> tuple[tuple[int, str, float], ...]:
    """Return the tendon and path of each creep, and how far it has settled at the start. These are
    numbers of a mechanism that remembers no internal state, and so belong to its structure.
    """
    return tuple(
        (i, name, tendon.creeps[name.rpartition(".")[2]].settled.value)
        for i, tendon in enumerate(mechanism.rig.tendons)
        for name in mechanism.creeps(i)
    )


def _inside_function(mechanism: Mechanism) -> ca.Function:
    still = Mechanism(mechanism.rig)
    at = ca.SX.sym("q", mechanism.n_bodies)
    pulls = still.pulls(at, ca.SX.zeros(mechanism.n_bodies))
    p = still.parameters
    strains = []
    for i, name, settled in _settled(mechanism):
        stretch = (pulls.joint[i] + pulls.drive[i]) / 2 / p[f"tendons.{i}.stiffness"]
        strains.append(settled * p[f"{name}.share"] * stretch)
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

RESOLVED = 0.5
"""Largest product of an interval and the natural frequency of that stiffness [1]. Source:
judgement.
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
        longest = min(longest, RESOLVED / float(np.sqrt(float(square))))
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


@dataclass(frozen=True)
class PlantMotion:
    """The plant's motion at the start and after every interval: the outputs y of its kernel, (k,
    n_y), see `plant_function`.
    """

    plant: Mechanism
    y: Floats

    @property
    def q(self) -> Floats:
        """Coordinates of the bodies, joints first, (k, n_bodies) [rad, m]."""
        return self.y[:, : self.plant.n_bodies]

    @property
    def v(self) -> Floats:
        """Velocities of the bodies, joints first, (k, n_bodies)."""
        return self.y[:, self.plant.n_bodies : 2 * self.plant.n_bodies]

    @property
    def tensions(self) -> Floats:
        """Tensions of the tendons, (k, n_tendons) [N]."""
        n = 2 * self.plant.n_bodies
        return self.y[:, n : n + self.plant.n_tendons]

    @property
    def pulls(self) -> Floats:
        """What pulls the bodies: torques on the joints, then forces or torques of the drives, (k,
        n_bodies) [N m, N].
        """
        return self.y[:, 2 * self.plant.n_bodies + self.plant.n_tendons :]

    def check(self) -> None:
        """Check that the motion is finite and within bounds.

        Raises:
            ScenarioError: it is not.
        """
        if not np.all(np.isfinite(self.y)) or np.abs(self.q).max() > 1e3:
            raise ScenarioError(
                "the simulated motion left all bounds: a force without a stop or tendon that "
                "holds it, "
                "or a step that is too long (see stepping.largest_step)"
            )


def rows_of(inputs: BodyInputs, dt: float) -> Floats:
    """Return the samples x of the plant's kernel, one row for each interval of length `dt` [s]."""
    k, n = inputs.effort.shape
    servo = inputs.servo.transpose(0, 2, 1).reshape(k, 3 * n)
    return np.hstack([inputs.effort, inputs.added_inertia, servo, np.full((k, 1), dt)])


def at_rest(
    mechanism: Mechanism, inputs: BodyInputs, start: Floats, kernel: Kernel
) -> tuple[Floats, Floats]:
    """Return the kernel state of a plant at rest, and the output y of its kernel there, (1, n_y).

    Of the inputs only the first interval counts.

    Args:
        start: coordinates at rest, (n_bodies,).
        kernel: of `plant_function`.
    """
    n = mechanism.n_bodies
    p = mechanism.parameters.values
    inside = np.array(
        inside_function(mechanism)(start, p[: p.size - len(mechanism.parameters.inside)])
    ).ravel()
    kernel_state = np.concatenate([start, np.zeros(n + len(hysteretic(mechanism))), inside])
    # a tiny interval gives the tensions there
    y = advance(kernel, Feed(kernel_state, rows_of(inputs, 1e-12)[:1], p)).ys
    y[:, :n] = start
    y[:, n : 2 * n] = 0.0
    servo = inputs.servo[:1]
    y[:, 2 * n + mechanism.n_tendons :] = inputs.effort[:1] + servo[:, :, 0] * (
        servo[:, :, 1] - start
    )
    return kernel_state, y


def resting_force(mechanism: Mechanism) -> ca.Function:
    """Return the function (q, p) → the elastic forces of the tendons on the bodies at rest."""
    structure = structure_of("resting force", mechanism, settled=_settled(mechanism))
    return function_of(structure, lambda: _resting_force(mechanism))


def _resting_force(mechanism: Mechanism) -> ca.Function:
    still = Mechanism(mechanism.rig)
    q = ca.SX.sym("q", mechanism.n_bodies)
    tied = still.internal_state(q).q
    pull = -ca.mtimes(still.length_jacobian(tied).T, still.elastic_forces(tied))
    return ca.Function("force", [q, still.parameters.symbols], [pull])


def equilibrium(mechanism: Mechanism, angles: Floats, inputs: BodyInputs) -> Floats:
    """Return the coordinates, (n_bodies,), at which every drive is in equilibrium while the joints
    are held at `angles` [rad], (n_joints,).

    A slack tendon counts as if it could push, so that a drive without a pull stands where its
    tendon is just straight. Of the inputs only the first interval counts.

    Raises:
        ScenarioError: a drive has no equilibrium.
    """
    from scipy.optimize import brentq

    force = resting_force(mechanism)
    p = mechanism.parameters.values[: len(mechanism.parameters) - len(mechanism.parameters.inside)]
    coordinates = np.concatenate([angles, np.zeros(mechanism.n_drives)])
    servo = inputs.servo[0]

    for i, drive in enumerate(mechanism.rig.drives, mechanism.n_joints):

        def net(position: float, body: int = i) -> float:
            coordinates[body] = position
            spring = servo[body, 0] * (servo[body, 1] - position)
            return (
                float(force(coordinates, p)[body]) + float(inputs.effort[0, body]) + float(spring)
            )

        reach = 1e-3
        while not (net(-reach) > 0.0 > net(reach)):
            reach *= 2.0
            if reach > 1e3:
                raise ScenarioError(
                    f"drives.{mechanism.bodies[i].name}: no equilibrium at the start; check its "
                    "pull"
                )
        coordinates[i] = float(brentq(net, -reach, reach, xtol=1e-12))
        if drive.stops is not None:
            coordinates[i] = float(np.clip(coordinates[i], *drive.stops))
    return coordinates
