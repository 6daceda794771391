"""The state vector: blocks side by side, and the sums of what they do."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from distal.estimators.adaptive.context import FilterContext
from distal.estimators.adaptive.states.joint import JointMotion
from distal.estimators.adaptive.states.registry import KINDS, Kind
from distal.estimators.adaptive.states.state import Fading, Learning, State
from distal.estimators.adaptive.states.transmission import Transmitted
from distal.expressions import Scalar, Vector
from distal.rig import Sensor


class StateVector:
    """All blocks of a rig; the layout of the state follows from their order.

    Args:
        context: the rig.
        kinds: what blocks there may be beside the joints' motion; default all.
    """

    def __init__(self, context: FilterContext, kinds: Sequence[Kind] = KINDS) -> None:
        self.context, self.kinds = context, tuple(kinds)
        blocks: list[State] = [JointMotion(context)]
        for kind in kinds:
            blocks += kind(context)
        self.blocks = tuple(blocks)
        ends = np.cumsum([len(block.names) for block in blocks])
        self._slices = {id(block): slice(int(e) - len(block.names), int(e)) for block, e in zip(blocks, ends)}
        self.names = tuple(name for block in blocks for name in block.names)
        self.state_kinds = tuple(kind for block in blocks for kind in block.kinds)
        self.state_parts = tuple(part for block in blocks for part in block.parts)
        self.means = np.concatenate([block.means for block in blocks])
        self.stds = np.concatenate([block.stds for block in blocks])
        self.walks = np.concatenate([np.full(len(block.names), block.walk) for block in blocks])
        self.lowest = np.concatenate([np.full(len(block.names), block.lowest) for block in blocks])
        self.unsmoothed = tuple(i for block in blocks if not block.smoothed for i in self.indices(block))
        lasting = [i for block in blocks if block.lasting for i in self.indices(block)]
        self.lasting = np.isin(np.arange(len(self.names)), lasting)
        self._considered = {i: 0.0 for block in blocks if block.considered for i in self.indices(block)}
        self._untold = {i: 0.0 for block in blocks if block.untold for i in self.indices(block)}
        self._parameters, self._curves, self._strains = (
            [i for block in blocks if block.learning is learning for i in self.indices(block)]
            for learning in (Learning.SLOWLY, Learning.FROM_REFERENCES_SLOWLY, Learning.AS_CREEP)
        )

    def __len__(self) -> int:
        return len(self.names)

    def prior(self) -> tuple[Vector, Vector]:
        """Return prior means and standard deviations, (n,) each, as expressions of the filter's inputs."""
        means, stds = zip(*(block.prior() for block in self.blocks))
        return ca.vertcat(*map(ca.SX, means)), ca.vertcat(*map(ca.SX, stds))

    def gain_shares(self, drive: int | None, reference: bool) -> dict[int, float]:
        """Return index → share of the gain of the states that do not take all of it (24).

        Args:
            drive: index of the drive whose force is compared, or None.
            reference: whether it is a joint's own angle, which tells of parameters what forces do not.
        """
        guards = self.context.robustness
        declared = drive is None or self.context.declares_friction(drive)
        time = guards.learning_time if declared else guards.learning_time_guarded
        share = min(1.0, self.context.channels.interval / time) if time > 0.0 and not reference else 1.0
        slow = {} if share == 1.0 else dict.fromkeys(self._parameters, share)
        if reference and guards.reference_time > 0.0:
            # a joint that rests shows one posture for a long time
            share = min(1.0, self.context.channels.interval / guards.reference_time)
            slow = dict.fromkeys([*self._parameters, *self._curves], share)
        if guards.creep_learning_time > 0.0 and not reference:
            share = min(1.0, self.context.channels.interval / guards.creep_learning_time)
            slow |= dict.fromkeys(self._strains, share)
        return {**slow, **({} if reference else self._untold), **self._considered}

    @property
    def slow(self) -> tuple[int, ...]:
        """Indices of the states that take a share of the gain of some forces."""
        guards = self.context.robustness
        longest = max(guards.learning_time, guards.learning_time_guarded)
        parameters = self._parameters if longest > self.context.channels.interval else []
        return (*parameters, *(self._strains if guards.creep_learning_time > self.context.channels.interval else []))

    def indices(self, block: State) -> range:
        """Return where a block's numbers stand.

        Args:
            block: one of `blocks`.
        """
        own = self._slices[id(block)]
        return range(own.start, own.stop)

    def own(self, block: State, state: Vector) -> Vector:
        """Return a block's numbers of a state.

        Args:
            block: one of `blocks`.
            state: (n,).
        """
        return state[self._slices[id(block)]]

    def fadings(self, dt: Scalar) -> list[tuple[int, Fading]]:
        """Return index and fading of every number that fades.

        Args:
            dt: length of the interval [s].
        """
        every = ((block, block.fading(dt)) for block in self.blocks)
        return [(i, fading) for block, fading in every if fading is not None for i in self.indices(block)]

    def parameters(self, state: Vector) -> Vector:
        """Return the model's parameters at a state, (n_p,).

        Args:
            state: (n,).
        """
        p = self.context.mechanism.parameters.symbols
        for block in self.blocks:
            p = block.parameters(self.own(block, state), p)
        return p

    def torques(self, state: Vector) -> Vector:
        """Return the external torque on each joint, (n_joints,) [N m].

        Args:
            state: (n,).
        """
        return ca.vertcat(
            *(
                sum((block.torque(j, self.own(block, state)) for block in self.blocks), ca.SX(0))
                for j in range(self.context.n_joints)
            )
        )

    def place(self, drive: int, reading: Scalar, state: Vector) -> Scalar:
        """Return the place of a drive [m, rad]: its reading less what its sensor errs by, or the state that stands for it.

        Args:
            reading: what its sensor reads, if it has one.
            state: (n,).
        """
        for block in self.blocks:
            place = block.place(drive, self.own(block, state))
            if place is not None:
                return place
        return reading - sum((b.place_error(drive, reading, self.own(b, state)) for b in self.blocks), ca.SX(0))

    def friction(self, drive: int, state: Vector) -> Scalar:
        """Return what is added to the friction limit of a drive [N, N m].

        Args:
            state: (n,).
        """
        return sum((block.friction(drive, self.own(block, state)) for block in self.blocks), ca.SX(0))

    def force(self, drive: int, state: Vector) -> Scalar:
        """Return what is added to the force that is expected at a drive [N, N m].

        Args:
            state: (n,).
        """
        return sum((block.force(drive, self.own(block, state)) for block in self.blocks), ca.SX(0))

    def sensor_error(self, sensor: Sensor, reading: Scalar, state: Vector) -> Scalar:
        """Return what is added to the reading of a sensor of force, tension or angle.

        Args:
            reading: what it reads.
            state: (n,).
        """
        return sum((block.sensor_error(sensor, reading, self.own(block, state)) for block in self.blocks), ca.SX(0))

    def unknowns(self, state: Vector) -> dict[str, Scalar]:
        """Return the numbers that readings depend on, by name.

        Args:
            state: (n,).
        """
        return {n: number for b in self.blocks for n, number in b.unknowns(self.own(b, state)).items()}

    def transmitted(self, drive: int) -> tuple[int, Transmitted] | None:
        """Return index and block of what a drive's play passes on, None where it has no play."""
        for block in self.blocks:
            if isinstance(block, Transmitted) and block.drive == drive:
                return self.indices(block)[0], block
        return None
