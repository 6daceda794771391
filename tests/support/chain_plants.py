"""Tendon-driven chains simulated by MuJoCo: three fingers and a surgical wrist, drawn plants.

The tendons and all friction are worked out here from the equations below; MuJoCo integrates the
links and the drives, each drive a body of its own, and solves the dry friction with its stick and
slip.

    stretch_i = pretension_i / k_i + sum_d E_id s_d - sum_j r_ij theta_j,    T_i = k_i
    max(stretch_i, 0) limit of the friction in joint j: f0_j + mur_j * (sum of T_i over the tendons
    that cross it) limit of the friction in drive d: dc + mus * sum_i |E_id| T_i

Lengths are in metres, angles in radians unless a name says degrees, everything else in SI units
too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import mujoco
import numpy as np

from distal.arrays import Floats

Row = tuple[float, ...]
Rows = tuple[Row, ...]
Commands = tuple[Floats, Floats, tuple[float, float]]

# steps of the simulation [s], a sample of the log every so many of them, and steps before the log
# begins
STEP, EVERY, SETTLING = 1e-4, 50, 10000


class Joint(NamedTuple):
    """One joint and its link."""

    name: str
    axis: str
    length: float
    mass: float
    damping: float
    armature: float
    stops_degrees: tuple[float, float]
    init_degrees: float
    friction_constant: float
    """f0 [N m]"""
    friction_radius: float
    """mur [m]"""
    spring: float = 0.0
    rest_degrees: float = 0.0


class Drives(NamedTuple):
    """The drives of a chain."""

    kind: Literal["slider", "motor"]
    names: tuple[str, ...]
    winding: Rows
    """E, a row for each tendon [1 or m/rad]"""
    inertia: float
    damping: float
    friction_constant: float
    """dc [N or N m]"""
    friction_share: float
    """mus"""


@dataclass(frozen=True)
class Plant:
    """The nominal numbers of one chain, what its user knows, and the size of its motions."""

    joints: tuple[Joint, ...]
    stiffness: float
    pretensions: Row
    arms: Rows
    drives: Drives
    gains: tuple[float, float]
    """of the position controllers: effort per place and per speed of the drive"""
    sweeps_degrees: dict[str, tuple[float, float]]
    """least and greatest motion wanted of a joint (with one flexor: of the first), from peak to
    peak; for `step` the ends of the levels, from `init_degrees`; the last of three joints with
    tendons of their own moves 70 % of that
    """
    torque: float
    """the greatest unmeasured torque on a joint but the last, which gets 60 % of it"""


def _pairs(arms: Rows) -> Rows:
    """Return rows and their opposites in turn: antagonistic tendons."""
    return tuple(tuple(sign * value for value in row) for row in arms for sign in (1.0, -1.0))


def _single(count: int, value: float = 1.0) -> Rows:
    """Return the rows of drives that each pull one tendon, or one pair after `_pairs`."""
    return tuple(tuple(value * (i == d) for d in range(count)) for i in range(count))


PLANTS: dict[str, Plant] = {
    "finger2N": Plant(
        joints=(
            Joint("mcp", "y", 0.045, 0.015, 0.001, 2e-6, (-20, 90), 20, 0.002, 0.6e-3),
            Joint("pip", "y", 0.045, 0.013, 0.0008, 1e-6, (-5, 100), 25, 0.0015, 0.6e-3),
        ),
        stiffness=2500.0,
        pretensions=(0.0,) * 4,
        arms=_pairs(((0.008, 0.0), (0.007, 0.006))),
        drives=Drives(
            "slider", ("mcp_f", "mcp_e", "pip_f", "pip_e"), _single(4), 0.02, 4.0, 0.1, 0.1
        ),
        gains=(3000.0, 6.0),
        sweeps_degrees={"servo": (45, 65), "step": (-55, 45), "contact": (35, 58)},
        torque=0.07,
    ),
    "finger_n1": Plant(
        joints=(
            Joint("mcp", "y", 0.045, 0.015, 0.001, 2e-6, (-20, 90), 20, 0.002, 0.6e-3),
            Joint("pip", "y", 0.025, 0.008, 0.0008, 1e-6, (-5, 100), 25, 0.0015, 0.5e-3),
            Joint("dip", "y", 0.020, 0.005, 0.0005, 1e-6, (-5, 80), 15, 0.001, 0.5e-3),
        ),
        stiffness=10000.0,
        pretensions=(0.0,) * 4,
        arms=(
            (0.008, 0.007, 0.006),
            (0.0075, -0.0065, -0.0055),
            (-0.008, 0.007, 0.0),
            (-0.0075, -0.007, 0.0),
        ),
        drives=Drives("slider", ("t1", "t2", "t3", "t4"), _single(4), 0.02, 4.0, 0.1, 0.05),
        gains=(3000.0, 6.0),
        sweeps_degrees={"servo": (35, 55), "step": (-34, 30), "contact": (30, 50)},
        torque=0.07,
    ),
    "finger_under": Plant(
        joints=(
            Joint("mcp", "y", 0.045, 0.015, 0.001, 2e-6, (-20, 95), 3, 0.001, 0.3e-3, 0.15, -10),
            Joint("pip", "y", 0.025, 0.008, 0.0008, 1e-6, (-20, 100), 1, 0.001, 0.3e-3, 0.12, -10),
            Joint("dip", "y", 0.020, 0.005, 0.0005, 1e-6, (-20, 85), -1, 0.001, 0.3e-3, 0.1, -10),
        ),
        stiffness=8000.0,
        pretensions=(0.0,),
        arms=((0.009, 0.007, 0.005),),
        drives=Drives("motor", ("flexor",), ((0.006,),), 5e-6, 0.002, 0.001, 0.05),
        gains=(2.0, 0.002),
        sweeps_degrees={"servo": (36, 50), "step": (-8, 56), "contact": (34, 50)},
        torque=0.05,
    ),
    "wrist_instrument": Plant(
        joints=(
            Joint("pitch", "y", 0.009, 0.003, 0.0005, 1e-6, (-80, 80), 0, 0.001, 0.35e-3),
            Joint("yaw", "z", 0.010, 0.002, 0.0004, 1e-6, (-80, 80), 0, 0.001, 0.35e-3),
            Joint("jaw", "z", 0.010, 0.001, 0.0003, 1e-6, (-80, 80), 0, 0.0005, 0.35e-3),
        ),
        stiffness=18000.0,
        pretensions=(8.0,) * 6,
        arms=_pairs(((0.005, 0.0, 0.0), (0.0035, 0.0045, 0.0), (0.0035, 0.0032, 0.0045))),
        drives=Drives(
            "motor", ("pitch", "yaw", "jaw"), _pairs(_single(3, 0.006)), 5e-6, 0.001, 0.002, 0.05
        ),
        gains=(2.0, 0.002),
        sweeps_degrees={"servo": (75, 120), "step": (-46, 46), "contact": (25, 60)},
        torque=0.035,
    ),
}

SHIPPED = {
    "finger-2n": ("finger2N", "0.04 N m"),
    "finger-n-plus-1": ("finger_n1", "0.04 N m"),
    "finger-underactuated": ("finger_under", "0.03 N m"),
    "wrist-instrument": ("wrist_instrument", "0.02 N m"),
}
"""Shipped rig → name of the plant, and the torque that a user says may occur in a contact."""


class Truth(NamedTuple):
    """The numbers of a plant as drawn within what its user leaves open."""

    stiffness: Floats
    arms: Floats
    springs: Floats
    joint_friction: Floats
    """a factor for each joint"""
    drive_friction: Floats
    """a factor for each drive"""


def draw_truth(plant: Plant, rng: np.random.Generator) -> Truth:
    """Return one true plant, uniform in friction, stiffness, moment arms and springs."""
    arms, springs = np.array(plant.arms), np.array([joint.spring for joint in plant.joints])
    common = 1 + 0.1 * rng.uniform(-1, 1)
    return Truth(
        stiffness=plant.stiffness * common * (1 + 0.01 * rng.uniform(-1, 1, len(arms))),
        arms=arms * (1 + 0.02 * rng.uniform(-1, 1, arms.shape)),
        springs=springs * (1 + 0.05 * rng.uniform(-1, 1, springs.shape)),
        joint_friction=1 + 0.2 * rng.uniform(-1, 1, len(plant.joints)),
        drive_friction=1 + 0.2 * rng.uniform(-1, 1, len(plant.drives.names)),
    )


def build_model(plant: Plant, springs: Floats) -> mujoco.MjModel:
    """Return the links, thin rods along x, and one body for each drive, with friction limits that
    are set at each step.
    """
    dry = 'frictionloss="1" solreffriction="0.0002 1" solimpfriction="0.9999 0.9999 0.001"'
    chain, ends, base = "", "", 0.0
    for joint, spring in zip(plant.joints, springs):
        low, high = np.radians(joint.stops_degrees)
        across = joint.mass * joint.length**2 / 12
        chain += (
            f'<body pos="{base} 0 0">'
            f'<inertial pos="{joint.length / 2} 0 0" mass="{joint.mass}" '
            f'diaginertia="{1e-3 * across} {across} {across}"/>'
            f'<joint type="hinge" axis="{"0 1 0" if joint.axis == "y" else "0 0 1"}" '
            f'damping="{joint.damping}"'
            f' armature="{joint.armature}" stiffness="{spring}" '
            f'springref="{np.radians(joint.rest_degrees)}" {dry}'
            f' range="{low} {high}" solreflimit="0.002 1" solimplimit="0.95 0.99 0.001"/>'
        )
        ends, base = ends + "</body>", joint.length
    size, way = plant.drives.inertia, "slide" if plant.drives.kind == "slider" else "hinge"
    drive = (
        f'<body><inertial pos="0 0 0" mass="{size}" diaginertia="{size} {size} {size}"/>'
        f'<joint type="{way}" axis="1 0 0" damping="{plant.drives.damping}" {dry}/></body>'
    )
    return mujoco.MjModel.from_xml_string(
        '<mujoco><compiler angle="radian" autolimits="true"/>'
        f'<option timestep="{STEP}" integrator="implicitfast" solver="Newton" iterations="50" '
        'tolerance="1e-12"'
        ' jacobian="dense"><flag contact="disable"/></option>'
        f"<worldbody>{chain}{ends}{drive * len(plant.drives.names)}</worldbody></mujoco>"
    )


def simulate(
    plant: Plant,
    truth: Truth,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    commands: Commands,
    torques: Floats,
) -> tuple[Floats, Floats]:
    """Return angles and drives (samples, n + d) and the drives' efforts (samples, d), begun at rest
    after a settling.

    The commands are places and efforts for the drives (k, d) and the gains that tie the drives to
    these places; `torques` (k, n) act on the joints besides.
    """
    n, winding = len(plant.joints), np.array(plant.drives.winding)
    stretching = np.hstack([-truth.arms, winding])
    loosening = -stretching.T.copy()
    slack = np.array(plant.pretensions) / truth.stiffness
    factors = np.append(truth.joint_friction, truth.drive_friction)
    drives = [plant.drives.friction_constant] * winding.shape[1]
    constant = factors * np.append([joint.friction_constant for joint in plant.joints], drives)
    per_joint = np.array([joint.friction_radius for joint in plant.joints]) * (truth.arms != 0)
    per_tension = (
        factors[:, np.newaxis]
        * np.hstack([per_joint, plant.drives.friction_share * np.abs(winding)]).T
    )
    goals, pulls, (gain, gain_damping) = commands
    data.qpos[n:] = goals[0]
    positions, speeds, forces, limits = (
        data.qpos,
        data.qvel,
        data.qfrc_applied,
        model.dof_frictionloss,
    )
    samples = (len(goals) - 1) // EVERY + 1
    states, efforts = np.empty((samples, len(positions))), np.empty((samples, winding.shape[1]))
    for k in range(-SETTLING, len(goals)):
        at = max(k, 0)
        tensions = truth.stiffness * np.maximum(stretching @ positions + slack, 0.0)
        effort = pulls[at] + gain * (goals[at] - positions[n:]) - gain_damping * speeds[n:]
        if k >= 0 and k % EVERY == 0:
            states[k // EVERY], efforts[k // EVERY] = positions, effort
        forces[:] = loosening @ tensions
        forces[:n] += torques[at]
        forces[n:] += effort
        limits[:] = constant + per_tension @ tensions
        mujoco.mj_step(model, data)
    return states, efforts
