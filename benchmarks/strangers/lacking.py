"""Rigs drawn at random (`tests.support.drawn_rigs`) whose plants have one or two things that the
rig file is silent about.

Friction along the cable (Coulomb's, at three points), creep, play at the drives, moment arms that
change with the angle, a motor's cogging. One of the logs is of a wider and faster motion
("outside"). Plants come to rest at each instant; no code of `distal.model` is shared.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from tests.support.drawn_logs import FASTER, FITTED, JUDGED, positions_of
from tests.support.drawn_plants import (
    PARTS,
    balanced,
    efforts,
    loads,
    parameters_of,
    prepared,
    ramps,
)
from tests.support.drawn_rigs import RATE, WIDER, Drawn

from distal import Log
from distal.logs import FROM_SENSOR

Floats = NDArray[np.float64]

KINDS = ("friction along the cable", "creep", "play", "arms", "cogging")
POINTS = 3
"""Points of friction in a plant's cable."""
SWEEPS = 3
"""Times that these settle at each instant, from end to end."""


def extras(rig: Drawn, rng: np.random.Generator) -> dict[str, Any]:
    """Return one or two things that a plant has beside its rig, by name."""
    tendons = len(rig.raw["tendons"])
    sizes: dict[str, Any] = {
        "friction along the cable": rng.uniform(0.1, 0.35, tendons),
        "creep": (rng.uniform(0.1, 0.3, tendons), rng.uniform(2.0, 20.0)),
        "play": rng.uniform(0.2, 0.6, len(rig.raw["drives"])),
        "arms": rng.uniform(-0.25, 0.25, tendons),
        "cogging": (rng.integers(7, 25), rng.uniform(0.02, 0.06)),
    }
    return {str(name): sizes[name] for name in rng.choice(KINDS, rng.integers(1, 3), replace=False)}


class Cables:
    """What lies between drives and joints of one plant on several logs: play, creep, points of
    friction.
    """

    def __init__(self, rig: Drawn, p: dict[str, Floats], has: dict[str, Any], ends: Floats) -> None:
        self.p, self.has, logs = p, has, len(ends)
        arm = np.abs(p["arms"][0]).max(axis=1)
        self.ends, self.strain = ends.copy(), np.zeros_like(ends)
        # a third of a degree of the joint is a usual play of a gear or a knot
        widths = np.deg2rad(has.get("play", np.zeros(p["levers"].shape[2])))
        self.width = (np.abs(p["levers"][0]) > 0) @ widths * arm
        self.grips = np.exp(
            np.asarray(has.get("friction along the cable", np.zeros(len(arm)))) / POINTS
        )
        self.points: Floats | None = (
            None if "friction along the cable" not in has else np.zeros((logs, len(arm), POINTS))
        )
        self.started = False

    def turned(self, ends: Floats, angles: Floats, rubbing: float) -> tuple[Floats, Floats]:
        """Return angles (b, j), and tensions at the drives (b, t), as the drives have brought the
        ends to a place.
        """
        p, has = self.p, self.has
        self.ends = np.clip(self.ends, ends - self.width / 2, ends + self.width / 2)
        bent, own = np.zeros_like(ends), dict(p)
        if "arms" in has:
            change = np.asarray(has["arms"])[:, None]
            own["arms"] = p["arms"] * (1.0 + change * angles[:, None, :])
            # ∫ r (1 + s θ) dθ, as far as the plain arms times θ do not give it
            bent = np.einsum("btj,bj->bt", p["arms"] * change * 0.5, angles**2)
            bent -= np.einsum("btj,bj->bt", own["arms"] - p["arms"], angles)
        begins = self.ends - bent - self.strain
        if self.points is None:
            angles = balanced(own, begins, angles, rubbing)
            tension = loads(own, begins, angles)[3]
        else:
            angles, tension = self._sheathed(own, begins, angles, rubbing)
        if "creep" in has:
            share, slow = has["creep"]
            self.strain += (share * tension / p["stiffness"] - self.strain) / slow / RATE / PARTS
        return angles, tension

    def _sheathed(
        self, p: dict[str, Floats], ends: Floats, angles: Floats, rubbing: float
    ) -> tuple[Floats, Floats]:
        drive, k = p["taut"] + ends, p["stiffness"]
        springs = np.array([2 * POINTS, *[POINTS] * (POINTS - 1), 2 * POINTS])
        assert self.points is not None
        m = self.points
        for _ in range(SWEEPS):
            joint = np.einsum("btj,bj->bt", p["arms"], angles)
            if not self.started:
                shares = (2 * np.arange(POINTS) + 1) / (2 * POINTS)
                m[:] = drive[:, :, None] + (joint - drive)[:, :, None] * shares
            for i in [*range(POINTS), *range(POINTS - 2, -1, -1)]:
                before = drive if i == 0 else m[:, :, i - 1]
                after = joint if i == POINTS - 1 else m[:, :, i + 1]
                near, far = springs[i], springs[i + 1]
                drawn = (near * before + self.grips * far * after) / (near + self.grips * far)
                let_out = (self.grips * near * before + far * after) / (self.grips * near + far)
                m[:, :, i] = np.clip(
                    m[:, :, i], np.minimum(drawn, let_out), np.maximum(drawn, let_out)
                )
            last = prepared({**p, "stiffness": springs[-1] * k, "taut": 0.0 * p["taut"]})
            angles = balanced(last, m[:, :, -1], angles, rubbing)
        self.started = True
        return angles, k * springs[0] * np.maximum(drive - m[:, :, 0], 0.0)


