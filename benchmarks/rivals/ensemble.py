"""What filters of many states at once share: the displacement-driven model, applied to an ensemble."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import casadi as ca
import numpy as np
from distal.estimators.augmented import AugmentedState
from distal.estimators.displacement_driven import follow_all
from distal.estimators.force_update import force_rows
from distal.estimators.motion import MEMORY
from distal.estimators.stick_slip import friction_row
from numpy.typing import NDArray

from distal.estimators.adaptive import LONGEST_SUBSTEP, prior_memory, with_places
from distal.estimators.channels import channels_of, sensor_for
from distal.estimators.contract import Belief, Innovation, KernelEstimator, innovation
from distal.logs import frozen
from distal.model import Kick, Mechanism, kick_and_drift, responses
from distal.rig import Rig
from distal.sensors import variance

Floats = NDArray[np.float64]


class EnsembleFilter(KernelEstimator, ABC):
    """A filter that carries many states (particles, sigma points) through the model of `adaptive`.

    carry = (mean, covariance, memory of the drives, then what the filter itself remembers).

    Args:
        name: of the estimator.
        rig: the description.
        size: states in the ensemble.
        compiled: ignored; the ensemble runs in CasADi's interpreter.

    Raises:
        EstimationError: the sensors do not suffice.
    """

    def __init__(self, name: str, rig: Rig, size: int, compiled: bool = True) -> None:
        mechanism, channels = Mechanism(rig), channels_of(rig, name)
        self._augmented, self._channels, self._size = AugmentedState(mechanism, channels), channels, size
        self._count = max(1, int(np.ceil(channels.interval / LONGEST_SUBSTEP - 1e-9)))
        self._follow = follow_function(self._augmented)
        self._move = move_function(self._augmented, self._count).map(size)
        self._compare = compare_function(self._augmented).map(size)
        self._place_noise = np.array(
            [
                0.0 if sensor is None else variance(sensor)
                for sensor in (sensor_for(channels.positions, drive.name) for drive in rig.drives)
            ]
        )
        forces = tuple(sensor.name for sensor in (*channels.forces, *channels.tensions))
        super().__init__(
            name,
            rig,
            None,
            mechanism.parameters.values,
            channels.names,
            forces,
            self._augmented.names,
            channels.interval,
        )

    def step(self, belief: Belief, time: float, sample: Floats) -> tuple[Belief, Innovation]:
        """Return the belief after a sample, and its innovation.

        Args:
            belief: before.
            time: of the sample [s].
            sample: values of `channels`, SI, NaN where missing, (n_channels,).

        Raises:
            EstimationError: as `KernelEstimator.step`.
        """
        sample, time = self._accepted(belief, time, sample)
        rows, _ = self._rows(np.array([time - belief.time]), sample[None, :])
        carry, values, variances = np.array(belief.carry), None, None
        for k, row in enumerate(rows):
            carry, values, variances = self._advance(carry, row, (belief.samples, k))
        y = np.concatenate([values, variances])[None, :]
        told = self._innovations(y, sample[None, :])
        return Belief(time, frozen(carry), belief.size, belief.samples + 1), innovation(told[0][0], told[1][0])

    def scan(self, belief: Belief, times: Floats, samples: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Return means, covariances, innovations and their variances of a whole log: `step` for each sample.

        Args:
            belief: before the first sample.
            times: stamps [s], rising, (k,).
            samples: values of `channels`, (k, n_channels).
        """
        means, covariances, values, variances = [], [], [], []
        for time, sample in zip(np.asarray(times, dtype=np.float64), np.asarray(samples, dtype=np.float64)):
            belief, told = self.step(belief, float(time), sample)
            means.append(belief.mean)
            covariances.append(belief.covariance)
            values.append(told.values)
            variances.append(told.variances)
        return np.array(means), np.array(covariances), np.array(values), np.array(variances)

    def _rows(self, steps: Floats, samples: Floats) -> tuple[Floats, NDArray[np.intp]]:
        return with_places(*super()._rows(steps, samples), samples, len(self._channels.positions))

    @abstractmethod
    def _advance(self, carry: Floats, row: Floats, key: tuple[int, int]) -> tuple[Floats, Floats, Floats]:
        """Return the carry after a row, its innovations and their variances; random draws are seeded by `key`."""

    def _process_stds(self, dt: float) -> Floats:
        """Return the standard deviation that each state gains over an interval, (n,)."""
        augmented = self._augmented
        stds = np.zeros(len(augmented))
        stds[1] = augmented.mechanism.rig.joints[0].unmodelled * np.sqrt(dt)
        for i, drift in augmented.drifts.items():
            stds[i] = drift * np.sqrt(dt)
        if augmented.torque is not None:
            fade = np.exp(-dt / augmented.torque.correlation_time)
            stds[augmented.torque_at] = augmented.torque.std * np.sqrt(1 - fade**2)
        return stds

    def _prior(self, sample: Floats) -> tuple[Floats, Floats, Floats]:
        augmented = self._augmented
        memory = prior_memory(self.rig, self._channels, sample)
        return augmented.means, np.diag(augmented.stds**2), np.concatenate([memory, self._own_memory()])

    def _own_memory(self) -> Floats:
        return np.zeros(0)

    def _lowest(self, states: Floats) -> Floats:
        """Keep parameters at or above what they can be, in place; states (n, size)."""
        for k, part in enumerate(self._augmented.parameters):
            at = self._augmented.parameters_at + k
            np.maximum(states[at], part.lowest, out=states[at])
        return states


