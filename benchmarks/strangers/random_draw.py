"""One draw of a rig that nobody built, and of a motion for it, as raw descriptions."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

DURATION = 8.0
"""Of each log [s]."""

COUNTS, COUNT_SHARES = (1, 2, 3, 4, 5), (0.25, 0.40, 0.13, 0.12, 0.10)
"""How many tendons, and how often."""

OFTEN, HALF, AT_TIMES, SELDOM = 0.7, 0.5, 0.3, 0.2
"""How often a rig has a feature."""


class Draw:
    """One draw of a rig and of its motion; all sizes follow from the joint's radius, a tension and
    a stretch.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self.rate = float(rng.choice([50.0, 100.0, 100.0, 200.0]))
        self.n = int(rng.choice(COUNTS, p=COUNT_SHARES))
        self.radius = self.between(4e-3, 25e-3)
        self.tension = self.between(2.0, 30.0)
        self.capstan = self.n >= 2 and self.often(0.4)
        self.sides = self.drawn_sides()
        self.one_sided = len(set(self.sides)) == 1
        self.forces = self.often(OFTEN)
        self.alike = self.often(0.6)
        turn = self.between(0.01, 0.4)  # by which angle the base tension stretches a tendon
        softness = np.exp(rng.uniform(-0.4, 0.4, self.n)) if not self.alike else np.ones(self.n)
        self.stiffness = np.clip(self.tension / (self.radius * turn) * softness, 200.0, 1e5)
        relative = float(rng.uniform(0.03, 0.15))
        self.relative = [
            relative if self.alike else float(rng.uniform(0.03, 0.15)) for _ in range(self.n)
        ]
        self.pinned = self.radius < 15e-3 and self.often(AT_TIMES)
        self.spring = self.gravity = None
        if self.one_sided or self.often(AT_TIMES):
            self.spring = self.drawn_spring()
        if self.often(AT_TIMES):
            self.gravity = self.drawn_gravity()
        self.drives = self.drawn_drives()

    def often(self, probability: float) -> bool:
        return bool(self.rng.random() < probability)

    def between(self, low: float, high: float) -> float:
        """Return a number whose logarithm is uniform."""
        return float(np.exp(self.rng.uniform(np.log(low), np.log(high))))

    def known(self, value: float, low: float, high: float) -> dict[str, float]:
        """Return a parameter with a relative std between two shares."""
        return {"value": value, "std": abs(value) * float(self.rng.uniform(low, high))}

    def drawn_sides(self) -> list[int]:
        if self.n == 1:
            return [int(self.rng.choice([-1, 1]))]
        if self.capstan or self.often(0.9):  # one tendon each way, the others anywhere
            return [1, -1, *(int(side) for side in self.rng.choice([-1, 1], self.n - 2))]
        return [int(self.rng.choice([-1, 1]))] * self.n

    def drawn_spring(self) -> dict[str, Any]:
        stiffness = self.tension * self.radius * float(self.rng.uniform(0.5, 1.5))
        rest = 0.0
        if self.one_sided:  # it holds the base tension of all tendons at θ = 0
            rest = -self.sides[0] * self.n * self.tension * self.radius / stiffness
        else:
            rest = float(self.rng.uniform(-0.3, 0.3))
        angle = {
            "value": rest,
            "std": float(np.deg2rad(self.rng.uniform(0.5, 3.0))) if self.often(HALF) else 0.0,
        }
        return {"stiffness": self.known(stiffness, 0.03, 0.1), "rest_angle": angle}

    def drawn_gravity(self) -> dict[str, Any]:
        distance = self.radius * float(self.rng.uniform(2, 6))
        mass = self.tension * self.radius * float(self.rng.uniform(0.1, 0.6)) / (9.81 * distance)
        hanging = float(self.rng.uniform(-np.pi / 2, np.pi / 2))
        return {
            "mass": self.known(mass, 0.01, 0.05),
            "distance": self.known(distance, 0.01, 0.05),
            "hanging_angle": hanging,
        }

    def drawn_drives(self) -> list[dict[str, Any]]:
        """Return for each drive its tendons, its kind and its own description."""
        groups = [[0, 1]] if self.capstan else []
        for i in range(2 if self.capstan else 0, self.n):
            mates = [
                g
                for g in groups[self.capstan :]
                if len(g) == 1 and self.sides[g[0]] == self.sides[i]
            ]
            if mates and self.n >= 3 and self.often(SELDOM):
                mates[0].append(i)
            else:
                groups.append([i])
        return [
            self.motor(g) if self.capstan and k == 0 else self.slider(k, g)
            for k, g in enumerate(groups)
        ]

    def slider(self, index: int, tendons: list[int]) -> dict[str, Any]:
        load = self.known(self.between(2e-3, 0.15), 0.1, 0.4)
        friction: dict[str, Any] = {"load": load}
        if self.often(AT_TIMES):
            friction["constant"] = self.known(
                self.tension * float(self.rng.uniform(0.01, 0.08)), 0.1, 0.3
            )
        drive = {
            "name": f"slider{index}",
            "kind": "slider",
            "mass": self.between(2e-3, 80e-3),
            "damping": self.between(0.05, 5.0),
            "friction": friction,
            "nominal_force": {
                "value": len(tendons) * self.tension,
                "std": len(tendons) * self.tension * 0.5,
            },
        }
        if self.often(HALF):
            reach = self.radius * float(self.rng.uniform(0.6, 1.2))
            centre = self.tension / float(self.stiffness[tendons[0]])
            drive["stops"] = [centre - reach, centre + reach]
        return {"tendons": tendons, "arm": 1.0, "description": drive}

    def motor(self, tendons: list[int]) -> dict[str, Any]:
        arm = self.between(4e-3, 12e-3)
        friction: dict[str, Any] = {"load": self.known(self.between(5e-3, 0.1), 0.1, 0.4)}
        if self.often(OFTEN):
            friction["constant"] = self.known(
                self.tension * arm * self.between(0.01, 0.3), 0.1, 0.3
            )
        drive: dict[str, Any] = {
            "name": "motor",
            "kind": "capstan",
            "inertia": self.between(0.3, 30.0) * 0.05 * arm**2,
            "radius": arm,
            "damping": self.between(1e-4, 3e-3),
            "friction": friction,
        }
        if self.often(SELDOM):
            drive["hysteresis"] = {
                "constant": self.known(self.tension * arm * self.between(0.05, 0.2), 0.1, 0.3)
            }
        return {"tendons": tendons, "arm": arm, "description": drive}

    def tendon(self, index: int) -> dict[str, Any]:
        drive = next(d for d in self.drives if index in d["tendons"])
        radius: Any = self.known(self.radius, 0.002, 0.01) if self.often(HALF) else self.radius
        insertion = {"kind": "pulley", "radius": radius}
        if self.pinned:
            insertion = {
                "kind": "pinned",
                "radius": radius,
                "free_length": float(self.rng.uniform(0.1, 0.4)),
            }
        stiffness = float(self.stiffness[index])
        made = {
            "name": f"tendon{index}",
            "joint": "link",
            "drive": drive["description"]["name"],
            "side": self.sides[index],
            "insertion": insertion,
            "stiffness": self.stiffness_of(index),
            "damping": stiffness * self.between(1e-5, 1e-3),
        }
        if drive["description"]["kind"] == "capstan":
            made["pretension"] = self.known(2.0 * self.tension, 0.05, 0.2)
        if self.bends is not None:
            made["path"] = {"friction": self.known(self.bends[0], 0.1, 0.3), "wrap": self.bends[1]}
        return made

    def stiffness_of(self, index: int) -> dict[str, Any]:
        """Return a tendon's stiffness: those of one make err together, others alone."""
        value, relative = float(self.stiffness[index]), self.relative[index]
        if self.alike and self.n > 1:
            return {"value": value, "shared": {"name": "tendons.stiffness", "std": relative}}
        return {"value": value, "std": value * relative}

    def joint(self) -> dict[str, Any]:
        mode = self.between(3.0, 40.0)  # [Hz]
        mode = min(mode, 0.7 * self.rate)
        stiffness = float(np.sum(self.stiffness)) * self.radius**2
        inertia = stiffness / (2 * np.pi * mode) ** 2
        self.mode = mode
        made: dict[str, Any] = {
            "name": "link",
            "inertia": inertia,
            "damping": 2.0 * self.between(0.02, 0.5) * np.sqrt(stiffness * inertia),
            "initial": {"value": 0.0, "std": float(np.deg2rad(self.rng.uniform(1.0, 4.0)))},
        }
        if self.often(0.9):
            made["friction"] = {
                "coefficient": self.known(self.between(0.03, 0.5), 0.1, 0.3),
                "radius": self.radius * float(self.rng.uniform(0.1, 0.35)),
            }
            if self.often(HALF):
                made["friction"]["preload"] = self.known(
                    self.tension * float(self.rng.uniform(0.1, 1.0)), 0.1, 0.2
                )
        if self.spring is not None:
            made["spring"] = self.spring
        if self.gravity is not None:
            made["gravity"] = self.gravity
        return made

    def sensors(self) -> list[dict[str, Any]]:
        """Return a position sensor of each drive and, in seven rigs of ten, its force or torque."""
        made = []
        noise, linearity = (
            self.between(2e-4, 3e-3),
            self.between(2e-3, 1.5e-2) if self.often(0.6) else 0.0,
        )
        bias, force = (
            self.between(1e-3, 1e-2) if self.often(AT_TIMES) else 0.0,
            self.between(0.01, 0.1),
        )
        force_bias = self.between(0.01, 0.05) if self.often(AT_TIMES) else 0.0
        coarse = self.often(AT_TIMES)
        for drive in self.drives:
            name, length = drive["description"]["name"], self.radius
            pull = len(drive["tendons"]) * self.tension
            if drive["description"]["kind"] == "capstan":
                length, pull = self.radius / drive["arm"], self.tension * drive["arm"]
            sensor = {"name": f"x_{name}", "measures": "position", "of": name, "rate": self.rate}
            sensor |= {"noise": length * noise, "linearity": length * linearity}
            if coarse:
                sensor["resolution"] = 2.0 * length * noise
            if bias:
                sensor["bias"] = {"value": 0.0, "std": length * bias}
            made.append(sensor)
            if self.forces:
                sensor = {
                    "name": f"u_{name}",
                    "measures": "force",
                    "of": name,
                    "rate": self.rate,
                    "noise": pull * force,
                }
                if force_bias:
                    sensor["bias"] = {"value": 0.0, "std": pull * force_bias}
                made.append(sensor)
        return made

    def raw(self) -> tuple[dict[str, Any], dict[str, Any], str]:
        """Return the raw rig, the raw scenario without its plant, and the rig in words."""
        self.bends = (
            (self.between(0.03, 0.15), float(self.rng.uniform(0.5, 3.0)))
            if self.often(SELDOM)
            else None
        )
        joint = self.joint()
        rig = {
            "name": "random rig",
            "joints": [joint],
            "drives": [drive["description"] for drive in self.drives],
            "tendons": [self.tendon(i) for i in range(self.n)],
            "sensors": self.sensors(),
        }
        start = float(np.clip(self.rng.normal(), -2, 2)) * joint["initial"]["std"]
        times, angles = self.motion(start)
        scenario = {
            "name": "random rig",
            "duration": DURATION,
            "initial": {"link": start},
            "drives": self.pulls(times, angles),
        }
        return rig, scenario, self.words()

    def motion(self, start: float) -> tuple[Floats, Floats]:
        """Return what the joint should do: a sine, ramps with rests, or steps, about its start."""
        times = np.arange(0.0, DURATION + 0.01, 0.01)
        reach = float(np.deg2rad(self.rng.uniform(10, 30 if self.pinned else 40)))
        kind = str(self.rng.choice(["sine", "ramps", "ramps", "steps"]))
        if kind == "sine":
            frequency = float(self.rng.uniform(0.15, 0.7))
            return times, start + reach * np.sin(2 * np.pi * frequency * times) * np.minimum(
                times, 1.0
            )
        knots, time, angle = [(0.0, start), (0.5, start)], 0.5, start
        while time < DURATION:
            move = float(self.rng.uniform(0.3, 1.2)) if kind == "ramps" else 0.04
            angle = start + float(self.rng.uniform(-reach, reach))
            knots += [(time + move, angle)]
            time += move + float(self.rng.uniform(0.3, 1.0))
            knots += [(time, angle)]
        made = np.array(knots)
        return times, np.interp(times, made[:, 0], made[:, 1])

    def pulls(self, times: Floats, angles: Floats) -> dict[str, Any]:
        """Return what pulls each drive: servos, or forces where a spring brings the joint back."""
        torque = np.zeros_like(angles)
        if self.spring is not None:
            stiffness, rest = self.spring["stiffness"]["value"], self.spring["rest_angle"]["value"]
            torque += stiffness * (angles - rest)
        if self.gravity is not None:
            weight = self.gravity["mass"]["value"] * 9.81 * self.gravity["distance"]["value"]
            torque += weight * np.sin(angles - self.gravity["hanging_angle"])
        by_force = self.spring is not None and not self.capstan and self.often(HALF)
        constant = not self.one_sided and not self.capstan and not by_force and self.often(AT_TIMES)
        made = {}
        for k, drive in enumerate(self.drives):
            tendons, arm, name = drive["tendons"], drive["arm"], drive["description"]["name"]
            if drive["description"]["kind"] == "capstan":
                stiffness = float(np.sum(self.stiffness[tendons])) * arm**2
                gain = stiffness * self.between(2.0, 10.0)
                inertia = drive["description"]["inertia"]
                # the torque that the joint's load asks for twists the tendons and the position loop
                twist = torque * arm / self.radius * (1 / stiffness + 1 / gain)
                servo = {
                    "angle": _points(times, angles * self.radius / arm + twist),
                    "stiffness": gain,
                    "damping": 1.4 * float(np.sqrt((gain + stiffness) * inertia)),
                }
                made[name] = {"servo": servo}
                continue
            side = self.sides[tendons[0]]
            load = self.loads(torque, side)
            stiffness = float(np.sum(self.stiffness[tendons]))
            if by_force or (constant and k == 1):
                level = load if by_force else np.full_like(load, self.tension)
                made[name] = {
                    "force": {
                        "points": _points(times, len(tendons) * level),
                        "interpolation": "linear",
                    }
                }
                continue
            gain = stiffness * self.between(2.0, 10.0)
            pull = len(tendons) * load
            servo = {
                "position": _points(
                    times, side * self.radius * angles + pull / stiffness + pull / gain
                ),
                "stiffness": gain,
                "damping": 1.4 * float(np.sqrt((gain + stiffness) * drive["description"]["mass"])),
            }
            made[name] = {"servo": servo}
        return made

    def loads(self, torque: Floats, side: int) -> Floats:
        """Return the tension of each tendon on a side: the base tension, and its share of what the
        joint needs.
        """
        mates = self.sides.count(side)
        if self.one_sided:
            return np.maximum(side * torque / (self.radius * mates), 0.1 * self.tension)
        base = self.tension * self.n / (2.0 * mates)
        if self.capstan:  # the motor carries the joint's load; the sliders beside it pull evenly
            return np.full_like(torque, base)
        return base + np.maximum(side * torque, 0.0) / (self.radius * mates)

    def words(self) -> str:
        sliders = len(self.drives) - self.capstan
        kinds = (["capstan"] if self.capstan else []) + (
            [f"{sliders} slider{'s' * (sliders > 1)}"] if sliders else []
        )
        parts = [
            f"{self.n} tendon{'s' * (self.n > 1)}",
            " and ".join(kinds),
            "pinned" if self.pinned else "pulley",
        ]
        parts += [
            word
            for word, there in (("spring", self.spring), ("gravity", self.gravity))
            if there is not None
        ]
        parts += [
            "forces" if self.forces else "no forces",
            f"{self.mode:.0f} Hz mode at {self.rate:.0f} samples/s",
        ]
        return ", ".join(parts)


def _points(times: Floats, values: Floats) -> list[list[float]]:
    return [[float(t), float(v)] for t, v in zip(times, values)]
