"""The kinds of states beside the joints' motion, and the state vector: blocks one after the other,
and the sums of their effects.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import casadi as ca
import numpy as np

from distal.estimators.adaptive.filter_context import FilterContext
from distal.estimators.adaptive.states.drive import (
    Transmitted,
    transmissions,
    unknown_frictions,
    unmeasured_positions,
)
from distal.estimators.adaptive.states.internal import inside
from distal.estimators.adaptive.states.joint import (
    ExternalTorqueState,
    JointMotion,
    external_torques,
)
from distal.estimators.adaptive.states.parameter import uncertain_parameters
from distal.estimators.adaptive.states.reading import (
    linearities,
    sensor_biases,
    unknowns_of_readings,
)
from distal.estimators.adaptive.states.state import Fading, Learning, State
from distal.expressions import Scalar, Vector
from distal.rig import Sensor

Kind = Callable[[FilterContext], Sequence[State]]
"""Function that returns the blocks of one kind that a rig has."""

KINDS: tuple[Kind, ...] = (
    external_torques,
    uncertain_parameters,
    linearities,
    unmeasured_positions,
    unknown_frictions,
    transmissions,
    inside,
    sensor_biases,
    unknowns_of_readings,
)
"""All kinds; their order is that of the state vector, after the joints' motion."""