def follow_function(augmented: AugmentedState) -> ca.Function:
    """Return (memory, x) → (memory⁺ and bends, variances of the places) of all drives.

    Args:
        augmented: the layout of the state.
    """
    nd, width = augmented.mechanism.n_drives, len(augmented.channels.names)
    held, x = ca.SX.sym("memory", nd * MEMORY), ca.SX.sym("x", 1 + 2 * width)
    kept, bends, noise = follow_all(augmented, held, x)
    return ca.Function("follow", [held, x], [ca.densify(ca.vertcat(*kept, *bends)), ca.densify(ca.vertcat(*noise))])


def move_function(augmented: AugmentedState, count: int) -> ca.Function:
    """Return (state, noise of the places, before, motions, dt, p) → state⁺: the joint moved over an interval, exactly.

    Args:
        augmented: the layout of the state.
        count: sub-steps.
    """
    mechanism, n = augmented.mechanism, len(augmented)
    nd, nb = mechanism.n_drives, mechanism.n_bodies
    state, shift = ca.SX.sym("state", n), ca.SX.sym("shift", nd)
    before, motions, dt = ca.SX.sym("before", nd), ca.SX.sym("motions", nd * (MEMORY + 1)), ca.SX.sym("dt")
    p = mechanism.parameters.symbols
    starts, speeds = [], []
    for i in range(nd):
        if i in augmented.places_at:
            starts.append(state[augmented.places_at[i]])
            speeds.append(ca.SX(0))
            continue
        now = motions[MEMORY * i]
        first = before[i] - augmented.systematic_error(i, before[i], state) + shift[i]
        last = now - augmented.systematic_error(i, now, state) + shift[i]
        starts.append(first)
        speeds.append(ca.if_else(dt > 0, (last - first) / ca.if_else(dt > 0, dt, 1), 0))
    parameters = augmented.model_parameters(state)
    torque = state[augmented.torque_at] if augmented.torque is not None else ca.SX(0)
    h = dt / count
    q, v, effort = ca.SX.sym("q", nb), ca.SX.sym("v", nb), ca.SX.sym("effort", nb)
    response, step = ca.SX.sym("response", nb, 4), ca.SX.sym("h")
    kick = Kick(q, v, effort, response, step, step)
    moved = kick_and_drift(mechanism, kick, rebounds=False, bodies=[0])
    substep = ca.Function("substep", [q, v, effort, response, step, p], list(moved))
    prepare = ca.Function("responses", [step, p], [responses(mechanism, step, step)])
    first_stage = ca.Function(
        "prepare",
        [state, shift, before, motions, dt, p],
        [
            ca.vertcat(state[0], *starts),
            ca.vertcat(state[1], *speeds),
            ca.densify(parameters),
            ca.densify(prepare(h, parameters)),
            ca.vertcat(torque, ca.SX.zeros(nd)),
        ],
    )
    arguments = [ca.MX.sym(f"x{i}", *s.shape) for i, s in enumerate((state, shift, before, motions, dt))]
    mx_p = ca.MX.sym("p", p.numel())
    place, speed, held, prepared, pushed = first_stage(*arguments, mx_p)
    for _ in range(count):
        place, speed = substep(place, speed, pushed, prepared, arguments[4] / count, held)
    after = ca.vertcat(place[0], speed[0], arguments[0][2:])
    if augmented.torque is not None:
        fade = ca.exp(-arguments[4] / augmented.torque.correlation_time)
        after[augmented.torque_at] = fade * after[augmented.torque_at]
    return ca.Function("move", [*arguments, mx_p], [after])


