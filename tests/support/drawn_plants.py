"""Plants for rigs that nobody built, in NumPy, several of one layout at once; no code of
`distal.model` is shared.

A plant has all numbers of a raw rig description, each once and for good. Its drives are moved by
stiff servos, so that their places are given; tendons stretch, joints rub. Without inertia each
joint moves only as far as balance but for friction asks (`at_rest`); with it, steps of 0.2 ms whose
friction is implicit, so that what sticks stays (`moving`). `told` asks by finite differences what
the noise of the sensors leaves of each number: Fisher's information.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from distal.arrays import Floats
from tests.support.drawn_rigs import RATE, Raw, parameters, settled, spread, units

Parameters = dict[str, Floats]
"""The arrays of plants; the first axis is that of the plants, then joints j, tendons t or drives d.
"""

DURATION = 12.0
"""Of a log [s]."""
STEP, PARTS = 2e-4, 4
"""Time step with inertia [s]; parts of an interval without."""
GRAVITY = 9.80665
PRESLIDING = 1e-5
"""Way of a tendon's end over which the drive's friction turns round [m]."""

ALIKE = 0.1
"""Samples within this time count as one where it is asked what they tell [s]: errors of a model
last.
"""
EXACT = np.deg2rad(0.02)
"""No encoder counts as better than this [rad]."""
NUDGE = 0.1
"""Step of the finite differences, in stds of the prior: wider than the kinks of friction."""
CLEAR = 0.5
"""A number is told if its marginal std is below this share of that of its prior."""


def parameters_of(raw: Raw, values: Mapping[str, float]) -> Parameters:
    """Return the arrays of one plant."""
    rig = settled(raw, values)
    joints, drives, tendons = rig["joints"], rig["drives"], rig["tendons"]
    names = [joint["name"] for joint in joints]
    arms, levers = np.zeros((len(tendons), len(joints))), np.zeros((len(tendons), len(drives)))
    for i, tendon in enumerate(tendons):
        crossings = (
            tendon["crossings"] if "crossings" in tendon else [{**tendon, **tendon["insertion"]}]
        )
        for crossing in crossings:
            arms[i, names.index(crossing["joint"])] += crossing["side"] * crossing["radius"]
        d = next(k for k, drive in enumerate(drives) if drive["name"] == tendon["drive"])
        levers[i, d] = (
            crossings[0]["side"] * drives[d]["radius"] if drives[d]["kind"] == "capstan" else 1.0
        )
    positions, efforts = (
        [one for one in rig["sensors"] if one["measures"] == kind] for kind in ("position", "force")
    )
    stiffness = np.array([tendon["stiffness"] for tendon in tendons])
    # the servos hold what their sensors read, so an offset moves the drive
    taut = np.array([one.get("pretension", 0.0) for one in tendons]) / stiffness
    taut -= np.array([one.get("slack", 0.0) for one in tendons]) + levers @ [
        one.get("bias", 0.0) for one in positions
    ]
    paths = [one.get("path", {"friction": 0.0, "wrap": 0.0}) for one in tendons]
    axles = [one.get("friction", {"coefficient": 0.0, "radius": 1.0}) for one in joints]
    grip = np.array([one["coefficient"] * one["radius"] for one in axles])
    springs = [one.get("spring", {"stiffness": 0.0}) for one in joints]
    weights = [one.get("gravity", {"mass": 0.0, "distance": 0.0}) for one in joints]
    lever = np.abs(levers).max(axis=0)
    rubbing = [one.get("friction", {}) for one in drives]
    ends = np.array([one.get("stops", (-np.inf, np.inf)) for one in joints])
    return {
        "arms": arms,
        "levers": levers,
        "crosses": (arms != 0.0).astype(float),
        "stiffness": stiffness,
        "taut": taut,
        "wrapped": np.array([one["friction"] * one["wrap"] for one in paths]),
        "grip": grip,
        "axle": grip * [one.get("preload", 0.0) for one in axles],
        "spring": np.array([one["stiffness"] for one in springs]),
        "rest": np.array([one.get("rest_angle", 0.0) for one in springs]),
        "weight": np.array([one["mass"] * GRAVITY * one["distance"] for one in weights]),
        "hanging": np.array([one.get("hanging_angle", 0.0) for one in weights]),
        "inertia": np.array([one["inertia"] for one in joints]),
        "damping": np.array([one["damping"] for one in joints]),
        "low": ends[:, 0],
        "high": ends[:, 1],
        "constant": np.array([one.get("constant", 0.0) for one in rubbing]),
        "load": lever * [one.get("load", 0.0) for one in rubbing],
        "viscous": np.array([one.get("damping", 0.0) for one in drives]),
        "mass": np.array(
            [one["mass"] if one["kind"] == "slider" else one["inertia"] for one in drives]
        ),
        "gain": np.array([one.get("gain", 1.0) for one in efforts]),
        "bias": np.array([one.get("bias", 0.0) for one in efforts]),
    }


def soft(value: Floats, limit: Floats) -> Floats:
    """Return what friction leaves of a load."""
    return value - np.minimum(np.maximum(value, -limit), limit)


def loads(p: Parameters, ends: Floats, angles: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Return torques (b, j), limits of friction (b, j), stretches and tensions (b, t); `ends` are
    places of tendons.
    """
    stretch = p["taut"] + ends - np.einsum("btj,bj->bt", p["arms"], angles)
    tension = p["stiffness"] * np.maximum(stretch, 0.0)
    torque = np.einsum("btj,bt->bj", p["arms"], tension) - p["spring"] * (angles - p["rest"])
    if p["heavy"]:
        torque -= p["weight"] * np.sin(angles - p["hanging"])
    return (
        torque,
        p["axle"] + p["grip"] * np.einsum("btj,bt->bj", p["crosses"], tension),
        stretch,
        tension,
    )


