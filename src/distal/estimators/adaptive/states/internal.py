"""Internal states of a rig, which no sensor sees: the far side of a backlash, points of a cable in
its sheath, the creep of a tendon.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from typing import ClassVar

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.estimators.adaptive.filter_context import FilterContext
from distal.estimators.adaptive.states.state import Begin, Learning, State, ZeroMean
from distal.estimators.state_kinds import StateKind
from distal.expressions import Scalar, Vector
from distal.model import Mechanism
from distal.rig import Rig

LEAST_TENSION = 1.0
"""Smallest tension that is assumed at the start [N]; it only sets the uncertainty of the start.
Source: judgement.
"""

UNKNOWN_TENSION = 10.0
"""Tension that is assumed at the start where neither sensor nor pre-tension nor nominal force gives
one [N]. Source: judgement.
"""


@dataclass(frozen=True)
class Inside(ZeroMean):
    """One of the model's internal states: a parameter of its equations that moves (see
    `internal_motion.follow`) from the first reading on.
    """

    context: FilterContext
    name: str

    @property
    def _keys(self) -> tuple[str, int, str, str]:
        """Keys of its name: drives or tendons, the index among them, the part of that, and the last
        key.
        """
        kind, index, part, *keys = self.name.split(".")
        return kind, int(index), part, keys[-1]

    @property
    def kind(self) -> StateKind:
        """Kind of the state: backlash, sheath or creep."""
        drive_or_tendon, _, part, _ = self._keys
        if drive_or_tendon == "drives":
            return StateKind.BACKLASH
        return StateKind.SHEATH if part == "path" else StateKind.CREEP

    @property
    def part(self) -> str:
        """Name of the drive or tendon."""
        kind, index, _, _ = self._keys
        return self.context.mechanism.rig.components[kind][index].name

    @property
    def index(self) -> int:
        """Index of the drive or tendon."""
        return self._keys[1]

    @property
    def point(self) -> int:
        """Number of the point in a sheath, from the drive to the joint; 0 for any other state."""
        return int(self._keys[3]) if self.kind is StateKind.SHEATH else 0

    @property
    def names(self) -> tuple[str, ...]:
        """Name of the state: ``backlash_DRIVE``, ``sheath_TENDON_k`` or ``creep_TENDON``."""
        if self.kind is StateKind.SHEATH:
            return (f"sheath_{self.part}_{self.point}",)
        return (f"{self._keys[2]}_{self.part}",)

    @property
    def stds(self) -> Floats:
        """Prior standard deviation where nothing is read at the first sample; see `first`."""
        n = self.context.n_drives
        nt = self.context.mechanism.n_tendons
        begin = self.first(Begin([0.0] * n, [None] * n, [None] * nt))
        assert begin is not None  # it always says
        p = self.context.mechanism.parameters
        return np.array([float(ca.Function("std", [p.symbols], [begin[1]])(p.values))])

    def parameters(self, values: Vector, p: Vector) -> Vector:
        """Return the model's parameters with this state's value among them."""
        changed = ca.SX(p)
        changed[self.context.mechanism.parameters.names.index(self.name)] = values[0]
        return changed

    def _value(self, path: str) -> Scalar:
        return self.context.mechanism.parameters[path]

    def _std(self, path: str) -> Scalar:
        name = f"{path}.std"
        inputs = self.context.mechanism.parameters
        return self.context.number(name) if path in inputs.names else 0.0


@dataclass(frozen=True)
class BacklashOrSheathState(Inside):
    """The far side of a backlash, or a point in a sheath [m, rad]."""

    @property
    def which(self) -> int:
        """Index among the mechanism's plays."""
        return self.context.mechanism.plays.index(self.name)

    def first(self, begin: Begin) -> tuple[Scalar, Scalar]:
        """Return mean and standard deviation at the first sample: in the middle of where
        it can be.
        """
        index = self.index
        mechanism = self.context.mechanism
        if self.kind is StateKind.BACKLASH:
            path = f"drives.{index}.backlash.width"
            width = self._value(path) + 2 * self._std(path)
            return begin.positions[index], width / sqrt(12.0)
        still = Mechanism(mechanism.rig)
        p = still.parameters
        q = ca.SX.sym("q", still.n_bodies)
        tension = ca.SX.sym("T")
        sheath = still.sheath(index, q)
        point = self.point
        assert sheath is not None  # it has points
        position = still.internal_state(q).inside[self.which]
        joints = still.joints_of[index]
        initial = [f"joints.{j}.initial" for j in range(mechanism.n_joints)]
        slopes = ca.jacobian(position, q)
        stds = ca.SX.sym("stds", mechanism.n_joints)
        turned = sum(((slopes[0, j] * stds[j]) ** 2 for j in joints), ca.SX(0))
        friction = (sheath.drawn**sheath.count - 1) * tension / sheath.stiffness
        share = (2 * point + 1) / (2 * sheath.count)
        spread = ca.sqrt(turned + (share * friction) ** 2)
        prior = ca.Function("first", [q, tension, stds, p.symbols], [position, spread])
        mean, std = prior(
            ca.vertcat(*map(self.context.number, initial), *begin.positions),
            _tension(self.context, index, begin),
            ca.vertcat(*(self.context.number(f"{path}.std") for path in initial)),
            ca.vertcat(*(mechanism.parameters[name] for name in p.names)),
        )
        return mean, std