def _pull(augmented: AugmentedState, name: str, x: Any) -> Any:
    """Return the measured pull that a row compares, or None where it is nominal."""
    for sensor in augmented.channels.forces:
        if sensor.name == name:
            return x[1 + augmented.channels.names.index(name)] - sensor.bias.value
    return None


def compare_function(augmented: AugmentedState) -> ca.Function:
    """Return (state, kept, motions, before, noise, x, p) → (residuals, variances, masks, kept⁺) of all forces.

    Args:
        augmented: the layout of the state.
    """
    mechanism, n, nd = augmented.mechanism, len(augmented), augmented.mechanism.n_drives
    width = len(augmented.channels.names)
    state, kept = ca.SX.sym("state", n), ca.SX.sym("kept", nd)
    motions, before = ca.SX.sym("motions", nd * (MEMORY + 1)), ca.SX.sym("before", nd)
    noise, x = ca.SX.sym("noise", nd), ca.SX.sym("x", 1 + 2 * width)
    speeds = []
    for i in range(nd):
        moved = motions[MEMORY * i] - before[i]
        speeds.append(ca.if_else(x[0] > 0, moved / ca.if_else(x[0] > 0, x[0], 1), 0))
    rows = force_rows(augmented, state, motions, ca.vertcat(*speeds), noise, x)
    memory: list[Any] = [kept[i] for i in range(nd)]
    residuals, variances, masks = [], [], []
    for row in rows:
        pull = _pull(augmented, row.name, x)
        declared = row.drive is not None and not augmented.is_clean(row.drive)
        if row.drive is not None and declared and pull is not None:
            # the pull is averaged, not the residual: each state has its own tension, which may just have changed
            before_now = ca.if_else(kept[row.drive] == 0, pull, kept[row.drive])
            memory[row.drive] = row.residual + before_now - pull
        taken = friction_row(
            augmented,
            row.drive,
            motions,
            row.residual,
            row.limit,
            row.lean,
            row.variance,
            ca.SX(0),
            ca.SX(0),
            ca.SX(0) if row.drive is None else memory[row.drive],
            row.mask,
            x[0],
        )
        residuals.append(taken.innovation)
        variances.append(taken.variance)
        masks.append(row.mask)
        if row.drive is not None:
            told = taken.memory - row.residual + pull if declared and pull is not None else taken.memory
            memory[row.drive] = ca.if_else(row.mask > 0, told, kept[row.drive])
    arguments = [state, kept, motions, before, noise, x, mechanism.parameters.symbols]
    outputs = [ca.vertcat(*part) for part in (residuals, variances, masks, memory)]
    return ca.Function("compare", arguments, ca.cse([ca.densify(entry) for entry in outputs]))
