"""Tendon-driven chains simulated by MuJoCo: three fingers and a surgical wrist, with drawn plants,
sensors and motions.

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
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Row = tuple[float, ...]
Rows = tuple[Row, ...]
Commands = tuple[Floats, Floats, tuple[float, float]]

# steps of the simulation [s], a sample of the log every so many of them, and steps before the log
# begins
STEP, EVERY, SAMPLES, SETTLING = 1e-4, 50, 2400, 10000
# one count of a motor's encoder [rad], and the lag with which a step is commanded [s]
COUNT, LAG = 2 * np.pi / 4096, 0.03
KINDS = ("servo", "step", "contact")


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


def smooth_step(at: Floats) -> Floats:
    """Return a curve that goes from 0 to 1 as its argument does, level at both ends."""
    inside = np.clip(at, 0.0, 1.0)
    return inside**2 * (3 - 2 * inside)


def draw_wave(rng: np.random.Generator, times: Floats, fastest: float) -> Floats:
    """Return a sum of two to four sinusoids that starts at rest at 0 and spans 1 from peak to
    peak.
    """
    count = int(rng.integers(2, 5))
    rates, weights = rng.uniform(0.1, fastest, count), rng.uniform(0.4, 1.0, count)
    phases = rng.uniform(0, 2 * np.pi, count)
    wave = np.sin(2 * np.pi * np.outer(times, rates) + phases) @ weights
    wave = (wave - wave[0]) * smooth_step(times / 0.25)
    return np.asarray(wave / np.ptp(wave))


def draw_holds(
    rng: np.random.Generator, times: Floats, start: Floats, low: Floats, high: Floats
) -> Floats:
    """Return values (k, n) that step between drawn levels, held for 0.4 to 1.2 s and reached with a
    lag of 30 ms.
    """
    values = np.tile(start, (len(times), 1))
    at = float(rng.uniform(0.4, 1.2))
    while at < times[-1]:
        first = int(np.searchsorted(times, at))
        level = rng.uniform(low, high)
        remaining = np.exp(-(times[first:] - at) / LAG)[:, np.newaxis]
        values[first:] = level + (values[first] - level) * remaining
        at += float(rng.uniform(0.4, 1.2))
    return values


def draw_wish(
    plant: Plant, kind: str, start: Floats, load: Floats, rng: np.random.Generator, times: Floats
) -> tuple[Floats, Floats]:
    """Return the angles wanted (k, n) and the tensions wanted with them (k, m) from a start with
    its load on the joints.
    """
    arms = np.array(plant.arms)
    least, greatest = plant.sweeps_degrees[kind]
    fastest = 1.0 if kind == "servo" else 0.5
    if len(arms) == 1:
        # one flexor against springs: its tension sets the posture
        compliance = arms[0] / np.array([joint.spring for joint in plant.joints])
        first = max(float(arms[0] @ load / (arms[0] @ arms[0])), 1.5)
        if kind == "step":
            ends = first + np.radians([[least], [greatest]]) / compliance[0]
            tensions = draw_holds(rng, times, np.array([first]), np.maximum(ends[0], 1.5), ends[1])
        else:
            wave = draw_wave(rng, times, fastest)
            closing = (wave - wave.min() * smooth_step(times / 0.8))[:, np.newaxis]
            tensions = np.maximum(
                first + closing * np.radians(rng.uniform(least, greatest)) / compliance[0], 1.5
            )
        return start + (tensions - first) * compliance, tensions
    # tensions that turn no joint: equal ones, less what would turn them
    ones = np.ones(len(arms))
    balance = ones - arms @ (np.linalg.pinv(arms) @ ones)
    pull = rng.uniform(6.0, 8.5)
    shares = np.ones(len(start))
    shares[2:] = 0.7
    if kind == "step":
        middle = np.radians([joint.init_degrees for joint in plant.joints])
        low = np.append(middle + shares * np.radians(least), 4.5)
        high = np.append(middle + shares * np.radians(greatest), 10.5)
        held = draw_holds(rng, times, np.append(start, pull), low, high)
        return held[:, :-1], held[:, -1:] * balance / balance.mean()
    angles = np.empty((len(times), len(start)))
    for j, joint in enumerate(plant.joints):
        wave = shares[j] * np.radians(rng.uniform(least, greatest)) * draw_wave(rng, times, fastest)
        low, high = np.radians(joint.stops_degrees) + np.radians([3.0, -3.0])
        ways = (start[j] + wave, start[j] - wave)
        angles[:, j] = np.clip(
            min(ways, key=lambda way: float(np.abs(way - np.clip(way, low, high)).sum())), low, high
        )
    return angles, np.tile(pull * balance / balance.mean(), (len(times), 1))


def draw_torques(plant: Plant, rng: np.random.Generator, times: Floats) -> Floats:
    """Return torques (k, n) that nobody measures, on one joint at a time for 0.6 to 1.6 s, with
    onsets of 20 to 50 ms.
    """
    torques = np.zeros((len(times), len(plant.joints)))
    at = float(rng.uniform(0.6, 1.5))
    while at < times[-1]:
        joint, length, onset = (
            int(rng.integers(len(plant.joints))),
            rng.uniform(0.6, 1.6),
            rng.uniform(0.02, 0.05),
        )
        share = 0.6 if joint == len(plant.joints) - 1 else 1.0
        size = share * plant.torque * rng.uniform(0.4, 1.0) * rng.choice((-1.0, 1.0))
        torques[:, joint] += (
            size * smooth_step((times - at) / onset) * smooth_step((at + length - times) / onset)
        )
        at += float(length + rng.uniform(0.4, 1.4))
    return torques


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


def sense(
    plant: Plant, drives: Floats, efforts: Floats, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """Return what the sensors of the drives' places and efforts (k, d) read."""
    if plant.drives.kind == "motor":
        return COUNT * np.round(drives / COUNT), efforts + rng.normal(0.0, 1.2e-3, efforts.shape)
    read = drives + rng.normal(0.0, 5e-6, drives.shape)
    for d in range(drives.shape[1]):
        # linearity: waves of 40, 20 and 10 mm, within 0.1 mm over the 20 mm around the motion
        waves, weights = (
            2 * np.pi / np.array([0.04, 0.02, 0.01]),
            rng.uniform(0.3, 1.0, 3) / np.array([1.0, 1.5, 3.0]),
        )
        phases, middle = rng.uniform(0, 2 * np.pi, 3), (drives[:, d].min() + drives[:, d].max()) / 2
        travel = np.linspace(middle - 0.01, middle + 0.01, 201)
        height = np.abs(np.sin(np.outer(travel, waves) + phases) @ weights).max()
        curve = np.sin(np.outer(drives[:, d], waves) + phases) @ weights
        read[:, d] += 1e-4 * rng.uniform(0.4, 1.0) * curve / height
    return read, efforts + rng.normal(0.0, 0.2, efforts.shape)


