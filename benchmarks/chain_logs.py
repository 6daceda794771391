"""Logs of the chains in `tests/support/chain_plants`: drawn motions, torques and sensors."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray
from tests.support.chain_plants import (
    EVERY,
    PLANTS,
    STEP,
    Plant,
    build_model,
    draw_truth,
    simulate,
)

Floats = NDArray[np.float64]

SAMPLES = 2400
"""Of a log."""
COUNT, LAG = 2 * np.pi / 4096, 0.03
"""One count of a motor's encoder [rad], and the lag with which a step is commanded [s]."""
KINDS = ("servo", "step", "contact")


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