class StateVector:
    """All blocks of a rig; their order gives the layout of the state, (n,).

    Args:
        context: the rig as the filter reads it.
        kinds: kinds of states beside the joints' motion; default all.
    """

    def __init__(self, context: FilterContext, kinds: Sequence[Kind] = KINDS) -> None:
        self.context = context
        self.kinds = tuple(kinds)
        blocks: list[State] = [JointMotion(context)]
        for kind in kinds:
            blocks += kind(context)
        self.blocks = tuple(blocks)
        ends = np.cumsum([len(block.names) for block in blocks])
        self._slices = {
            id(block): slice(int(e) - len(block.names), int(e)) for block, e in zip(blocks, ends)
        }
        self.names = tuple(name for block in blocks for name in block.names)
        self.state_kinds = tuple(kind for block in blocks for kind in block.kinds)
        self.state_parts = tuple(part for block in blocks for part in block.parts)
        self.means = np.concatenate([block.means for block in blocks])
        self.stds = np.concatenate([block.stds for block in blocks])
        block_of = [block for block in blocks for _ in block.names]  # of each number
        self.walks = np.array([block.walk for block in block_of], dtype=np.float64)
        self.lowest = np.array([block.lowest for block in block_of], dtype=np.float64)
        self.unsmoothed = tuple(i for i, block in enumerate(block_of) if not block.smoothed)
        self.lasting = np.array([block.lasting for block in block_of], dtype=np.bool_)
        torques = (
            (i, block) for i, block in enumerate(block_of) if isinstance(block, ExternalTorqueState)
        )
        self.torque_states = {i: block.joint for i, block in torques}
        self._considered = {i: 0.0 for i, block in enumerate(block_of) if block.considered}
        self._unidentified = {i: 0.0 for i, block in enumerate(block_of) if block.unidentified}
        self._parameters, self._curves, self._strains = (
            [i for i, block in enumerate(block_of) if block.learning is learning]
            for learning in (Learning.SLOWLY, Learning.FROM_REFERENCES_SLOWLY, Learning.AS_CREEP)
        )

    @property
    def structure(self) -> tuple[object, ...]:
        """What the structure of a kernel depends on in the states: all but their values."""
        walks = self.walks > 0.0
        bounded = np.isfinite(self.lowest)
        flags = tuple(zip(walks.tolist(), bounded.tolist()))
        blocks = tuple((type(block).__name__, block.structure) for block in self.blocks)
        shares = tuple(self._considered), tuple(self._unidentified)
        return self.names, blocks, flags, *shares, self.context.contact_structure

    def __len__(self) -> int:
        return len(self.names)

    def inputs(self) -> Iterator[tuple[str, float]]:
        """Yield name and value of the inputs of the filter's kernel that follow from the states."""
        for i in range(len(self)):
            yield f"state.{i}.mean", self.means[i]
            yield f"state.{i}.std", self.stds[i]
            yield f"state.{i}.walk", self.walks[i]
            yield f"state.{i}.lowest", self.lowest[i]
        for block in self.blocks:
            yield from block.inputs()

    def prior(self) -> tuple[Vector, Vector]:
        """Return prior means and standard deviations, (n,) each, as expressions of the filter's
        inputs.
        """
        values = range(len(self))
        means, stds = (
            ca.vertcat(*(self.context.number(f"state.{i}.{moment}") for i in values))
            for moment in ("mean", "std")
        )
        for block in self.blocks:
            mean, std = block.prior()
            if mean is not None:
                means[self._slices[id(block)]] = mean
            if std is not None:
                stds[self._slices[id(block)]] = std
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
        slow = dict[int, Scalar]()
        if time > 0.0 and not reference:
            slow = dict.fromkeys(self._parameters, ca.fmin(1.0, interval / time))
        if reference and guards.reference_time > 0.0:
            # the many samples of a joint at rest show only one posture
            share = ca.fmin(1.0, interval / guards.reference_time)
            slow = dict.fromkeys([*self._parameters, *self._curves], share)
        if guards.creep_learning_time > 0.0 and not reference:
            share = ca.fmin(1.0, interval / guards.creep_learning_time)
            slow |= dict.fromkeys(self._strains, share)
        return {**slow, **({} if reference else self._unidentified), **self._considered}

    @property
    def slow(self) -> tuple[int, ...]:
        """Indices of the states that take a share of the gain of some forces."""
        guards = self.context.robustness
        longest = max(guards.learning_time, guards.learning_time_guarded)
        parameters = self._parameters if longest > self.context.channels.interval else []
        return (
            *parameters,
            *(self._strains if guards.creep_learning_time > self.context.channels.interval else []),
        )

    def indices(self, block: State) -> range:
        """Return the indices of a block's values in the state."""
        stretch = self._slices[id(block)]
        return range(stretch.start, stretch.stop)

    def _values(self, state: Vector) -> Iterator[tuple[State, Vector]]:
        """Yield each block with its values in a state."""
        return ((block, state[self._slices[id(block)]]) for block in self.blocks)

    def fadings(self, dt: Scalar) -> list[tuple[int, Fading]]:
        """Return index and fading of every value that fades over an interval of length `dt` [s]."""
        every = ((block, block.fading(dt)) for block in self.blocks)
        return [
            (i, fading)
            for block, fading in every
            if fading is not None
            for i in self.indices(block)
        ]

    def parameters(self, state: Vector) -> Vector:
        """Return the model's parameters at a state, (n_p,)."""
        p = self.context.mechanism.parameters.symbols
        for block, values in self._values(state):
            p = block.parameters(values, p)
        return p

    def torques(self, state: Vector) -> Vector:
        """Return the external torque on each joint, (n_joints,) [N m]."""
        joints = range(self.context.n_joints)
        return ca.vertcat(
            *(
                sum((block.torque(j, values) for block, values in self._values(state)), ca.SX(0))
                for j in joints
            )
        )

    def position(self, drive: int, reading: Scalar, state: Vector) -> Scalar:
        """Return the position of a drive [m, rad]: its `reading` less the error of its sensor, or
        the state that holds the position.
        """
        for block, values in self._values(state):
            position = block.position(drive, values)
            if position is not None:
                return position
        errors = (
            block.position_error(drive, reading, values) for block, values in self._values(state)
        )
        return reading - sum(errors, ca.SX(0))

    def friction(self, drive: int, state: Vector) -> Scalar:
        """Return what a `state` adds to the friction limit of a drive [N, N m]."""
        return sum(
            (block.friction(drive, values) for block, values in self._values(state)), ca.SX(0)
        )

    def force(self, drive: int, state: Vector) -> Scalar:
        """Return what a `state` adds to the expected force of a drive [N, N m]."""
        return sum((block.force(drive, values) for block, values in self._values(state)), ca.SX(0))

    def sensor_error(self, sensor: Sensor, reading: Scalar, state: Vector) -> Scalar:
        """Return what a `state` adds to the `reading` of a sensor of force, tension or angle."""
        errors = (
            block.sensor_error(sensor, reading, values) for block, values in self._values(state)
        )
        return sum(errors, ca.SX(0))

    def unknowns(self, state: Vector) -> dict[str, Scalar]:
        """Return name → value of the quantities that readings depend on."""
        return {
            name: number
            for block, values in self._values(state)
            for name, number in block.unknowns(values).items()
        }

    def transmitted(self, drive: int) -> tuple[int, Transmitted] | None:
        """Return index and block of the effort that a drive's play passes on, None where it has no
        play.
        """
        for block in self.blocks:
            if isinstance(block, Transmitted) and block.drive == drive:
                return self.indices(block)[0], block
        return None