def hung_load(
    plant: Plant, rng: np.random.Generator, times: Floats, start: float, end: float
) -> Floats:
    """Return torques (k, n) of a load on one drawn joint from `start` to `end` [s], half to all of
    the greatest.
    """
    torques, joint = np.zeros((len(times), len(plant.joints))), int(rng.integers(len(plant.joints)))
    share = 0.6 if joint == len(plant.joints) - 1 else 1.0
    size = share * plant.torque * rng.uniform(0.5, 1.0) * rng.choice((-1.0, 1.0))
    torques[:, joint] = (
        size * smooth_step((times - start) / 0.03) * smooth_step((end - times) / 0.03 + 1.0)
    )
    return torques


def make_log(
    plant: str,
    kind: str,
    seed: int,
    samples: int = SAMPLES,
    hung: tuple[float, float] | None = None,
    instrument: int | None = None,
) -> tuple[dict[str, Floats], dict[str, Floats]]:
    """Return the columns of a log and those of its truth, of a plant and a motion that the seed
    draws.

    A log has so many samples; something is `hung` on one joint from its first to its second time
    [s]. Logs of the same `instrument` have the same plant; else each seed has its own.
    """
    of = PLANTS[plant]
    rng = np.random.default_rng([seed, list(PLANTS).index(plant), KINDS.index(kind)])
    n = len(of.joints)
    truth = draw_truth(of, rng if instrument is None else np.random.default_rng(instrument))
    model = build_model(of, truth.springs)
    start = np.radians([joint.init_degrees + rng.normal(0.0, 3.0) for joint in of.joints])
    times = np.asarray(np.arange((samples - 1) * EVERY + 1) * STEP, dtype=np.float64)
    data = mujoco.MjData(model)
    data.qpos[:n] = start
    mujoco.mj_forward(model, data)
    load = (data.qfrc_bias - data.qfrc_passive)[:n]
    angles, tensions = draw_wish(of, kind, start, load, rng, times)
    winding = np.array(of.drives.winding)
    positions = (angles @ np.array(of.arms).T + tensions / of.stiffness) @ np.linalg.pinv(winding).T
    # steps of a flexor are steps of its motor's torque
    gains = (0.0, 0.0) if kind == "step" and len(of.arms) == 1 else of.gains
    torques = draw_torques(of, rng, times) if kind == "contact" else np.zeros((len(times), n))
    if hung is not None:
        torques += hung_load(of, np.random.default_rng([seed, 1]), times, *hung)
    states, efforts = simulate(
        of, truth, model, data, (positions, tensions @ winding, gains), torques
    )
    read, measured = sense(of, states[:, n:], efforts, rng)
    at = times[::EVERY]
    position, effort = ("x", "F") if of.drives.kind == "slider" else ("phi", "tau")
    log = {"time": at}
    log |= {f"{position}_{name}": read[:, d] for d, name in enumerate(of.drives.names)}
    log |= {f"{effort}_{name}": measured[:, d] for d, name in enumerate(of.drives.names)}
    true = {"t": at} | {f"theta_{joint.name}": states[:, j] for j, joint in enumerate(of.joints)}
    if kind == "contact":
        true |= {
            f"external_torque_{joint.name}": torques[::EVERY, j]
            for j, joint in enumerate(of.joints)
        }
    return log, true
