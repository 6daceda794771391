"""Helpers of several tests: one finite difference for every Jacobian, and the paper's equations
typed out naively.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from distal import Log
from distal.estimators.adaptive import FilterContext
from distal.rig import Rig, Sensor
from distal.sensor_models import SensorErrors
from distal.simulation import Scenario, build_scenario

Floats = NDArray[np.float64]

PULLEYS = {f"tendons.{i}.insertion": {"kind": "pulley", "radius": "9.53 mm"} for i in (0, 1)}
"""Insertions with which a wild displacement is a wild angle for estimators that trust it."""


def changed(log: Log, **columns: Floats) -> Log:
    """Return a log with other readings in some of its columns."""
    return replace(log, channels={**log.channels, **columns})


def finite_difference(
    function: Callable[[Floats], Floats], at: Floats, steps: Floats | float = 1e-6
) -> Floats:
    """Return the Jacobian of a function by central differences, (n_out, n_in)."""
    at = np.asarray(at, dtype=float)
    steps = np.broadcast_to(steps, at.shape)
    columns = []
    for i, step in enumerate(steps):
        shift = np.zeros_like(at)
        shift[i] = step
        columns.append(
            (np.asarray(function(at + shift)) - np.asarray(function(at - shift))) / (2 * step)
        )
    return np.column_stack(columns)


def at_parameters(context: FilterContext, expression: ca.SX) -> float:
    """Return an expression of the filter's inputs at the numbers of its rig."""
    parameters = context.mechanism.parameters
    return float(ca.Function("f", [parameters.symbols], [expression])(parameters.values))


@dataclass(frozen=True)
class NaiveRig:
    """The paper's rig as its equations stand (with the mends), in plain NumPy: what the model is
    checked against.
    """

    inertia: float = 4.239e-4
    mass: float = 1e-3
    k: float = 806.0
    r: float = 9.53e-3
    length: float = 0.375
    b_theta: float = 8e-3
    r_a: float = 3.18e-3
    mu_theta: float = 0.5
    t0: float = 4.9
    b_x: float = 0.01
    mu_x: float = 2e-3

    def geometry(self, theta: float, x1: float, x2: float) -> tuple[float, ...]:
        """Equations (4) to (7)."""
        across = self.r * (1 - np.cos(theta))
        a1, a2 = (
            self.length + x1 - self.r * np.sin(theta),
            self.length + x2 + self.r * np.sin(theta),
        )
        return (
            np.hypot(across, a1),
            np.hypot(across, a2),
            np.arctan2(across, a1),
            np.arctan2(across, a2),
        )

    def tensions(self, theta: float, x1: float, x2: float) -> tuple[float, float]:
        """Equations (8) and (9)."""
        l1, l2, _, _ = self.geometry(theta, x1, x2)
        return self.k * max(l1 - self.length, 0.0), self.k * max(l2 - self.length, 0.0)

    def tendon_forces(self, theta: float, x1: float, x2: float) -> Floats:
        """Torque τ1 − τ2 of (10) and (11), and −T cos φ of (2) and (3)."""
        _, _, phi1, phi2 = self.geometry(theta, x1, x2)
        t1, t2 = self.tensions(theta, x1, x2)
        tau1 = t1 * self.r * (np.cos(theta) * np.cos(phi1) - np.sin(theta) * np.sin(phi1))
        tau2 = t2 * self.r * (np.cos(theta) * np.cos(phi2) + np.sin(theta) * np.sin(phi2))
        return np.array([tau1 - tau2, -t1 * np.cos(phi1), -t2 * np.cos(phi2)])

    def limits(self, theta: float, x1: float, x2: float) -> Floats:
        """Coulomb limits of (12) and (13)."""
        t1, t2 = self.tensions(theta, x1, x2)
        return np.array(
            [self.mu_theta * self.r_a * (self.t0 + t1 + t2), self.mu_x * t1, self.mu_x * t2]
        )

    @property
    def inertias(self) -> Floats:
        return np.array([self.inertia, self.mass, self.mass])

    @property
    def dampings(self) -> Floats:
        return np.array([self.b_theta, self.b_x, self.b_x])

    def interval(
        self, q: Floats, v: Floats, effort: Floats, dt: float, count: int
    ) -> tuple[Floats, Floats]:
        """Kick–drift–kick, written as it reads; no stops."""
        h = dt / count

        def kick(q: Floats, v: Floats, length: float) -> Floats:
            a = np.exp(-self.dampings * length / self.inertias)
            b = (1 - a) / self.dampings
            z = a * v + b * (self.tendon_forces(*q) + effort)
            limit = b * self.limits(*q)
            return np.maximum(z - limit, 0) + np.minimum(z + limit, 0)

        for i in range(count):
            v = kick(q, v, h / 2 if i == 0 else h)
            q = q + h * v
        return q, kick(q, v, h / 2)

    def derivative(self, state: Floats, effort: Floats, width: Floats) -> Floats:
        """ẏ with sgn smoothed to tanh(v/width): what a general ODE solver needs."""
        q, v = state[:3], state[3:]
        friction = self.limits(*q) * np.tanh(v / width) + self.dampings * v
        return np.concatenate([v, (self.tendon_forces(*q) + effort - friction) / self.inertias])


def without_stops(rig: Rig) -> Rig:
    """Return the rig with stops far outside every motion."""
    return rig.with_values({"drives.0.stops": [-0.5, 0.5], "drives.1.stops": [-0.5, 0.5]})


def rms_degrees(values: Floats) -> float:
    """Return the root mean square of angles [rad] in degrees."""
    return float(np.rad2deg(np.sqrt(np.mean(np.square(values)))))


def measure(
    sensor: Sensor, true: Floats, travel: tuple[float, float], rng: np.random.Generator
) -> Floats:
    """Return what a sensor reads over a whole run, (n,), of `true` values [SI] over a `travel`
    [SI]; see `SensorErrors`.
    """
    return SensorErrors(sensor, travel, rng).read(true)


def turned_capstan(duration: float, **more: object) -> Scenario:
    """Return what turns the motor of the shipped capstan to and fro, for some seconds."""
    servo = {"angle": {"amplitude": 0.5, "frequency": 0.4}, "stiffness": 20.0, "damping": 0.2}
    drives = {"motor": {"servo": servo}}
    return build_scenario({"rig": "capstan-joint", "duration": duration, "drives": drives, **more})
