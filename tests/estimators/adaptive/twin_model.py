"""What the naive twin takes from `distal.model`: one sub-step, forces and limits, each with its
slopes in x.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.model import (
    Kick,
    Limit,
    Mechanism,
    joint_frequency,
    soft_moments,
)
from distal.rig import Rig
from tests.estimators.adaptive.twin_states import State
from tests.support.one_body import one_body


class TwinModel:
    """Functions of (x, places s, speeds ṡ) with their slopes in x and s; the parameters are read
    from x.
    """

    def __init__(
        self, rig: Rig, mechanism: Mechanism, states: list[State], interval: float
    ) -> None:
        self.mechanism, self.states = mechanism, states
        self.n, self.n_j, self.n_d = len(states), mechanism.n_joints, mechanism.n_drives
        # n sub-steps: 2.5 ms, or 0.6/ω₀ where that is shorter, 50 at most
        self.substeps = min(
            max(1, int(np.ceil(interval / min(2.5e-3, 0.6 / joint_frequency(mechanism))))), 50
        )
        self.x, self.s, self.rates = (
            ca.SX.sym("x", self.n),
            ca.SX.sym("s", self.n_d),
            ca.SX.sym("rates", self.n_d),
        )
        self.parameters = self._parameters()
        self.step_function = self._substep(rig)
        self.functions = self._compared()
        self.limits: dict[int, ca.Function] = {}

    def _parameters(self) -> Any:
        """p as a function of x: a state of its own, or its value times a factor."""
        p = self.mechanism.parameters
        values = [ca.SX(value) for value in p.values]
        for i, state in enumerate(self.states):
            if state.kind == "parameter":
                values[state.of] = self.x[i]
            for k in state.members:
                values[k] = p.values[k] * self.x[i]
        for i, state in enumerate(self.states):
            if state.kind == "deviation":
                values[state.of] = values[state.of] + self.x[i]
        return ca.vertcat(*values)

    def _with_parameters(self, *expressions: Any) -> list[Any]:
        return [
            ca.substitute(ca.SX(e), self.mechanism.parameters.symbols, self.parameters)
            for e in expressions
        ]

    def _sloped(self, *values: Any) -> ca.Function:
        """(x, s, ṡ) → one column, and its slopes in x and in s."""
        (value,) = self._with_parameters(ca.vertcat(*values))
        slopes = [ca.densify(ca.jacobian(value, of)) for of in (self.x, self.s)]
        return ca.Function("sloped", [self.x, self.s, self.rates], [value, *slopes])

    def _bodies(self) -> tuple[Any, Any]:
        """q = (θ, s) and v = (ω, ṡ)."""
        return ca.vertcat(self.x[: self.n_j], self.s), ca.vertcat(
            self.x[self.n_j : 2 * self.n_j], self.rates
        )

    def _substep(self, rig: Rig) -> ca.Function:
        """(x, s, ṡ, h, σ_τ) → θ⁺, ω⁺, slopes of ω⁺ in x and in s, what friction adds to its
        variance: (8), (9), (10).
        """
        h, sigma = ca.SX.sym("h"), ca.SX.sym("sigma", self.n_j)
        q, v = self._bodies()
        torques = [ca.SX(0)] * self.n_j
        for i, state in enumerate(self.states):
            if state.kind == "torque":
                torques[state.of] = self.x[i]
        effort = ca.vertcat(*torques, ca.SX.zeros(self.n_d, 1))
        kick = Kick(q, v, effort, h, h)
        joints = [one_body(self.mechanism, kick, j) for j in range(self.n_j)]
        smooth = [joint.velocity for joint in joints]
        speeds, remaining = ca.vertcat(*smooth), [ca.SX(0)] * self.n_j
        constants, values = [], []
        for i, joint in enumerate(rig.joints):
            if joint.external_torque.std == 0:
                continue
            alone = joints[i]
            b = alone.b
            mass = ca.if_else(h > 0, h / b, self.mechanism.inertias()[i])
            push, held = mass * alone.z, mass * (1 + b * alone.damping)
            friction = [mass * side for side in (alone.up, alone.down)]
            inertia, speed, forward, back = (ca.SX.sym(name) for name in ("m", "w", "f", "b"))
            limit = Limit(*(side / held for side in friction))
            expected = soft_moments(push / held, limit, h * sigma[i] / held + 1e-9)
            # slopes of the balance of impulses, for the share of joints that slip
            balance = held * speed - push + forward * friction[0] - back * friction[1]
            smooth[i], remaining[i] = -balance / inertia, expected.rest
            constants += [inertia, speed, forward, back]
            share = ca.fmax(expected.slope, 1e-12)
            slip = (expected.forward / share, expected.back / share)
            values += [held / share, speeds[i], *slip]
        slope = ca.vertcat(*smooth)
        outputs = [q[: self.n_j] + h * speeds, speeds, ca.vertcat(*remaining)]
        by_x, by_s = [
            ca.jacobian(e, of) for e in self._with_parameters(slope) for of in (self.x, self.s)
        ]
        outputs = [*self._with_parameters(*outputs), by_x, by_s]
        outputs = ca.substitute(outputs, constants, self._with_parameters(*values))
        return ca.Function("substep", [self.x, self.s, self.rates, h, sigma], outputs)

    def substep(self, x: Floats, s: Floats, rates: Floats, h: float, sigma: Floats) -> list[Floats]:
        theta, omega, rest, by_x, by_s = self.step_function(x, s, rates, h, sigma)
        return [array(theta), array(omega), by_x.full(), by_s.full(), array(rest)]

    def _compared(self) -> dict[str, ca.Function]:
        """What is compared, with its slopes: T, the pull without damping, the pull, l and a of the
        drives, limits of the joints' friction, and the drives' damping.
        """
        q, v = self._bodies()
        m = self.mechanism
        tensions = m.tensions(q, v)
        elastic = ca.mtimes(m.length_jacobian(q).T, tensions)[self.n_j :]
        dampings = m.dampings()[self.n_j :]
        limits = m.friction_limits(q, v, tensions)
        own = limits[self.n_j :]
        return {
            "tension": self._sloped(tensions),
            "elastic": self._sloped(elastic),
            "pull": self._sloped(elastic + dampings * self.rates),
            "mean": self._sloped(*(limit.mean for limit in own)),
            "asymmetry": self._sloped(*(limit.asymmetry for limit in own)),
            "friction": self._sloped(*(limit.mean for limit in limits[: self.n_j])),
            "damping": self._sloped(dampings),
        }

    def compared(self, x: Floats, s: Floats, rates: Floats) -> dict[str, list[Floats]]:
        found = {}
        for name, function in self.functions.items():
            value, *slopes = (part.full() for part in function(x, s, rates))
            found[name] = [value.ravel(), *slopes]
        return found

    def play_limit(self, drive: int, x: Floats, s: Floats) -> list[Floats]:
        """Limit of a drive's play at the tensions of that place at rest, its slopes in x and s."""
        q, _ = self._bodies()
        tensions = self.mechanism.tensions(q, ca.SX.zeros(self.n_j + self.n_d, 1))
        if drive not in self.limits:
            limit = self.mechanism.hysteresis_limit(drive, q, tensions)
            self.limits[drive] = self._sloped(limit)
        return [part.full() for part in self.limits[drive](x, s, 0.0)]


def array(value: Any) -> Floats:
    return np.array(value.full(), dtype=float).ravel()
