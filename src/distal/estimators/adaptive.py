"""`adaptive`: right when the model is wrong, and honest about how sure it is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from distal.estimators.augmented import AugmentedState
from distal.estimators.channels import Channels, channels_of, sensor_for
from distal.estimators.contract import KernelEstimator
from distal.estimators.displacement_driven import adaptive_function
from distal.estimators.full_state import UNKNOWN_PLACE
from distal.estimators.motion import MEMORY
from distal.kernels import Kernel
from distal.model import RESOLUTION, Mechanism, joint_frequency
from distal.rig import Rig, Sensor

Floats = NDArray[np.float64]

LONGEST_SUBSTEP = 2.5e-3
"""Longest sub-step of the joint alone [s]: its own modes are slow."""

FINE = 0.2
"""Largest product of sub-step and the joint's own frequency in a fit: its errors must not look like parameters."""

MOST_JOINT_SUBSTEPS = 50


def with_places(rows: Floats, last: NDArray[np.intp], samples: Floats, places: int) -> tuple[Floats, NDArray[np.intp]]:
    """Return a kernel's rows in which displacements cross gaps in a straight line to the reading that ends them.

    Args:
        rows: (dt, values, mask) with the bridges, (k, 1 + 2 n_channels).
        last: index of each sample's own row.
        samples: (n, n_channels), NaN where missing.
        places: number of position sensors, which come first.
    """
    if len(last) == len(rows):
        return rows, last
    width = samples.shape[1]
    for i in np.flatnonzero(np.diff(last, prepend=-1) > 1):
        first = last[i - 1] + 1 if i else 0
        there = np.isfinite(samples[i, :places])
        ahead = np.arange(last[i] - first + 1, 1, -1)
        rows[first : last[i], 1 : 1 + places] = np.where(there, samples[i, :places], 0.0)
        rows[first : last[i], 1 + width : 1 + width + places] = -ahead[:, None] * there
    return rows, last


def prior_memory(rig: Rig, channels: Channels, sample: Floats) -> Floats:
    """Return what is remembered of the drives before the first sample: they rest where it says.

    Args:
        rig: the description.
        channels: the sensors that are read.
        sample: values of the channels, NaN where missing.
    """
    memory = []
    for drive in rig.drives:
        sensor = sensor_for(channels.positions, drive.name)
        if sensor is None:
            memory.append(np.zeros(MEMORY))
            continue
        read = sample[channels.names.index(sensor.name)] - sensor.bias.value
        place, unknown = (read, 0.0) if np.isfinite(read) else (0.0, UNKNOWN_PLACE[drive.kind] ** 2)
        memory.append(np.array([place, 0.0, 0.0, 0.0, unknown, 0.0]))
    return np.concatenate([*memory, np.zeros(len(rig.drives))])


