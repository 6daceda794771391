"""Each part of the physics alone: simulated by a plant of its own, fitted from three logs, judged on a fourth.

`python -m benchmarks.parts [SEEDS]` (default 20). The plant shares no code with `distal.model`: a joint of one link between
two position-controlled tendons, integrated by RK4 at 0.1 ms in NumPy, with sensors' noise. Shown are how often a fitted
number is within two standard errors of the plant's, and the angle's error beside that of the filter that is given it.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import table
from distal import Log, Rig, estimate, fit
from distal.rig import build_rig

Floats = NDArray[np.float64]

RADIUS, STIFFNESS, INERTIA, DAMPING = 0.01, 2000.0, 2e-4, 6e-3
RATE, DURATION, STEP = 100.0, 8.0, 1e-4
NOISE = {"x1": 5e-6, "x2": 5e-6, "u1": 0.05, "u2": 0.05}
"""Of the sensors [m, N]; the encoder's is 0.05°."""


@dataclass(frozen=True)
class Part:
    """A part of the physics.

    Args:
        name: of the part.
        path: of the number that is not known.
        value: what the rig says.
        std: and how far it may be off.
        fixed: other values of the rig.
    """

    name: str
    path: str
    value: float
    std: float
    fixed: Mapping[str, Any]


SPRING = {"stiffness": 0.05, "rest_angle": 0.0}
BETWEEN = {
    "stiffness": 250.0, "free_length": 0.018, "radius": 0.009, "distance": 0.026, "line_angle": -0.9, "preload": 0.4,
}  # fmt: skip
PARTS = (
    Part("slack at home", "tendons.0.slack", 0.5e-3, 0.2e-3, {"joints.0.spring": SPRING}),
    Part("cubic spring", "joints.0.spring.cubic", 0.2, 0.1, {"joints.0.spring": {**SPRING, "cubic": 0.2}}),
    Part(
        "quadratic spring", "joints.0.spring.quadratic", 0.02, 0.008, {"joints.0.spring": {**SPRING, "quadratic": 0.02}}
    ),
    Part(
        "extension spring", "joints.0.extension_spring.stiffness", 250.0, 60.0, {"joints.0.extension_spring": BETWEEN}
    ),
    Part("its line", "joints.0.extension_spring.line_angle", -0.9, 0.15, {"joints.0.extension_spring": BETWEEN}),
)


def rig_of(part: Part, value: float | None = None) -> Rig:
    """Return the rig with what is not known of a part, or with its true number and no std."""
    sensors = [
        {
            "name": name,
            "measures": "position" if name[0] == "x" else "force",
            "of": side,
            "noise": NOISE[name],
            "rate": RATE,
        }
        for name, side in (("x1", "left"), ("u1", "left"), ("x2", "right"), ("u2", "right"))
    ]
    encoder = {"name": "encoder", "measures": "angle", "of": "link", "noise": np.deg2rad(0.05), "rate": RATE}
    tendons = [
        {
            "name": side,
            "joint": "link",
            "drive": side,
            "side": sign,
            "insertion": {"kind": "pulley", "radius": RADIUS},
            "stiffness": STIFFNESS,
        }
        for side, sign in (("left", 1), ("right", -1))
    ]
    drives = [{"name": side, "kind": "slider", "mass": 0.05, "nominal_force": 2.0} for side in ("left", "right")]
    joint = {"name": "link", "inertia": INERTIA, "damping": DAMPING, "initial": {"value": 0.0, "std": 0.1}}
    rig = build_rig(
        {"name": part.name, "joints": [joint], "drives": drives, "tendons": tendons, "sensors": [*sensors, encoder]},
        part.name,
    ).with_values(part.fixed)
    known = {"value": part.value, "std": part.std} if value is None else {"value": value, "std": 0.0}
    return rig.with_values({part.path: known})


def torque(part: Part, number: float, angle: float) -> float:
    """Return the springs' torque on the joint [N m]."""
    name, total = part.path.rpartition(".")[2], 0.0
    if "joints.0.spring" in part.fixed:
        spring = {"quadratic": 0.0, "cubic": 0.0, **part.fixed["joints.0.spring"]}
        if name in spring:
            spring[name] = number
        total -= spring["stiffness"] * angle + spring["quadratic"] * angle**2 + spring["cubic"] * angle**3
    if "joints.0.extension_spring" in part.fixed:
        own = {**part.fixed["joints.0.extension_spring"]}
        if part.path.startswith("joints.0.extension_spring"):
            own[name] = number
        ends = own["radius"] * np.exp(1j * (angle - own["line_angle"])), own["distance"]
        length = abs(ends[0] - ends[1])
        force = max(own["preload"] + own["stiffness"] * (length - own["free_length"]), 0.0)
        total -= force * own["radius"] * own["distance"] * np.sin(angle - own["line_angle"]) / length
    return float(total)


