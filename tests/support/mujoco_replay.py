"""Motions in MuJoCo whose drives go where they went elsewhere; and a motion of a hand that shares
no code with distal, with the rig that has its true numbers.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from distal import Rig, load_rig
from distal.arrays import Floats
from distal.bridges.mujoco import Tendons, to_mjcf
from tests.support.servo_hands import STEP, Drawn, orca_like

SAMPLE = 4 * STEP
"""Interval of the motion of a hand [s]."""


class Motion(NamedTuple):
    """A motion: times [s], (k,), angles of the joints [rad], (k, n_joints), positions of the
    drives [m, rad], (k, n_drives), and torques on the joints from outside [N m], (k, n_joints).
    """

    time: Floats
    angles: Floats
    positions: Floats
    torques: Floats | float = 0.0


DRIVEN = 1e8
"""Of a drive that goes with a given speed whatever pulls it: force per speed that is lacking [N
s/m, N m s/rad]; its inertia is 1 kg, kg m². Source: rounding (a step leaves 1e-4 of a jump).
"""


def driven(rig: Rig) -> mujoco.MjSpec:
    """Return a rig's model whose controls are its drives' speeds, then torques on its joints; its
    sensors are the joints' angles.
    """
    spec = mujoco.MjSpec.from_string(to_mjcf(rig))
    for part in (*spec.actuators, *spec.sensors):
        spec.delete(part)
    for name in [f"drive_{name}" for name in rig.drive_names] + rig.joint_names:
        actuator = spec.add_actuator(name=name, target=name)
        actuator.trntype = mujoco.mjtTrn.mjTRN_JOINT
        if name in rig.joint_names:
            sensor = spec.add_sensor(name=name, objname=name)
            sensor.objtype, sensor.type = (
                mujoco.mjtObj.mjOBJ_JOINT,
                mujoco.mjtSensor.mjSENS_JOINTPOS,
            )
        else:
            actuator.set_to_velocity(DRIVEN)
            spec.joint(name).armature = 1.0
            spec.joint(name).limited = 0
    return spec


def controls(model: mujoco.MjModel, motion: Motion) -> tuple[Floats, NDArray[np.int64]]:
    """Return the controls of a driven model at each step of a motion, (steps, n_drives +
    n_joints), and after how many steps each of its times has come, (k,).
    """
    intervals = np.diff(motion.time)
    steps = np.rint(intervals / model.opt.timestep).astype(np.int64)
    speeds = np.diff(motion.positions, axis=0) / (steps * model.opt.timestep)[:, None]
    torques = np.broadcast_to(motion.torques, motion.angles.shape)[:-1]
    each = np.repeat(np.column_stack([speeds, torques]), steps, axis=0)
    return each, np.concatenate([[0], np.cumsum(steps)])


def begun(model: mujoco.MjModel, rig: Rig, motion: Motion) -> mujoco.MjData:
    """Return the state of a model at the beginning of a motion."""
    data = mujoco.MjData(model)
    for name, angle in zip(rig.joint_names, motion.angles[0]):
        data.joint(name).qpos = angle
    for name, position in zip(rig.drive_names, motion.positions[0]):
        data.joint(f"drive_{name}").qpos = position
    return data


def replayed(
    rig: Rig, motion: Motion, tendons: bool, model: mujoco.MjModel | None = None
) -> Floats:
    """Return the angles [rad], (k, n_joints), to which the rig's model in MuJoCo, or another
    driven one, turns its joints while its drives go through a motion; with `tendons` it is helped
    by `Tendons`.
    """
    if model is None:
        model = driven(rig).compile()
    data = begun(model, rig, motion)
    acting = Tendons(model, rig) if tendons else None
    joints = model.jnt_qposadr[[model.joint(name).id for name in rig.joint_names]]
    each, at = controls(model, motion)
    angles = np.empty((len(each) + 1, len(joints)))
    angles[0] = motion.angles[0]
    for k, row in enumerate(each):
        data.ctrl[:] = row
        if acting is not None:
            acting.apply(data)
        mujoco.mj_step(model, data)
        angles[k + 1] = data.qpos[joints]
    return angles[at]


def rms(off: Floats) -> float:
    """Return the RMS of some angles in degrees."""
    return float(np.rad2deg(np.sqrt(np.mean(off**2))))


def stranger(seed: int, duration: float) -> tuple[Rig, Motion]:
    """Return a motion of a joint of a hand with slack tendons in sheaths, and its true rig."""
    _, hands = orca_like([seed], ("index_mcp",))
    frequency = np.random.default_rng([seed, 31]).uniform(0.2, 0.5)
    ratio = float(hands.d.arms[0, 0, 0] / hands.d.spools[0, 0, 0])
    time = SAMPLE * np.arange(1, round(duration / SAMPLE) + 1)
    angles, positions = [], []
    for now in time:
        wish = 0.5 + 0.8 * np.sin(2 * np.pi * frequency * now) * min(now, 1.0)
        hands.goals = np.full_like(hands.positions, ratio * wish)
        hands._period(round(SAMPLE / STEP))
        angles.append(hands.angles[0].copy())
        positions.append(hands.positions[0].copy())
    return true_rig(hands.d), Motion(time, np.array(angles), np.array(positions))


def true_rig(d: Drawn) -> Rig:
    """Return the rig of a drawn hand of one joint."""
    weight, arm, axle = float(d.weight[0, 0]), float(d.arms[0, 0, 0]), d.axle[0, 0]
    values: dict[str, object] = {
        "joints.0.stops": [d.low[0, 0], d.high[0, 0]],
        "joints.0.spring": {"stiffness": d.spring[0, 0], "rest_angle": d.rest[0, 0]},
        "joints.0.gravity": {
            "mass": abs(weight) / 9.80665,
            "distance": 1.0,
            "hanging_angle": 0.0 if weight > 0 else np.pi,
        },
        "joints.0.friction": {
            "coefficient": axle,
            "radius": arm,
            "preload": d.dry[0, 0] / (axle * arm),
        },
        "tendons.*.insertion.radius": arm,
        "drives.0.radius": d.spools[0, 0, 0],
    }
    for t, (slack, stiffness) in enumerate(zip(d.slack[0].tolist(), d.stiffness[0].tolist())):
        loose = ("slack", slack) if slack > 0 else ("pretension", -slack * stiffness)
        values |= {
            f"tendons.{t}.{loose[0]}": loose[1],
            f"tendons.{t}.stiffness": stiffness,
            f"tendons.{t}.path.friction": d.sheath[0, t],
        }
    return load_rig(Path(__file__).with_name("servo_joint.toml")).with_values(values)
