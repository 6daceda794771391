"""Hands watched while they move: `python -m benchmarks.hands_watched [--first-seed N] [--draws K]
[--minutes M] [--middle]`.

Each motor of hands of others gets a fault after some time, or none. A finding that names it before,
or without a fault, is a false alarm: of a tendon, or of torques that are not as the model says. A
quarter of the motions goes to an end of the range, as hands open and close; `--middle`: none does.
"""

from __future__ import annotations

import argparse
import re
import warnings
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from tests.support.hands import calibrated, log_of, motion, rig_of
from tests.support.servo_hands import PERIOD, Hands, Known, orca_like

import distal
from benchmarks.report import table
from distal import LiveEstimator, Monitor

KINDS = ("loosened", "slack", "broken", "slipped", "")
"""By 5 to 8°, by 15 to 25° at the joint, one tendon, by 0.15 to 0.4 rad of the spool, none."""

AWAY = 10.0
"""A motor that was not named for so long is an alarm of its own [s]."""


@dataclass
class Injected:
    """Which fault each motor gets, and when [s]."""

    kinds: list[list[str]]
    when: Any
    rng: np.random.Generator = field(repr=False)

    @classmethod
    def drawn(cls, hands: Hands, seed: int, seconds: float) -> Injected:
        """Draw them."""
        rng, shape = np.random.default_rng([seed, 77]), hands.positions.shape
        kinds = [
            [KINDS[int(k)] for k in rng.integers(0, len(KINDS), shape[1])] for _ in range(shape[0])
        ]
        return cls(kinds, rng.uniform(0.3 * seconds, 0.4 * seconds, shape), rng)

    def apply(self, hands: Hands, time: float) -> None:
        """Make the faults of one period."""
        n, d, rng = hands.positions.shape[1], hands.d, self.rng
        for a, k in zip(*np.nonzero((self.when <= time) & (time < self.when + PERIOD))):
            kind, side = self.kinds[a][k], k + n * int(rng.integers(0, 2))
            if kind in ("loosened", "slack"):
                away = rng.uniform(5, 8) if kind == "loosened" else rng.uniform(15, 25)
                d.slack[a, side] += np.deg2rad(away) * abs(d.arms[a, k, k])
            elif kind == "broken":
                hands.broken[a, side] = True
            elif kind == "slipped":
                hands.slipped[a, k] += rng.choice([-1.0, 1.0]) * rng.uniform(0.15, 0.4)


def findings(
    known: Known, rig: distal.Rig, run: dict[str, Any], a: int
) -> dict[str, list[tuple[float, str]]]:
    """Return motor → when it was named, and how, as its stream goes by."""
    log, live = log_of(known, run, a), LiveEstimator(rig)
    monitor, samples = (
        Monitor(live),
        np.column_stack([log.channels[name] for name in live.channels]),
    )
    names = {motor: re.compile(rf"\b{motor} goes|\b{motor}_\w+ ") for motor in known.motors}
    found: dict[str, list[tuple[float, str]]] = {motor: [] for motor in known.motors}
    for time, sample in zip(log.time, samples):
        reading = monitor.take(float(time), sample)
        if reading.health in ("disagrees", "dead"):
            for motor, pattern in names.items():
                if pattern.search(reading.detail + " "):
                    found[motor].append((float(time), reading.detail))
    return found


def main() -> None:
    """Print how often and how soon each fault is named, and false alarms per hour of a motor."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--draws", type=int, default=5)
    parser.add_argument("--minutes", type=float, default=2.0)
    parser.add_argument("--middle", action="store_true", help="no motion goes to an end")
    asked = parser.parse_args()
    first, draws, seconds = asked.first_seed, asked.draws, 60.0 * asked.minutes
    warnings.simplefilter("ignore", distal.DistalWarning)
    known, hands = orca_like(range(first, first + draws))
    results = calibrated(known, hands, rig_of(known), together=True)
    ends = np.array(
        [
            [
                [position.min(), position.max()]
                for position in (log.channels[f"{motor}_position"] for motor in known.motors)
            ]
            for _, log in results
        ]
    )
    injected = Injected.drawn(hands, first, seconds)
    run = motion(
        known,
        hands,
        np.moveaxis(ends, 2, 0),
        first,
        seconds,
        0.0 if asked.middle else 0.25,
        injected.apply,
    )
    counts: dict[str, list[Any]] = {kind: [0, [], 0.0, 0, 0] for kind in KINDS}
    for a, (result, _) in enumerate(results):
        faulty = {fault.drive for fault in result.faults}
        for k, (motor, named) in enumerate(findings(known, result.rig, run, a).items()):
            if motor in faulty:
                print(
                    f"hand {a}: {motor} not watched, as its routine found: "
                    f"{result.faults[0].sentence}"
                )
                continue
            kind, when = injected.kinds[a][k], float(injected.when[a, k])
            row, until = counts[kind], when if kind else seconds
            before = [(time, detail) for time, detail in named if time < until]
            after = [time for time, _ in named if time >= until]
            alarms = [
                one for one, last in zip(before, [(-1e9, ""), *before]) if one[0] - last[0] > AWAY
            ]
            of_tendons = sum(f"{motor} goes" in detail for _, detail in alarms)
            row[0], row[2], row[3], row[4] = (
                row[0] + 1,
                row[2] + until / 3600,
                row[3] + of_tendons,
                row[4] + len(alarms),
            )
            row[1] += [after[0] - when] if kind and after else []
            for time, detail in alarms:
                print(f"false: hand {a}, {motor}, {time:.1f} s: {detail[:150]}")
    rows = []
    for kind, (motors, delays, hours, of_tendons, alarms) in counts.items():
        if motors:
            late = (
                [f"{np.median(delays):.1f}", f"{np.percentile(delays, 90):.1f}"]
                if delays
                else ["", ""]
            )
            rows.append(
                [
                    kind or "none",
                    f"{motors}",
                    f"{len(delays)}" if kind else "",
                    *late,
                    f"{of_tendons}",
                    f"{alarms - of_tendons}",
                    f"{hours:.2f}",
                ]
            )
    titles = [
        "fault",
        "motors",
        "named",
        "delay, s (median)",
        "(90 %)",
        "false: tendons",
        "torques",
        "in motor-hours",
    ]
    table("hands-watched", f"hands watched, seeds {first} on, {seconds:.0f} s", titles, rows)


if __name__ == "__main__":
    main()
