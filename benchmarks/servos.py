"""Commands for hobby servos, which give way under load: `python -m benchmarks.servos
[--first-seed N] [--hands N]`.

Joints of `tests.support.servo_hands` in sheaths, on servos with a P loop and a dead band, that give
way by 25 of 4096 counts under a usual load. Each hand is calibrated by its power-on routine, and
fitted from there to three logs with a reference and the goals that were sent. Then sines, ramps and
steps are commanded in an open loop and live. By hand: goals that are affine in the wanted angles,
and affine with their speed and direction, by least squares on the same logs.
"""

from __future__ import annotations

import argparse
import warnings
from typing import Any

import numpy as np
from tests.support.hands import Driven, calibrated, rig_of
from tests.support.servo_hands import PERIOD, Hands, Known, orca_like

from benchmarks.commands import desired_angles
from benchmarks.report import table
from distal import Inverse, LiveInverse, Log, Rig, fit
from distal.logs import FROM_SENSOR

JOINTS = ("index_mcp", "index_pip")
STIFFNESS, DAMPING, DEAD_BAND = 1.3, 0.05, 4 * 2 * np.pi / 4096
"""Of the servos [N m/rad, N m s/rad, rad]."""

ENCODER = np.deg2rad(0.1)
"""Step of the temporary encoders in the joints [rad]."""

GOES_THERE = 2.0
"""Time to the first angle [s]."""

KINDS = ("sine", "ramps", "steps")


def hands_of(seed: int) -> tuple[Known, Hands]:
    """Return one hand with such servos."""
    known, hands = orca_like([seed], JOINTS)
    hands.stiffness, hands.damping, hands.dead_band = STIFFNESS, DAMPING, DEAD_BAND
    hands.limits[:] = 0.4
    return known, hands


def angles_of(known: Known, seed: int, kind: str) -> Any:
    """Return wanted angles, (k, n) [rad], within the joints' ranges."""
    rng = np.random.default_rng([seed, 71])
    raw = desired_angles(kind, "finger-2n", len(known.joints), rng)
    share = (raw - np.deg2rad(5.0)) / np.deg2rad(45.0)
    low, high = known.low + 0.25, known.high - 0.25
    return low + (high - low) * np.clip(share, 0.0, 1.0)


def driven(known: Known, hands: Hands, goals: Any) -> dict[str, Any]:
    """Send goals [rad], as sensors read them, one after the other; first go to where they begin."""
    servo = Driven(hands)
    begin = hands.positions * 1.0 + hands.d.zeros * hands.d.signs
    count = round(GOES_THERE / PERIOD)
    for k in range(count):
        servo.read(begin + min(1.0, 1.2 * (k + 1) / count) * (goals[0] - begin))
    rows = {"positions": [], "torques": [], "angles": []}
    for goal in goals:
        positions, torques = servo.read(goal[None])
        for name, value in (
            ("positions", positions),
            ("torques", torques),
            ("angles", hands.angles),
        ):
            rows[name].append(value[0].copy())
    return {name: np.array(value) for name, value in rows.items()}


def log_of(known: Known, run: dict[str, Any], goals: Any, name: str) -> Log:
    """Return the log of a run, with a reference."""
    time = np.arange(len(goals)) * PERIOD
    channels = {f"{m}_position": run["positions"][:, i] for i, m in enumerate(known.motors)}
    channels |= {f"{m}_current": run["torques"][:, i] for i, m in enumerate(known.motors)}
    seen = ENCODER * np.round(run["angles"] / ENCODER)
    truth = {f"theta_{joint}": seen[:, j] for j, joint in enumerate(known.joints)}
    sent = {m: goals[:, i] for i, m in enumerate(known.motors)}
    return Log(time, channels, truth, name, FROM_SENSOR, goals=sent)


def by_hand(logs: list[Log], joint: int, features: Any, known: Known) -> Any:
    """Return coefficients of goals by least squares on features of the true angle."""
    truth, motor = f"theta_{known.joints[joint]}", known.motors[joint]
    matrix = np.vstack([features(log.truth[truth]) for log in logs])
    goals = np.concatenate([log.goals[motor] for log in logs])
    return np.linalg.lstsq(matrix, goals, rcond=None)[0]


def affine(angles: Any) -> Any:
    """Return 1 and the angle."""
    return np.column_stack([np.ones(len(angles)), angles])


def moving(angles: Any) -> Any:
    """Return 1, the angle, its speed and its direction."""
    speed = np.gradient(angles, PERIOD)
    return np.column_stack([affine(angles), speed, np.tanh(speed / 0.1)])


