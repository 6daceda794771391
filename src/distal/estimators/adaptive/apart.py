"""One filter of parts that move without one another: each part's own filter, side by side in one kernel.

The covariance between parts is zero and stays so; what one part costs, and what its sensors say, does not touch the others.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import casadi as ca
import numpy as np

from distal.estimators.adaptive.drive_tracking import MEMORY
from distal.estimators.adaptive.states.vector import StateVector
from distal.estimators.channels import Channels
from distal.expressions import VectorNode
from distal.kernels import Indices, Layout, placed, taken
from distal.model import Mechanism
from distal.rig import Part, independent_parts


@dataclass(frozen=True)
class Apart:
    """A part of a rig with its own state vector, and where its numbers stand in those of the whole.

    Args:
        at: of its states, (n,).
        inputs: of its inputs x = (dt, values, mask).
        numbers: of its model's parameters.
        compared: of its innovations.
    """

    states: StateVector
    at: Indices
    drives: Indices
    inputs: Indices
    numbers: Indices
    compared: Indices


@lru_cache(maxsize=32)
def parts_of(states: StateVector) -> tuple[Apart, ...]:
    """Return the parts of a filter that do not touch each other; none where there is only one."""
    mechanism = states.context.mechanism
    parts = independent_parts(mechanism.rig)
    if len(parts) == 1 or mechanism.parameters.inside:
        return ()
    filters = tuple(_apart(states, part) for part in parts)
    # a state that two parts have in common, or that neither has, would tie them
    covered = np.sort(np.concatenate([part.at for part in filters]))
    return filters if np.array_equal(covered, np.arange(len(states))) else ()


def _apart(states: StateVector, part: Part) -> Apart:
    context, parameters = states.context, states.context.mechanism.parameters
    mechanism = Mechanism(part.rig, part.own_paths(parameters.inputs), remembers=True)
    channels = _channels(part, context.channels)
    part_states = StateVector(replace(context, mechanism=mechanism, channels=channels), states.kinds)
    keys, every = _keys(states), context.channels.names
    values = np.array([every.index(name) for name in channels.names], dtype=np.intp)
    compared = [sensor.name for sensor in context.channels.compared]
    return Apart(
        part_states,
        np.array([keys.index(key) if key in keys else -1 for key in _keys(part_states)], dtype=np.intp),
        np.array(part.indices["drives"], dtype=np.intp),
        np.concatenate([[0], 1 + values, 1 + len(every) + values]).astype(np.intp),
        np.array([parameters.names.index(part.whole_path(name)) for name in mechanism.parameters.names], dtype=np.intp),
        np.array([compared.index(sensor.name) for sensor in channels.compared], dtype=np.intp),
    )


def _keys(states: StateVector) -> list[tuple[object, str, int]]:
    """Return for each state its kind, what it is of, and which of several of that kind it is."""
    counts, keys = Counter[tuple[object, str]](), list[tuple[object, str, int]]()
    for kind, part in zip(states.state_kinds, states.state_parts):
        keys.append((kind, part, counts[kind, part]))
        counts[kind, part] += 1
    return keys


@dataclass(frozen=True)
class _PartOfChannels(Channels):
    """The sensors of a part; its nominal interval is that of the whole rig."""

    nominal_interval: float = 0.0

    @property
    def interval(self) -> float:
        """Interval of the fastest sensor of the whole rig [s]."""
        return self.nominal_interval


def _channels(part: Part, channels: Channels) -> Channels:
    names = {sensor.name for sensor in part.rig.sensors}
    joints = {joint.name for joint in part.rig.joints}

    positions, forces, tensions, others = (
        tuple(sensor for sensor in sensors if sensor.name in names)
        for sensors in (channels.positions, channels.forces, channels.tensions, channels.others)
    )
    angles = tuple(sensor for sensor in channels.angles if sensor.of in joints)
    return _PartOfChannels(positions, forces, tensions, angles, others, channels.interval)


def side_by_side(
    parts: Sequence[Apart],
    filters: Sequence[ca.Function],
    layouts: Callable[[int, int], Layout],
    sizes: tuple[int, int, int, int],
    numbers: int,
    trace: bool,
) -> ca.Function:
    """Return (carry, x, p) → (carry⁺, y) of a rig, whose parts' filters are given.

    Args:
        filters: of the parts, (carry, x, p) → (carry⁺, y) each.
        layouts: (states, drives) → layout of a carry.
        sizes: number of states, drives, inputs and innovations of the rig.
        numbers: number of the model's parameters.
        trace: whether the predicted mean, its covariance and the transition stand behind y.
    """
    n, nd, width, m = sizes
    layout = layouts(n, nd)
    carry, x, p = ca.MX.sym("carry", layout.size), ca.MX.sym("x", width), ca.MX.sym("p", numbers)
    first = {name: layout[name].start for name in ("mean", "covariance", "drives", "forces")}
    carries, outputs = list[VectorNode](), list[VectorNode]()
    to_carry, to_y = list[Indices](), list[Indices]()
    for part, part_filter in zip(parts, filters):
        # matrices stand column by column
        square = (part.at[None, :] * n + part.at[:, None]).ravel(order="F")
        memory = (MEMORY * part.drives[:, None] + np.arange(MEMORY)).ravel()
        stretches = {"mean": part.at, "covariance": square, "drives": memory, "forces": part.drives}
        to_carry.append(np.concatenate([first[name] + at for name, at in stretches.items()]))
        after, y = part_filter(taken(carry, to_carry[-1]), taken(x, part.inputs), taken(p, part.numbers))
        carries.append(after)
        outputs.append(y)
        places = [part.compared, m + part.compared]
        if trace:
            places += [2 * m + part.at, 2 * m + n + square, 2 * m + n + n * n + square]
        to_y.append(np.concatenate(places))
    # what stands between parts is zero and stays as it is
    following = ca.MX(carry)
    for after, at in zip(carries, to_carry):
        following[at.tolist()] = after
    y = placed(outputs, to_y, 2 * m + (n + 2 * n * n if trace else 0))
    return ca.Function("adaptive", [carry, x, p], [following, y], ["carry", "x", "p"], ["next", "y"])
