"""What `make accuracy` runs: plants that differ from the rig the filter knows, and scenarios drawn
from a seed.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from distal import Log, Rig, Scenario, load_rig, simulate
from distal.simulation import build_scenario

WINDOW = {"drives.0.stops": ["-5 mm", "15 mm"], "drives.1.stops": ["-5 mm", "15 mm"]}
DURATION = 12.0

PLANTS: dict[str, dict[str, Any]] = {
    "as the rig": {},
    "friction +20 %": {"joints.0.friction.coefficient": 0.6},
    "friction −20 %": {"joints.0.friction.coefficient": 0.4},
    "stiffness +10 %": {"tendons.0.stiffness": 886.6, "tendons.1.stiffness": 886.6},
    "stiffness −10 %": {"tendons.0.stiffness": 725.4, "tendons.1.stiffness": 725.4},
    "friction +20 %, stiffness −10 %": {
        "joints.0.friction.coefficient": 0.6,
        "tendons.0.stiffness": 725.4,
        "tendons.1.stiffness": 725.4,
    },
    "friction +30 %": {"joints.0.friction.coefficient": 0.65},
    "friction −30 %": {"joints.0.friction.coefficient": 0.35},
    "as observed": {
        "drives.0.friction.load": 0.1,
        "drives.1.friction.load": 0.1,
        "joints.0.friction.exponent": 1.5,
        "joints.0.friction.reference": "12.9 N",
    },
    "slider friction 0.5 N": {"drives.0.friction.constant": 0.5, "drives.1.friction.constant": 0.5},
    "slider friction 1 N": {"drives.0.friction.constant": 1.0, "drives.1.friction.constant": 1.0},
    "no linearity error": {"sensors.x1.linearity": 0.0, "sensors.x2.linearity": 0.0},
}
WITHIN = tuple(PLANTS)[:6]
HARD = tuple(PLANTS)[6:11]
MID_RANGE = ("ramps", "weights", "servo")
INTO_STOPS = ("ramps into stops", "weights into stops")
SCENARIOS = (*MID_RANGE, *INTO_STOPS)


def paper_rig(plant: str) -> Rig:
    """Return what the filter knows: the paper's rig in a 20 mm window; without linearity error
    where there is none.
    """
    values = dict(WINDOW)
    if plant == "no linearity error":
        values |= PLANTS[plant]
    return load_rig("paper-2008-printed").with_values(values)


def _points(
    rng: np.random.Generator, every: tuple[float, float], low: float, high: float
) -> list[list[float]]:
    time, points = 0.0, [[0.0, 3.0]]
    while time < DURATION:
        time += float(rng.uniform(*every))
        points.append([time, float(rng.uniform(low, high))])
    return points


def _alternating(rng: np.random.Generator, high: float) -> dict[str, list[list[float]]]:
    """Return pulls of which now one, now the other is the stronger."""
    time, points = 0.0, {"left": [[0.0, 3.0]], "right": [[0.0, 3.0]]}
    strong = bool(rng.integers(2))
    while time < DURATION:
        time += float(rng.uniform(1.0, 2.0))
        strong = not strong
        upper = float(rng.uniform(4.3, 5.2) if high < 6.0 else rng.uniform(5.0, high))
        lower = float(rng.uniform(1.8, 2.2))
        for name, pulls in (("left", strong), ("right", not strong)):
            points[name].append([time, upper if pulls else lower])
    return points


def scenario(kind: str, plant: str, seed: int) -> Scenario:
    """Return a scenario drawn from a seed.

    Ramps pull one side by 4.3 to 5.2 N, the other by 1.8 to 2.2 N (into the stops: 5 to 8 N) and
    change over every 1 to 2 s, so that the link moves; weights are hung every 1.5 to 2.5 s, 2 to 5
    N (2 to 8 N); servos move both sliders against each other. The link starts where the filter's
    prior says it may. Args: kind: one of `SCENARIOS`. plant: one of `PLANTS`. seed: of the draw.
    """
    rng = np.random.default_rng([seed, SCENARIOS.index(kind)])
    high = 8.0 if "stops" in kind else 5.0
    drives: dict[str, Any] = {}
    frequency, amplitude, centre = (
        rng.uniform(0.15, 0.5),
        rng.uniform(3e-3, 5e-3),
        rng.uniform(3e-3, 6e-3),
    )
    alternating = _alternating(rng, high)
    for side, name in ((1, "left"), (-1, "right")):
        if kind.startswith("ramps"):
            drives[name] = {"force": {"points": alternating[name], "interpolation": "linear"}}
        elif kind.startswith("weights"):
            drives[name] = {"weight": _points(rng, (1.5, 2.5), 2.0, high)}
        else:
            position = {"mean": centre, "amplitude": side * amplitude, "frequency": frequency}
            drives[name] = {"servo": {"position": position, "stiffness": 5000.0, "damping": 5.0}}
    # the filter takes 0 ± 3° for the start
    start = {"link": float(np.deg2rad(np.clip(rng.normal(0, 3), -6, 6)))}
    raw = {
        "rig": "paper-2008-printed",
        "duration": DURATION,
        "plant": PLANTS[plant],
        "drives": drives,
        "initial": start,
        "name": kind,
    }
    return build_scenario(raw, f"{kind}, seed {seed}")


def paper_log(kind: str, plant: str, seed: int) -> Log:
    """Return a simulated log of the paper's rig."""
    return simulate(paper_rig(plant), scenario(kind, plant, seed), seed)


