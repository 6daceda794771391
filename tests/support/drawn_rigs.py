"""Descriptions of rigs that nobody built, as a user would write them, of one to three joints, and
true numbers for them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from distal.arrays import Floats

Raw = dict[str, Any]

RATE = 100.0
"""Of all sensors [Hz]."""
WIDER = 1.25
"""How far the widest motion goes, beside the others."""

LAYOUTS: dict[str, list[list[tuple[int, int]]]] = {
    "pair 1": [[(0, 1)], [(0, -1)]],
    "each 1": [[(0, 1)], [(0, -1)]],
    "spring 1": [[(0, 1)]],
    "pair 2": [[(0, 1)], [(0, -1)], [(0, 1), (1, 1)], [(0, -1), (1, -1)]],
    "each 2": [[(0, 1)], [(0, -1)], [(0, 1), (1, 1)], [(0, -1), (1, -1)]],
    "crossed 2": [[(0, 1), (1, 1)], [(0, 1), (1, -1)], [(0, -1)]],
    "spring 2": [[(0, 1)], [(0, 1), (1, 1)]],
    "pair 3": [[(j, side) for j in range(n + 1)] for n in range(3) for side in (1, -1)],
    "crossed 3": [
        [(0, 1), (1, 1), (2, 1)],
        [(0, 1), (1, -1), (2, -1)],
        [(0, -1), (1, 1)],
        [(0, -1), (1, -1)],
    ],
    "spring 3": [[(j, 1) for j in range(n + 1)] for n in range(3)],
}
"""Joints and sides that each tendon crosses. In a "pair" one capstan winds two tendons, else each
tendon has its drive.
"""


@dataclass(frozen=True)
class Drawn:
    """A rig that nobody built, and the plant that it describes.

    Args:
        raw: its description.
        truth: the plant's numbers by path.
        inert: whether joints have inertia and damping.
        kind: layout and drives.
        tension: usual tension [N].
        reach: of the joints to both sides [rad], (j,).
        pressed: where drives go on to while joints stand in their stops [rad], (j,); 0 without
            stops.
        offsets: of the encoders [rad], (j,).
    """

    raw: Raw
    truth: dict[str, float]
    inert: bool
    kind: str
    tension: float
    reach: Floats
    pressed: Floats
    offsets: Floats


def parameters(part: Any, path: str = "") -> dict[str, Raw]:
    """Return what of a raw rig has a std, by path, but for what is of a log or an encoder: first
    angles, offsets, loads.
    """
    if isinstance(part, dict) and "value" in part:
        return {path: part}
    if isinstance(part, dict) and part.get("measures") == "angle":
        return {}
    found: dict[str, Raw] = {}
    if isinstance(part, (dict, list)):
        for key, inner in part.items() if isinstance(part, dict) else enumerate(part):
            if key not in ("initial", "nominal_force"):
                found |= parameters(inner, f"{path}.{key}".lstrip("."))
    return found


def units(raw: Raw) -> dict[str, list[str]]:
    """Return the numbers that err as one, by the path of the first: those that share a name, or one
    alone.
    """
    found: dict[str, list[str]] = {}
    first: dict[str, str] = {}
    for path, number in parameters(raw).items():
        name = number["shared"]["name"] if "shared" in number else path
        found.setdefault(first.setdefault(name, path), []).append(path)
    return found


def spread(number: Raw) -> float:
    """Return the std of a number."""
    return float(number["value"] * number["shared"]["std"] if "shared" in number else number["std"])


def true_parameters(raw: Raw, rng: np.random.Generator) -> dict[str, float]:
    """Return numbers by path, normal about those of a rig; what is positive there stays above a
    tenth of itself.
    """
    known, found = parameters(raw), dict[str, float]()
    for paths in units(raw).values():
        least = [
            0.1 * known[path]["value"] if known[path]["value"] > 0.0 else -np.inf for path in paths
        ]
        values = least
        while any(value <= low for value, low in zip(values, least)):
            z = rng.normal()
            values = [known[path]["value"] + spread(known[path]) * z for path in paths]
        found |= dict(zip(paths, values))
    return found


def settled(part: Any, values: Mapping[str, float], path: str = "") -> Any:
    """Return a raw rig with plain numbers: those given by path, else its own; what is of a log
    keeps its std.
    """
    if isinstance(part, dict) and "value" in part:
        return (
            part
            if path.endswith((".initial", ".nominal_force"))
            else values.get(path, part["value"])
        )
    if isinstance(part, dict):
        return {
            key: settled(inner, values, f"{path}.{key}".lstrip(".")) for key, inner in part.items()
        }
    if isinstance(part, list):
        return [settled(inner, values, f"{path}.{key}") for key, inner in enumerate(part)]
    return part


class Draw:
    """One draw of a rig; its sizes follow from an arm, a tension, and the angle by which that
    stretches a tendon.
    """

    def __init__(self, seed: int) -> None:
        self.rng = rng = np.random.default_rng([seed, 71])
        self.inert, n = bool(seed % 2), int(rng.choice([1, 2, 3], p=[0.5, 0.3, 0.2]))
        self.layout = str(rng.choice([name for name in LAYOUTS if name.endswith(str(n))]))
        self.crossed, self.n = LAYOUTS[self.layout], n
        self.pair, self.sprung = self.layout.startswith("pair"), self.layout.startswith("spring")
        self.capstan = self.pair or self.often(0.4)
        self.arm, self.tension = self.between(5e-3, 14e-3), self.between(3.0, 20.0)
        self.turn = self.between(0.02, 0.3 if n == 1 else 0.1)
        self.lever = self.between(5e-3, 12e-3) if self.capstan else 1.0
        self.reach = np.deg2rad(rng.uniform(20, 40, n) if n == 1 else rng.uniform(15, 30, n))
        self.ends = WIDER * self.reach + np.deg2rad(8)
        self.arms = np.zeros((len(self.crossed), n))
        for t, crossed in enumerate(self.crossed):
            for j, side in crossed:
                second = self.pair and t % 2 == 1  # on the same pulley as the one before
                self.arms[t, j] = (
                    -self.arms[t - 1, j] if second else side * self.arm * rng.uniform(0.8, 1.1)
                )
        self.stiffness = self.tension / (
            self.turn * np.array([np.abs(row[row != 0.0]).mean() for row in self.arms])
        )
        self.alike = len(self.crossed) > 1 and self.often(0.4)
        if self.alike:
            self.stiffness[:] = self.stiffness.mean()

    def often(self, share: float) -> bool:
        return bool(self.rng.random() < share)

    def between(self, low: float, high: float) -> float:
        """Return a number whose logarithm is uniform."""
        return float(np.exp(self.rng.uniform(np.log(low), np.log(high))))

    def about(self, value: float, low: float, high: float) -> Raw:
        """Return a number whose std is a share of it between two."""
        return {"value": value, "std": abs(value) * float(self.rng.uniform(low, high))}

    def tendons(self) -> list[Raw]:
        precision, softness = self.rng.uniform(0.01, 0.03), self.rng.uniform(0.1, 0.25)
        rubs = (self.between(0.03, 0.15), self.between(0.5, 3.0)) if self.often(0.3) else None
        slack, made = self.sprung and self.often(0.5), []
        for t, crossed in enumerate(self.crossed):
            drive, stiffness = t // 2 if self.pair else t, self.stiffness[t]
            tendon: Raw = {
                "name": f"tendon{t}",
                "drive": f"drive{drive}",
                "stiffness": self.about(stiffness, 0.1, 0.25),
            }
            if self.alike:
                tendon["stiffness"] = {
                    "value": stiffness,
                    "shared": {"name": "rope", "std": softness},
                }
            ends = [
                {"kind": "pulley", "radius": self.about(abs(self.arms[t, j]), precision, precision)}
                for j, _ in crossed
            ]
            if self.n == 1:
                tendon |= {"joint": "joint0", "side": crossed[0][1], "insertion": ends[0]}
            else:
                tendon["crossings"] = [
                    {**e, "joint": f"joint{j}", "side": side} for e, (j, side) in zip(ends, crossed)
                ]
            if self.pair:
                tendon["pretension"] = self.about(self.tension, 0.15, 0.3)
            elif slack:
                tendon["slack"] = self.about(self.arm * self.rng.uniform(0.03, 0.08), 0.2, 0.4)
            if rubs:
                tendon["path"] = {"friction": self.about(rubs[0], 0.2, 0.4), "wrap": rubs[1]}
            made.append(tendon)
        return made

    def joint(self, j: int, stops: bool) -> Raw:
        held, stiff = (
            self.tension * np.abs(self.arms[:, j]).sum(),
            self.stiffness @ self.arms[:, j] ** 2,
        )
        inertia = (
            stiff
            / (2 * np.pi * (self.between(3.0, 12.0) if self.inert else self.between(20.0, 40.0)))
            ** 2
        )
        damping = (
            2
            * np.sqrt(stiff * inertia)
            * (self.between(0.1, 0.5) if self.inert else self.between(0.01, 0.03))
        )
        made: Raw = {"name": f"joint{j}", "inertia": inertia, "damping": damping}
        made["initial"] = {"value": 0.0, "std": np.deg2rad(5.0)}
        if self.inert:
            made["damping"] = self.about(damping, 0.3, 0.5)
            made["inertia"] = self.about(inertia, 0.1, 0.2) if self.often(0.5) else inertia
        axle = self.arm * self.rng.uniform(0.1, 0.3)
        made["friction"] = {
            "coefficient": self.about(self.between(0.05, 0.3), 0.2, 0.4),
            "radius": axle,
        }
        if self.often(0.5):
            made["friction"]["preload"] = self.about(
                self.tension * self.rng.uniform(0.2, 1.0), 0.15, 0.3
            )
        if self.sprung or self.often(0.3):
            # against tendons of one side it holds their tension at 0
            share = 0.1 if not self.sprung else 0.5 if self.n == 1 else 0.2
            rest = -self.reach[j] / share if self.sprung else 0.0
            made["spring"] = {"stiffness": self.about(share * held / self.reach[j], 0.05, 0.15)}
            made["spring"]["rest_angle"] = {
                "value": rest,
                "std": np.deg2rad(self.rng.uniform(1, 3)),
            }
        if self.n == 1 and self.often(0.3):
            distance = self.arm * self.rng.uniform(2, 5)
            mass = self.about(0.2 * held / (9.81 * distance), 0.05, 0.15)
            made["gravity"] = {
                "mass": mass,
                "distance": distance,
                "hanging_angle": self.rng.uniform(-1.0, 1.0),
            }
        if stops:
            made["stops"] = [-self.ends[j], self.ends[j]]
        return made

    def drives(self) -> list[Raw]:
        constant, load = (
            self.between(0.01, 0.06) * self.tension * self.lever,
            self.between(0.01, 0.12),
        )
        drag = (
            self.between(0.03, 0.1) * self.tension * self.lever**2 / (0.5 * self.arm)
            if self.often(0.3)
            else 0.0
        )
        made = []
        for d in range(len(self.crossed) // (2 if self.pair else 1)):
            drive: Raw = {"name": f"drive{d}", "kind": "slider", "mass": 0.01}
            if self.capstan:
                drive |= {"kind": "capstan", "radius": self.lever, "inertia": 0.01 * self.lever**2}
                del drive["mass"]
            drive["friction"] = {
                "constant": self.about(constant, 0.2, 0.4),
                "load": self.about(load, 0.2, 0.4),
            }
            if drag:
                drive["damping"] = self.about(drag, 0.2, 0.4)
            usual = self.tension * self.lever
            side = 0.0 if self.pair else self.crossed[d][0][1] if self.capstan else 1.0
            made.append(drive | {"nominal_force": {"value": side * usual, "std": 0.5 * usual}})
        return made

    def sensors(self, drives: int) -> list[Raw]:
        noise, rough = self.between(1e-4, 6e-4) * self.arm / self.lever, self.between(0.005, 0.03)
        coarse, zeros, drifts, gains = (
            self.often(0.3),
            self.often(0.2),
            self.often(0.25),
            self.often(0.3),
        )
        usual, made = self.tension * self.lever, list[Raw]()
        for d in range(drives):
            position: Raw = {
                "name": f"x{d}",
                "measures": "position",
                "of": f"drive{d}",
                "rate": RATE,
                "noise": noise,
            }
            force: Raw = {
                "name": f"u{d}",
                "measures": "force",
                "of": f"drive{d}",
                "rate": RATE,
                "noise": rough * usual,
            }
            if coarse:
                position["resolution"] = 2.0 * noise
            if zeros:
                off = np.deg2rad(self.rng.uniform(0.2, 0.5)) * self.arm / self.lever
                position["bias"] = {"value": 0.0, "std": off}
            if gains:
                force["gain"] = {"value": 1.0, "std": self.rng.uniform(0.005, 0.02)}
            if drifts:
                force["bias"] = {"value": 0.0, "std": self.rng.uniform(0.01, 0.03) * usual}
            made += [position, force]
        fine, off = np.deg2rad(self.rng.uniform(0.03, 0.1)), np.deg2rad(self.rng.uniform(0.05, 0.2))
        for j in range(self.n):
            encoder = {
                "name": f"encoder{j}",
                "measures": "angle",
                "of": f"joint{j}",
                "rate": RATE,
                "noise": fine,
            }
            made.append({**encoder, "bias": {"value": 0.0, "std": off}})
        return made


def drawn_rig(seed: int, stops: bool) -> Drawn:
    """Return the rig and the plant of a seed; plants of even seeds have no inertia."""
    draw = Draw(seed)
    joints, drives = [draw.joint(j, stops) for j in range(draw.n)], draw.drives()
    raw = {"name": f"drawn {seed}", "joints": joints, "drives": drives, "tendons": draw.tendons()}
    raw["sensors"] = draw.sensors(len(drives))
    raw = json.loads(json.dumps(raw, default=float))  # plain numbers, and no two parts that are one
    off = [one["bias"]["std"] for one in raw["sensors"] if one["measures"] == "angle"]
    pressed = draw.ends + 1.5 * draw.turn + np.deg2rad(2) if stops else np.zeros(draw.n)
    kind = f"{draw.layout}, {'capstans' if draw.capstan else 'sliders'}"
    truth, offsets = true_parameters(raw, draw.rng), np.array(off) * draw.rng.normal(size=draw.n)
    return Drawn(raw, truth, draw.inert, kind, draw.tension, draw.reach, pressed, offsets)
