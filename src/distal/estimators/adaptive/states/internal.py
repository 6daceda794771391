"""Internal states of a rig, which no sensor sees: the far side of a backlash, points of a cable in
its sheath, the creep of a tendon.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from math import sqrt

import casadi as ca

from distal.estimators.adaptive.filter_context import FilterContext
from distal.estimators.adaptive.states.state import Begin, State
from distal.estimators.state_kinds import StateKind
from distal.expressions import Scalar
from distal.model import Mechanism
from distal.rig import Rig

UNKNOWN_TENSION = 10.0
"""Tension that is assumed at the start where neither sensor nor pre-tension nor nominal force gives
one [N]. Source: judgement.
"""


def inside(context: FilterContext) -> Iterator[State]:
    """Yield the model's internal states: parameters of its equations that move (see
    `internal_motion.follow`) from the first reading on. They are the far sides of backlashes and
    the points in sheaths [m, rad], then the slow parts of tendons' stretches [m], which creep over
    minutes.

    A prior standard deviation is that where nothing is read at the first sample.
    """
    mechanism = context.mechanism
    p = mechanism.parameters
    nothing = Begin(
        [0.0] * context.n_drives, [None] * context.n_drives, [None] * mechanism.n_tendons
    )
    for path in (*mechanism.plays, *mechanism.strains):
        components, index, quantity, *keys = path.split(".")
        part = mechanism.rig.components[components][int(index)].name
        kind = StateKind.BACKLASH if components == "drives" else StateKind.CREEP
        name = f"{quantity}_{part}"
        if quantity == "path":
            kind = StateKind.SHEATH
            name = f"sheath_{part}_{keys[-1]}"
        first = partial(FIRST[kind], context, path, int(index))
        std = float(ca.Function("std", [p.symbols], [first(nothing)[1]])(p.values))
        at = p.names.index(path)
        yield State(name, kind, part, 0.0, std, indices=(at,), first=first)


def _std(context: FilterContext, path: str) -> Scalar:
    """Return the std of a parameter, 0 where the filter has no such input."""
    return context.number(f"{path}.std") if path in context.mechanism.parameters.names else 0


def _far_side(context: FilterContext, path: str, drive: int, begin: Begin) -> tuple[Scalar, Scalar]:
    """Return mean and std of the far side of a backlash at the first sample: in the middle of
    where it can be.
    """
    width = f"drives.{drive}.backlash.width"
    most = context.mechanism.parameters[width] + 2 * _std(context, width)
    return begin.positions[drive], most / sqrt(12.0)


def _point(context: FilterContext, path: str, tendon: int, begin: Begin) -> tuple[Scalar, Scalar]:
    """Return mean and std of a point in a sheath at the first sample: as if nothing rubbed."""
    mechanism = context.mechanism
    still = Mechanism(mechanism.rig)
    p = still.parameters
    q = ca.SX.sym("q", still.n_bodies)
    tension = ca.SX.sym("T")
    sheath = still.sheath(tendon)
    assert sheath is not None  # it has points
    position = still.internal_state(q).inside[mechanism.plays.index(path)]
    initial = [f"joints.{j}.initial" for j in range(mechanism.n_joints)]
    slopes = ca.jacobian(position, q)
    stds = ca.SX.sym("stds", mechanism.n_joints)
    turned = sum(((slopes[0, j] * stds[j]) ** 2 for j in still.joints_of[tendon]), ca.SX(0))
    friction = (sheath.drawn**sheath.count - 1) * tension / sheath.stiffness
    share = (2 * int(path.rpartition(".")[2]) + 1) / (2 * sheath.count)
    spread = ca.sqrt(turned + (share * friction) ** 2)
    prior = ca.Function("first", [q, tension, stds, p.symbols], [position, spread])
    mean, std = prior(
        ca.vertcat(*map(context.number, initial), *begin.positions),
        _tension(context, tendon, begin),
        ca.vertcat(*(context.number(f"{angle}.std") for angle in initial)),
        ca.vertcat(*(mechanism.parameters[name] for name in p.names)),
    )
    return mean, std


def _strain(context: FilterContext, path: str, tendon: int, begin: Begin) -> tuple[Scalar, Scalar]:
    """Return mean and std of the slow part of a stretch at the first sample: the share ``settled``
    of γ T/k_t has crept already.
    """
    p = context.mechanism.parameters
    creep = path.rpartition(".")[0]
    share = p[f"{creep}.share"]
    stretch = _tension(context, tendon, begin) / p[f"tendons.{tendon}.stiffness"]
    settled = context.number(f"{creep}.settled")
    spread = ca.sqrt(
        (share * context.number(f"{creep}.settled.std")) ** 2
        + (_std(context, f"{creep}.share") * settled) ** 2
    )
    return settled * share * stretch, spread * stretch


FIRST: dict[StateKind, Callable[[FilterContext, str, int, Begin], tuple[Scalar, Scalar]]] = {
    StateKind.BACKLASH: _far_side,
    StateKind.SHEATH: _point,
    StateKind.CREEP: _strain,
}
"""Kind of an internal state → its mean and std at the first sample. Source: definition."""


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
    return ca.fmax(tension, 0)


def likely_tension(rig: Rig, tendon: int) -> float:
    """Return the likely tension of a tendon at the start where nothing reads it [N]: pre-tension,
    else nominal force, else `UNKNOWN_TENSION`.
    """
    part = rig.tendons[tendon]
    drive = next(drive for drive in rig.drives if drive.name == part.drive)
    return part.home_tension or abs(drive.nominal_force.value) or UNKNOWN_TENSION
