"""Wanted angles against true ones: the inverse, live and in an open loop, against the ratio, an
affine map and a PI loop.

`python -m benchmarks.commands [PLANTS] [--first-seed N] [--seeds N] [--fit]` drives plants whose
drives are servos of place (`tests/support/servo_plants`) and prints RMS errors of the true angle.
Wanted are sines, ramps with rests and smoothed steps. All open loops make up for the servos' lag
and delay; `--fit` also fits each rig to three logs of its plant.
"""

from __future__ import annotations

import argparse
import os
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from tests.support.commands import (
    LEAST_TENSION,
    driven,
    inextensible,
    live_law,
    run,
)
from tests.support.servo_plants import PERIOD

from benchmarks.commanded_plants import PLANTS
from benchmarks.report import table
from benchmarks.shell import written
from distal import Inverse, Log, Rig
from distal.confidence import BAND
from distal.errors import DistalWarning
from distal.inverse import Command, Commands, Feedback
from distal.inverse.command_trajectory import followable, sent
from distal.logs import FROM_SENSOR

Floats = NDArray[np.float64]


DURATION, COUNTED = 10.0, 1.0
"""Of a run, and what is left out at its begin [s]."""


KINDS = ("sine", "ramps", "steps")
RANGES = {
    "paper": (-22.0, 22.0),
    "Bowden sheath": (15.0, 65.0),
    "ropes": (-35.0, 35.0),
    "finger-2n": (5.0, 50.0),
    "finger-n-plus-1": (10.0, 40.0),
    "finger-underactuated": (10.0, 40.0),
    "wrist-instrument": (-30.0, 30.0),
}
"""Of wanted angles [°]."""

ENCODER = np.deg2rad(1.0)


METHODS = (
    "ratio",
    "affine",
    "inverse",
    "fitted inverse",
    "live",
    "live, feedback",
    "fitted, feedback",
    "PI on an encoder",
)


