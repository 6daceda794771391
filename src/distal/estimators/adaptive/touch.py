"""Find whether something touches a joint: an external torque may act on it once its forces say so.
Equations (13b), (29), (30), (32) and (33).

The mean innovation of each force is compared with what is usual. The part beyond that opens the
variance of an external torque on the joints that the force moves (a test of the innovations
against a jump of a state: Willsky and Jones, IEEE TAC 21, 1976). Then the size of the torque
itself keeps the variance open, so that a light touch and a wall are both followed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import reduce

import casadi as ca

from distal.estimators.adaptive.filter_context import FilterContext
from distal.estimators.adaptive.filter_inputs import Interval
from distal.estimators.adaptive.states import StateVector
from distal.estimators.estimator_protocol import TOUCHED
from distal.expressions import ScalarNode, VectorNode, symbols
from distal.kernels.layout import Layout
from distal.rig import Sensor

EVIDENCE_TIME = 0.05
"""Time constant of the mean innovation of a force [s]. Source: benchmark (benchmarks.ablation)."""

OPENED = 3.0
"""Std of the torque that is opened, per part of a force that is not normal [1], so that a torque
that changes within its correlation time is followed at once. Source: benchmark
(docs/results/touch.md).
"""

CLOSING_TIME = 0.3
"""Time constant with which the opened std is forgotten [s]. Source: benchmark
(docs/results/touch.md).
"""

CLEAR_TORQUE = 3.0
"""Number of times the smallest torque that is felt, beyond which a torque is clear and may come
back [1]. Source: benchmark (docs/results/touch.md).
"""

LASTING_TIME = 2.4
"""Time constant with which the std of a clear torque is forgotten [s]. Source: benchmark
(docs/results/touch.md).
"""

USUAL_TIME = 2.5
"""Time constant of the mean square of a force's mean innovation, which says what is normal [s].
Source: benchmark (benchmarks.ablation).
"""

UNEXPLAINED = 1.0
"""Smallest mean innovation, in stds, that is not normal [1]. Source: benchmark
(docs/results/touch.md).
"""

UNUSUAL = 4.0
"""Mean innovation, in those that are usual, that is not normal [1].
Source: benchmark (docs/results/chains.md, "Something happens").
"""

TOUCHING = 4.0
"""Torque, in the smallest that is felt, at which a touch has a probability of one half [1]: with 2
a finger reports 46 touches in 10 min of free motion, with 4 none. Source: benchmark
(benchmarks/false_touches).
"""

STILL = 0.06
"""Probability below which a touch ends [1]: that of twice the smallest torque that is felt. Source:
judgement.
"""

SMALLEST_TORQUE = 1e-30
"""Square of a torque that counts as zero [(N m)²]. Source: rounding (division by zero)."""

FORCE = Layout(mean=1, force=1, usual=1)
"""Layout of what is remembered of a force or tension that is compared: its mean innovation in stds
[1] and as a force [N, N m], and the mean square of the first [1]. Source: definition (layout of a
vector).
"""

TORQUE = Layout(opened=1, clear=1, share=1, probability=1, since=1)
"""Layout of what is remembered of the torque on a joint: the opened variance and that of a clear
touch [(N m)²], the share of a touch, 0 (free) to 1, its probability, and for how long it has lasted
[s]. Source: definition (layout of a vector).
"""


WEIGHED = ("excess", "normal", "used")
"""Names of the parts of the evidence of a force that `opening_function` weighs, after what the
torques explain of it: the square of the part of its mean innovation that is not normal, that of the
largest that is normal [N², (N m)²], and 1 where the force is read, else 0.
"""


@dataclass(frozen=True)
class Remembered:
    """What is remembered from sample to sample beside the drives' motion; its entries are replaced
    in place.

    Args:
        friction: of the friction of each drive, see `Comparison`, or its smoothed effort, (14).
        forces: a `FORCE` for each force or tension that is asked for a touch, by its sensor's name.
        torques: a `TORQUE` for each joint that may be touched, by its index.
    """

    friction: list[ScalarNode]
    forces: dict[str, dict[str, ScalarNode]]
    torques: dict[int, dict[str, ScalarNode]]

    @classmethod
    def of(cls, context: FilterContext, layout: Layout, kernel_state: VectorNode) -> Remembered:
        """Return what a kernel state remembers, as symbols by name."""
        friction, forces, torques = (
            ca.vertsplit(layout.part(kernel_state, part), size)
            for part, size in (("forces", 1), ("evidence", FORCE.size), ("torques", TORQUE.size))
        )
        names = [sensor.name for sensor in compared_forces(context)]
        of_forces = dict(zip(names, map(FORCE.parts, forces)))
        return cls(friction, of_forces, dict(zip(context.touchable, map(TORQUE.parts, torques))))

    @property
    def opened(self) -> dict[int, ScalarNode]:
        """Joint → the open variance of the external torque on it [(N m)²]."""
        return {joint: torque["opened"] for joint, torque in self.torques.items()}

    @property
    def touched(self) -> ScalarNode:
        """1 while something touches a joint, else 0."""
        return reduce(ca.fmax, (torque["since"] > 0 for torque in self.torques.values()), ca.MX(0))

    def joined(self) -> dict[str, VectorNode]:
        """Return the parts of a kernel state that hold what is remembered."""
        forces = (FORCE.joined(**force) for force in self.forces.values())
        torques = (TORQUE.joined(**torque) for torque in self.torques.values())
        parts = {"forces": self.friction, "evidence": forces, "torques": torques}
        return {name: ca.vertcat(ca.MX(0, 1), *part) for name, part in parts.items()}


def compared_forces(context: FilterContext) -> tuple[Sensor, ...]:
    """Return the sensors of forces and tensions that are asked for a touch; none where no joint may
    be touched.
    """
    return context.forces if context.touchable else ()


def evidence_function() -> ca.Function:
    """Return the function (kept, ν, S, used, dt) → what is remembered of a force, `FORCE`, and the
    evidence of a touch in it, `WEIGHED`: (30).

    The mean z̄ of ν/√S over `EVIDENCE_TIME` is compared with z_w of (29). Each ν/√S is limited, so
    that at intervals below 35 ms one sample alone never exceeds z_w.
    """
    sizes = {"kept": FORCE.size, "innovation": 1, "variance": 1, "is_used": 1, "dt": 1}
    inputs = symbols(ca.SX, **sizes)
    kept, innovation, variance, used, dt = inputs
    memory = FORCE.parts(kept)
    threshold = ca.fmax(UNEXPLAINED, UNUSUAL * ca.sqrt(memory["usual"]))
    fade = ca.exp(-dt / EVIDENCE_TIME)
    std = ca.sqrt(ca.fmax(variance, SMALLEST_TORQUE))
    most = threshold * ca.fmax(2, 1 / ca.fmax(1 - fade, 1e-6))
    shown = ca.fmin(ca.fmax(innovation / std, -most), most)
    mean = ca.if_else(used > 0, fade * memory["mean"] + (1 - fade) * shown, memory["mean"])
    force = fade * memory["force"] + (1 - fade) * shown * std
    force = ca.if_else(used > 0, force, memory["force"])
    slowly = ca.exp(-dt / USUAL_TIME)
    usual = ca.if_else(used > 0, slowly * memory["usual"] + (1 - slowly) * mean**2, memory["usual"])
    share = ca.fmax(1 - threshold**2 / ca.fmax(mean**2, SMALLEST_TORQUE), 0)
    outputs = [mean, force, usual, used * share * force**2, threshold**2 * variance, used]
    return ca.Function("evidence", inputs, outputs, list(sizes), [*FORCE.names, *WEIGHED])


def open_torques(
    states: StateVector,
    evidence: Mapping[str, Mapping[str, ScalarNode]],
    kept: Remembered,
    mean: VectorNode,
    interval: Interval,
) -> None:
    """Change what is remembered of the torques after a sample, in place: (32), (33)."""
    context = states.context
    torques = states.torque_states
    of_forces = {sensor.name: sensor for sensor in compared_forces(context)}
    explained = {name: ca.MX(0) for name in evidence}
    for at, joint in torques.items():
        moved = context.rig.joints[joint].name
        for name in evidence:
            if context.by_torque(joint, of_forces[name]) != 0.0:
                change = f"{context.path(of_forces[name])}.by_torque.{moved}"
                explained[name] += context.parameters(interval.p, [change]) * mean[at]
    at_joints = {joint: at for at, joint in torques.items()}
    for joint, torque in kept.torques.items():
        names = [name for name in context.by_contact(joint) if name in evidence]
        if not names:
            continue
        moved = context.rig.joints[joint].name
        changes = [f"{context.path(of_forces[name])}.by_contact.{moved}" for name in names]
        by_contact = context.parameters(interval.p, changes)
        weighed = ca.horzcat(
            *(
                ca.vertcat(explained[name], *(evidence[name][part] for part in WEIGHED))
                for name in names
            )
        )
        opening = opening_function(len(names))
        remembered = TORQUE.joined(**torque)
        after = opening(remembered, mean[at_joints[joint]], weighed, by_contact, interval.x[0])
        torque.update(TORQUE.parts(after))


def opening_function(count: int) -> ca.Function:
    """Return the function (kept, τ_ext, weighed, b, dt) → what is remembered of the torque on a
    joint, by several forces: (32), (33).

    A unit of torque on a joint changes a force U by a_τ. The torque of a contact, with those on
    other joints that come with it, changes U by b = √(a_τᵀ C_τ a_τ) over the joint's own √C_τ, per
    unit of torque on the joint. The force shows a torque beyond √(normal)/b; all forces together
    show one beyond τ₀, 1/τ₀² = Σ b²/normal. The estimated torques explain Σ a_τ τ_ext of each
    force, and z² = Σ explained²/normal over all. The opened variance is the largest of three: its
    last value, fading; `OPENED`² Σ excess/b²; and τ₀² (z² − 1). That of a clear torque fades
    slowly.
    """
    parts = 1 + len(WEIGHED)
    inputs = symbols(ca.SX, kept=TORQUE.size, torque=1, weighed=(parts, count), b=count, dt=1)
    kept, torque, weighed, by_contact, dt = inputs
    was = TORQUE.parts(kept)
    square = by_contact**2
    explained, excess, normal, used = (row.T for row in ca.vertsplit(weighed))
    least = ca.fmax(normal, SMALLEST_TORQUE)
    felt = ca.sum1(used * square / least)
    lost = felt <= 0
    smallest = 1 / ca.fmax(felt, SMALLEST_TORQUE)
    z_square = ca.sum1(used * explained**2 / least)
    pushed = (1 - was["share"]) * OPENED**2 * ca.sum1(excess / square)
    held = ca.if_else(lost, 0, smallest * ca.fmax(z_square - 1, 0))
    clearly = ca.if_else(lost, 0, smallest * ca.fmax(z_square - CLEAR_TORQUE**2, 0))
    clear = ca.fmax(ca.exp(-2 * dt / LASTING_TIME) * was["clear"], clearly)
    fade = ca.exp(-2 * dt / CLOSING_TIME)
    opened = ca.fmax(ca.fmax(fade * was["opened"], clear), ca.fmax(pushed, held))
    share = ca.if_else(lost, fade * was["share"], opened / (opened + smallest))
    times = torque**4 / ca.fmax(smallest**2, SMALLEST_TORQUE)
    probability = ca.if_else(lost, was["probability"], times / (times + TOUCHING**4))
    touches = probability > ca.if_else(was["since"] > 0, STILL, TOUCHED)
    since = ca.if_else(touches, was["since"] + dt, 0)
    after = TORQUE.joined(
        opened=opened, clear=clear, share=share, probability=probability, since=since
    )
    return ca.Function("opening", inputs, [after])


def touch_layout(context: FilterContext) -> dict[str, int]:
    """Return the lengths of the parts of the kernel state that remember forces and torques."""
    return {
        "forces": context.n_drives,
        "evidence": FORCE.size * len(compared_forces(context)),
        "torques": TORQUE.size * len(context.touchable),
    }
