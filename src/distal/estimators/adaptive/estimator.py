"""`adaptive`: right when the model is wrong, and honest about how sure it is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from distal.estimators.adaptive.drive_tracking import MEMORY, UNKNOWN
from distal.estimators.adaptive.filter import adaptive_function
from distal.estimators.adaptive.robustness import Robustness
from distal.estimators.adaptive.setup import Setup
from distal.estimators.adaptive.states import KINDS, Kind, StateVector
from distal.estimators.channels import UNKNOWN_PLACE, channels_of
from distal.estimators.contract import KernelEstimator
from distal.kernels import Kernel
from distal.logs import frozen
from distal.model import RESOLUTION, Mechanism, joint_frequency
from distal.rig import Rig, Sensor

Floats = NDArray[np.float64]

LONGEST_SUBSTEP = 2.5e-3
"""Longest sub-step of the joints alone [s]: their own modes are slow (docs/numerics.md)."""

MOST_JOINT_SUBSTEPS = 50
"""More sub-steps than this would cost more than they bring: a stiffer joint follows its tendons."""


class AdaptiveFilter(KernelEstimator):
    """A displacement-driven Kalman filter that estimates what is uncertain in the rig beside the joints' motion.

    Args:
        rig: the description.
        compiled: compile its kernel where possible.
        robustness: the guards against a wrong model and bad sensors.
        name: of the estimator.
        references: sensors of joints' angles that are read too, while they are known (homing, fitting).
        given: numbers of the description that are inputs of its kernel and no states (fitting).
        resolution: largest product of sub-step and a joint's own frequency.
        trace: let the kernel put out what a smoother needs.
        kinds: kinds of states that there may be; each returns the blocks of a rig.

    Raises:
        EstimationError: the sensors do not suffice.
    """

    def __init__(
        self,
        rig: Rig,
        compiled: bool = True,
        robustness: Robustness = Robustness(),  # noqa: B008  (frozen)
        name: str = "adaptive",
        references: Sequence[Sensor] = (),
        given: Sequence[str] = (),
        resolution: float = RESOLUTION,
        trace: bool = False,
        kinds: Sequence[Kind] = KINDS,
    ) -> None:
        mechanism, channels = Mechanism(rig, given), channels_of(rig, name, references)
        self._states = StateVector(Setup(mechanism, channels, robustness), kinds)
        longest = min(LONGEST_SUBSTEP, resolution / max(joint_frequency(mechanism), 1e-12))
        self._count = min(max(1, int(np.ceil(channels.interval / longest - 1e-9))), MOST_JOINT_SUBSTEPS)
        super().__init__(
            name,
            rig,
            Kernel(adaptive_function(self._states, self._count, trace=trace), compiled),
            mechanism.parameters.values,
            channels.names,
            tuple(sensor.name for sensor in channels.compared),
            self._states.names,
            channels.interval,
        )

    def export_function(self) -> ca.Function:
        """Return (carry, x, p) → (carry⁺, y) in the form for small memories: matrices as loops, the same numbers."""
        return adaptive_function(self._states, self._count, loops=True)

    def prior_function(self) -> ca.Function:
        """Return (values, mask) → (mean, covariance's diagonal, memory) before the first sample.

        The drives rest where the first sample says; what a play passes on is the first reading of its effort.
        """
        states, setup = self._states, self._states.setup
        names = setup.channels.names
        values, mask = ca.SX.sym("values", len(names)), ca.SX.sym("mask", len(names))

        def read(sensor: Sensor, otherwise: float) -> ca.SX:
            k = names.index(sensor.name)
            return ca.if_else(mask[k] > 0, values[k] - sensor.bias.value, otherwise)

        mean, memory = ca.SX(ca.DM(states.means)), ca.SX.zeros((MEMORY + 1) * setup.n_drives)
        for i, drive in enumerate(self.rig.drives):
            position, effort, transmitted = setup.position_sensor(i), setup.force_sensor(i), states.transmitted(i)
            if position is not None:
                unknown = ca.if_else(mask[names.index(position.name)] > 0, 0.0, UNKNOWN_PLACE[drive.kind] ** 2)
                memory[MEMORY * i], memory[MEMORY * i + UNKNOWN] = read(position, 0.0), unknown
            if transmitted is not None and effort is not None:
                at = transmitted[0]
                mean[at] = read(effort, float(states.means[at]))
        return ca.Function("prior", [values, mask], [mean, ca.SX(ca.DM(states.stds**2)), memory])

    @property
    def bridged(self) -> int:
        """Number of displacements, the first of the channels: they cross gaps in a straight line."""
        return len(self._states.setup.channels.positions)

    @property
    def states(self) -> StateVector:
        """The state vector: its blocks, their priors and what they do."""
        return self._states

    @cached_property
    def priors(self) -> tuple[Floats, Floats]:
        """Prior means and stds of the states that are numbers of the rig, NaN for the others, (n,) each."""
        states = self._states
        means, stds = (np.where(states.lasting, each, np.nan) for each in (states.means, states.stds))
        return frozen(means), frozen(stds)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the kernel's parameters, (n_p,)."""
        return self._states.setup.mechanism.parameters.names

    def with_prior(self, values: Mapping[str, float]) -> AdaptiveFilter:
        """Return the same filter, kernel included, that begins where the rig with other values would.

        Args:
            values: path → number, as `Rig.with_values`.
        """
        rig, setup = self.rig.with_values(values), self._states.setup
        sensors = {sensor.name: sensor for sensor in rig.sensors}

        def same(group: tuple[Sensor, ...]) -> tuple[Sensor, ...]:
            return tuple(sensors.get(sensor.name, sensor) for sensor in group)

        read = setup.channels
        channels = replace(
            read,
            positions=same(read.positions),
            forces=same(read.forces),
            tensions=same(read.tensions),
            angles=same(read.angles),
        )
        other = copy(self)
        other.rig, other._begin = rig, None
        other.__dict__.pop("priors", None)
        mechanism = Mechanism(rig, setup.mechanism.parameters.given)
        other._states = StateVector(replace(setup, mechanism=mechanism, channels=channels), self._states.kinds)
        return other
