"""A PID controller of joints' angles, whose torques become commands of the drives by the moment arms."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from distal.kernels import Evaluation
from distal.model import Mechanism
from distal.rig import Rig
from distal.run import Reading
from distal.simulation import JointControl

Floats = NDArray[np.float64]

SMOOTHED = 0.3
"""Share of a new difference in the speed that damps: an encoder's steps are spread over about three periods."""

LEAVES = 2.0
"""A joint that rests within its dead band rests until its error is so many times as large."""

LOST = 0.35
"""An angle whose std is above this is not known [rad]."""

RIDGE = 1e-12
"""Added to A Aᵀ, as a share of its trace, so that it can be inverted."""

UNUSABLE = frozenset({"bad", "dead"})
"""Health of an estimate with which nothing is controlled."""


@dataclass(frozen=True)
class Held:
    """A time in which the last commands were held since the angle was not known.

    Args:
        begin: of it [s].
        end: of it [s].
        why: what the estimate said.
    """

    begin: float
    end: float
    why: str


class Allocation:
    """Commands of drives for torques on joints: T = c + (Aᵀ)⁺ τ with the joints' moment arms A, U = (∂ℓ/∂s)ᵀ T.

    c is a constant tension without any torque, raised together where a slider's tendon would otherwise have to push.

    Args:
        rig: the description.
        co_contraction: tension of all tendons without a torque, as far as it makes none [N].
    """

    def __init__(self, rig: Rig, co_contraction: float) -> None:
        mechanism = Mechanism(rig)
        q, p = ca.SX.sym("q", mechanism.n_bodies), mechanism.parameters
        slopes = ca.densify(mechanism.length_jacobian(q))
        at = ca.substitute(slopes, p.symbols, ca.DM(p.values))
        self._slopes = Evaluation(ca.Function("slopes", [q], [at]))
        self._mechanism, self._tension = mechanism, co_contraction
        sliders = {drive.name for drive in rig.drives if drive.kind == "slider"}
        self._pulled = np.array([tendon.drive in sliders for tendon in rig.tendons])
        self._place = np.zeros(mechanism.n_bodies)
        self._spread = mechanism.spread.full()

    def commands(self, angles: Floats, torques: Floats) -> Floats:
        """Return a command for each drive [N or N m], (n_drives,).

        Args:
            angles: of the joints [rad], (n_joints,).
            torques: wanted [N m], (n_joints,).
        """
        mechanism, nj = self._mechanism, self._mechanism.n_joints
        self._place[:nj] = angles
        slopes = self._slopes(self._place)[0].reshape(mechanism.n_bodies, mechanism.n_tendons).T
        arms = -(slopes[:, :nj] @ self._spread).T  # torque on the free joints of a newton in each tendon
        # a pseudo-inverse: with fewer tendons than joints too
        inverse = arms.T @ np.linalg.inv(arms @ arms.T + RIDGE * float(np.sum(arms * arms)) * np.eye(len(arms)))
        constant = self._tension * (1.0 - inverse @ arms.sum(axis=1))
        needed = inverse @ (self._spread.T @ torques)
        lifts = self._pulled & (constant > 1e-6 * self._tension)
        share = max(float(np.max(-needed[lifts] / constant[lifts], initial=1.0)), 1.0)
        drives: Floats = slopes[:, nj:].T @ (share * constant + needed)
        return drives


class PID:
    """A PID controller of the angles of some joints; a callable for `simulate` and `closed_loop`.

    τ = k_p e + k_i ∫ e dt − k_d ω with e = 0 in the dead band, which ends stick–slip (Armstrong-Hélouvry, Dupont and
    Canudas de Wit, Automatica 30, 1994), cut at the joint's `torque_limit`; the integral stands while it is cut. Without an
    angle, or with one that is not known, it holds its last commands and says so in `held`.

    Args:
        rig: the description.
        joints: reference and gains of each joint by its name.
        period: between two calls [s].
        co_contraction: see `Allocation` [N].
    """

    def __init__(self, rig: Rig, joints: Mapping[str, JointControl], period: float, co_contraction: float) -> None:
        self._names = [drive.name for drive in rig.drives]
        self._allocation, self._period = Allocation(rig, co_contraction), period
        self._at = {[joint.name for joint in rig.joints].index(name): each for name, each in joints.items()}
        self._n = len(rig.joints)
        self._integral, self._speed = np.zeros(self._n), np.zeros(self._n)
        self._rests = np.zeros(self._n, dtype=bool)
        self._last: Floats | None = None
        self._commands = dict.fromkeys(self._names, 0.0)
        self.held: tuple[Held, ...] = ()

    def __call__(self, time: float, measured: Mapping[str, float], estimate: Reading) -> dict[str, float]:
        """Return the drives' commands.

        Args:
            time: [s].
            measured: by sensor; not used.
            estimate: of the joints' angles.
        """
        if not all(isfinite(angle) for angle in estimate.angles):
            return self._hold(time, f"no angle: {estimate.health}")
        if estimate.health in UNUSABLE or max(estimate.angle_stds) > LOST:
            return self._hold(time, f"{estimate.health}: {estimate.detail or 'the angle is not known'}")
        angles, torques = np.array(estimate.angles), np.zeros(self._n)
        if self._last is not None:
            self._speed += SMOOTHED * ((angles - self._last) / self._period - self._speed)
        self._last = angles
        for j, joint in self._at.items():
            away = float(joint.reference.at(np.array([time]))[0]) - angles[j]
            self._rests[j] = abs(away) < joint.deadband * (LEAVES if self._rests[j] else 1.0)
            error = 0.0 if self._rests[j] else away - min(max(away, -joint.deadband), joint.deadband)
            own = joint.proportional * error + self._integral[j] - joint.derivative * self._speed[j]
            limit = np.inf if joint.torque_limit is None else joint.torque_limit
            torques[j] = min(max(own, -limit), limit)
            if torques[j] == own:
                self._integral[j] += joint.integral * error * self._period
        self._commands = dict(zip(self._names, self._allocation.commands(angles, torques).tolist()))
        return self._commands

    def _hold(self, time: float, why: str) -> dict[str, float]:
        last = self.held[-1] if self.held else None
        if last is not None and last.why == why and time - last.end < 1.5 * self._period:
            self.held = (*self.held[:-1], Held(last.begin, time, why))
        else:
            self.held = (*self.held, Held(time, time, why))
        return self._commands
