"""The filter of a fit: the free parameters are inputs of its kernel, and several runs go through it
side by side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from distal.arrays import Floats
from distal.estimators import AdaptiveFilter, Robustness
from distal.fitting.free_parameter import Free
from distal.fitting.resampling import refined, steps_per_sample
from distal.fitting.samples_in_stops import in_stops
from distal.logs import Log, true_angles
from distal.rig import Rig, Sensor
from distal.run import samples_of
from distal.sensor_errors import variance

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
