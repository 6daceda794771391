"""All steps of the adaptive filter in their order: an interval, then a sample. The equations are
those of docs/reference/adaptive-equations.md.

The kernel state is the mean, the covariance, and what is remembered of each drive's motion, of
forces, and of torques on the joints. Independent subsystems have a filter each, side by side in one
kernel: the covariance between them is zero and stays zero.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import casadi as ca
import numpy as np

from distal.estimators.adaptive.drive_tracking import MEMORY, REMEMBERED, tracking
from distal.estimators.adaptive.filter_context import DERIVED
from distal.estimators.adaptive.filter_inputs import Interval, Prediction, states_of_rig
from distal.estimators.adaptive.joint_motion import Moved, moved
from distal.estimators.adaptive.prediction import follow, play, predicted, revert, within_play
from distal.estimators.adaptive.states import StateVector
from distal.estimators.adaptive.touch import (
    FORCE,
    TORQUE,
    Remembered,
    compared_forces,
    touch_layout,
)
from distal.estimators.adaptive.update import depths_in_stops, updated
from distal.estimators.estimator_protocol import Channels
from distal.expressions import MatrixNode, VectorNode, symbols
from distal.kernels import Indices, Layout, PlacedKernel, kernel_state_layout, side_by_side
from distal.rig import Subsystem, independent_parts


def adaptive_layout(states: StateVector) -> Layout:
    """Return the layout of the kernel state: mean, covariance, and what is remembered of each
    drive's motion, of forces, and of torques on the joints.
    """
    context = states.context
    drives = MEMORY, context.n_drives
    return kernel_state_layout(len(states), drives=drives, **touch_layout(context))


@lru_cache(maxsize=32)
def adaptive_function(
    states: StateVector, resolution: float | None = None, trace: bool = False
) -> ca.Function:
    """Return the function (kernel_state, x, p) → (kernel_state⁺, y) of the displacement-driven
    filter; y = (innovations, variances).

    Args:
        resolution: of the joints' motion; see `FilterContext.substeps`.
        trace: append the predicted mean, its covariance and the transition to y, for smoothing.
    """
    context = states.context
    layout = adaptive_layout(states)
    parameters = len(context.mechanism.parameters)
    parts = subsystems_of(states)
    if parts:
        filters = [adaptive_function(part.states, resolution, trace) for part in parts]
        m = 2 * len(context.channels.compared)
        outputs = len(_meanings(states)["y"]) if trace else m
        sizes = layout.size, context.width, parameters, outputs
        return side_by_side("adaptive", [part.of(f) for part, f in zip(parts, filters)], sizes)
    inputs = symbols(ca.MX, kernel_state=layout.size, x=context.width, p=parameters)
    kernel_state, x, p = inputs
    mean, covariance, memory = (
        layout.part(kernel_state, name) for name in ("mean", "covariance", "drives")
    )
    tracks = tracking(states)(mean, memory, x, p)  # (1) to (6)
    interval = Interval(tracks, memory, x, p)
    motion = moved(states, context.substeps(resolution), mean, covariance, interval)  # (7) to (10)
    after = predicted(states, mean, covariance, motion, interval)  # (11), (12)
    prediction = Prediction(*after, _moving(states, motion))
    kept = Remembered.of(context, layout, kernel_state)
    revert(states, prediction, kept.opened, interval)  # (13)
    for i in range(context.n_drives):
        if states.transmitted(i) is not None:
            kept.friction[i] = play(
                states, i, prediction, motion.rates, kept.friction[i], interval
            )  # (14), (15)
    follow(states, prediction, interval)  # (15b)
    before = [ca.MX(prediction.state), ca.vec(prediction.covariance), ca.vec(prediction.transition)]
    mean, covariance, y = updated(states, prediction, motion.rates, kept, interval)  # (17) to (32)
    mean, covariance = within_play(states, mean, covariance, interval)  # (26b)
    _bounded(states, mean, covariance, p)
    remembered = tracks[:MEMORY, :]
    following = layout.joined(mean=mean, covariance=covariance, drives=remembered, **kept.joined())
    y = ca.vertcat(y, *before) if trace else y
    return ca.Function("adaptive", inputs, [following, y])


def _bounded(states: StateVector, mean: VectorNode, covariance: MatrixNode, p: VectorNode) -> None:
    """Keep states above their lowest values, and the variances of angles above those that stops
    leave, in place.
    """
    for at, lowest in enumerate(states.lowest):
        if np.isfinite(lowest):
            least = states.context.parameters(p, [f"state.{at}.lowest"])
            mean[at] = ca.fmax(mean[at], least)  # (27)
    for j, depth in depths_in_stops(states, mean, p).items():
        # how deep a joint sits in its stop is known no better than the depth
        covariance[j, j] = ca.fmax(covariance[j, j], ca.fmax(depth, 0) ** 2)  # (27b)


def _moving(states: StateVector, motion: Moved) -> MatrixNode:
    """Return the transition Φ, (n, n), of an interval in which nothing but angles and speeds
    moves.
    """
    n = len(states)
    nj = states.context.n_joints
    transition = ca.MX(ca.DM.eye(n).full())
    parameters = len(motion.chosen)
    transition[: 2 * nj, :] = 0
    transition[: 2 * nj, motion.chosen] = motion.slopes[:parameters, :].T
    for k, (at, slopes) in enumerate(motion.positions):
        if at:
            transition[: 2 * nj, at] += ca.mtimes(motion.slopes[parameters + k, :].T, slopes.T)
    return transition


@dataclass(frozen=True)
class Apart:
    """An independent subsystem with its own state vector, and the indices of its values among those
    of the whole filter.

    Args:
        states: its state vector.
        at: vector of a kernel (kernel_state, x, p, y) → indices of its numbers in that of the
            whole; y as with `trace`.
    """

    states: StateVector
    at: dict[str, Indices]

    def of(self, function: ca.Function) -> PlacedKernel:
        """Return the filter of the subsystem, `function`, as a part of the whole."""
        at = {**self.at, "y": self.at["y"][: function.numel_out(1)]}
        return PlacedKernel(function, **at)


@lru_cache(maxsize=32)
def subsystems_of(states: StateVector) -> tuple[Apart, ...]:
    """Return the independent subsystems of a filter; none where there is only one."""
    mechanism = states.context.mechanism
    parts = independent_parts(mechanism.rig)
    if len(parts) == 1 or mechanism.parameters.inside:
        return ()
    filters = tuple(_apart(states, part) for part in parts)
    # a state that two parts have in common, or that neither has, would tie them
    covered = [key for part in filters for key in _keys(part.states)]
    return filters if sorted(covered) == sorted(_keys(states)) else ()


def _apart(states: StateVector, part: Subsystem) -> Apart:
    context = states.context
    parameters = context.mechanism.parameters
    inputs = part.own_paths(parameters.inputs)
    channels = _channels(part, context.channels)
    subsystem = states_of_rig(
        part.rig, inputs, channels, context.robustness, states.kinds, parameters.folded
    )
    of_all = _meanings(states)
    at = {name: _among(of_all[name], meanings) for name, meanings in _meanings(subsystem).items()}
    of_states = _among(_keys(states), _keys(subsystem))
    names = subsystem.context.mechanism.parameters.names
    at["p"] = _among(parameters.names, [_whole_name(part, of_states, name) for name in names])
    return Apart(subsystem, at)


def _meanings(states: StateVector) -> dict[str, list[tuple[str, object]]]:
    """Return a vector of the kernel → what each of its numbers is, in the words of the rig."""
    context = states.context
    rig = context.rig
    channels = context.channels
    keys = _keys(states)
    square = [(row, column) for column in keys for row in keys]
    forces = [sensor.name for sensor in compared_forces(context)]
    torques = [rig.joint_names[joint] for joint in context.touchable]
    compared = [sensor.name for sensor in channels.compared]
    kernel_state: dict[str, Iterable[object]] = {
        "mean": keys,
        "covariance": square,
        "drives": product(rig.drive_names, REMEMBERED),
        "forces": rig.drive_names,
        "evidence": product(forces, FORCE.names),
        "torques": product(torques, TORQUE.names),
    }
    x: dict[str, Iterable[object]] = {
        "dt": [None],
        "values": channels.names,
        "mask": channels.names,
    }
    y: dict[str, Iterable[object]] = {
        "values": compared,
        "variances": compared,
        "mean": keys,
        "covariance": square,
        "transition": square,
    }
    return {
        vector: [(name, meaning) for name, meanings in parts.items() for meaning in meanings]
        for vector, parts in (("kernel_state", kernel_state), ("x", x), ("y", y))
    }


def _among(whole: Sequence[object], part: Sequence[object]) -> Indices:
    """Return the indices of some things among all, −1 for one that is not among them."""
    index = {item: i for i, item in enumerate(whole)}
    return np.array([index.get(item, -1) for item in part], dtype=np.intp)


def _whole_name(part: Subsystem, at: Indices, name: str) -> str:
    """Return the name among the whole filter's inputs for an input of a subsystem, whose states
    have the indices `at` in the whole.
    """
    path = name.removeprefix(DERIVED)
    if path == name:
        return part.whole_path(name)
    if path.startswith("state."):
        _, index, key = path.split(".")
        return f"{DERIVED}state.{at[int(index)]}.{key}"
    return f"{DERIVED}{part.whole_path(path)}"


def _keys(states: StateVector) -> list[tuple[str, str, int]]:
    """Return for each state its kind, its component, and its number among several of that kind and
    component.
    """
    counts = Counter[tuple[str, str]]()
    keys = []
    for state in states.states:
        of = state.kind.name, state.part
        keys.append((*of, counts[of]))
        counts[of] += 1
    return keys


def _channels(part: Subsystem, channels: Channels) -> Channels:
    """Return the sensors of a part; its nominal interval is that of the whole rig."""
    own = {*part.rig.sensor_names, *part.rig.joint_names}
    positions, forces, tensions, angles = (
        tuple(sensor for sensor in sensors if {sensor.name, sensor.of} & own)
        for sensors in (channels.positions, channels.forces, channels.tensions, channels.angles)
    )
    return Channels(positions, forces, tensions, angles, channels.interval)