def balanced(p: Parameters, ends: Floats, angles: Floats, rubbing: float = 1.0) -> Floats:
    """Return where joints come to rest, (b, j): each stays unless more than friction turns it;
    Newton from kink to kink.
    """
    for _ in range(60):
        torque, limit, stretch, _ = loads(p, ends, angles)
        left = soft(torque, rubbing * limit)
        left = np.where(
            (left > 0.0) & (angles >= p["high"]) | (left < 0.0) & (angles <= p["low"]), 0.0, left
        )
        if np.all(np.abs(left) < 1e-7 * p["stiff"]):
            return angles
        pulled = p["stiffness"][:, :, None] * (stretch > 0.0)[:, :, None] * p["arms"]
        toward = p["arms"] - (rubbing * np.sign(left) * p["grip"])[:, None, :] * p["crosses"]
        slope = np.einsum("bti,btj->bij", toward, pulled)
        own = (
            p["spring"]
            + p["weight"] * np.maximum(np.cos(angles - p["hanging"]), 0.0)
            + 1e-6 * p["stiff"]
        )
        slope[:, p["each"], p["each"]] += own
        free = left != 0.0
        for _ in range(2):
            # what sticks has its own row; what the others would turn back sticks too
            both = free[:, :, None] & free[:, None, :]
            asked = np.where(free, left, 0.0)[:, :, None]
            turn = np.linalg.solve(np.where(both, slope, np.eye(len(p["each"]))), asked)[:, :, 0]
            back = free & (turn * left < 0.0)
            if not back.any():
                break
            free &= ~back
        # no further than to where a slack tendon is taut
        moved = np.einsum("btj,bj->bt", p["arms"], turn)
        caught = (stretch <= 0.0) & (stretch - moved > 0.0)
        part = np.where(caught, stretch / np.where(caught, moved, 1.0) + 1e-6, 1.0).min(
            axis=1, keepdims=True
        )
        angles = np.clip(angles + np.minimum(part, 1.0) * turn, p["low"], p["high"])
    raise ArithmeticError("a plant does not come to rest")


def prepared(p: Parameters) -> Parameters:
    """Return the arrays with what the loops need beside them."""
    stiff = np.einsum("bt,btj->bj", p["stiffness"], p["arms"] ** 2) + p["spring"]
    return {
        **p,
        "stiff": stiff,
        "heavy": np.any(p["weight"] != 0.0),
        "each": np.arange(p["arms"].shape[2]),
    }


