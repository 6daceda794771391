"""All steps of the adaptive filter in their order: an interval, then a sample. The equations are
those of docs/reference/adaptive-equations.md.

The kernel state is the mean, the covariance, and what is remembered of each drive's motion, of
forces, and of torques on the joints. Independent subsystems have a filter each, side by side in one
kernel: the covariance between them is zero and stays zero.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from distal.estimators.adaptive.drive_tracking import MEMORY, Tracks, tracking
from distal.estimators.adaptive.filter_context import DERIVED
from distal.estimators.adaptive.filter_inputs import Interval, Prediction, states_of_rig
from distal.estimators.adaptive.joint_motion import Moved, moved
from distal.estimators.adaptive.prediction import follow, play, predicted, revert, within_play
from distal.estimators.adaptive.states import StateVector
from distal.estimators.adaptive.touch import (
    DRIVE,
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
from distal.rig import Sensor, Subsystem, independent_parts


def adaptive_layout(states: StateVector) -> Layout:
    """Return the layout of the kernel state: mean, covariance, and what is remembered of each
    drive's motion, of forces, and of torques on the joints.
    """
    context = states.context
    drives = MEMORY * context.n_drives
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
    filters = [
        (part, adaptive_function(part.states, resolution, trace)) for part in subsystems_of(states)
    ]
    if filters:
        return filter_by_parts(states, filters, layout, trace)
    parameters = len(context.mechanism.parameters)
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
            friction = kept.drives[i]["friction"]
            kept.drives[i]["friction"] = play(
                states, i, prediction, motion.rates, friction, interval
            )  # (14), (15)
    follow(states, prediction, interval)  # (15b)
    before = [ca.MX(prediction.state), ca.vec(prediction.covariance), ca.vec(prediction.transition)]
    mean, covariance, y = updated(states, prediction, motion.rates, kept, interval)  # (17) to (32)
    mean, covariance = within_play(states, mean, covariance, interval)  # (26b)
    _bounded(states, mean, covariance, p)
    remembered = Tracks(tracks).memory
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
        at: indices of its states, (n,).
        drives: of its drives.
        inputs: of its inputs x = (dt, values, mask).
        parameters: of its model's parameters.
        compared: of its innovations.
        forces: of its forces that are asked for a touch, among all that are.
        touchable: of its joints that may be touched, among all that may be.
    """

    states: StateVector
    at: Indices
    drives: Indices
    inputs: Indices
    parameters: Indices
    compared: Indices
    forces: Indices
    touchable: Indices


@lru_cache(maxsize=32)
def subsystems_of(states: StateVector) -> tuple[Apart, ...]:
    """Return the independent subsystems of a filter; none where there is only one."""
    mechanism = states.context.mechanism
    parts = independent_parts(mechanism.rig)
    if len(parts) == 1 or mechanism.parameters.inside:
        return ()
    filters = tuple(_apart(states, part) for part in parts)
    # a state that two parts have in common, or that neither has, would tie them
    covered = np.sort(np.concatenate([part.at for part in filters]))
    return filters if np.array_equal(covered, np.arange(len(states))) else ()


def _apart(states: StateVector, part: Subsystem) -> Apart:
    context = states.context
    parameters = context.mechanism.parameters
    inputs = part.own_paths(parameters.inputs)
    channels = _channels(part, context.channels)
    part_states = states_of_rig(
        part.rig, inputs, channels, context.robustness, states.kinds, parameters.folded
    )
    at = _among(_keys(states), _keys(part_states))
    values = _among(context.channels.names, channels.names)
    forces = compared_forces(part_states.context)
    names = part_states.context.mechanism.parameters.names
    return Apart(
        part_states,
        at,
        np.array(part.indices["drives"], dtype=np.intp),
        np.concatenate([[0], 1 + values, 1 + len(context.channels.names) + values]),
        np.array([parameters.index(_whole_name(part, at, name)) for name in names], dtype=np.intp),
        _among(context.channels.compared, channels.compared),
        _among(compared_forces(context), forces),
        _among(context.touchable, [j for j in part.indices["joints"] if j in context.touchable]),
    )


def _among(whole: Sequence[object], part: Sequence[object]) -> Indices:
    """Return the indices of some things among all, −1 for one that is not among them."""
    return np.array([whole.index(item) if item in whole else -1 for item in part], dtype=np.intp)


def _whole_name(part: Subsystem, at: Indices, name: str) -> str:
    """Return the name among the whole filter's inputs for an input of a subsystem, whose states
    have the indices `at` in the whole.
    """
    derived = name.startswith(DERIVED)
    path = name.removeprefix(DERIVED)
    if not derived:
        return part.whole_path(name)
    if path.startswith("state."):
        _, index, key = path.split(".")
        return f"{DERIVED}state.{at[int(index)]}.{key}"
    return f"{DERIVED}{part.whole_path(path)}"


def _keys(states: StateVector) -> list[tuple[object, str, int]]:
    """Return for each state its kind, its component, and its number among several of that kind and
    component.
    """
    counts = Counter[tuple[object, str]]()
    keys = list[tuple[object, str, int]]()
    for kind, part in zip(states.state_kinds, states.state_parts):
        keys.append((kind, part, counts[kind, part]))
        counts[kind, part] += 1
    return keys


def _channels(part: Subsystem, channels: Channels) -> Channels:
    """Return the sensors of a part; its nominal interval is that of the whole rig."""

    def of_part(sensors: Sequence[Sensor]) -> tuple[Sensor, ...]:
        return tuple(sensor for sensor in sensors if sensor.name in part.rig.sensor_names)

    return Channels(
        of_part(channels.positions),
        of_part(channels.forces),
        of_part(channels.tensions),
        tuple(sensor for sensor in channels.angles if sensor.of in part.rig.joint_names),
        channels.interval,
    )


def _stretches(which: Indices, size: int) -> Indices:
    """Return the indices of the values of some objects that have `size` values each."""
    return (size * which[:, None] + np.arange(size)).ravel()


def filter_by_parts(
    states: StateVector, filters: Sequence[tuple[Apart, ca.Function]], layout: Layout, trace: bool
) -> ca.Function:
    """Return the function (kernel_state, x, p) → (kernel_state⁺, y) of a rig from the filters of
    its subsystems.

    With `trace` the predicted mean, its covariance and the transition are appended to y.
    """
    context = states.context
    n = len(states)
    m = len(context.channels.compared)
    kernels = []
    for part, part_filter in filters:
        # matrices stand column by column
        square = (part.at[None, :] * n + part.at[:, None]).ravel(order="F")
        stretches = {
            "mean": part.at,
            "covariance": square,
            "drives": _stretches(part.drives, MEMORY),
            "forces": _stretches(part.drives, DRIVE.size),
            "evidence": _stretches(part.forces, FORCE.size),
            "torques": _stretches(part.touchable, TORQUE.size),
        }
        kernel_state = np.concatenate([layout[name].start + at for name, at in stretches.items()])
        y = [part.compared, m + part.compared]
        if trace:
            y += [2 * m + part.at, 2 * m + n + square, 2 * m + n + n * n + square]
        kernels.append(
            PlacedKernel(part_filter, kernel_state, part.inputs, part.parameters, np.concatenate(y))
        )
    outputs = 2 * m + (n + 2 * n * n if trace else 0)
    return side_by_side(
        "adaptive",
        kernels,
        (layout.size, context.width, len(context.mechanism.parameters), outputs),
    )
