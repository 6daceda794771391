"""The kinds of states, and the state vector: all states of a rig, and the sums of what they add."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence

import casadi as ca
import numpy as np

from distal.estimators.adaptive.filter_context import FilterContext
from distal.estimators.adaptive.states.internal import inside
from distal.estimators.adaptive.states.motion import (
    external_torques,
    motions,
    transmissions,
    unknown_frictions,
    unmeasured_positions,
)
from distal.estimators.adaptive.states.parameter import uncertain_parameters
from distal.estimators.adaptive.states.reading import linearities, sensor_biases
from distal.estimators.adaptive.states.state import State, Target
from distal.estimators.state_kinds import StateKind
from distal.expressions import Scalar, Vector

Kind = Callable[[FilterContext], Iterable[State]]
"""Function that returns the states of one kind that a rig has."""

KINDS: tuple[Kind, ...] = (
    motions,
    external_torques,
    uncertain_parameters,
    linearities,
    unmeasured_positions,
    unknown_frictions,
    transmissions,
    inside,
    sensor_biases,
)
"""All kinds; their order is that of the state vector."""

LEARNED_SLOWLY: tuple[StateKind, ...] = (StateKind.PARAMETER, StateKind.SENSOR_GAIN)
"""Kinds of states that learn slowly from forces, tensions and references. Source: definition."""

LASTING = (*LEARNED_SLOWLY, StateKind.LINEARITY, StateKind.SENSOR_BIAS)
"""Kinds of states that are constants of the rig or of a sensor; others are meant to move. Source:
definition.
"""


class StateVector:
    """All states of a rig in their order, (n,).

    Args:
        context: the rig as the filter reads it.
        kinds: kinds of states; default all.
    """

    def __init__(self, context: FilterContext, kinds: Sequence[Kind] = KINDS) -> None:
        self.context = context
        self.kinds = tuple(kinds)
        self.states = tuple(state for kind in kinds for state in kind(context))
        self.names = tuple(state.name for state in self.states)
        self.state_kinds = tuple(state.kind for state in self.states)
        self.state_parts = tuple(state.part for state in self.states)
        self.means, self.stds, self.walks, self.lowest = (
            np.array(values, dtype=np.float64)
            for values in zip(*((s.mean, s.std, s.walk, s.lowest) for s in self.states))
        )
        # friction at one time tells little of another time
        self.unsmoothed = self.of_kind(StateKind.FRICTION)
        self.lasting = np.array([kind in LASTING for kind in self.state_kinds])
        joints = context.mechanism.rig.joint_names
        torques = self.of_kind(StateKind.EXTERNAL_TORQUE)
        self.torque_states = {i: joints.index(self.state_parts[i]) for i in torques}

    @property
    def structure(self) -> tuple[object, ...]:
        """What the structure of a kernel depends on in the states: all but their values."""
        return *(state.structure for state in self.states), self.context.contact_structure

    def __len__(self) -> int:
        return len(self.states)

    def of_kind(self, *kinds: StateKind) -> tuple[int, ...]:
        """Return the indices of the states of some kinds."""
        return tuple(i for i, state in enumerate(self.states) if state.kind in kinds)

    def inputs(self) -> Iterator[tuple[str, float]]:
        """Yield name and value of the inputs of the filter's kernel that follow from the states."""
        for i, state in enumerate(self.states):
            yield f"state.{i}.mean", state.mean
            yield f"state.{i}.std", state.std
            yield f"state.{i}.walk", state.walk
            yield f"state.{i}.lowest", state.lowest
            yield from state.inputs.items()

    def prior(self) -> tuple[Vector, Vector]:
        """Return prior means and standard deviations, (n,) each, as expressions of the filter's
        inputs.
        """
        number = self.context.number
        moments = [
            (
                number(f"state.{i}.mean") if state.mean_by is None else state.mean_by(),
                number(f"state.{i}.std") if state.std_by is None else state.std_by(),
            )
            for i, state in enumerate(self.states)
        ]
        means, stds = (ca.vertcat(*moment) for moment in zip(*moments))
        return means, stds

    def gain_shares(
        self, drive: int | None, reference: bool, interval: Scalar
    ) -> dict[int, Scalar]:
        """Return index → share of the gain, for the states that do not take all of it (24).

        Args:
            drive: index of the drive whose force is compared, None for any other reading.
            reference: whether a joint's own angle is compared, which tells of parameters what
                forces do not.
            interval: nominal interval of the filter [s].
        """
        guards = self.context.robustness
        declared = drive is None or self.context.declares_friction(drive)
        time = guards.learning_time if declared else guards.learning_time_guarded
        times = [(time, LEARNED_SLOWLY), (guards.creep_learning_time, (StateKind.CREEP,))]
        if reference:
            # the many samples of a joint at rest show only one posture
            times = [(guards.reference_time, (*LEARNED_SLOWLY, StateKind.LINEARITY))]
        slow = dict[int, Scalar]()
        for of_all, kinds in times:
            if of_all > 0.0:
                slow |= dict.fromkeys(self.of_kind(*kinds), ca.fmin(1.0, interval / of_all))
        # of an error for which the model has no state only the uncertainty counts (Schmidt, 1966)
        kept = list(self.of_kind(StateKind.TRANSMISSION_ERROR))
        if not reference:
            kept += [i for i, state in enumerate(self.states) if state.unidentified]
        return slow | dict.fromkeys(kept, 0.0)

    @property
    def slow(self) -> tuple[int, ...]:
        """Indices of the states that take a share of the gain of some forces."""
        guards = self.context.robustness
        interval = self.context.channels.interval
        kinds = list[StateKind]()
        if max(guards.learning_time, guards.learning_time_guarded) > interval:
            kinds += LEARNED_SLOWLY
        if guards.creep_learning_time > interval:
            kinds.append(StateKind.CREEP)
        return self.of_kind(*kinds)

    def fadings(self) -> list[tuple[int, Scalar, Scalar]]:
        """Return index, time constant [s] and lasting std of each state that fades."""
        _, stds = self.prior()
        return [
            (i, state.fades_in(), stds[i])
            for i, state in enumerate(self.states)
            if state.fades_in is not None
        ]

    def parameters(self, state: Vector) -> Vector:
        """Return the model's parameters at a state, (n_p,)."""
        p = ca.SX(self.context.mechanism.parameters.symbols)
        for i, unknown in enumerate(self.states):
            z = state[i]
            for at in unknown.indices:
                p[at] = {"value": z, "factor": p[at] * z, "deviation": p[at] + z}[unknown.acts]
        return p

    def added(self, to: Target, state: Vector, reading: Scalar = 0) -> Scalar:
        """Return what a `state` adds to something, of which the `reading` is that of a sensor."""
        every = enumerate(self.states)
        return sum((of.times(reading) * state[i] for i, of in every if of.to == to), ca.SX(0))

    def adding(self, to: Target) -> list[int]:
        """Return the indices of the states that add to something."""
        return [i for i, state in enumerate(self.states) if state.to == to]

    def placing(self, drive: int) -> list[int]:
        """Return the indices of the states that change the `position` of a drive."""
        sensor = self.context.position_sensor(drive)
        of_sensor = [] if sensor is None else self.adding(("reading", sensor.name))
        return of_sensor or self.adding(("position", drive))

    def torques(self, state: Vector) -> Vector:
        """Return the external torque on each joint, (n_joints,) [N m]."""
        joints = range(self.context.n_joints)
        return ca.vertcat(*(self.added(("torque", j), state) for j in joints))

    def position(self, drive: int, reading: Scalar, state: Vector) -> Scalar:
        """Return the position of a drive [m, rad]: its `reading` less the error of its sensor, or
        the state that holds the position.
        """
        sensor = self.context.position_sensor(drive)
        if sensor is None:
            return self.added(("position", drive), state)
        return reading - self.added(("reading", sensor.name), state, reading)

    def coordinates(self, state: Vector, readings: Sequence[Scalar]) -> Vector:
        """Return the coordinates q of joints and drives at a `state`, from the `readings` of all
        drives' positions.
        """
        positions = (self.position(i, reading, state) for i, reading in enumerate(readings))
        return ca.vertcat(state[: self.context.n_joints], *positions)

    def transmitted(self, drive: int) -> int | None:
        """Return the index of the effort that a drive's play passes on, None where it has no
        play.
        """
        name = self.context.mechanism.rig.drive_names[drive]
        of = (i for i in self.of_kind(StateKind.TRANSMITTED) if self.state_parts[i] == name)
        return next(of, None)
