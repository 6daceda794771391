"""The shipped controllers of joints' angles: a PID whose torques the moment arms turn into commands
of the drives, and the rig's inverse, which adds the forces that the reference's own motion needs.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import inf

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.expressions import Vector
from distal.inverse import Feedback, LiveInverse
from distal.inverse.feedforward import REMEMBERED, feedback_torques, solved
from distal.kernels import Evaluation, Layout
from distal.model import Mechanism
from distal.rig import Rig
from distal.run import Reading
from distal.simulation import JointControl

SMOOTHED = 0.3
"""Share with which a new difference of the angle enters the smoothed speed of k_d: an encoder's
steps are spread over about three periods. Source: judgement.
"""

KEPT = 0.75
"""Share of the co-contraction below which no tension falls; a torque may use the rest. Source:
judgement.
"""


def allocated(mechanism: Mechanism, angles: Vector, torques: Vector, tension: float) -> Vector:
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
    square = ca.mtimes(arms, arms.T)
    needed, making = (
        ca.mtimes(arms.T, solved(square, right))
        for right in (ca.mtimes(mechanism.spread.T, torques), ca.sum2(arms))
    )
    constant = tension * (1 - making)
    share = ca.SX(1)
    sliders = {drive.name for drive in rig.drives if drive.kind == "slider"}
    for i, tendon in enumerate(rig.tendons):
        if tendon.drive in sliders:
            lifts = constant[i] > 1e-6 * tension
            share = ca.fmax(
                share, ca.if_else(lifts, -needed[i] / ca.if_else(lifts, constant[i], 1), 1)
            )
    return ca.mtimes(slopes[:, nj:].T, share * constant + needed)


def feedback_of(joint: JointControl) -> Feedback:
    """Return the feedback that the gains of a scenario stand for."""
    gains = joint.deadband, joint.proportional, joint.integral, joint.derivative
    return Feedback(0.0, *gains, torque_limit=joint.torque_limit or inf)


class PID:
    """A PID controller of the angles of some joints, a callable for `simulate` and `closed_loop`.

    The torques of `feedback_torques`, with the error of each joint's angle and the smoothed speed
    of the joint, become commands by `allocated`. While an angle is missing or not known the last
    commands are held.

    Args:
        joints: reference and gains by joint.
        period: time between two calls [s].
        co_contraction: tension of all tendons without a torque [N].
    """

    def __init__(
        self, rig: Rig, joints: Mapping[str, JointControl], period: float, co_contraction: float
    ) -> None:
        n = len(joints)
        self._rig = rig
        self._joints = joints
        self._period = period
        self._layout = Layout(
            **dict.fromkeys((*REMEMBERED, "speed", "last"), n), begun=1, commands=len(rig.drives)
        )
        self._law = Evaluation(self._function(co_contraction))
        self._memory = np.zeros(self._layout.size)

    def _function(self, co_contraction: float) -> ca.Function:
        """Return the function (angles, memory, reference) → memory⁺, of which the commands are a
        part.
        """
        mechanism = Mechanism(self._rig)
        angles = ca.SX.sym("angles", mechanism.n_joints)
        memory = ca.SX.sym("memory", self._layout.size)
        reference = ca.SX.sym("reference", len(self._joints))
        before = self._layout.parts(memory)
        at = [self._rig.joint_names.index(name) for name in self._joints]
        turned = (angles[at] - before["last"]) / self._period
        speed = before["speed"] + before["begun"] * SMOOTHED * (turned - before["speed"])
        made = feedback_torques(
            Feedback.gains([feedback_of(joint) for joint in self._joints.values()]),
            before=before,
            error=reference - angles[at],
            lag=-speed,
            dt=self._period,
        )
        torques = ca.SX.zeros(mechanism.n_joints)
        torques[at] = made.torques
        after = self._layout.joined(
            **made.after,
            speed=speed,
            last=angles[at],
            begun=ca.SX(1),
            commands=allocated(mechanism, angles, torques, co_contraction),
        )
        p = mechanism.parameters
        known = ca.substitute(after, p.symbols, ca.DM(p.values))
        return ca.Function("pid", [angles, memory, reference], [ca.densify(known)])

    def part(self, name: str) -> Floats:
        """Return a part of what the controller remembers, such as "effort", the integral of the
        error [rad s], "speed" [rad/s], "rests" or "commands".
        """
        return self._layout.view(self._memory, name)

    def __call__(
        self, time: float, measured: Mapping[str, float], estimate: Reading
    ) -> dict[str, float]:
        """Return the commands by drive at a `time` [s] from the `estimate`. What is `measured` is
        not used.
        """
        if not estimate.unusable:
            desired = references_at(self._joints, time)
            (self._memory,) = self._law(estimate.angles, self._memory, [*desired.values()])
        return dict(zip(self._rig.drive_names, self.part("commands").tolist()))


class CommandedForces:
    """A controller by `LiveInverse` for drives that follow forces. The inverse has a filter of its
    own, which also tells the angles, so that no second one runs.

    Args:
        joints: reference and gains by joint; other joints stay where they are.
        co_contraction: tension of all tendons without a torque [N]; each tendon keeps at least the
            share `KEPT` of it.
    """

    def __init__(self, rig: Rig, joints: Mapping[str, JointControl], co_contraction: float) -> None:
        feedback = {name: feedback_of(one) for name, one in joints.items()}
        self._inverse = LiveInverse(
            rig, least_tension=KEPT * co_contraction, feedback=feedback, compensates=True
        )
        self._at = [rig.sensor_names.index(channel) for channel in self._inverse.channels]
        self._joints = joints
        self._forces: Floats = np.zeros(len(rig.drives))

    def tell(self, stamp: float, values: Floats) -> Reading:
        """Return the filter's estimate from the `values` of all sensors [SI] at a `stamp` [s], and
        compute the forces to be commanded.
        """
        desired = references_at(self._joints, stamp)
        command = self._inverse.step(stamp, desired, values[self._at])
        self._forces = command.forces
        return command.reading

    def __call__(
        self, time: float, measured: Mapping[str, float], estimate: Reading
    ) -> dict[str, float]:
        """Return the forces by drive that `tell` has computed last [N or N m]. The arguments are
        those of every controller: the `time` [s], what is `measured`, and the estimate; they are
        not used.
        """
        return dict(zip(self._inverse.rig.drive_names, self._forces.tolist()))


def references_at(joints: Mapping[str, JointControl], time: float) -> dict[str, float]:
    """Return the desired angle of each joint at a `time` [s], by joint [rad]."""
    return {name: float(one.reference.at(np.array([time]))[0]) for name, one in joints.items()}
