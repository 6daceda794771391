"""The filter of a fit: the free parameters are inputs of its kernel, and several runs go through it
side by side.

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


class FitFilter:
    """The filter of a fit: the free parameters are inputs of its kernel, and several runs go
    through it side by side.

    Args:
        rig: the rig, with its references.
        references: sensors of joints' angles that give the reference.
        free: the free parameters.
        compiled: whether the kernel is compiled; else it is interpreted.
    """

    def __init__(
        self,
        rig: Rig,
        references: Sequence[Sensor],
        free: Sequence[Free],
        compiled: bool = True,
    ) -> None:
        self.rig = rig
        self.references = tuple(references)
        self.estimator = AdaptiveFilter(
            rig,
            "lanes" if compiled else False,
            Robustness.fitting(),
            name="fit",
            references=self.references,
            inputs=[path for part in free for path in part.paths],
            resolution=FINE,
        )

    def data_of(self, log: Log) -> Data:
        """Return a log, ready for the filter.

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
        rows, last = estimator.rows(np.diff(log.time, prepend=log.time[0]), samples)
        return Data(log, samples, rows, last)
