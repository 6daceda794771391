"""The tuning of the filter: how fast unknowns may change, how fast they are learned, and when a
reading is an outlier.

`Robustness` is one frozen description; `Robustness.none()` leaves the textbook filter.
docs/explanation/adaptive-guards.md says where each value enters the algorithm; below are the
equations for wild readings and lost drives.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, radians

import casadi as ca

from distal.expressions import Scalar
from distal.regression import MOST_EVIDENCE


@dataclass(frozen=True)
class Robustness:
    """The values of the guards; the text under each default says where it was measured.

    Args:
        wild_displacement: distance of a reading from the expected one, in recent motions, beyond
            which the reading is wild [1].
        real_jump: chance that a far reading is a real jump, if nothing else is known [1].
        persistence: time after which a jump that stays is no wild reading, where a force can judge
            it [s].
        persistence_alone: the same where no force can [s].
        bend_share: share of the bend between samples that a straight line may miss [1].
        follow_time: time in which the joint follows a drive whose position is not known [s].
        wild_force: squared innovation, in its variances, beyond which an innovation counts less
            [1].
        sticking_time: time for which friction of a drive that sticks stays the same [s].
        turning_time: time for which it stays the same while a drive turns back [s].
        beyond_time: time in which all samples of a force beyond its drive's friction count as one
            [s]; 0: each counts.
        unknown_friction: std of friction that the rig does not declare, in those of the drive's
            force sensor [1]; 0: not estimated.
        unknown_friction_walk: its random walk, in the same unit per √s.
        declared_friction: a drive with at least this friction at its nominal load declares it [N].
        learning_time: time in which all samples of a force count as one for the parameters [s]
            (24).
        learning_time_guarded: the same for a force whose drive declares no friction [s].
        creep_learning_time: time in which all samples of all forces count as one for the creep of a
            tendon [s].
        reference_time: time in which all samples of a reference angle count as one for the
            parameters [s]; 0: each counts.
        parameter_walk: random walk of a parameter without a `drift`, in its standard deviations per
            √s.
        unmodelled: share of the rig's `unmodelled` torque that is added [1].
        angle_walk: random walk of the joints' angles, which the model of a stuck joint lacks
            [rad/√s].
        opens_torques: whether an external torque that the rig does not declare may act on a joint
            once forces say so (29).
        moving_only: where friction is declared, let only forces of drives that clearly move count,
            as a fit does.
        asks_positions: whether positions that no drive can have are taken as missing.
    """

    wild_displacement: float = 6.0
    """docs/results/guards.md: costs on loads that step, brings on bursts and random rigs with wild
    samples
    """
    real_jump: float = 0.1
    """docs/results/guards.md, bursts of five samples"""
    persistence: float = 0.02
    """docs/results/guards.md"""
    persistence_alone: float = 0.05
    """docs/results/guards.md"""
    bend_share: float = 0.12
    """a parabola misses 1/8 of its second difference; docs/reference/adaptive-equations.md,
    equation (6)
    """
    follow_time: float = 0.05
    """docs/results/guards.md: without it the band is too narrow where samples are missing"""
    wild_force: float = 9.0
    """3 σ; docs/results/guards.md: without it one wild force throws the filter off"""
    sticking_time: float = 0.5
    """docs/results/guards.md; 50 samples of the paper's rig"""
    turning_time: float = 0.1
    """docs/results/guards.md; 10 samples of the paper's rig"""
    beyond_time: float = 0.0
    """docs/explanation/chains.md: of a joint with its own drives one mean residual is compared
    anyway
    """
    unknown_friction: float = 0.7
    """docs/results/guards.md, and `python -m benchmarks.sensitivity`, table sensitivity-priors"""
    unknown_friction_walk: float = 0.6
    """as above"""
    declared_friction: float = 0.1
    """a third of a load cell's σ on the paper's rig: less cannot be told from noise"""
    reference_time: float = 0.0
    """docs/explanation/homing.md: of one joint a reference teaches as fast as it comes"""
    parameter_walk: float = 0.02
    """docs/results/guards.md: nothing on logs of 12 s; on a long log a parameter that drifts is
    followed
    """
    learning_time: float = 0.3
    """docs/results/guards.md, "How fast parameters are learned"; of forces with declared friction,
    and of tensions
    """
    learning_time_guarded: float = 0.03
    """as above; of forces with friction that is not declared, where `sticking_time` and
    `turning_time` do the most
    """
    creep_learning_time: float = 10.0
    """docs/explanation/model.md, "Creep": two tendons that creep against each other look like a
    joint that turns
    """
    unmodelled: float = 1.0
    """the rig file says how much (docs/reference/rig-keys.md); without it the band is too narrow:
    docs/results/guards.md
    """
    angle_walk: float = 0.0
    """docs/results/chains.md: of one joint, `unmodelled` does the same"""
    opens_torques: bool = False
    """docs/results/chains.md, "Something happens"; of one joint friction and a torque cannot be
    told apart so soon
    """
    moving_only: bool = False
    """docs/explanation/learning.md, "The criterion\""""
    asks_positions: bool = True
    """a fit leaves such positions out before, so that rigs of a kind share its kernel"""

    @classmethod
    def none(cls) -> Robustness:
        """Return no guards: the textbook filter, right where the model is right and the sensors err
        as described.

        At a stop a force is still left out, since no model of the joint contains its contact force.
        """
        return cls(
            wild_displacement=inf,
            bend_share=0.0,
            wild_force=inf,
            sticking_time=0.0,
            turning_time=0.0,
            unknown_friction=0.0,
            parameter_walk=0.0,
            learning_time=0.0,
            learning_time_guarded=0.0,
            creep_learning_time=0.0,
            unmodelled=0.0,
        )

    @classmethod
    def usual(cls, n_joints: int, felt: bool = False) -> Robustness:
        """Return the guards that a rig gets where none are given.

        In a chain several forces depend on each joint, so that one sample of each counts more
        (docs/explanation/chains.md).

        Args:
            n_joints: number of joints.
            felt: whether logs said what is normal of the rig's forces in free motion.
        """
        if n_joints == 1:
            return cls(opens_torques=felt)
        return cls(
            sticking_time=0.1,
            turning_time=0.05,
            learning_time=0.05,
            beyond_time=0.2,
            reference_time=0.5,
            angle_walk=radians(0.3),
            opens_torques=True,
        )

    @classmethod
    def fitting(cls) -> Robustness:
        """Return the guards of a fit: friction is as the rig says, and only drives that clearly
        move count.
        """
        return cls(unknown_friction=0.0, moving_only=True, asks_positions=False)


