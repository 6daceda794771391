"""Corrections of the joints' angles by learned maps, at the readings that a command would give,
with their variances.

A map corrects the angles that the filter estimates from readings. A command has no readings, only
those that the model foresees; the map's variance says how far these are from the logs.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from distal.arrays import Floats
from distal.estimators import AdaptiveFilter, first_values
from distal.kernels import mean_of, variances_of
from distal.rig import Rig, gain_of


class LearnedShift:
    """The filter of a rig, run over the readings that commands would give, for the corrections by
    its maps.

    Args:
        rig: a rig with learned maps.
    """

    def __init__(self, rig: Rig, compiled: bool = True) -> None:
        self._estimator = AdaptiveFilter(rig, compiled)

    def __call__(
        self, time: Floats, readings: Mapping[str, Mapping[str, Floats]]
    ) -> tuple[Floats, Floats]:
        """Return the corrections of the joints' angles by maps [rad] and their variances [rad²],
        (k, n_joints) each.

        Args:
            time: stamps [s], (k,).
            readings: what a sensor measures → drive or tendon → its values, (k,), SI.
        """
        estimator = self._estimator
        rig = self._estimator.rig
        samples = np.full((len(time), len(estimator.channels)), np.nan)
        for sensor in rig.sensors:
            of = readings.get(sensor.measures, {})
            if sensor.name in estimator.channels and sensor.of in of:
                offset = sensor.bias.value if sensor.measures != "position" else 0.0
                samples[:, estimator.channels.index(sensor.name)] = (
                    gain_of(sensor).value * of[sensor.of] + offset
                )
        begin = estimator.initial(time[0], first_values(samples))
        kernel_states, ys = estimator.advanced(begin, time, samples)
        n = begin.size
        joints = len(rig.joints)
        own = mean_of(kernel_states, n)
        spreads = variances_of(kernel_states, n)
        added = estimator.report.means(own.copy(), ys) - own
        variances = estimator.report.variances_of(spreads.copy(), ys) - spreads
        return added[:, :joints], np.maximum(variances[:, :joints], 0.0)
