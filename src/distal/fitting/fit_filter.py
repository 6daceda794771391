"""The filter of a fit: the free parameters are inputs of its kernel, and several runs go through it
side by side.

Displacements between samples, interpolated by curves: a fit runs offline and knows the next
samples.

Samples in which a joint rests in a stop: there its angle depends on the stop alone, and teaches
nothing of the other parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from distal.arrays import Bools, Floats
from distal.estimators import AdaptiveFilter, Robustness
from distal.fitting.free_parameter import Free
from distal.logs import Log, true_angles
from distal.rig import Rig, Sensor
from distal.run import samples_of
from distal.sensor_errors import variance

FINEST = 4
"""Largest number of steps per sample. Source: judgement."""


def steps_per_sample(positions: Floats, noise: Floats) -> int:
    """Return how many steps per sample keep the error of straight lines within the sensors'
    `noise`, (m,): 1, 2 or `FINEST`.

    A straight line between samples misses ẍ dt²/8. Where sliders swing with ω, that much tension is
    missing at every crest, and stiffness would be fitted too large by (ω dt)²/12. With n steps the
    error is n² times less. The displacements `positions` are (k, m), NaN where missing.
    """
    bends = np.abs(np.diff(positions, n=2, axis=0)) / 8.0
    missed = [float(np.sqrt(np.nanmean(b**2))) if np.isfinite(b).any() else 0.0 for b in bends.T]
    # the second difference of noise alone has the variance 6 σ²
    noise_bends = np.sqrt(6.0) / 8.0 * noise
    excess = max(
        (np.sqrt(max(m**2 - o**2, 0.0)) / n for m, o, n in zip(missed, noise_bends, noise)),
        default=0.0,
    )
    return next((steps for steps in (1, 2) if excess < 0.5 * steps**2), FINEST)


def refined(
    times: Floats, samples: Floats, positions: int, steps: int
) -> tuple[Floats, Floats, NDArray[np.intp]]:
    """Return stamps, samples and the rows of the original samples, with interpolated displacements
    between them.

    Each interval of `times` [s], (k,), is cut into `steps`. The displacements, the first
    `positions` columns of `samples`, (k, n_channels), follow the cubic through the four samples
    about the interval (Catmull and Rom, 1974), or a straight line where one of these is missing or
    the stamps have a gap. All other channels are NaN between the samples.
    """
    k = len(times)
    if steps == 1 or k < 4:
        return times, samples, np.arange(k)
    parts = np.arange(1, steps) / steps
    interval = np.diff(times)
    even = interval < 1.5 * np.median(interval)
    rows = np.arange(k) * steps
    fine_times = np.empty((k - 1) * steps + 1)
    fine = np.full((len(fine_times), samples.shape[1]), np.nan)
    fine_times[rows] = times
    fine[rows] = samples
    x = samples[:, :positions]
    before = np.vstack([x[:1], x[:-2]])
    after = np.vstack([x[2:], x[-1:]])
    first = x[:-1]
    last = x[1:]
    smooth = np.isfinite(before + after) & even[:, None]
    smooth &= (np.r_[True, even[:-1]] & np.r_[even[1:], True])[:, None]
    left = np.where(smooth, (last - before) / 2, last - first)
    right = np.where(smooth, (after - first) / 2, last - first)
    for j, s in enumerate(parts, start=1):
        fine_times[j::steps] = times[:-1] + s * interval
        fine[j::steps, :positions] = (
            (2 * s**3 - 3 * s**2 + 1) * first
            + (s**3 - 2 * s**2 + s) * left
            + (3 * s**2 - 2 * s**3) * last
            + (s**3 - s**2) * right
        )
    # the filter itself bridges gaps
    keep = np.ones(len(fine_times), dtype=bool)
    for j in range(1, steps):
        keep[j::steps] = even & np.isfinite(fine[j::steps, :positions]).all(axis=1)
    new_rows = np.cumsum(keep) - 1
    return fine_times[keep], fine[keep], new_rows[rows]


NEAR_STOP = float(np.deg2rad(0.5))
"""Distance from a stop within which a joint is in it [rad], beside twice the std of its encoder's
offset. Source: judgement.
"""

AFTER_STOP = 0.05
"""Time after which a joint has left a stop [s]. Source: judgement."""


def in_stops(times: Floats, truth: Floats, rig: Rig) -> Bools:
    """Return whether each joint is in one of its stops or has just left it, (k, n_joints).

    The angles `truth` [rad], (k, n_joints), are NaN where not known; `times` are the stamps [s],
    (k,).
    """
    resting = np.zeros(truth.shape, dtype=bool)
    for j, (joint, angles) in enumerate(zip(rig.joints, truth.T)):
        if joint.stops is not None:
            doubts = [
                sensor.bias.filter_std
                for sensor in rig.sensors_of("angle")
                if sensor.of == joint.name
            ]
            margin = NEAR_STOP + 2.0 * max(doubts, default=0.0)
            low, high = joint.stops
            with np.errstate(invalid="ignore"):
                resting[:, j] = (angles < low + margin) | (angles > high - margin)
    last = np.maximum.accumulate(np.where(resting, times[:, None], -np.inf), axis=0)
    return times[:, None] - last <= AFTER_STOP


FINE = 0.2
"""Largest product of a sub-step and a joint's own angular frequency in a fit, so that the errors of
the sub-steps do not look like parameters. Source: judgement.
"""


@dataclass(frozen=True)
class Data:
    """A log, ready for the filter.

    Args:
        samples: values of its channels, those of the references last, (k, n_channels).
        rows: rows of the filter's kernel.
        last: index of each sample's own row, (k,).
    """

    log: Log
    samples: Floats
    rows: Floats
    last: NDArray[np.intp]

    def beginning(self, count: int) -> Data:
        """Return the first `count` samples of the log."""
        count = min(count, len(self.last))
        log = Log(self.log.time[:count], {}, {}, self.log.source)
        return Data(
            log, self.samples[:count], self.rows[: self.last[count - 1] + 1], self.last[:count]
        )


class FitFilter:
    """The filter of a fit: the free parameters are inputs of its kernel, and several runs go
    through it side by side.

    Args:
        rig: the rig, with its references.
        references: sensors of joints' angles that give the reference.
        free: the free parameters.
        steps: rows per sample, see `resampling`; with more of them each needs fewer sub-steps.
        compiled: whether the kernel is compiled; else it is interpreted.
    """

    def __init__(
        self,
        rig: Rig,
        references: Sequence[Sensor],
        free: Sequence[Free],
        steps: int = 1,
        compiled: bool = True,
    ) -> None:
        self.rig = rig
        self.references = tuple(references)
        self.steps = steps
        self.estimator = AdaptiveFilter(
            rig,
            "lanes" if compiled else False,
            Robustness.fitting(),
            name="fit",
            references=self.references,
            inputs=[path for part in free for path in part.paths],
            resolution=FINE * steps,
        )

    def data_of(self, log: Log) -> Data:
        """Return a log, ready for the filter, with its displacements between samples on cubics, see
        `refined`.

        The known angles are the readings of the references, NaN where they are not known.
        """
        estimator = self.estimator
        joints = self.rig.joint_names
        names = estimator.channels[: -len(self.references)]
        proximal = samples_of(log, names, "fit").copy()
        for sensor in estimator.states.context.channels.positions:
            centre, away = estimator.states.context.possible_positions(sensor)
            column = proximal[:, names.index(sensor.name)]
            column[np.abs(column - centre) > away] = np.nan
        angles = true_angles(log, joints)
        truth = np.full((len(log), len(joints)), np.nan) if angles is None else angles
        read = [joints.index(sensor.of) for sensor in self.references]
        # in a stop the angle depends on the stop alone: readings there teach nothing of the other
        # parameters
        stopped = in_stops(log.time, truth, self.rig)
        samples = np.column_stack([proximal, np.where(stopped, np.nan, truth)[:, read]])
        samples[stopped.all(axis=1), estimator.bridged :] = np.nan
        times, fine, originals = refined(log.time, samples, estimator.bridged, self.steps)
        rows, last = estimator.rows(np.diff(times, prepend=times[0]), fine)
        return Data(log, samples, rows, last[originals])


def steps_of(rig: Rig, logs: Sequence[Log]) -> int:
    """Return how many rows per sample the filter of some logs needs, so that displacements between
    samples are right.

    Joints that settle within an interval need one row, since they do not depend on the way there.
    """
    if AdaptiveFilter(rig, False).states.context.joints_settle:
        return 1
    sensors = list(rig.sensors_of("position"))
    noise = np.sqrt([variance(sensor) for sensor in sensors])
    positions = [
        np.column_stack([log.channels[sensor.name] for sensor in sensors])
        for log in logs
        if sensors
    ]
    return max((steps_per_sample(displacements, noise) for displacements in positions), default=1)
