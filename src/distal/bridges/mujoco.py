"""A rig as a MuJoCo model, and what its tendons do there that no model file can say."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import mujoco
import numpy as np
import tomlkit
from numpy.typing import NDArray

from distal.errors import RigError
from distal.fitting.fit import plain_value
from distal.kernels import kernel_of, structure_of
from distal.model import Mechanism
from distal.rig import Rig, as_rig
from distal.rig.mjcf_bodies import EMBEDDED
from distal.simulation.plant import (
    hysteretic,
    internal_friction,
    rest_function,
    settled_function,
)
from distal.simulation.simulate import intervals_of

TINY = 1e-12
"""Least mass and moments of inertia of a body [kg, kg m²]. Source: rounding (MuJoCo refuses less
than 1e-15).
"""

RIGID = 0.9999
"""Largest impedance of a constraint [1]. Source: definition (MuJoCo's mjMAXIMP)."""

SLACKEST = -1e3
"""Length of a tendon below which it would push [m]. Source: definition (none is so slack)."""


MEASURED = {
    "position": mujoco.mjtSensor.mjSENS_JOINTPOS,
    "force": mujoco.mjtSensor.mjSENS_JOINTACTFRC,
    "angle": mujoco.mjtSensor.mjSENS_JOINTPOS,
}
"""What a sensor measures → the sensor of a joint that MuJoCo has for it."""


def to_mjcf(rig: Rig | str | Path, into: str | Path | None = None) -> str:
    """Return a rig as a MuJoCo model, XML in SI, with the rig's text in it, but for learned maps.

    A drive is a body with a joint ``drive_NAME``; a tendon pulls with k (L − L₀) + c L̇, L₀ being
    where it is slack. Curves (paths, springs) are tangents at the joints' initial angles; friction
    is that at nominal tension, outside of sheaths. `Tendons` has what this leaves out.

    Args:
        rig: the description, or a shipped rig's name, or a path.
        into: a model whose joints have the rig's names. It keeps its bodies, couplings and all
            else, except tendons, actuators and sensors that are called like the rig's, or refer to
            such.

    Raises:
        RigError: the rig is unknown or wrong, a joint is missing, or MuJoCo refuses the model.
    """
    rig = as_rig(rig)
    try:
        if into is None:
            spec = mujoco.MjSpec()
            _add_links(spec, rig)
        else:
            spec = mujoco.MjSpec.from_file(str(into))
        gone = {EMBEDDED, *rig.tendon_names, *rig.drive_names, *rig.sensor_names}
        for part in (*spec.tendons, *spec.actuators, *spec.sensors, *spec.texts):
            if gone & {part.name, getattr(part, "target", ""), getattr(part, "objname", "")}:
                gone |= {part.name} - {""}
                spec.delete(part)
        interval, count = intervals_of(Mechanism(rig), spec.option.timestep)
        spec.option.timestep = 2 * interval / count
        spec.compiler.saveinertial = True
        spec.compiler.boundmass = spec.compiler.boundinertia = TINY
        spec.copy_back(_with_parts(spec, rig))
        return str(spec.to_xml())
    except RigError:
        raise
    except (KeyError, ValueError) as problem:
        reason = " ".join(str(problem).split())
        raise RigError(f"{into or rig.name}: MuJoCo does not take it: {reason}") from None


def _names(rig: Rig) -> list[str]:
    """Return the names of the joints of all bodies."""
    return [*rig.joint_names, *(f"drive_{name}" for name in rig.drive_names)]


def _unlinked(rig: Rig) -> Rig:
    """Return a rig without links, whose weight and inertia are MuJoCo's."""
    return rig.bare().with_values({"joints.*.link": None})


def _add_links(spec: mujoco.MjSpec, rig: Rig) -> None:
    """Add a body for each joint; their frames are all parallel at zero angles."""
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.gravity = rig.base.gravity
    base = spec.worldbody.add_body(name="base")
    mujoco.mju_euler2Quat(base.quat, rig.base.orientation, "XYZ")
    bodies: dict[int | None, mujoco.MjsBody] = {None: base}
    for i, joint in enumerate(rig.joints):
        body = bodies[rig.parent_of(i)].add_body(name=joint.name, pos=joint.offset)
        bodies[i] = body
        body.add_joint(name=joint.name, axis=joint.axis)
        if joint.link is not None:
            body.mass = joint.link.mass.value
            body.ipos = joint.link.centre
            body.inertia = joint.link.inertia
            body.explicitinertial = True
        if joint.coupled is not None:
            pair = spec.add_equality(
                name1=joint.name, name2=joint.coupled.joint, type=mujoco.mjtEq.mjEQ_JOINT
            )
            pair.data[:2] = joint.coupled.offset, joint.coupled.ratio
            pair.solimp[:2] = RIGID


def _with_parts(spec: mujoco.MjSpec, rig: Rig) -> mujoco.MjModel:
    """Return the model with all parts but the links, and with their numbers."""
    names = _names(rig)
    _add_drives_and_sensors(spec, rig)
    described = plain_value(rig.bare().model_dump(exclude_defaults=True))
    spec.add_text(name=EMBEDDED, data=tomlkit.dumps(described))
    mechanism = Mechanism(_unlinked(rig))
    pulls = []
    for tendon in rig.tendons:
        drive = rig.drive(tendon.drive)
        usual = abs(drive.nominal_force.value) / drive.lever / len(rig.tendons_of(drive.name))
        pulls.append(max(usual, tendon.home_tension))
    q = ca.SX.sym("q", mechanism.n_bodies)
    limits = mechanism.friction_limits(q, ca.DM.inf(mechanism.n_bodies), ca.DM(pulls))
    passive = mechanism.passive_forces(q)
    expressions = [
        ca.horzcat(mechanism.elongations(q), mechanism.length_jacobian(q)),
        ca.horzcat(
            mechanism.inertias(),
            mechanism.dampings(),
            ca.vertcat(*(limit.mean for limit in limits)),
            passive,
            -ca.diag(ca.jacobian(passive, q)),
        ),
    ]
    at = np.zeros(mechanism.n_bodies)
    at[: len(rig.joints)] = [joint.initial.value for joint in rig.joints]
    p = mechanism.parameters
    of_tendons, of_bodies = ca.Function("numbers", [q, p.symbols], expressions)(at, p.values)
    for tendon, (length, *arms) in zip(rig.tendons, of_tendons.full()):
        loose = np.dot(arms, at) - length + tendon.loose
        added = spec.add_tendon(name=tendon.name, springlength=(SLACKEST, loose))
        added.stiffness[0] = tendon.stiffness.value
        added.damping[0] = tendon.damping.value
        for name, arm in zip(names, arms):
            if arm:
                added.wrap_joint(name, arm)
    model = spec.compile()
    joints = [model.joint(name).id for name in names]
    dofs = model.jnt_dofadr[joints]
    rows = of_bodies.full().T
    model.dof_armature[dofs], model.dof_damping[dofs], model.dof_frictionloss[dofs] = rows[:3]
    torque, stiffness = rows[3:]
    model.dof_solref[dofs] = -1, -1 / model.opt.timestep
    model.dof_solimp[dofs, :2] = RIGID
    model.jnt_stiffness[joints] = stiffness
    away = torque / np.where(stiffness == 0, 1, stiffness)
    model.qpos_spring[model.jnt_qposadr[joints]] = at + away
    mujoco.mj_setConst(model, mujoco.MjData(model))
    step = 2 * model.opt.timestep
    for joint, dof, part in zip(joints, dofs, (*rig.joints, *rig.drives)):
        if part.stops is not None:
            stop = np.array([part.stop_stiffness.value, part.stop_damping.value])
            stop *= model.dof_invweight0[dof]
            # a contact that a step resolves needs no inertia; MuJoCo's least time is two steps
            share = min(1, 1 / max(step**2 * stop[0], step * stop[1]))
            model.jnt_limited[joint] = 1
            model.jnt_range[joint] = part.stops
            model.jnt_solref[joint] = -share * stop
            model.jnt_solimp[joint, :2] = 1 - share
    return model


def _add_drives_and_sensors(spec: mujoco.MjSpec, rig: Rig) -> None:
    """Add the drives with their actuators, and the sensors, to a model."""
    for drive in rig.drives:
        name = f"drive_{drive.name}"
        if spec.joint(name) is None:
            joint = spec.worldbody.add_body(name=name).add_joint(name=name, axis=(1, 0, 0))
            if drive.kind == "slider":
                joint.type = mujoco.mjtJoint.mjJNT_SLIDE
        actuator = spec.add_actuator(
            name=drive.name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT
        )
        servo = drive.servo
        if servo is not None and servo.stiffness is not None:
            actuator.set_to_position(servo.stiffness, dampratio=1, timeconst=servo.lag)
        if drive.limit is not None:
            actuator.forcerange = -drive.limit, drive.limit
    for sensor in rig.sensors:
        if sensor.measures in MEASURED:
            spec.add_sensor(
                name=sensor.name,
                type=MEASURED[sensor.measures],
                noise=sensor.noise,
                objname=sensor.of if sensor.measures == "angle" else f"drive_{sensor.of}",
                objtype=mujoco.mjtObj.mjOBJ_JOINT,
            )


def _function(mechanism: Mechanism) -> ca.Function:
    """Return the function (kernel_state, x, p) → (kernel_state⁺, y) of a rig's tendons.

    The kernel state is (q, friction inside the transmissions, internal state), x is (q, v, dt), and
    y is (forces on the bodies, their friction limits, tensions).
    """
    n = mechanism.n_bodies
    q, v = (ca.SX.sym(name, n) for name in "qv")
    symbols = mechanism.parameters.symbols
    pulls = mechanism.pulls(q, ca.SX.zeros(n))
    limits = mechanism.friction_limits(q, v, pulls.joint, pulls.drive)
    # what friction does in both directions alike is a limit, the rest a force
    forces = pulls.forces + mechanism.passive_forces(q)
    forces -= ca.vertcat(*(limit.asymmetry for limit in limits))
    y = ca.vertcat(forces, *(limit.mean for limit in limits), pulls.joint)
    outputs = ca.Function("outputs", [q, v, symbols], [ca.densify(y)])
    rubbing = hysteretic(mechanism)
    inside = len(mechanism.parameters.inside)
    ends = np.cumsum([0, n, len(rubbing), inside]).tolist()
    kernel_state = ca.MX.sym("kernel_state", ends[-1])
    x = ca.MX.sym("x", 2 * n + 1)
    p = ca.MX.sym("p", symbols.numel())
    before, frictions, rested = ca.vertsplit(kernel_state, ends)
    q, v, dt = ca.vertsplit(x, [0, n, 2 * n, 2 * n + 1])
    constants = p[: p.numel() - inside]
    rested = settled_function(mechanism)(q, dt, ca.vertcat(constants, rested))
    parameters = ca.vertcat(constants, rested)
    force, follow = internal_friction(mechanism, rubbing)
    frictions = follow(before, q, v, frictions, parameters)
    y = outputs(q, v, parameters)
    y[:n] += force(q, frictions, parameters)
    return ca.Function("tendons", [kernel_state, x, p], [ca.vertcat(q, frictions, rested), y])


class Tendons:
    """The tendons and springs of a rig in MuJoCo, by the equations of distal's own plant: exact
    paths, slack, stiffening, play, sheaths, creep, hysteresis. Coulomb friction stays MuJoCo's,
    with limits by the present tensions.

    ```python
    tendons = Tendons(model, rig)
    while data.time < 3:
        tendons.apply(data)
        mujoco.mj_step(model, data)
    ```

    Args:
        model: by `to_mjcf`. Its springs are set to zero.
        rig: the description, or a shipped rig's name, or a path.

    Raises:
        RigError: the rig is unknown or wrong.
        KeyError: the model has no joint or tendon of such a name.
    """

    def __init__(self, model: mujoco.MjModel, rig: Rig | str | Path) -> None:
        rig = as_rig(rig)
        joints = [model.joint(name).id for name in _names(rig)]
        model.jnt_stiffness[joints] = 0
        model.tendon_stiffness[[model.tendon(name).id for name in rig.tendon_names]] = 0
        self._model = model
        self._names = rig.tendon_names
        self._positions = _slice(model.jnt_qposadr[joints])
        self._dofs = _slice(model.jnt_dofadr[joints])
        self._mechanism = mechanism = Mechanism(_unlinked(rig), remembers=True)
        kernel = kernel_of(structure_of("tendons", mechanism), lambda: _function(mechanism))
        self._loop = kernel.loop(mechanism.parameters.values)
        ends = mechanism.n_bodies, 2 * mechanism.n_bodies
        self._q, self._v, self._dt = np.split(self._loop.x, ends)
        self._forces, self._limits, self._tensions = np.split(self._loop.y, ends)
        self._data = None

    def reset(self, data: mujoco.MjData) -> None:
        """Begin anew where the simulation is, as if it had long rested there."""
        self._data = data
        # MuJoCo makes a new array each time one is asked for
        self._arrays = data.qpos, data.qvel, data.qfrc_applied, self._model.dof_frictionloss
        self._dt[:] = self._model.opt.timestep
        p = self._mechanism.parameters
        q = data.qpos[self._positions]
        inside, _ = rest_function(self._mechanism)(q, p.values[: len(p) - len(p.inside)])
        state = self._loop.kernel_state
        state[:] = 0
        state[: len(q)] = q
        state[len(state) - len(p.inside) :] = inside.full()[:, 0]

    def apply(self, data: mujoco.MjData) -> None:
        """Set ``qfrc_applied`` and the friction limits of the rig's joints and drives for the next
        step; push them by ``xfrc_applied`` or actuators.
        """
        if data is not self._data:
            self.reset(data)
        positions, velocities, forces, friction = self._arrays
        self._q[:] = positions[self._positions]
        self._v[:] = velocities[self._dofs]
        self._loop.step()
        forces[self._dofs] = self._forces
        friction[self._dofs] = self._limits

    @property
    def tensions(self) -> dict[str, float]:
        """Tendon → its tension at the last step, but for damping [N]."""
        return dict(zip(self._names, self._tensions.tolist()))


def _slice(indices: NDArray[np.int32]) -> NDArray[np.int32] | slice:
    """Return indices that follow one another as a slice, which is faster."""
    return slice(indices[0], indices[-1] + 1) if np.all(np.diff(indices) == 1) else indices
