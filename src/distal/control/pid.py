"""A PID controller of joints' angles. The moment arms turn its torques into commands of the
drives.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.expressions import Vector
from distal.kernels import Evaluation, Layout
from distal.model import Mechanism
from distal.rig import Rig
from distal.run import LOST, Reading
from distal.simulation import JointControl

SMOOTHED = 0.3
"""Share with which a new difference of the angle enters the smoothed speed of k_d: an encoder's
steps are spread over about three periods. Source: judgement.
"""

LEAVES = 2.0
"""Error at which a joint that rests in its dead band moves again, as a multiple of the band.
Source: judgement.
"""

RIDGE = 1e-12
"""Number that is added to the diagonal of A Aᵀ, as a share of its trace, so that A Aᵀ can be
inverted. Source: rounding (a singular matrix).
"""

GAINS = ("proportional", "integral", "derivative", "deadband", "torque_limit")
"""Names of the numbers of a joint's controller, in their order."""

UNBOUNDED = 1e300
"""Number that stands for no limit. Source: definition (larger than every limit)."""


@dataclass(frozen=True)
class Held:
    """A time from `begin` to `end` [s] in which the last commands were held because the angle was
    not known; `why` is the reason that the estimate gave.
    """

    begin: float
    end: float
    why: str

    def __str__(self) -> str:
        """Return it in words."""
        return f"commands held from {self.begin:g} to {self.end:g} s: {self.why}"


def allocated(mechanism: Mechanism, angles: Vector, torques: Vector, tension: Vector) -> Vector:
    """Return the drives' commands U = (∂ℓ/∂s)ᵀ T for torques on the joints, with the tensions T = c
    + (Aᵀ)⁺ τ by the joints' moment arms A.

    The constant tensions c make no torque: they are `tension` [N] in all tendons, less the part
    that would make one. They are raised by a common factor where otherwise a slider's tendon would
    have to push. The joints are at `angles` [rad], (n_joints,), and need the `torques` τ [N m],
    (n_joints,).
    """
    rig = mechanism.rig
    nj = mechanism.n_joints
    slopes = mechanism.length_jacobian(ca.vertcat(angles, ca.SX.zeros(mechanism.n_drives)))
    arms = -ca.mtimes(slopes[:, :nj], mechanism.spread).T
    square = ca.mtimes(arms, arms.T) + RIDGE * ca.sum1(ca.sum2(arms * arms)) * ca.SX.eye(
        arms.size1()
    )
    inverse = ca.mtimes(arms.T, ca.inv(square))
    constant = tension * (1 - ca.mtimes(inverse, ca.sum2(arms)))
    needed = ca.mtimes(inverse, ca.mtimes(mechanism.spread.T, torques))
    share = ca.SX(1)
    sliders = {drive.name for drive in rig.drives if drive.kind == "slider"}
    for i, tendon in enumerate(rig.tendons):
        if tendon.drive in sliders:
            lifts = constant[i] > 1e-6 * tension
            share = ca.fmax(
                share, ca.if_else(lifts, -needed[i] / ca.if_else(lifts, constant[i], 1), 1)
            )
    return ca.mtimes(slopes[:, nj:].T, share * constant + needed)


def memory_layout(rig: Rig) -> Layout:
    """Return the layout of the vector that a PID remembers."""
    n = len(rig.joints)
    return Layout(integral=n, speed=n, last=n, rests=n, begun=1, commands=len(rig.drives))