class AdaptiveFilter(KernelEstimator):
    """A displacement-driven Kalman filter that estimates what is uncertain in the rig beside the joint's motion.

    Args:
        rig: the description.
        compiled: compile its kernel where possible.
        updates: how often each update is linearised again; 1 = extended, more = iterated.
        ideal: leave out all that guards against a wrong model; for bounds.
        trace: keep what a smoother needs.
        name: of the estimator.
        reference: a sensor of the joint's angle that is read too, while it is known (homing, fitting).
        given: numbers of the description that are inputs of its kernel and no states (fitting).
        suspicious: look for friction at drives that the rig does not know of; a fit takes what the rig says.

    Raises:
        EstimationError: the sensors do not suffice.
    """

    def __init__(
        self,
        rig: Rig,
        compiled: bool = True,
        updates: int = 1,
        ideal: bool = False,
        trace: bool = False,
        name: str = "adaptive",
        reference: Sensor | None = None,
        given: Sequence[str] = (),
        suspicious: bool = True,
    ) -> None:
        self._mechanism, self._channels = Mechanism(rig, given), channels_of(rig, name, reference)
        self._augmented = AugmentedState(self._mechanism, self._channels, suspicious)
        interval = self._channels.interval
        resolution = RESOLUTION if suspicious else FINE
        longest = min(LONGEST_SUBSTEP, resolution / max(joint_frequency(self._mechanism), 1e-12))
        count = min(max(1, int(np.ceil(interval / longest - 1e-9))), MOST_JOINT_SUBSTEPS)
        function = adaptive_function(self._augmented, count, updates, ideal, trace)
        self._count, self._updates = count, updates
        forces = tuple(sensor.name for sensor in self._channels.compared)
        super().__init__(
            name,
            rig,
            Kernel(function, compiled),
            self._mechanism.parameters.values,
            self._channels.names,
            forces,
            self._augmented.names,
            interval,
        )

    def _rows(self, steps: Floats, samples: Floats) -> tuple[Floats, NDArray[np.intp]]:
        """Return the kernel's rows; in those that bridge a gap, displacements go in a straight line to its end."""
        return with_places(*super()._rows(steps, samples), samples, len(self._channels.positions))

    def _prior(self, sample: Floats) -> tuple[Floats, Floats, Floats]:
        augmented, means = self._augmented, self._augmented.means.copy()
        for i, at in augmented.transmitted_at.items():
            sensor = sensor_for(self._channels.forces, self.rig.drives[i].name)
            read = np.nan if sensor is None else sample[self._channels.names.index(sensor.name)] - sensor.bias.value
            means[at] = read if np.isfinite(read) else means[at]
        return means, np.diag(augmented.stds**2), prior_memory(self.rig, self._channels, sample)

    def export_function(self) -> ca.Function:
        """Return (carry, x, p) → (carry⁺, y) in the form for small memories: matrices as loops, the same numbers."""
        return adaptive_function(self._augmented, self._count, self._updates, loops=True)

    @property
    def leads_gaps(self) -> bool:
        """Whether displacements cross a gap in a straight line to the reading that ends it."""
        return True

    def prior_function(self) -> ca.Function:
        """Return (values, mask) → (mean, covariance's diagonal, memory) before the first sample."""
        augmented, names = self._augmented, self._channels.names
        values, mask = ca.SX.sym("values", len(names)), ca.SX.sym("mask", len(names))

        def read(sensor: Sensor, otherwise: float) -> ca.SX:
            k = names.index(sensor.name)
            return ca.if_else(mask[k] > 0, values[k] - sensor.bias.value, otherwise)

        mean, memory = ca.SX(ca.DM(augmented.means)), ca.SX.zeros(MEMORY * len(self.rig.drives) + len(self.rig.drives))
        for i, drive in enumerate(self.rig.drives):
            place, effort = (
                sensor_for(group, drive.name) for group in (self._channels.positions, self._channels.forces)
            )
            if place is not None:
                unknown = ca.if_else(mask[names.index(place.name)] > 0, 0.0, UNKNOWN_PLACE[drive.kind] ** 2)
                memory[MEMORY * i], memory[MEMORY * i + 4] = read(place, 0.0), unknown
            if i in augmented.transmitted_at and effort is not None:
                at = augmented.transmitted_at[i]
                mean[at] = read(effort, float(augmented.means[at]))
        return ca.Function("prior", [values, mask], [mean, ca.SX(ca.DM(augmented.stds**2)), memory])

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the kernel's parameters, (n_p,)."""
        return self._mechanism.parameters.names

    @property
    def parameter_values(self) -> Floats:
        """Values of the kernel's parameters, (n_p,), a copy."""
        return np.array(self._mechanism.parameters.values)

    @property
    def places(self) -> int:
        """Number of displacements, the first of the channels."""
        return len(self._channels.positions)

    def rows(self, steps: Floats, samples: Floats) -> tuple[Floats, NDArray[np.intp]]:
        """Return the kernel's rows (dt, values, mask), bridges included, and the index of each sample's own row.

        Args:
            steps: intervals before the samples [s], (k,).
            samples: values of `channels`, NaN where missing, (k, n_channels).
        """
        return self._rows(steps, samples)

    def with_prior(self, values: Mapping[str, float]) -> AdaptiveFilter:
        """Return the same filter, kernel included, that begins where the rig with other values would.

        Args:
            values: path → number, as `Rig.with_values`.
        """
        rig = self.rig.with_values(values)
        other = copy(self)
        other.rig = rig
        mechanism = Mechanism(rig, self._mechanism.parameters.given)
        other._augmented = AugmentedState(mechanism, self._channels_in(rig), bool(self._augmented.friction_at))
        return other

    def _channels_in(self, rig: Rig) -> Channels:
        """Return the same channels with the sensors as another rig describes them."""
        sensors = {sensor.name: sensor for sensor in rig.sensors}

        def same(group: tuple[Sensor, ...]) -> tuple[Sensor, ...]:
            return tuple(sensors.get(sensor.name, sensor) for sensor in group)

        held = self._channels
        return Channels(same(held.positions), same(held.forces), same(held.tensions), same(held.angles))

    @property
    def prior_means(self) -> Floats:
        """Means of the states before the first sample, (n,)."""
        return self._augmented.means

    @property
    def prior_stds(self) -> Floats:
        """Standard deviations of the states before the first sample, (n,)."""
        return self._augmented.stds

    @property
    def torque_at(self) -> int | None:
        """Index of the external torque among the states, or None where it cannot occur."""
        return self._augmented.torque_at if self._augmented.torque is not None else None

    def torque_fade(self, steps: Floats) -> Floats:
        """Return how much of an external torque is left after each interval, e^{−dt/τ}.

        Args:
            steps: lengths of the intervals [s], (k,).
        """
        torque = self._augmented.torque
        return np.ones_like(steps) if torque is None else np.exp(-steps / torque.correlation_time)