def at_rest(p: Parameters, ends: Floats, logs: NDArray[np.intp]) -> tuple[Floats, Floats]:
    """Return angles (k, b, j) and tensions (k, b, t) without inertia; `ends` of tendons are (PARTS
    k, logs, t).
    """
    p = prepared(p)
    angles = balanced(p, ends[0][logs], np.zeros_like(p["axle"]), 0.0)
    turned, pulls = [], []
    for k in range(len(ends)):
        angles = balanced(p, ends[k][logs], angles)
        if k % PARTS == 0:
            turned.append(angles)
            pulls.append(loads(p, ends[k][logs], angles)[3])
    return np.array(turned), np.array(pulls)


def moving(p: Parameters, ends: Floats, logs: NDArray[np.intp]) -> tuple[Floats, Floats]:
    """Return angles (k, b, j) and tensions (k, b, t) with inertia; `ends` of tendons are (steps,
    logs, t).
    """
    p, every = prepared(p), round(1.0 / RATE / STEP)
    angles = balanced(p, ends[0][logs], np.zeros_like(p["axle"]), 0.0)
    speeds, kick = np.zeros_like(angles), p["inertia"] / STEP
    drag, stops = 1.0 / (kick + p["damping"]), bool(np.isfinite(p["high"]).any())
    turned, pulls = [], []
    for k in range(len(ends)):
        torque, limit, _, tension = loads(p, ends[k][logs], angles)
        if k % every == 0:
            turned.append(angles)
            pulls.append(tension)
        speeds = soft(kick * speeds + torque, limit) * drag
        angles = angles + STEP * speeds
        if stops:
            held = np.clip(angles, p["low"], p["high"])
            speeds, angles = np.where(held == angles, speeds, 0.0), held
    return np.array(turned), np.array(pulls)


def efforts(p: Parameters, positions: Floats, tensions: Floats) -> Floats:
    """Return what force and torque sensors read without noise, (k, b, d), of places (k, b, d) and
    tensions (k, b, t).
    """
    levers = p["levers"][0]
    lever = np.abs(levers).max(axis=0)
    sense = np.zeros_like(positions)
    for k in range(1, len(positions)):
        sense[k] = np.clip(
            sense[k - 1] + 2.0 * lever * (positions[k] - positions[k - 1]) / PRESLIDING, -1.0, 1.0
        )
    limit = p["constant"] + p["load"] * (tensions @ (levers != 0.0))
    drawn_in, let_out = tensions * np.expm1(p["wrapped"]), -tensions * np.expm1(-p["wrapped"])
    for d in range(levers.shape[1]):
        for t in np.flatnonzero(levers[:, d]):
            inwards = sense[:, :, d] * np.sign(levers[t, d]) > 0.0
            limit[:, :, d] += lever[d] * np.where(inwards, drawn_in[:, :, t], let_out[:, :, t])
    speeds = np.gradient(positions, 1.0 / RATE, axis=0)
    moved = p["viscous"] * speeds + p["mass"] * np.gradient(speeds, 1.0 / RATE, axis=0)
    return p["gain"] * (tensions @ levers + sense * limit + moved) + p["bias"]


def simulated(
    raw: Raw,
    plants: Sequence[Mapping[str, float]],
    of: Sequence[Sequence[int]],
    positions: Floats,
    inert: bool,
) -> list[list[tuple[Floats, Floats]]]:
    """Return angles (k, j) and efforts (k, d) of each plant on each of its logs.

    Args:
        raw: the description.
        plants: true numbers by path, of each plant.
        of: which logs each of them runs.
        places: of the drives, (steps, logs, d): `STEP` apart with inertia, else `PARTS` in an
            interval.
        inert: whether joints have inertia and damping.
    """
    made = [parameters_of(raw, plant) for plant in plants]
    rows = [one for one, own in zip(made, of) for _ in own]
    p = {name: np.stack([one[name] for one in rows]) for name in made[0]}
    logs = np.array([log for own in of for log in own])
    ends = positions @ made[0]["levers"].T
    angles, tensions = (moving if inert else at_rest)(p, ends, logs)
    if not inert:
        p["mass"] = 0.0 * p["mass"]
    every = round(1.0 / RATE / STEP) if inert else PARTS
    read = efforts(p, positions[::every][:, logs], tensions)
    each = iter(range(len(logs)))
    return [[(angles[:, row], read[:, row]) for _, row in zip(own, each)] for own in of]