def desired_angles(kind: str, plant: str, count: int, rng: np.random.Generator) -> Floats:
    """Return wanted angles of `count` joints, (k, count) [rad]."""
    time = np.arange(round(DURATION / PERIOD)) * PERIOD
    low, high = np.deg2rad(RANGES[plant])
    middle, size = (low + high) / 2, (high - low) / 2
    columns = []
    for _ in range(count):
        if kind == "sine":
            raw = middle + size * rng.uniform(0.6, 1.0) * np.sin(
                2 * np.pi * rng.uniform(0.15, 0.4) * time
            )
        else:
            marks, levels = [0.0], [middle]
            while marks[-1] < DURATION:
                slow = rng.uniform(0.5, 1.5) if kind == "ramps" else 0.05
                marks += [marks[-1] + slow, marks[-1] + slow + rng.uniform(0.6, 2.6)]
                levels += [middle + size * rng.uniform(-1, 1)] * 2
            raw = np.interp(time, marks, levels)
        width = 15 if kind == "ramps" else 41
        kernel = np.hanning(width + 2)[1:-1]
        columns.append(
            np.convolve(np.pad(raw, width // 2, mode="edge"), kernel / kernel.sum(), "valid")
        )
    return np.column_stack(columns)


def led(rig: Rig, positions: Floats) -> Floats:
    """Return what is sent so that servos are at places in time."""
    time = np.arange(len(positions)) * PERIOD
    return np.column_stack(
        [
            sent(time, followable(time, positions[:, i], drive), drive)
            for i, drive in enumerate(rig.drives)
        ]
    )


def pi_law(
    rig: Rig, free: Sequence[int], start: Floats, first: Floats, rate: float
) -> Callable[..., Floats]:
    """Return the ratio with a PI correction of its angle by an encoder of 1°, as a law."""
    correction = np.zeros(len(free))

    def law(time: float, now: Floats, read: dict[str, float], angles: Floats) -> Floats:
        nonlocal correction
        known = ENCODER * np.round(angles / ENCODER)
        error = now - known[list(free)]
        quiet = np.abs(error) < ENCODER / 2
        correction = correction + rate * PERIOD * np.where(quiet, 0.0, error)
        full = first.copy()
        full[list(free)] = now + correction + 0.1 * rate * np.where(quiet, 0.0, error)
        return inextensible(rig, np.vstack([first, full]), start)[1]

    return law


@dataclass
class Result:
    """Squared errors by method, and shares inside."""

    squares: dict[str, list[float]]
    inside: dict[str, list[float]]

    def add(
        self, method: str, desired: Floats, angles: Floats, commands: Commands | None = None
    ) -> None:
        """Add a run of a method: true angles, and what its commands said of them."""
        time = np.arange(len(desired)) * PERIOD
        late = time >= COUNTED
        self.squares.setdefault(method, []).append(float(np.mean((angles - desired)[late] ** 2)))
        if commands is not None:
            is_inside = np.abs(angles - commands.angles)[late] < BAND * commands.stds[late]
            self.inside.setdefault(method, []).append(float(np.mean(is_inside)))


def calibrated(name: str, seed: int, rig: Rig) -> tuple[Rig, Callable[[Floats], Floats]]:
    """Return the rig fitted to three logs of its plant, and an affine inverse by least squares on
    the same logs.
    """
    logs, positions, angles = list[Log](), [], []
    free = Inverse(rig, compiled=False).model.free
    for k in range(3):
        rng = np.random.default_rng([seed, 7, k])
        plant = PLANTS[name](seed)
        wish = reachable(
            rig, np.vstack([desired_angles("ramps", name, len(free), rng) for _ in range(2)])
        )
        time = np.arange(len(wish)) * PERIOD
        commands = Inverse(rig, least_tension=LEAST_TENSION)(time, wish[:, free])
        true, read = run(plant, inextensible(rig, wish, commands.sent[0]))
        names = [sensor.name for sensor in rig.sensors if sensor.name in read[0]]
        channels = {each: np.array([row[each] for row in read]) for each in names}
        noisy = true + np.deg2rad(0.03) * rng.normal(size=true.shape)
        keys = ["theta"] if true.shape[1] == 1 else [f"theta_{joint.name}" for joint in rig.joints]
        logs.append(Log(time, channels, dict(zip(keys, noisy.T)), f"{name} {k}", FROM_SENSOR))
        position_sensors = [
            next(s.name for s in rig.sensors_of("position") if s.of == drive.name)
            for drive in rig.drives
        ]
        positions.append(np.column_stack([channels[each] for each in position_sensors]))
        angles.append(noisy)
    matrix = np.column_stack([np.vstack(angles), np.ones(sum(map(len, angles)))])
    slopes = np.linalg.lstsq(matrix, np.vstack(positions), rcond=None)[0]
    fitted = written(rig, logs, "fit")
    return fitted, lambda wish: np.column_stack([wish, np.ones(len(wish))]) @ slopes


def reachable(rig: Rig, desired: Floats) -> Floats:
    """Return the nearest angles of all joints that the drives can hold by the rig file."""
    time = np.arange(len(desired)) * PERIOD
    commands = Inverse(rig, least_tension=LEAST_TENSION)(time, desired)
    return commands.angles


def judge(name: str, seed: int, with_fit: bool) -> Result:
    """Return errors of all methods on one plant."""
    warnings.simplefilter("ignore", DistalWarning)
    found = Result({}, {})
    rig = PLANTS[name](seed).rig
    inverses = {"inverse": Inverse(rig, least_tension=LEAST_TENSION)}
    affine = None
    if with_fit:
        fitted, affine = calibrated(name, seed, rig)
        inverses["fitted inverse"] = Inverse(fitted, least_tension=LEAST_TENSION)
    free = inverses["inverse"].model.free
    for kind in KINDS:
        rng = np.random.default_rng([seed, KINDS.index(kind), 3])
        desired = reachable(rig, desired_angles(kind, name, len(free), rng))
        time = np.arange(len(desired)) * PERIOD
        commands: dict[str, Commands] = {
            key: inverse(time, desired[:, free]) for key, inverse in inverses.items()
        }
        for key, command in commands.items():
            found.add(key, desired, run(PLANTS[name](seed), command.sent)[0], command)
        start = commands["inverse"].sent[0]
        found.add(
            "ratio",
            desired,
            run(PLANTS[name](seed), led(rig, inextensible(rig, desired, start)))[0],
        )
        if affine is not None:
            found.add("affine", desired, run(PLANTS[name](seed), led(rig, affine(desired)))[0])
        laws: dict[str, Callable[..., Command | Floats]] = {
            "live": live_law(rig, Feedback(follow=0.0)),
            "live, feedback": live_law(rig, Feedback()),
            "PI on an encoder": pi_law(rig, free, start, desired[0], 4.0),
        }
        if with_fit:
            laws["fitted, feedback"] = live_law(fitted, Feedback())
        for key, law in laws.items():
            found.add(key, desired, driven(PLANTS[name](seed), rig, desired, free, start, law))
    return found


def main() -> None:
    """Print a table of all plants and methods."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("plants", nargs="*", default=list(PLANTS))
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--fit", action="store_true")
    asked = parser.parse_args()
    seeds = range(asked.first_seed, asked.first_seed + asked.seeds)
    rows = []
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        jobs = {
            name: [pool.submit(judge, name, seed, asked.fit) for seed in seeds]
            for name in asked.plants
        }
        for name, futures in jobs.items():
            rows.append([name, *cells([future.result() for future in futures])])
            print(*rows[-1], flush=True)
    said = "RMS [°], in brackets the worst plant, then % inside the band"
    table(
        "commands" + "-fit" * asked.fit,
        f"Wanted against true angles: {said}",
        ["plant", *METHODS],
        rows,
    )


def cells(results: Sequence[Result]) -> list[str]:
    """Return what each method does on a kind of plant."""
    found = []
    for method in METHODS:
        rms = [
            float(np.rad2deg(np.sqrt(np.mean(one.squares[method]))))
            for one in results
            if method in one.squares
        ]
        inside = [np.mean(one.inside[method]) for one in results if method in one.inside]
        share = f" {100 * np.mean(inside):.0f}%" if inside else ""
        found.append(f"{np.mean(rms):.2f} ({max(rms):.2f}){share}" if rms else "")
    return found


if __name__ == "__main__":
    main()