STILL_LOST = 3
"""Power in (12) with which a lost position moves its joint [1], so that one missing sample does no
harm. Source: benchmark (benchmarks.ablation).
"""


def jump_evidence(change: Scalar, expected: Scalar, variance: Scalar, shown: Scalar) -> Scalar:
    """Return the logarithm of the likelihood ratio of a real jump to a wild reading, from the
    change of the drive's force: (2).

    A light slider rings after a jump: it may be seen anywhere from half to twice as far as its
    force says, of which joints that follow leave a share.

    Args:
        change: of the force since the last position that was believed [N, N m].
        expected: change that the jump would make, ∂F/∂s times the jump.
        variance: of the difference of `change` and `expected`.
        shown: share of the expected change that is left when the joints have followed [1].
    """
    ratio = change * expected / ca.fmax(expected * expected, 1e-300)
    explained = ca.fmin(ca.fmax(ratio, shown / 2), 2) * expected
    return ca.fmin(
        ca.fmax((change - explained / 2) * explained / variance, -MOST_EVIDENCE), MOST_EVIDENCE
    )


SHIFTED = 0.002
"""Chance that a far reading is one of a sensor whose zero jumped [1]; of a drive whose forces are
compared with those of free motion it is `SHIFTED_FELT`, since they settle it soon. Source:
benchmark (benchmarks.wrong_inputs).
"""

SHIFTED_FELT = 0.4
"""See `SHIFTED` [1]. Source: benchmark (benchmarks.wrong_inputs)."""

SETTLED = 0.97
"""Chance from which on a jump is real for good [1]. Source: benchmark (benchmarks.wrong_inputs)."""


def chance_of_jump(
    robustness: Robustness, time: Scalar, evidence: Scalar, judged: Scalar, felt: Scalar
) -> Scalar:
    """Return the chance that a drive made the jump of its reading: (2).

    It did so with `real_jump` r, or its sensor's zero jumped, with f, or this reading is wild, with
    1 − r, of which less is left the longer it stays: p = 1/(1 + e^{−E} ((1 − r) (1 − t/T)⁺ + f)/r).

    Args:
        time: since the jump, t [s].
        evidence: logarithm of the likelihood ratio for the drive, E.
        judged: 1 where its force is read, else 0.
        felt: 1 where forces are compared with those of free motion, else 0.
    """
    lasting = ca.if_else(judged, robustness.persistence, robustness.persistence_alone)
    real = robustness.real_jump
    wild = (1 - real) * ca.fmax(1 - time / lasting, 0)
    shifted = ca.if_else(felt, SHIFTED_FELT, SHIFTED)
    return 1 / (1 + ca.exp(-evidence) * (wild + shifted) / real)


def followed_share(robustness: Robustness, lost: Scalar) -> Scalar:
    """Return the share, 0 to 1, of a drive's motion that its joint has followed, after the position
    was `lost` for a time [s]: (12).
    """
    return (lost / (lost + robustness.follow_time)) ** STILL_LOST


GOES_ON = 0.25
"""Smallest step from one sample to the next of a drive that goes on after a jump, as a share of the
jump [1]. Source: judgement.
"""