def logs_of(
    rig: Drawn, seed: int, fitted: int = FITTED, judged_by: int = JUDGED
) -> tuple[list[Log], dict[str, Any]]:
    """Return the logs of a rig, those to fit first, and what its plant has beside the rig."""
    rng, count = np.random.default_rng([seed, 73]), fitted + judged_by
    has, moves, rate = extras(rig, rng), [], PARTS * RATE
    rngs = [np.random.default_rng([seed, log, 74]) for log in range(count)]
    for log, own in enumerate(rngs):
        wide, fast = (WIDER, FASTER) if log == count - 1 else (1.0, 1.0)
        wish = np.column_stack([ramps(own, wide * a, fast, rate) for a in rig.reach])
        wave = 2.0 * np.pi * (own.uniform(0.05, 0.2) * np.arange(len(wish)) / rate + own.uniform())
        moves.append(positions_of(rig, wish, 1.0 + 0.35 * np.sin(wave)))
    positions = np.stack(moves, axis=1)
    one = parameters_of(rig.raw, rig.truth)
    p = prepared({name: np.stack([value] * count) for name, value in one.items()})
    p["mass"] = 0.0 * p["mass"]
    ends = positions @ one["levers"].T
    cables, angles = Cables(rig, p, has, ends[0]), np.zeros((count, len(rig.reach)))
    turned, pulls = [], []
    for k in range(len(ends)):
        angles, tension = cables.turned(ends[k], angles, 0.0 if k == 0 else 1.0)
        if k % PARTS == 0:
            turned.append(angles)
            pulls.append(tension)
    read = efforts(p, positions[::PARTS], np.array(pulls))
    if "cogging" in has:
        periods, size = has["cogging"]
        lever = np.abs(one["levers"]).max(axis=0)
        read = read + size * rig.tension * lever * np.sin(
            periods * positions[::PARTS] * np.where(lever == 1.0, 100.0, 1.0)
        )
    joints = [joint["name"] for joint in rig.raw["joints"]]
    names = ["theta"] if len(joints) == 1 else [f"theta_{joint}" for joint in joints]
    logs = []
    for log, own in enumerate(rngs):
        exact = {
            "position": positions[::PARTS, log],
            "force": read[:, log],
            "angle": np.array(turned)[:, log] + rig.offsets,
        }
        channels: dict[str, dict[str, Floats]] = {kind: {} for kind in exact}
        for sensor in rig.raw["sensors"]:
            mine, step = channels[sensor["measures"]], sensor.get("resolution", 0.0)
            column = exact[sensor["measures"]][:, len(mine)]
            column = column + sensor["noise"] * own.normal(size=len(column))
            mine[sensor["name"]] = step * np.round(column / step) if step else column
        true = channels["angle"].values() if log < fitted else np.array(turned)[:, log].T
        said = "calibration" if log < fitted else "outside" if log == count - 1 else "motion"
        made = {**channels["position"], **channels["force"]}
        source = f"lacking {seed}, {said} {log}"
        time_ = np.arange(len(turned)) / RATE
        logs.append(
            Log(
                time_,
                made,
                dict(zip(names, true)),
                source,
                FROM_SENSOR if log < fitted else "the plant",
            )
        )
    return logs, has
