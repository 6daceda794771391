"""Hands calibrated by their power-on routine alone, on plants of others: `python -m
benchmarks.hands orca [--first-seed N]`.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from tests.support.hands import calibrated, log_of, motion, ratio, rig_of
from tests.support.servo_hands import (
    Hands,
    Known,
    aero_like,
    orca_like,
)

import distal
from benchmarks.report import table
from benchmarks.shell import written
from distal import Rig
from distal.hands import Calibrated
from distal.logs import Log
from distal.rig import independent_parts


def as_written(found: Sequence[tuple[Calibrated, Log]], rig: Rig) -> list[tuple[Calibrated, Log]]:
    """Return calibrations whose rigs are those of the files that `distal calibrate` writes; faults
    have no place in a file.
    """
    return [(replace(one, rig=written(rig, [log], "calibrate")), log) for one, log in found]


def fitted(seeds: range, joints: Sequence[str]) -> list[list[str]]:
    """Return RMS errors after the routine, and after a fit of each joint to three logs with a
    reference, on a fourth.
    """
    known, hands = orca_like(seeds, joints)
    rig, rows = rig_of(known), list[list[str]]()
    found = as_written(calibrated(known, hands, rig), rig)
    m = len(known.motors)
    ends = np.zeros((2, len(found), m))
    for a, (_, log) in enumerate(found):
        positions = np.column_stack([log.channels[f"{motor}_position"] for motor in known.motors])
        ends[:, a] = np.min(positions, axis=0), np.max(positions, axis=0)
    runs = [motion(known, hands, ends, seeds[0] + 1000 * k) for k in range(4)]
    for a, (result, _) in enumerate(found):
        off = {name: list[Any]() for name in ("routine", "fitted", "ratio")}
        plain = ratio(known, runs[3]["positions"][:, a], (ends[0, a], ends[1, a]))
        for j, part in enumerate(independent_parts(result.rig)):
            truth = runs[3]["angles"][:, a, j]
            logs = [log_of(known, run, a) for run in runs]
            logs = [
                Log(
                    log.time,
                    {
                        s.name: log.channels[s.name]
                        for s in part.rig.sensors
                        if s.name in log.channels
                    },
                    {"theta": run["angles"][:, a, j].copy()},
                    f"log {k}",
                )
                for k, (log, run) in enumerate(zip(logs, runs))
            ]
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", distal.DistalWarning)
                learned = written(part.rig, logs[:3], "fit")
                last = Log(logs[3].time, logs[3].channels, {}, "last")
                off["fitted"].append(distal.estimate(last, learned).angles[:, 0] - truth)
                off["routine"].append(distal.estimate(last, part.rig).angles[:, 0] - truth)
            off["ratio"].append(plain[:, j] - truth)
        sizes = {
            name: float(np.rad2deg(np.sqrt(np.mean(np.square(errors)))))
            for name, errors in off.items()
        }
        share = sizes["fitted"] / sizes["ratio"]
        rows.append(
            [
                f"{a}",
                *(f"{sizes[name]:.2f}" for name in ("routine", "fitted", "ratio")),
                f"{share:.2f}",
            ]
        )
    return rows


def judged(make: Callable[[Any], tuple[Known, Hands]], seeds: range) -> list[list[str]]:
    """Return RMS errors of ten hands after the routine alone."""
    known, hands = make(seeds)
    rig = rig_of(known)
    begun = time.perf_counter()
    found = as_written(calibrated(known, hands, rig), rig)
    print(
        f"calibrated {len(found)} hands, {(time.perf_counter() - begun) / len(found):.1f} s each "
        "with their plants"
    )
    m = len(known.motors)
    ends = np.zeros((2, len(found), m))
    for a, (_, log) in enumerate(found):
        for k, motor in enumerate(known.motors):
            position = log.channels[f"{motor}_position"]
            ends[:, a, k] = np.nanmin(position), np.nanmax(position)
            if (
                len([t for t in rig.tendons if t.drive == motor]) == 1
            ):  # what it lets out beyond is no travel
                ends[0, a, k] += 0.3
    run = motion(known, hands, ends, seeds[0])
    rows = []
    for a, (result, _) in enumerate(found):
        truth = run["angles"][:, a]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", distal.DistalWarning)
            estimate = distal.estimate(log_of(known, run, a), result.rig)
        off = np.rad2deg(estimate.angles - truth)
        plain = np.rad2deg(ratio(known, run["positions"][:, a], (ends[0, a], ends[1, a])) - truth)
        inside = np.abs(off) < 1.96 * np.rad2deg(estimate.angle_stds)
        sizes = [float(np.sqrt(np.mean(errors**2))) for errors in (off, plain)]
        per_joint = np.sqrt(np.mean(off**2, axis=0))
        worst = int(np.argmax(per_joint))
        share, faults = (
            f"{sizes[0] / sizes[1]:.2f}",
            ", ".join(fault.sentence for fault in result.faults),
        )
        row = [f"{a}", f"{sizes[0]:.2f}", f"{sizes[1]:.2f}", share, f"{100 * inside.mean():.0f}"]
        rows.append([*row, f"{known.joints[worst]} {per_joint[worst]:.1f}", faults])
    return rows


FAULTS = ("side", "slack", "broken", "slipped", "")


def injected(hands: Hands, seed: int) -> list[list[str]]:
    """Give each motor of hands with pairs of tendons one fault, or none, and return which, by hand
    and motor.
    """
    rng, n, d = np.random.default_rng([seed, 5]), hands.positions.shape[1], hands.d
    kinds = [
        [FAULTS[int(k)] for k in rng.integers(0, len(FAULTS), n)]
        for _ in range(len(hands.positions))
    ]
    for a, of_hand in enumerate(kinds):
        for k, kind in enumerate(of_hand):
            tendon = k + n * int(rng.integers(0, 2))
            if kind == "side":
                d.spools[a, tendon, k] *= -1.0
            elif kind == "slack":
                d.slack[a, tendon] += rng.uniform(0.3, 0.5) * abs(d.arms[a, k, k])
            elif kind == "broken":
                hands.broken[a, tendon] = True
            elif kind == "slipped":
                hands.slips[a, k] = rng.uniform(0.06, 0.09)
    return kinds


def found_faults(seeds: range, faulty: bool) -> list[list[str]]:
    """Return how often each fault is found as itself, as another one, or not; without faults, false
    alarms.
    """
    known, hands = orca_like(seeds)
    kinds = injected(hands, seeds[0]) if faulty else [[""] * len(known.motors) for _ in seeds]
    results, counts = calibrated(known, hands, rig_of(known), together=True), dict[str, list[int]]()
    length = float(results[0][1].time[-1])
    for of_hand, (result, _) in zip(kinds, results):
        named = {fault.drive: fault.kind for fault in result.faults}
        for motor, kind in zip(known.motors, of_hand):
            found = named.get(motor, "")
            row = counts.setdefault(kind or "none", [0, 0, 0, 0])
            row[0] += 1
            # both tendons wound one way, and one broken: a motor tells no difference, and the
            # sentence names both
            row[1] += found == kind or (found, kind) == ("broken", "side")
            row[2] += bool(found) and found != kind and (found, kind) != ("broken", "side")
            row[3] += not found and bool(kind)
    motors = sum(row[0] for row in counts.values())
    print(f"{motors} motors, {motors * length / 3600:.1f} motor-hours")
    return [[kind, *map(str, row)] for kind, row in sorted(counts.items())]


def main() -> None:
    """Print the table of what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("orca", "aero", "fitted", "faults", "sound"))
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--draws", type=int, default=10)
    asked = parser.parse_args()
    first, seeds = asked.first_seed, range(asked.first_seed, asked.first_seed + asked.draws)
    if asked.what in ("faults", "sound"):
        rows = found_faults(seeds, asked.what == "faults")
        titles = ["fault", "motors", "found", "as another", "not found"]
        table("hands-faults", f"faults that the routine finds, seeds {first} on", titles, rows)
        return
    if asked.what == "fitted":
        rows = fitted(seeds, ("thumb_mcp", "index_abd", "index_mcp", "index_pip"))
        titles = ["hand", "routine, °", "fitted, °", "ratio, °", "of it"]
        title = f"four joints of orca-like hands, fitted to three logs, seeds {first} on"
        table("hands-fitted", title, titles, rows)
        return
    rows = judged(orca_like if asked.what == "orca" else aero_like, seeds)
    titles = ["hand", "RMS, °", "ratio, °", "of it", "inside, %", "worst joint, °", "faults"]
    values = np.array([[float(row[1]), float(row[2]), float(row[4])] for row in rows])
    total = np.sqrt(np.mean(values[:, :2] ** 2, axis=0))
    share, inside = total[0] / total[1], values[:, 2].mean()
    title = (
        f"{asked.what}-like hands, seeds {first} on: {total[0]:.2f}°, ratio {total[1]:.2f}°, "
        f"{share:.2f}, {inside:.0f} %"
    )
    table(f"hands-{asked.what}", title, titles, rows)


if __name__ == "__main__":
    main()