def live(known: Known, hands: Hands, rig: Rig, desired: Any) -> Any:
    """Return true angles, (k, n), with `LiveInverse` in the loop."""
    inverse, servo = LiveInverse(rig), Driven(hands)
    positions = hands.positions + hands.d.zeros * hands.d.signs
    torques, count, angles = np.zeros_like(positions), round(GOES_THERE / PERIOD), []
    names = [joint.name for joint in rig.joints]
    begin = hands.angles[0].copy()
    for k in range(count + len(desired)):
        sample = dict(zip([f"{m}_position" for m in known.motors], positions[0]))
        sample |= dict(zip([f"{m}_current" for m in known.motors], torques[0]))
        share = min(1.0, 1.2 * (k + 1) / count)
        now = desired[k - count] if k >= count else begin + share * (desired[0] - begin)
        values = np.array([sample[name] for name in inverse.channels])
        command = inverse.step(k * PERIOD, dict(zip(names, now.tolist())), values)
        goals = np.where(np.isfinite(command.positions), command.positions, positions[0])
        positions, torques = servo.read(goals[None])
        if k >= count:
            angles.append(hands.angles[0].copy())
    return np.array(angles)


def errors_of(seed: int) -> dict[str, float]:
    """Return RMS errors of the true angle about what was wanted [deg]."""
    known, hands = hands_of(seed)
    rig = rig_of(known).with_values({f"drives.{m}.servo.goal": f"{m}_goal" for m in known.motors})
    ratio = known.arms[np.arange(2), np.arange(2)] / known.spools[np.arange(2), np.arange(2)]
    zeros = (hands.d.zeros * hands.d.signs)[0]
    logs = []
    for i, kind in enumerate(KINDS):
        goals = zeros + ratio * angles_of(known, 1000 * seed + i, kind)
        logs.append(log_of(known, driven(known, hands, goals), goals, kind))
    ((found, _),) = calibrated(known, hands_of(seed)[1], rig)
    rigs = {"routine": found.rig, "routine and logs": fit(logs, found.rig).rig}
    rigs |= {f"{name}, stiff servo": without(one) for name, one in rigs.items()}
    sums = dict[str, list[float]]()
    for i, kind in enumerate(KINDS):
        desired = angles_of(known, 1000 * seed + 100 + i, kind)
        time = np.arange(len(desired)) * PERIOD
        ways = {
            "affine by hand": np.column_stack(
                [affine(desired[:, j]) @ by_hand(logs, j, affine, known) for j in range(2)]
            ),
            "with speed, by hand": np.column_stack(
                [moving(desired[:, j]) @ by_hand(logs, j, moving, known) for j in range(2)]
            ),
            **{
                f"open loop, {name}": Inverse(one)(time, desired).sent for name, one in rigs.items()
            },
        }
        for name, goals in ways.items():
            _, own = hands_of(seed)
            error = driven(known, own, goals)["angles"] - desired
            sums.setdefault(name, []).append(float(np.mean(error**2)))
        for name, one in rigs.items():
            _, own = hands_of(seed)
            error = live(known, own, one, desired) - desired
            sums.setdefault(f"live, {name}", []).append(float(np.mean(error**2)))
    return {name: float(np.rad2deg(np.sqrt(np.mean(each)))) for name, each in sums.items()}


def without(rig: Rig) -> Rig:
    """Return the rig with servos that do not give way."""
    values = {f"drives.{drive.name}.servo.stiffness": 1e9 for drive in rig.drives}
    values |= {f"drives.{drive.name}.servo.dead_band": 0.0 for drive in rig.drives}
    return rig.with_values(values)


def main() -> None:
    """Print RMS errors."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.servos", description=__doc__)
    parser.add_argument("--hands", type=int, default=5)
    parser.add_argument("--first-seed", type=int, default=0)
    asked = parser.parse_args()
    warnings.simplefilter("ignore")
    found = [errors_of(seed) for seed in range(asked.first_seed, asked.first_seed + asked.hands)]
    best = [min(one["affine by hand"], one["with speed, by hand"]) for one in found]
    rows = []
    for name in found[0]:
        errors = np.array([one[name] for one in found])
        share = np.exp(np.mean(np.log(errors / best)))
        rows.append([name, f"{np.sqrt(np.mean(errors**2)):.2f}", f"{share:.2f}"])
    columns = ("way", "RMS of the true angle − wanted [°]", "of the best by hand, geometric mean")
    table("servos", "Hobby servos that give way", columns, rows)


if __name__ == "__main__":
    main()
