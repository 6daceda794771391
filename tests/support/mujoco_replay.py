"""Motions in MuJoCo whose drives go where they went elsewhere; and a motion of a hand that shares
no code with distal, with the rig that has its true numbers.
"""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from distal import Rig
from distal.bridges.mujoco import Tendons, to_mjcf
from distal.rig import build_rig
from tests.support.servo_hands import STEP, Drawn, orca_like

Floats = NDArray[np.float64]

SAMPLE = 4 * STEP
"""Interval of the motion of a hand [s]."""


class Motion(NamedTuple):
    """A motion: times [s], (k,), angles of the joints [rad], (k, n_joints), and positions of the
    drives [m, rad], (k, n_drives).
    """

    time: Floats
    angles: Floats
    positions: Floats


def replayed(rig: Rig, motion: Motion, tendons: bool) -> Floats:
    """Return the angles [rad], (k, n_joints), to which the rig's model in MuJoCo turns its joints
    while its drives go through a motion; with `tendons` it is helped by `Tendons`.
    """
    model = mujoco.MjModel.from_xml_string(to_mjcf(rig))
    data = mujoco.MjData(model)
    joints = model.jnt_qposadr[[model.joint(name).id for name in rig.joint_names]]
    drives = [model.joint(f"drive_{name}").id for name in rig.drive_names]
    places, dofs = model.jnt_qposadr[drives], model.jnt_dofadr[drives]
    data.qpos[joints], data.qpos[places] = motion.angles[0], motion.positions[0]
    acting = Tendons(model, rig) if tendons else None
    angles = np.empty_like(motion.angles)
    before = motion.positions[0]
    for k, (interval, after) in enumerate(
        zip(np.diff(motion.time, prepend=motion.time[0]), motion.positions)
    ):
        steps = round(interval / model.opt.timestep)
        for step in range(steps):
            data.qvel[dofs] = (after - before) / interval
            if acting is not None:
                acting.apply(data)
            mujoco.mj_step(model, data)
            data.qpos[places] = before + (step + 1) / steps * (after - before)
        before = after
        angles[k] = data.qpos[joints]
    return angles


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
    weight, arm = float(d.weight[0, 0]), float(d.arms[0, 0, 0])
    joint = {
        "name": "mcp",
        "inertia": 1e-5,
        "damping": 1e-3,
        "stops": [d.low[0, 0], d.high[0, 0]],
        "stop_stiffness": 25.0,
        "stop_damping": 0.02,
        "spring": {"stiffness": d.spring[0, 0], "rest_angle": d.rest[0, 0]},
        "gravity": {
            "mass": abs(weight) / 9.80665,
            "distance": 1.0,
            "hanging_angle": 0.0 if weight > 0 else np.pi,
        },
        "friction": {
            "coefficient": d.axle[0, 0],
            "radius": arm,
            "preload": d.dry[0, 0] / (d.axle[0, 0] * arm),
        },
    }
    tendons = []
    for t, side in enumerate((1, -1)):
        slack, stiffness = float(d.slack[0, t]), float(d.stiffness[0, t])
        loose = {"slack": slack} if slack > 0 else {"pretension": -slack * stiffness}
        tendons.append(
            {
                "name": f"tendon{t}",
                "joint": "mcp",
                "drive": "motor",
                "side": side,
                "insertion": {"kind": "pulley", "radius": arm},
                "stiffness": stiffness,
                "path": {"friction": d.sheath[0, t], "wrap": 1.0, "nodes": 1},
                **loose,
            }
        )
    drive = {"name": "motor", "kind": "capstan", "radius": d.spools[0, 0, 0], "inertia": 2e-4}
    raw = {"name": "a hand", "joints": [joint], "drives": [drive], "tendons": tendons}
    return build_rig(raw, "hand")
