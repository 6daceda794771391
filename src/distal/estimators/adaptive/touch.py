"""Touched or free: a torque from outside may act on a joint once its forces say so.

Equations (13b), (29), (30), (32) and (33).

The mean innovation of each force is compared with what is normal in free motion. What is more than
that opens the variance of a torque on the joints that the force moves (a test of the innovations
against a jump of a state: Willsky and Jones, IEEE TAC 21, 1976). While it is open, the size of the
torque itself keeps it open, so that it fits a light touch and a wall alike.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import reduce

import casadi as ca

from distal.estimators.adaptive.drive_tracking import Tracks
from distal.estimators.adaptive.filter_context import FilterContext
from distal.estimators.adaptive.interval import Interval
from distal.estimators.adaptive.states.vector import StateVector
from distal.expressions import ScalarNode, VectorNode
from distal.kernels.layout import Layout
from distal.rig import Sensor

EVIDENCE_TIME = 0.05
"""Time constant of the mean innovation of a force [s]."""

OPENED = 3.0
"""So many times the part of a force that is not normal is the std of what opens [1]: a torque that
changes within its correlation time is followed at once. docs/results/touch.md
"""

CLOSING_TIME = 0.3
"""Time constant with which the opened std is forgotten [s]: docs/results/touch.md."""

CLEARLY = 3.0
LASTING_TIME = 2.4
"""A torque beyond so many times the smallest that is felt [1] may come back: its std is forgotten
with this time constant [s]. docs/results/touch.md
"""

PACE_TIME = 0.1
"""For so long after a fast motion its forces are less sure [s]."""

USUAL_TIME = 2.5
"""Time constant of what is usual of a force where no log says what is normal [s]."""

UNEXPLAINED = 0.7
UNUSUAL = 4.0
"""Without such logs, normal is the larger of so many stds and so many times what is usual [1]:
docs/results/chains.md, "Something happens".
"""

TOUCHING = 4.0
"""A torque of so many times the smallest that is felt is a touch with a probability of one half
[1]: with 2 a finger reports 46 touches in 10 min of free motion, with 4 none (benchmarks
false_touches).
"""

STILL = 0.06
"""A touch ends where its probability falls below this, at twice the smallest torque [1]."""

SURE = 3.0
"""A force is no larger than it is read to be, so many stds of its sensor added [1]."""

SMALLEST_TORQUE = 1e-30
"""Square of a torque that is none, so that nothing is divided by zero [(N m)²]."""

NORMAL = ("at_rest", "moving", "fastest")
"""Names of what is normal of a force in free motion, see `FreeMotion`."""

DRIVE = Layout(friction=1, pace=1)
"""What is remembered of a drive's force: of its friction (see `Comparison`), and the largest recent
square of its speed over the spread of its positions [1/s²].
"""

FORCE = Layout(mean=1, force=1, usual=1)
"""What is remembered of a force or tension that is compared: its mean innovation in stds [1] and as
a force [N, N m], and the mean square of the first [1].
"""

TORQUE = Layout(opened=1, clear=1, share=1, probability=1, since=1)
"""What is remembered of the torque on a joint: the variance that opened, that of a clear touch [(N
m)²], the share of it that a touch has, 0 (free) to 1, how probable a touch is, and for how long it
has been [s].
"""


WEIGHED = ("excess", "normal", "most", "used")
"""What of the evidence of a force weighs on a torque, behind what the torques explain of it."""


@dataclass(frozen=True)
class Evidence:
    """What one force says of a touch.

    Args:
        mean: its mean innovation, in stds.
        force: the same as a force [N, N m].
        usual: mean square of the first.
        excess: square of the part of it that is not normal [N², (N m)²].
        normal: square of the largest mean innovation that is normal [N², (N m)²].
        most: square of the largest force that may act, by what is read [N², (N m)²].
        used: 1 where it is read.
    """

    mean: ScalarNode
    force: ScalarNode
    usual: ScalarNode
    excess: ScalarNode
    normal: ScalarNode
    most: ScalarNode
    used: ScalarNode


@dataclass(frozen=True)
class Remembered:
    """What is remembered from sample to sample beside the drives' motion; its entries are replaced
    in place.

    Args:
        drives: a `DRIVE` for each.
        forces: a `FORCE` for each that is asked for a touch, by its sensor's name.
        torques: a `TORQUE` for each joint that may be touched, by its index.
    """

    drives: list[dict[str, ScalarNode]]
    forces: dict[str, dict[str, ScalarNode]]
    torques: dict[int, dict[str, ScalarNode]]

    @classmethod
    def of(cls, context: FilterContext, layout: Layout, kernel_state: VectorNode) -> Remembered:
        """Return what a kernel state remembers."""
        names = [sensor.name for sensor in compared_forces(context)]
        torques = _each(TORQUE, layout.part(kernel_state, "torques"), len(context.touchable))
        forces = _each(FORCE, layout.part(kernel_state, "evidence"), len(names))
        return cls(
            _each(DRIVE, layout.part(kernel_state, "forces"), context.n_drives),
            dict(zip(names, forces)),
            dict(zip(context.touchable, torques)),
        )

    @property
    def opened(self) -> dict[int, ScalarNode]:
        """The variance that is open of the torque on each joint [(N m)²]."""
        return {joint: torque["opened"] for joint, torque in self.torques.items()}

    @property
    def touched(self) -> ScalarNode:
        """1 while something touches a joint, else 0."""
        return reduce(ca.fmax, (torque["since"] > 0 for torque in self.torques.values()), ca.MX(0))

    def joined(self) -> dict[str, VectorNode]:
        """Return the parts of a kernel state."""
        return {
            "forces": ca.vertcat(*(DRIVE.joined(**drive) for drive in self.drives)),
            "evidence": ca.vertcat(ca.MX(0, 1), *(FORCE.joined(**f) for f in self.forces.values())),
            "torques": ca.vertcat(
                ca.MX(0, 1), *(TORQUE.joined(**t) for t in self.torques.values())
            ),
        }


def _each(layout: Layout, vector: VectorNode, count: int) -> list[dict[str, ScalarNode]]:
    stretches = (vector[layout.size * i : layout.size * (i + 1)] for i in range(count))
    return [layout.parts(stretch) for stretch in stretches]


def compared_forces(context: FilterContext) -> tuple[Sensor, ...]:
    """Return the forces and tensions that are compared, if a touch is looked for at all."""
    if not context.touchable:
        return ()
    forces = (*context.channels.forces, *context.channels.tensions)
    return tuple(sensor for sensor in context.channels.compared if sensor in forces)


def paced(states: StateVector, kept: Remembered, interval: Interval) -> ScalarNode:
    """Return Σ of the largest recent squares of the drives' speeds over their spreads, (29); what
    is remembered of each changes in place.
    """
    fade = ca.exp(-2 * interval.x[0] / PACE_TIME)
    total = ca.MX(0)
    tracks = Tracks(interval.tracks, states.context.n_drives)
    for i, memory in enumerate(kept.drives):
        spread = states.context.parameters(interval.p, [f"drives.{i}.spread"])
        memory["pace"] = ca.fmax(memory["pace"] * fade, (tracks[i].speed / spread) ** 2)
        total += memory["pace"]
    return total


def evidence_function(context: FilterContext) -> ca.Function:
    """Return (kept, ν, S, used, pace, U, σ, normal, dt) → the parts of `Evidence` of a force: (30).

    The mean z̄ of ν/√S over `EVIDENCE_TIME` is compared with z_w of (29) of logs in free
    motion, by `normal` = (z_a, z_b, n_m). One sample alone never exceeds it.
    """
    kept = ca.SX.sym("kept", FORCE.size)
    normal = ca.SX.sym("normal", len(NORMAL))
    scalars = [ca.SX.sym(name) for name in ("nu", "S", "used", "pace", "U", "sigma", "dt")]
    innovation, variance, used, speed, reading, noise, dt = scalars
    memory = FORCE.parts(kept)
    beyond = ca.fmax(1, speed / normal[2])
    threshold = ca.sqrt((normal[0] ** 2 + normal[1] ** 2 * speed) * beyond)
    if context.mechanism.rig.free_motion is None:
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
    largest = (ca.fabs(reading) + SURE * noise) ** 2
    outputs = [mean, force, usual, used * share * force**2, threshold**2 * variance, largest, used]
    names = [part.name for part in fields(Evidence)]
    inputs = [
        "kept",
        "innovation",
        "variance",
        "is_used",
        "pace",
        "reading",
        "noise",
        "normal_by",
        "dt",
    ]
    arguments = [kept, innovation, variance, used, speed, reading, noise, normal, dt]
    return ca.Function("evidence", arguments, outputs, inputs, names)


def open_torques(
    states: StateVector,
    evidence: Mapping[str, Evidence],
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
        for name, change in context.forces_by_torque(joint).items():
            if name in evidence:
                explained[name] += context.parameters(interval.p, [change]) * mean[at]
    at_joints = {joint: at for at, joint in torques.items()}
    for joint, torque in kept.torques.items():
        names = [name for name in context.by_contact(joint) if name in evidence]
        if not names:
            continue
        moved = context.mechanism.rig.joints[joint].name
        changes = [f"{context.path(of_forces[name])}.by_contact.{moved}" for name in names]
        by_contact = context.parameters(interval.p, changes)
        weighed = ca.horzcat(
            *(
                ca.vertcat(explained[name], *(getattr(evidence[name], part) for part in WEIGHED))
                for name in names
            )
        )
        opening = opening_function(len(names))
        remembered = TORQUE.joined(**torque)
        after = opening(remembered, mean[at_joints[joint]], weighed, by_contact, interval.x[0])
        torque.update(TORQUE.parts(after))


def opening_function(count: int) -> ca.Function:
    """Return (kept, τ_ext, weighed, b, dt) → what is remembered of a torque by some forces: (32),
    (33).

    A force U that changes by a_τ for a unit of torque on a joint changes by b = √(a_τᵀ C_τ a_τ)
    over the joint's own √C_τ for one with what contacts make beside it. It feels one beyond
    √(normal)/b; all together beyond τ₀, 1/τ₀² = Σ b²/normal. The torques explain Σ a_τ τ_ext of
    each force, z² = Σ explained²/normal of all. The opened variance is the largest of what it was,
    fading, of `OPENED`² Σ excess/b², and of τ₀² (z² − 1); that of a clear torque fades slowly. No
    torque is larger than the forces that are read hold: Σ √most/b.
    """
    kept = ca.SX.sym("kept", TORQUE.size)
    by_contact = ca.SX.sym("b", count)
    torque = ca.SX.sym("torque")
    dt = ca.SX.sym("dt")
    weighed = ca.SX.sym("weighed", 1 + len(WEIGHED), count)
    was = TORQUE.parts(kept)
    square = by_contact**2
    explained, excess, normal, most, used = (weighed[k, :].T for k in range(1 + len(WEIGHED)))
    least = ca.fmax(normal, SMALLEST_TORQUE)
    felt = ca.sum1(used * square / least)
    lost = felt <= 0
    smallest = 1 / ca.fmax(felt, SMALLEST_TORQUE)
    z_square = ca.sum1(used * explained**2 / least)
    pushed = (1 - was["share"]) * OPENED**2 * ca.sum1(excess / square)
    held = ca.if_else(lost, 0, smallest * ca.fmax(z_square - 1, 0))
    clearly = ca.if_else(lost, 0, smallest * ca.fmax(z_square - CLEARLY**2, 0))
    largest = ca.sum1(ca.sqrt(most / square)) ** 2
    clear = ca.fmax(ca.exp(-2 * dt / LASTING_TIME) * was["clear"], ca.fmin(clearly, largest))
    fade = ca.exp(-2 * dt / CLOSING_TIME)
    opened = ca.fmax(ca.fmax(fade * was["opened"], clear), ca.fmin(ca.fmax(pushed, held), largest))
    share = ca.if_else(lost, fade * was["share"], opened / (opened + smallest))
    times = torque**4 / ca.fmax(smallest**2, SMALLEST_TORQUE)
    probability = ca.if_else(lost, was["probability"], times / (times + TOUCHING**4))
    touches = probability > ca.if_else(was["since"] > 0, STILL, 0.5)
    since = ca.if_else(touches, was["since"] + dt, 0)
    after = TORQUE.joined(
        opened=opened, clear=clear, share=share, probability=probability, since=since
    )
    return ca.Function("opening", [kept, torque, weighed, by_contact, dt], [after])


def touch_layout(context: FilterContext) -> dict[str, int]:
    """Return the lengths of what is remembered of forces and torques, for the kernel state."""
    return {
        "forces": DRIVE.size * context.n_drives,
        "evidence": FORCE.size * len(compared_forces(context)),
        "torques": TORQUE.size * len(context.touchable),
    }
