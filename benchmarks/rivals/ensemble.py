"""What filters of many states at once share: the model of `adaptive`, applied to an ensemble."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from distal.estimators import Belief, KernelEstimator, Robustness, channels_of
from distal.estimators.adaptive import FilterContext, StateVector
from distal.estimators.adaptive.drive_tracking import MEMORY, Tracks, remembered_position, tracking
from distal.estimators.adaptive.filter_context import LONGEST_SUBSTEP
from distal.estimators.adaptive.filter_inputs import states_of_rig
from distal.estimators.adaptive.update import (
    Comparison,
    MeasurementRow,
    Residual,
    compared,
    measurement_rows_of,
)
from distal.estimators.estimator_protocol import UNKNOWN_POSITION, StateKind
from distal.kernels import covariance_of, mean_of
from distal.model import Kick, kick_and_drift, responses
from distal.rig import Rig

Floats = NDArray[np.float64]


def states_of(rig: Rig, name: str) -> StateVector:
    """Return the state vector that `adaptive` has for a rig.

    Args:
        rig: the description.
        name: of the estimator, for messages.
    """
    return states_of_rig(rig, (), channels_of(rig, name), Robustness())


class EnsembleFilter(KernelEstimator, ABC):
    """A filter that takes many states (particles, sigma points) through the model of `adaptive`.

    state = (mean, covariance, memory of the drives, then what the filter itself remembers). The
    ensemble runs in CasADi's interpreter.

    Args:
        name: of the estimator.
        rig: the description.
        size: states in the ensemble.

    Raises:
        EstimationError: the sensors do not suffice.
    """

    def __init__(self, name: str, rig: Rig, size: int) -> None:
        states = states_of(rig, name)
        context, channels = states.context, states.context.channels
        self._states, self._size = states, size
        count = max(1, int(np.ceil(channels.interval / LONGEST_SUBSTEP - 1e-9)))
        self._track = tracking(states)
        self._move = move_function(states, count).map(size)
        self._compare = compare_function(states).map(size)
        super().__init__(
            name,
            rig,
            None,
            context.mechanism.parameters.values,
            channels=channels,
            state_names=states.names,
            measured=tuple(sensor.name for sensor in channels.compared),
        )

    def scan(
        self, belief: Belief, times: Floats, samples: Floats
    ) -> tuple[Floats, Floats, Floats, Floats]:
        """Return means, covariances, innovations and their variances of a whole log.

        Args:
            belief: before the first sample.
            times: stamps [s], rising, (k,).
            samples: values of `channels`, (k, n_channels).
        """
        rows, last = self.checked_rows(belief, times, samples)
        kernel_state, n = np.array(belief.kernel_state), belief.size
        means, covariances, ys = [], [], []
        for k, own in enumerate(np.split(rows, last[:-1] + 1)):
            for j, row in enumerate(own):
                key = belief.samples + k, j
                kernel_state, values, variances = self._advance(kernel_state, row, key)
            means.append(mean_of(kernel_state, n))
            covariances.append(covariance_of(kernel_state, n))
            ys.append(np.concatenate([values, variances]))
        return (
            np.array(means),
            np.array(covariances),
            *self.innovations_of(np.array(ys), np.asarray(samples, dtype=np.float64)),
        )

    @property
    def bridged(self) -> int:
        """Number of displacements, the first of the channels: they cross gaps in a straight
        line.
        """
        return len(self._states.context.channels.positions)

    @property
    def state_kinds(self) -> tuple[StateKind, ...]:
        """What each state is, (n,)."""
        return self._states.state_kinds

    @property
    def state_parts(self) -> tuple[str, ...]:
        """The part that each state is of, (n,)."""
        return self._states.state_parts

    @abstractmethod
    def _advance(
        self, kernel_state: Floats, row: Floats, key: tuple[int, int]
    ) -> tuple[Floats, Floats, Floats]:
        """Return the kernel state after a row, its innovations and their variances; random draws
        are seeded by `key`.
        """

    def _process_stds(self, dt: float) -> Floats:
        """Return the standard deviation that each state gains over an interval, (n,)."""
        states, context = self._states, self._states.context
        stds: Floats = states.walks * np.sqrt(dt)
        for j in range(context.n_joints):
            lacking = context.mechanism.rig.joints[j].unmodelled
            stds[context.n_joints + j] = context.robustness.unmodelled * lacking * np.sqrt(dt)
        for at, fade, std in torque_fadings(states, dt):
            stds[at] = float(std) * np.sqrt(1 - float(fade) ** 2)
        return stds

    def prior(self, sample: Floats, p: Floats) -> tuple[Floats, Floats, Floats]:
        """Return mean, covariance and memory before the first sample: the drives rest where it
        says.

        Args:
            sample: the first values, NaN where missing, (n_channels,).
            p: the kernel's parameters, (n_p,).
        """
        states, context = self._states, self._states.context
        memory = np.zeros((context.n_drives, MEMORY))
        for i, drive in enumerate(self.rig.drives):
            sensor = context.position_sensor(i)
            if sensor is not None:
                read = sample[context.channels.names.index(sensor.name)] - sensor.bias.value
                known = bool(np.isfinite(read))
                memory[i, 0], memory[i, remembered_position(0, "unknown")] = (
                    (read, 0.0) if known else (0.0, UNKNOWN_POSITION[drive.kind] ** 2)
                )
        return (
            states.means,
            np.diag(states.stds**2),
            np.concatenate([memory.ravel(), np.zeros(context.n_drives), self._own_memory()]),
        )

    def _own_memory(self) -> Floats:
        return np.zeros(0)

    def _lowest(self, states: Floats) -> Floats:
        """Keep states at or above what they can be, in place; states (n, size)."""
        return np.maximum(states, self._states.lowest[:, None], out=states)


def torque_fadings(states: StateVector, dt: Any) -> list[tuple[int, Any, Any]]:
    """Return index, what is left after an interval, and std of each external torque.

    Args:
        states: the state vector.
        dt: length of the interval [s].
    """
    parameters, fadings, length = states.context.mechanism.parameters, [], ca.SX.sym("dt")
    for at, time, lasting_std in states.fadings():
        if at in states.torque_states:
            arguments, outputs = [length, parameters.symbols], [ca.exp(-length / time), lasting_std]
            factor, std = ca.Function("fading", arguments, outputs)(dt, parameters.values)
            fadings.append((at, factor, std))
    return fadings


def move_function(states: StateVector, count: int) -> ca.Function:
    """Return (state, errors of the places, places before, tracks, dt, p) → state⁺: the joints moved
    exactly.

    Args:
        states: the state vector.
        count: sub-steps.
    """
    context, mechanism, n = states.context, states.context.mechanism, len(states)
    nd, nj, nb = context.n_drives, context.n_joints, mechanism.n_bodies
    state, shift, before = ca.SX.sym("state", n), ca.SX.sym("shift", nd), ca.SX.sym("before", nd)
    vector, dt, h = ca.SX.sym("tracks", Tracks.size(nd)), ca.SX.sym("dt"), ca.SX.sym("h")
    p, tracks, starts, speeds = mechanism.parameters.symbols, Tracks(vector), [], []
    for i in range(nd):
        measured = context.position_sensor(i) is not None
        error = shift[i] if measured else 0
        first = states.position(i, before[i], state) + error
        last = states.position(i, tracks[i].position, state) + error
        starts.append(first)
        speeds.append(
            ca.if_else(dt > 0, (last - first) / ca.if_else(dt > 0, dt, 1), 0)
            if measured
            else ca.SX(0)
        )
    parameters = states.parameters(state)
    q, v, effort = ca.SX.sym("q", nb), ca.SX.sym("v", nb), ca.SX.sym("effort", nb)
    response = ca.SX.sym("response", nb, 4)
    stepped = kick_and_drift(
        mechanism, Kick(q, v, effort, response, h, h), rebounds=False, bodies=range(nj)
    )
    substep = ca.Function("substep", [q, v, effort, response, h, p], list(stepped))
    respond = ca.Function("responses", [h, p], [responses(mechanism, h, h)])
    outputs = [
        ca.vertcat(state[:nj], *starts),
        ca.vertcat(state[nj : 2 * nj], *speeds),
        parameters,
        respond(dt / count, parameters),
        ca.vertcat(states.torques(state), ca.SX.zeros(nd)),
    ]
    inputs = [state, shift, before, vector, dt, p]
    prepare = ca.Function("prepare", inputs, [ca.densify(entry) for entry in outputs])
    arguments = [ca.MX.sym(f"x{i}", *entry.shape) for i, entry in enumerate(inputs)]
    own, length = arguments[0], arguments[4]
    position, speed, held, prepared, pushed = prepare(*arguments)
    for _ in range(count):
        position, speed = substep(position, speed, pushed, prepared, length / count, held)
    after = ca.vertcat(position[:nj], speed[:nj], own[2 * nj :])
    for at, fade, _ in torque_fadings(states, length):
        after[at] = fade * after[at]
    return ca.Function("move", arguments, [after])


def compare_function(states: StateVector) -> ca.Function:
    """Return (state, kept, tracks, places before, x, p) → (residuals, variances, masks, kept⁺) of
    all forces.

    Args:
        states: the state vector.
    """
    context, n, nd = states.context, len(states), states.context.n_drives
    state, kept, before = ca.SX.sym("state", n), ca.SX.sym("kept", nd), ca.SX.sym("before", nd)
    vector, x = ca.SX.sym("tracks", Tracks.size(nd)), ca.SX.sym("x", context.width)
    tracks, dt = Tracks(vector), x[0]
    rates = [
        ca.if_else(dt > 0, (tracks[i].position - before[i]) / ca.if_else(dt > 0, dt, 1), 0)
        for i in range(nd)
    ]
    memory: list[Any] = [kept[i] for i in range(nd)]
    comparisons, rows = [], measurement_rows_of(states, state, tracks, ca.vertcat(*rates), x)
    for row in rows:
        comparison, remembered = _compared(context, row, tracks, kept, x)
        comparisons.append(comparison)
        if row.drive is not None:
            memory[row.drive] = ca.if_else(row.mask > 0, remembered, kept[row.drive])
    outputs = [
        [c.innovation for c in comparisons],
        [c.variance for c in comparisons],
        [row.mask for row in rows],
        memory,
    ]
    arguments = [state, kept, vector, before, x, context.mechanism.parameters.symbols]
    return ca.Function(
        "compare", arguments, ca.cse([ca.densify(ca.vertcat(*part)) for part in outputs])
    )


def _compared(
    context: FilterContext, row: MeasurementRow, tracks: Tracks, kept: Any, x: Any
) -> tuple[Comparison, Any]:
    """Return how a force is compared, and what to remember of its drive: a mean pull where the rig
    declares friction.

    The pull is averaged, not the residual: each state has its own tension, which may just have
    changed.
    """
    if row.drive is None:
        return Comparison(row.residual, row.variance, None), None
    sensor, before = context.force_sensor(row.drive), kept[row.drive]
    pull = (
        context.value(x, sensor)
        if sensor is not None and context.declares_friction(row.drive)
        else None
    )
    if pull is not None:
        before = row.residual + ca.if_else(before == 0, pull, before) - pull
    residual = Residual(
        row.residual, row.limit, row.asymmetry, row.variance, 0, 0, before, row.mask
    )
    comparison = compared(context, row.drive, tracks[row.drive], residual, x[0])
    return (
        comparison,
        comparison.memory if pull is None else comparison.memory - row.residual + pull,
    )