def log_of(part: Part, number: float, rng: np.random.Generator) -> Log:
    """Return a log of the plant with sensors' noise and its true angle."""
    slack = number if part.path.endswith("slack") else 0.0
    phase, fast = rng.uniform(0, 2 * np.pi, 2), rng.uniform(0.2, 0.5, 2)
    middle = 1e-3 + slack / 2

    def places(t: float) -> tuple[float, float]:
        turn = RADIUS * (
            0.45 * np.sin(2 * np.pi * fast[0] * t + phase[0]) + 0.2 * np.sin(2 * np.pi * fast[1] * t + phase[1])
        )
        both = middle * (1 + 0.5 * np.sin(2 * np.pi * 0.3 * t + phase[1]))
        return both + turn + slack / 2, both - turn

    def pulls(t: float, angle: float) -> tuple[float, float]:
        left, right = places(t)
        return (
            STIFFNESS * max(left - RADIUS * angle - slack, 0.0),
            STIFFNESS * max(right + RADIUS * angle, 0.0),
        )

    def rates(t: float, y: Floats) -> Floats:
        left, right = pulls(t, y[0])
        return np.array([y[1], (RADIUS * (left - right) + torque(part, number, y[0]) - DAMPING * y[1]) / INERTIA])

    every = round(1 / RATE / STEP)
    y, rows = np.zeros(2), []
    # it settles before the log begins
    for k in range(-round(1.0 / STEP), round(DURATION / STEP)):
        t = max(k, 0) * STEP
        if k >= 0 and k % every == 0:
            rows.append([t, *places(t), *pulls(t, y[0]), y[0]])
        later = t + (STEP if k >= 0 else 0.0)
        mid = (t + later) / 2
        a = rates(t, y)
        b = rates(mid, y + STEP / 2 * a)
        c = rates(mid, y + STEP / 2 * b)
        d = rates(later, y + STEP * c)
        y = y + STEP / 6 * (a + 2 * b + 2 * c + d)
    time, x1, x2, u1, u2, angle = np.array(rows).T
    clean = {"x1": x1, "x2": x2, "u1": u1, "u2": u2}
    channels = {name: values + NOISE[name] * rng.normal(size=len(time)) for name, values in clean.items()}
    return Log(time, channels, {"theta": angle}, f"{part.name}, {number:g}", "the plant")


def run(job: tuple[int, int]) -> tuple[int, float, float, float, float]:
    """Return part, error of its number in standard errors, RMS errors of both filters [°], share inside."""
    at, seed = job
    part, rng = PARTS[at], np.random.default_rng([seed, at, 11])
    number = part.value + part.std * float(np.clip(rng.normal(), -2, 2))
    *logs, judged = (log_of(part, number, rng) for _ in range(4))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = fit(logs, rig_of(part), workers=1, compiled=False)
        one = found[part.path]
        after = estimate(judged, found.rig.bare(), compiled=False)
        known = estimate(judged, rig_of(part, number), compiled=False)
    settled = judged.time > 0.5
    errors = [float(np.rad2deg(np.sqrt(np.mean(each.errors()[settled] ** 2)))) for each in (after, known)]
    inside = float(np.mean(np.abs(after.errors()[settled]) <= 1.96 * after.theta_std[settled]))
    return at, (one.value - number) / one.error, *errors, inside


def main() -> None:
    """Fit, judge, print."""
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    jobs = [(at, seed) for at in range(len(PARTS)) for seed in range(seeds)]
    with ProcessPoolExecutor() as pool:
        found = list(pool.map(run, jobs))
    rows = []
    for at, part in enumerate(PARTS):
        away, after, known, inside = (np.array(each) for each in list(zip(*(one for one in found if one[0] == at)))[1:])
        ratio = np.sqrt(np.mean(after**2) / np.mean(known**2))
        rows.append(
            [
                part.name,
                f"`{part.path}`",
                f"{np.mean(np.abs(away) <= 2):.0%}",
                f"{np.sqrt(np.mean(after**2)):.3f}",
                f"{np.sqrt(np.mean(known**2)):.3f}",
                f"{ratio:.2f}",
                f"{np.mean(inside):.0%}",
            ]
        )
    title = f"Each part alone: a plant of its own, fitted from three logs of {DURATION:g} s; {seeds} seeds"
    columns = [
        "part",
        "number",
        "within 2 standard errors",
        "RMS, fitted [°]",
        "RMS, plant known [°]",
        "ratio",
        "inside",
    ]
    table("parts", title, columns, rows)


if __name__ == "__main__":
    main()