@dataclass(frozen=True)
class Strained(Inside):
    """The slow part of a tendon's stretch [m], which creeps over minutes."""

    learning: ClassVar[Learning] = Learning.AS_CREEP

    @property
    def which(self) -> int:
        """Index among the mechanism's strains."""
        return self.context.mechanism.strains.index(self.name)

    def first(self, begin: Begin) -> tuple[Scalar, Scalar]:
        """Return mean and standard deviation at the first sample: the share ``settled`` of γ T/k_t
        has crept already.
        """
        index = self.index
        path = self.name.rpartition(".")[0]
        share = self._value(f"{path}.share")
        share_std = self._std(f"{path}.share")
        stretch = _tension(self.context, index, begin) / self._value(f"tendons.{index}.stiffness")
        settled = self.context.number(f"{path}.settled")
        settled_std = self.context.number(f"{path}.settled.std")
        spread = ca.sqrt((share * settled_std) ** 2 + (share_std * settled) ** 2)
        return settled * share * stretch, spread * stretch


def _tension(context: FilterContext, tendon: int, begin: Begin) -> Scalar:
    """Return a tendon's tension at the first sample [N]: as read, from its drive's effort, or as
    likely.
    """
    mechanism = context.mechanism
    path = f"tendons.{tendon}"
    part = mechanism.rig.tendons[tendon]
    index = mechanism.drive_of[tendon] - mechanism.n_joints
    tension = begin.tensions[tendon]
    effort = begin.efforts[index]
    drive = mechanism.rig.drives[index]
    if tension is None and effort is not None:
        lever = mechanism.parameters[f"drives.{index}.radius"] if drive.kind == "capstan" else 1.0
        count = sum(neighbour.drive == part.drive for neighbour in mechanism.rig.tendons)
        share = effort / lever / count * (part.winding if drive.kind == "capstan" else 1)
        tension = share + context.number(f"{path}.pretension") * (1 - 1 / count)
    if tension is None:
        return context.number(f"{path}.likely_tension")
    return ca.fmax(tension, LEAST_TENSION)


def likely_tension(rig: Rig, tendon: int) -> float:
    """Return the likely tension of a tendon at the start where nothing reads it [N]: pre-tension,
    else nominal force, else `UNKNOWN_TENSION`.
    """
    part = rig.tendons[tendon]
    drive = next(drive for drive in rig.drives if drive.name == part.drive)
    return part.pretension.value or abs(drive.nominal_force.value) or UNKNOWN_TENSION


def inside(context: FilterContext) -> Sequence[State]:
    """Return a block for each internal state of the rig."""
    mechanism = context.mechanism
    plays = [BacklashOrSheathState(context, name) for name in mechanism.plays]
    return [*plays, *(Strained(context, name) for name in mechanism.strains)]