HAND_FRICTION: dict[str, Any] = {"given": 0.15, "unknown": {"value": 0.05, "std": 0.15}}


def hand_rig(friction: str) -> Rig:
    """Return the pulley rig as it is read where a hand may turn the link: friction given, or hardly
    known.
    """
    value = HAND_FRICTION[friction]
    values = {
        "drives.0.friction.load": value,
        "drives.1.friction.load": value,
        "joints.0.external_torque.std": "0.1 N m",
    }
    return load_rig("pulley-antagonist").with_values(values)


def hand_log(seed: int) -> Log:
    """Return a simulated log of the pulley rig, its link turned by a hand against constant pulls
    and sheath friction.
    """
    rng = np.random.default_rng([seed, 99])
    start = angle = float(rng.uniform(-5, 5))
    time, points = 0.0, []
    while time < DURATION:
        hold, move, after = (
            rng.uniform(0.3, 0.8),
            rng.uniform(0.5, 1.2),
            float(rng.uniform(-14, 14)),
        )
        points.append([float(time), float(np.deg2rad(angle))])
        for part in np.linspace(0, 1, 12):
            blend = angle + (after - angle) * (1 - np.cos(np.pi * part)) / 2
            points.append([float(time + hold + part * move), float(np.deg2rad(blend))])
        time, angle = time + hold + move, after
    pull = float(rng.uniform(2.8, 4.0))
    raw = {
        "rig": "pulley-antagonist",
        "duration": DURATION,
        "initial": {"link": float(np.deg2rad(start))},
        "plant": {"drives.0.friction.load": 0.15, "drives.1.friction.load": 0.15},
        "drives": {"left": {"force": pull}, "right": {"force": pull}},
        "joints": {"link": {"hand": {"angle": points, "stiffness": 3.0}}},
    }
    return simulate(load_rig("pulley-antagonist"), build_scenario(raw, f"hand, seed {seed}"), seed)


def spoiled(log: Log, seed: int) -> Log:
    """Return the log with 30 % of each sensor's samples missing, 2 % wild (20 to 200 σ) and a gap
    of 0.5 s.
    """
    rng = np.random.default_rng([seed, 7])
    sigma = {"x1": 5e-6, "x2": 5e-6, "u1": 0.3, "u2": 0.3}
    channels = {}
    for name, values in log.channels.items():
        spoilt = np.array(values)
        if name in sigma:
            wild = rng.random(len(spoilt)) < 0.02
            size = (
                sigma[name] * rng.uniform(20, 200, len(spoilt)) * rng.choice([-1, 1], len(spoilt))
            )
            spoilt = np.where(wild, spoilt + size, spoilt)
            spoilt[rng.random(len(spoilt)) < 0.3] = np.nan
        channels[name] = spoilt
    whole = Log(log.time, channels, dict(log.truth), log.source)
    start = float(rng.uniform(3, 8))
    return whole.select((whole.time < start) | (whole.time > start + 0.5))
