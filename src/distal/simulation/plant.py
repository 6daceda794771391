"""The simulated plant: the rig's equations as a kernel, one function for each group of components
that moves independently; what acts on it by a scenario's signals, as arrays on a time grid with
one column per body; the equilibrium from which it starts; and its motion.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import accumulate
from math import inf, sqrt

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.errors import ScenarioError, did_you_mean
from distal.expressions import Scalar
from distal.kernels import (
    Feed,
    Kernel,
    Layout,
    PlacedKernel,
    advance,
    function_of,
    kernel_of,
    side_by_side,
    structure_of,
)
from distal.model import GRAVITY, Mechanism, interval_step
from distal.model.stepping import RESOLUTION
from distal.rig import Subsystem, independent_parts
from distal.simulation.scenario import (
    CapstanServo,
    DriveInput,
    JointInput,
    Scenario,
    SliderLoop,
    TurningHand,
)
from distal.units import to_si


def input_layout(mechanism: Mechanism) -> Layout:
    """Return the layout of a sample x of the plant's kernel, an interval: of each body the force or
    torque, hung weights included [N m, N]; the mass of hung weights [kg]; stiffness, target and
    damping of a spring and damper to a target; and the interval's length [s].
    """
    n = mechanism.n_bodies
    return Layout(effort=n, added_inertia=n, stiffness=n, target=n, damping=n, dt=1)


def output_layout(mechanism: Mechanism) -> Layout:
    """Return the layout of an output y of the plant's kernel: coordinates and velocities of the
    bodies, tensions, and pulls on the bodies.
    """
    n = mechanism.n_bodies
    return Layout(q=n, v=n, tensions=mechanism.n_tendons, pulls=n)


def parts_of_plant(mechanism: Mechanism) -> tuple[Subsystem, ...]:
    """Return the independent parts of a plant; none if there is only one, or if the plant has an
    internal state.
    """
    parts = independent_parts(mechanism.rig)
    return () if len(parts) == 1 or mechanism.parameters.inside else parts


def plants_apart(mechanism: Mechanism, parts: tuple[Subsystem, ...], count: int) -> ca.Function:
    """Return the function of a plant, see `plant_function`, put together from those of its
    independent `parts`.
    """
    n = mechanism.n_bodies
    nj = mechanism.n_joints
    rubbing = hysteretic(mechanism)
    parameters = mechanism.parameters
    inputs = input_layout(mechanism)
    outputs = output_layout(mechanism)
    kernels = []
    for part in parts:
        equations = Mechanism(part.rig, part.own_paths(parameters.inputs), remembers=True)
        joints, drives, tendons = (
            np.array(part.indices[kind], dtype=np.intp) for kind in ("joints", "drives", "tendons")
        )
        bodies = np.concatenate([joints, nj + drives])
        frictions = np.flatnonzero(np.isin(rubbing, drives))
        kernel_state = np.concatenate([bodies, n + bodies, 2 * n + frictions])
        x = np.append(np.add.outer(np.arange(0, inputs.size - 1, n), bodies), inputs.size - 1)
        names = equations.parameters.names
        p = np.array([parameters.index(part.whole_path(name)) for name in names])
        tense, pulled = (outputs[name].start for name in ("tensions", "pulls"))
        y = np.concatenate([bodies, n + bodies, tense + tendons, pulled + bodies])
        kernels.append(PlacedKernel(plant_function(equations, count), kernel_state, x, p, y))
    sizes = 2 * n + len(rubbing), inputs.size, len(parameters), outputs.size
    return side_by_side("plant", kernels, sizes)


def plant_function(mechanism: Mechanism, count: int) -> ca.Function:
    """Return the function (kernel_state, x, p) → (kernel_state⁺, y) of the plant over one interval
    of `count` sub-steps.

    The kernel state is (q, v, friction inside each drive's transmission, internal state), x and y
    are those of `input_layout` and `output_layout`. The pull is what a load cell or torque sensor
    between source and body reads: U = W − (W/g) ẍ for a hung weight.
    """
    n = mechanism.n_bodies
    rubbing = hysteretic(mechanism)
    nx = len(mechanism.parameters.inside)
    parts = parts_of_plant(mechanism)
    if parts:
        return plants_apart(mechanism, parts, count)
    step = interval_step(mechanism, count)
    q = ca.SX.sym("q", n)
    v = ca.SX.sym("v", n)
    tensions = ca.Function(
        "tensions", [q, v, mechanism.parameters.symbols], [mechanism.tensions(q, v)]
    )
    kernel_state = ca.MX.sym("kernel_state", 2 * n + len(rubbing) + nx)
    inputs = input_layout(mechanism)
    x = ca.MX.sym("x", inputs.size)
    parameters = ca.MX.sym("p", len(mechanism.parameters))
    at, before, frictions, inside = ca.vertsplit(
        kernel_state, [*accumulate((0, n, n, len(rubbing), nx))]
    )
    effort, added, *springs, dt = inputs.parts(x).values()
    stiffness, target, damping = springs
    known = parameters[: parameters.numel() - nx]
    p = ca.vertcat(known, inside)
    force, follow = internal_friction(mechanism, rubbing)
    acting = effort + force(at, frictions, p) if rubbing else effort
    q_next, v_next = step(at, before, acting, added, ca.horzcat(*springs), dt, p)
    acceleration = (v_next - before) / dt
    pull = effort - added * acceleration + stiffness * (target - q_next) - damping * v_next
    if nx:
        inside = settled_function(mechanism)(q_next, dt, p)
        p = ca.vertcat(known, inside)
    y = ca.vertcat(q_next, v_next, tensions(q_next, v_next, p), pull)
    frictions = follow(at, q_next, v_next, frictions, p) if rubbing else frictions
    following = ca.vertcat(q_next, v_next, frictions, inside)
    return ca.Function("plant", [kernel_state, x, parameters], [following, y])


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


def rest_function(mechanism: Mechanism) -> ca.Function:
    """Return the function (q, p) → (internal state, elastic forces of the tendons on the bodies) of
    a plant that has long stood at q: plays are in the middle of their bounds, and creep is as
    settled as the rig says. The parameters p are those of a mechanism that remembers no internal
    state.
    """
    tendons = enumerate(mechanism.rig.tendons)
    # numbers of such a mechanism, which so belong to its structure
    settled = tuple((i, t.creep.settled.value) for i, t in tendons if t.creep is not None)

    def make() -> ca.Function:
        still = Mechanism(mechanism.rig)
        q = ca.SX.sym("q", mechanism.n_bodies)
        pulls = still.pulls(q, ca.SX.zeros(mechanism.n_bodies))
        state = still.internal_state(q)
        p = still.parameters
        strains = []
        for i, share in settled:
            stretch = (pulls.joint[i] + pulls.drive[i]) / 2 / p[f"tendons.{i}.stiffness"]
            strains.append(share * p[f"tendons.{i}.creep.share"] * stretch)
        force = -ca.mtimes(still.length_jacobian(state.q).T, still.elastic_forces(state.q))
        return ca.Function("standing", [q, p.symbols], [ca.vertcat(*state.inside, *strains), force])

    return function_of(structure_of("standing", mechanism, settled=settled), make)


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
    longest = inf
    for i in hysteretic(mechanism):
        slopes = ca.jacobian(mechanism.stretch(i, q), q)
        square = presliding_stiffness(mechanism, i) * ca.sum2(slopes**2 / mechanism.inertias().T)
        square = ca.Function("square", [q, p.symbols], [square])(
            np.zeros(mechanism.n_bodies), p.values
        )
        longest = min(longest, RESOLUTION / sqrt(square))
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


PULLS = {"slider": ("weight", "force", "servo.position"), "capstan": ("torque", "servo.angle")}
"""Kind of a drive → what may pull it."""


def plant_inputs(scenario: Scenario, mechanism: Mechanism, dt: float, count: int) -> Floats:
    """Return what a scenario's signals do to the bodies in each of `count` intervals of length `dt`
    [s]: samples of the plant's kernel, (count, n_x), see `input_layout`.

    Raises:
        ScenarioError: the scenario names a joint or drive that the rig does not have, or pulls a
            drive in a way that its kind does not allow.
    """
    rig = mechanism.rig
    check_names(scenario.joints, rig.joint_names, "joints", "joint")
    check_names(scenario.drives, rig.drive_names, "drives", "drive")
    time = dt * np.arange(count, dtype=np.float64)
    layout = input_layout(mechanism)
    rows = np.zeros((count, layout.size))
    inputs = layout.views(rows)
    inputs["dt"][:] = dt
    for i, joint in enumerate(rig.joints):
        load = scenario.joints.get(joint.name, JointInput())
        if load.torque is not None:
            inputs["effort"][:, i] += load.torque.at(time)
        if load.hand is not None:
            _spring(inputs, i, load.hand, time)
    for i, drive in enumerate(rig.drives, mechanism.n_joints):
        pull = scenario.drives.get(drive.name, DriveInput())
        signals = {"weight": pull.weight, "force": pull.force, "torque": pull.torque}
        loop = "servo.position" if isinstance(pull.servo, SliderLoop) else "servo.angle"
        allowed = PULLS[drive.kind]
        for part, given in {**signals, loop: pull.servo}.items():
            if given is not None and part not in allowed:
                raise ScenarioError(
                    f"drives.{drive.name}.{part}: a {drive.kind} cannot be pulled so; "
                    f"{', '.join(allowed)} are allowed"
                )
        for signal in filter(None, signals.values()):
            inputs["effort"][:, i] += signal.at(time)
        if pull.weight is not None:
            inputs["added_inertia"][:, i] = pull.weight.at(time) / GRAVITY
        if pull.servo is not None:
            _spring(inputs, i, pull.servo, time)
    return rows


def _spring(
    inputs: Mapping[str, Floats],
    body: int,
    spring: TurningHand | SliderLoop | CapstanServo,
    time: Floats,
) -> None:
    target = spring.position if isinstance(spring, SliderLoop) else spring.angle
    inputs["stiffness"][:, body] = spring.stiffness
    inputs["target"][:, body] = target.at(time)
    inputs["damping"][:, body] = spring.damping


def check_names(
    keys: Iterable[str],
    names: list[str],
    where: str,
    kind: str,
    error: type[Exception] = ScenarioError,
) -> None:
    """Raise an error where a key of a scenario is no name of the rig's parts.

    Args:
        where: the table of the scenario.
        kind: what the names are of, such as "joint".
    """
    for name in keys:
        if name not in names:
            raise error(f"{where}: the rig has no {kind} '{name}'{did_you_mean(name, names)}")


def initial_angles(scenario: Scenario, mechanism: Mechanism) -> Floats:
    """Return the joints' angles at the start [rad], (n_joints,): the scenario's, else the rig's
    `initial`.

    Raises:
        ScenarioError: a joint is unknown or follows another one, or its angle is none.
    """
    names = mechanism.rig.joint_names
    check_names(scenario.initial, names, "initial", "joint")
    joints = mechanism.rig.joints
    angles = np.array([joint.initial.value for joint in joints])
    for name, raw in scenario.initial.items():
        at = names.index(name)
        coupled = joints[at].coupled
        if coupled is not None:
            raise ScenarioError(
                f"initial.{name}: it follows '{coupled.joint}'; give the angle of that joint"
            )
        try:
            angles[at] = to_si(raw, "rad")
        except ValueError as problem:
            raise ScenarioError(f"initial.{name}: {problem}") from None
    # a coupled joint follows from the joint that it is coupled to
    return np.array(mechanism.spread @ angles[mechanism.free] + mechanism.offsets).ravel()


def check_motion(plant: Mechanism, y: Floats) -> None:
    """Check that a plant's motion is finite and within bounds.

    Args:
        y: outputs of its kernel, (k, n_y), see `plant_function`.

    Raises:
        ScenarioError: it is not.
    """
    if not np.all(np.isfinite(y)) or np.abs(y[:, : plant.n_bodies]).max() > 1e3:
        raise ScenarioError(
            "the simulated motion left all bounds: a force without a stop or tendon that "
            "holds it, or a step that is too long (see stepping.largest_step)"
        )


def at_rest(
    mechanism: Mechanism, rows: Floats, start: Floats, kernel: Kernel
) -> tuple[Floats, Floats]:
    """Return the kernel state of a plant at rest, and the output y of its kernel there, (1, n_y).

    Args:
        rows: samples of the kernel, of which only the first counts, (k, n_x).
        start: coordinates at rest, (n_bodies,).
        kernel: of `plant_function`.
    """
    n = mechanism.n_bodies
    p = mechanism.parameters.values
    inside, _ = rest_function(mechanism)(start, p[: p.size - len(mechanism.parameters.inside)])
    still = np.zeros(n + len(hysteretic(mechanism)))
    kernel_state = np.concatenate([start, still, np.array(inside).ravel()])
    first = rows[:1].copy()
    inputs = input_layout(mechanism).views(first)
    inputs["dt"][:] = 1e-12  # a tiny interval gives the tensions there
    y = advance(kernel, Feed(kernel_state, first, p)).ys
    outputs = output_layout(mechanism).views(y)
    outputs["q"][:] = start
    outputs["v"][:] = 0.0
    outputs["pulls"][:] = inputs["effort"] + inputs["stiffness"] * (inputs["target"] - start)
    return kernel_state, y


def equilibrium(mechanism: Mechanism, angles: Floats, rows: Floats) -> Floats:
    """Return the coordinates, (n_bodies,), at which every drive is in equilibrium while the joints
    are held at `angles` [rad], (n_joints,).

    A slack tendon counts as if it could push, so that a drive without a pull stands where its
    tendon is just straight. Of the `rows`, samples of the plant's kernel, only the first counts.

    Raises:
        ScenarioError: a drive has no equilibrium.
    """
    from scipy.optimize import brentq

    at_rest = rest_function(mechanism)
    p = mechanism.parameters.values[: len(mechanism.parameters) - len(mechanism.parameters.inside)]
    coordinates = np.concatenate([angles, np.zeros(mechanism.n_drives)])
    inputs = input_layout(mechanism).views(rows[0])
    effort, stiffness, target = (inputs[name] for name in ("effort", "stiffness", "target"))

    for i, drive in enumerate(mechanism.rig.drives, mechanism.n_joints):

        def net(position: float, body: int = i) -> float:
            coordinates[body] = position
            spring = stiffness[body] * (target[body] - position)
            return float(at_rest(coordinates, p)[1][body] + effort[body] + spring)

        reach = 1e-3
        while not (net(-reach) > 0.0 > net(reach)):
            reach *= 2.0
            if reach > 1e3:
                raise ScenarioError(
                    f"drives.{drive.name}: no equilibrium at the start; check its pull"
                )
        coordinates[i] = brentq(net, -reach, reach, xtol=1e-12)
        if drive.stops is not None:
            coordinates[i] = np.clip(coordinates[i], *drive.stops)
    return coordinates
