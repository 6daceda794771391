"""The window of a homing move: the first seconds of a log, in which a reference is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from distal.arrays import Floats
from distal.estimators import AdaptiveFilter, Belief, StateKind, states_of
from distal.kernels import Advanced, covariance_of, mean_of, variances_of
from distal.logs import Log, frozen
from distal.sensor_errors import variance

START_STD = float(np.deg2rad(0.2))
"""Standard deviation of the joint's first angle where the reference gives it, without the
reference's offset [rad]. Source: judgement.
"""


@dataclass(frozen=True)
class Window:
    """The first seconds of a log, in which a reference is known.

    Args:
        estimator: the filter, whose channels contain the reference.
        start: its belief before the first sample.
        time: stamps [s], (k,).
        samples: values of the channels, (k, n_channels).
        truths: true angles [rad], NaN where not known, (k, n_joints).
    """

    estimator: AdaptiveFilter
    start: Belief
    time: Floats
    samples: Floats
    truths: Floats

    @staticmethod
    def of(
        estimator: AdaptiveFilter,
        start: Belief,
        log: Log,
        samples: Floats,
        truths: Floats,
        homing: float,
    ) -> Window:
        """Return the window of the first `homing` s of a log; `samples` and `truths` are those of
        the whole log.
        """
        until = int(np.searchsorted(log.time - log.time[0], homing))
        return Window(estimator, start, log.time[:until], samples[:until], truths[:until])

    @property
    def references(self) -> dict[int, int]:
        """Index of the channel → index of the joint, for each reference."""
        joints = self.estimator.rig.joint_names
        sensors = {
            sensor.name: joints.index(sensor.of)
            for sensor in self.estimator.rig.sensors_of("angle")
        }
        return {
            i: sensors[name] for i, name in enumerate(self.estimator.channels) if name in sensors
        }

    @property
    def _biases(self) -> dict[str, int]:
        """Channel → index of the state that is its sensor's offset."""
        estimator = self.estimator
        return states_of(
            StateKind.SENSOR_BIAS, estimator.channels, estimator.state_kinds, estimator.state_parts
        )

    @property
    def unaided(self) -> Floats:
        """The samples without the references' values, (k, n_channels)."""
        samples = self.samples.copy()
        samples[:, list(self.references)] = np.nan
        return samples

    def scan(self, kernel_state: Floats, samples: Floats) -> Advanced | None:
        """Return kernel states and outputs after each of the `samples`, begun at a `kernel_state`
        before the first; None where the filter diverges.
        """
        estimator = self.estimator
        size = self.start.size
        run = estimator.advanced(
            Belief(self.start.time, frozen(kernel_state), size), self.time, samples
        )
        bounded = (
            np.isfinite(mean_of(run.kernel_states, size)).all()
            and np.isfinite(covariance_of(run.kernel_states, size)).all()
        )
        return run if bounded else None

    def errors(self, kernel_states: Floats) -> tuple[Floats, Floats]:
        """Return the errors of the angles, true minus estimated and less the estimated offset of
        the reference, and the variances of these errors, (k, n_joints) each.
        """
        n = self.start.size
        nj = self.truths.shape[1]
        biases = self._biases
        errors = self.truths - kernel_states[:, :nj]
        variances = variances_of(kernel_states, n)[:, :nj].copy()
        sensors = {sensor.name: sensor for sensor in self.estimator.rig.sensors_of("angle")}
        for channel, joint in self.references.items():
            name = self.estimator.channels[channel]
            variances[:, joint] += variance(sensors[name])
            if name in biases:
                errors[:, joint] -= kernel_states[:, biases[name]]
        return errors, variances

    def anchored(self, kernel_state: Floats) -> Floats:
        """Return the kernel state, which is one before the first sample, with the first angles of
        the reference as angles of the joints.
        """
        n = self.start.size
        states = self.estimator.states
        names = self.estimator.channels
        biases = self._biases
        offsets = {
            j: float(states.stds[biases[names[c]]])
            for c, j in self.references.items()
            if names[c] in biases
        }
        kernel_state = kernel_state.copy()
        covariance = covariance_of(kernel_state, n)
        for joint, column in enumerate(self.truths.T):
            finite = column[np.isfinite(column)]
            if len(finite):
                kernel_state[joint] = finite[0]
                covariance[joint, :] = covariance[:, joint] = 0.0
                covariance[joint, joint] = START_STD**2 + offsets.get(joint, 0.0) ** 2
        return kernel_state

    def within(self, kernel_state: Floats, times: float) -> bool:
        """Return whether a run without reference keeps each joint's angle in its band: its mean
        e²/P is at most `times`.

        The run begins at a `kernel_state` before the first sample, with the angles of the
        reference.
        """
        done = self.scan(self.anchored(kernel_state), self.unaided)
        if done is None:
            return False
        errors, variances = self.errors(done[0])
        columns = [column[np.isfinite(column)] for column in (errors**2 / variances).T]
        return all(float(np.mean(column)) <= times for column in columns if len(column))