def nudged(raw: Raw, truth: Mapping[str, float]) -> list[dict[str, float]]:
    """Return the true numbers with each unit a little higher, and a little lower, in turn."""
    known = parameters(raw)
    steps = [{path: NUDGE * spread(known[path]) for path in paths} for paths in units(raw).values()]
    return [
        {**truth, **{k: truth[k] + sign * v for k, v in step.items()}}
        for step in steps
        for sign in (1, -1)
    ]


def identified(
    raw: Raw, nudged_runs: Sequence[Sequence[tuple[Floats, Floats]]]
) -> dict[str, float]:
    """Return what logs leave of each unit's std, as a share of that of its prior, by the path of
    its first number.

    Forces err by their sensor and by what the noise of places does to tensions, encoders by theirs
    and by an offset.
    """
    p = parameters_of(raw, {})
    positions, forces, encoders = (
        [one for one in raw["sensors"] if one["measures"] == kind]
        for kind in ("position", "force", "angle")
    )
    rough = [
        np.hypot(one["noise"], one.get("resolution", 0.0) / np.sqrt(12.0)) for one in positions
    ]
    shaken = (p["stiffness"] @ p["levers"] ** 2) * rough
    angle = np.maximum([one["noise"] for one in encoders], EXACT)
    whole = np.concatenate([angle, np.hypot([one["noise"] for one in forces], shaken)])
    share = np.sqrt(1.0 / (RATE * ALIKE)) / whole
    columns = [
        np.concatenate(
            [
                ((np.hstack(a) - np.hstack(b)) * share / (2.0 * NUDGE)).ravel()
                for a, b in zip(up, down)
            ]
        )
        for up, down in zip(nudged_runs[::2], nudged_runs[1::2])
    ]
    samples = len(columns[0]) // len(whole)
    for j, encoder in enumerate(encoders):
        offset = np.zeros(len(whole))
        offset[j] = encoder["bias"]["std"] * share[j]
        columns.append(np.tile(offset, samples))
    slopes = np.array(columns)
    left = np.sqrt(np.diag(np.linalg.inv(slopes @ slopes.T + np.eye(len(slopes)))))
    return {path: float(value) for path, value in zip(units(raw), left)}


def ramps(
    rng: np.random.Generator, reach: float, speed: float, rate: float, pressed: float = 0.0
) -> Floats:
    """Return ramps between random places with rests, smoothed over 0.2 s, that begin at 0; [rad] at
    `rate`.

    Args:
        rng: of the motion.
        reach: to both sides [rad].
        speed: factor on the speeds of 0.25 to 1.2 rad/s.
        rate: of the samples [Hz].
        pressed: where drives go on to while a joint stands in a stop, a third of the time [rad]; 0
            for never.
    """
    count, length = round(DURATION * rate), round(0.2 * rate)
    positions, spent = [0.0] * (2 * length), 0
    while len(positions) < count + length:
        press = pressed > 0.0 and spent < 0.27 * len(positions)  # the way there counts too
        aim = rng.choice([-1.0, 1.0]) * pressed if press else rng.uniform(-reach, reach)
        steps = max(2, round(abs(aim - positions[-1]) / (speed * rng.uniform(0.25, 1.2)) * rate))
        rests = round((rng.uniform(0.8, 1.8) if press else rng.uniform(0.15, 0.8)) * rate)
        positions += [*np.linspace(positions[-1], aim, steps)[1:], *([aim] * rests)]
        spent += rests if press else 0
    kernel = np.hanning(length + 1)
    smooth: Floats = np.convolve(positions, kernel / kernel.sum(), mode="valid")[:count]
    return smooth