def pid_function(rig: Rig, controlled: tuple[int, ...]) -> ca.Function:
    """Return the function (angles, stds, memory, reference, gains, period, tension, p) → memory⁺ of
    a PID, whose commands are a part of its memory.

    The torques are τ = k_p e + k_i ∫ e dt − k_d ω, cut at each joint's `torque_limit`; the integral
    stands still while they are cut. In the dead band e = 0, which ends stick–slip
    (Armstrong-Hélouvry, Dupont and Canudas de Wit, Automatica 30, 1994). Nothing changes while an
    angle is not known. `controlled` are the indices of the joints that have a reference.
    """
    mechanism = Mechanism(rig)
    nj = len(rig.joints)
    layout = memory_layout(rig)
    angles = ca.SX.sym("angles", nj)
    stds = ca.SX.sym("stds", nj)
    memory = ca.SX.sym("memory", layout.size)
    reference = ca.SX.sym("reference", len(controlled))
    gains = ca.SX.sym("gains", len(GAINS), len(controlled))
    period = ca.SX.sym("period")
    tension = ca.SX.sym("tension")
    p = mechanism.parameters.symbols
    before = layout.parts(memory)
    difference = (angles - before["last"]) / period
    speed = before["speed"] + before["begun"] * SMOOTHED * (difference - before["speed"])
    torques = ca.SX.zeros(nj)
    integral = ca.SX(before["integral"])
    rests = ca.SX(before["rests"])
    for k, j in enumerate(controlled):
        kp, ki, kd, band, limit = (gains[i, k] for i in range(len(GAINS)))
        away = reference[k] - angles[j]
        rests[j] = ca.fabs(away) < band * ca.if_else(before["rests"][j] > 0.5, LEAVES, 1.0)
        error = ca.if_else(rests[j], 0, away - ca.fmin(ca.fmax(away, -band), band))
        desired = kp * error + before["integral"][j] - kd * speed[j]
        torques[j] = ca.fmin(ca.fmax(desired, -limit), limit)
        integral[j] += ca.if_else(torques[j] == desired, ki * error * period, 0)
    commands = allocated(mechanism, angles, torques, tension)
    after = layout.joined(
        integral=integral, speed=speed, last=angles, rests=rests, begun=ca.SX(1), commands=commands
    )
    memory_after = ca.if_else(ca.mmax(stds) <= LOST, after, memory)
    arguments = [angles, stds, memory, reference, gains, period, tension, p]
    return ca.Function("pid", arguments, [ca.densify(memory_after)])


def pid_gains_of(joints: Mapping[str, JointControl]) -> Floats:
    """Return the gains of some joints, (5, n), in the order of `GAINS`; no limit is `UNBOUNDED`."""
    columns = [[getattr(joint, name) for name in GAINS] for joint in joints.values()]
    return np.array(
        [[UNBOUNDED if gain is None else gain for gain in column] for column in columns]
    ).T


class PID:
    """A PID controller of the angles of some joints (`pid_function`), a callable for `simulate` and
    `closed_loop`.

    While an angle is missing or not known it holds its last commands and notes that in `held`.

    Args:
        joints: reference and gains by joint.
        period: time between two calls [s].
        co_contraction: tension of all tendons without a torque [N]; see `allocated`.
    """

    def __init__(
        self, rig: Rig, joints: Mapping[str, JointControl], period: float, co_contraction: float
    ) -> None:
        names = rig.joint_names
        self._drives = rig.drive_names
        self._layout = memory_layout(rig)
        self._law = Evaluation(pid_function(rig, tuple(names.index(name) for name in joints)))
        self._references = [joint.reference for joint in joints.values()]
        self._period = period
        parameters = Mechanism(rig).parameters.values
        self._fixed = (pid_gains_of(joints).T.ravel(), period, co_contraction, parameters)
        self.memory = np.zeros(self._layout.size)
        self.held: tuple[Held, ...] = ()

    def part(self, name: str) -> Floats:
        """Return a part of what the controller remembers, such as "integral" [N m], "speed"
        [rad/s], "rests" or "commands".
        """
        return self._layout.view(self.memory, name)

    def __call__(
        self, time: float, measured: Mapping[str, float], estimate: Reading
    ) -> dict[str, float]:
        """Return the commands by drive at a `time` [s] from the `estimate`. What is `measured` is
        not used.
        """
        if estimate.unusable:
            self._hold(time, estimate.unusable)
        else:
            desired = [reference.at(np.array([time]))[0] for reference in self._references]
            (self.memory,) = self._law(
                estimate.angles, estimate.angle_stds, self.memory, desired, *self._fixed
            )
        return dict(zip(self._drives, self.part("commands").tolist()))

    def _hold(self, time: float, why: str) -> None:
        last = self.held[-1] if self.held else None
        if last is not None and last.why == why and time - last.end < 1.5 * self._period:
            self.held = (*self.held[:-1], Held(last.begin, time, why))
        else:
            self.held = (*self.held, Held(time, time, why))
