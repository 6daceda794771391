"""What a map that a fit learned adds to the angles at what the drives' sensors would read, and how
sure it is of that.

It corrects what the filter makes of readings. A command has none: those that the model foresees
often lie outside of what the logs had, where terms that cancelled in the logs do not. So only a
constant is followed; of other maps the band counts (docs/results/control.md).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from distal.arrays import Floats
from distal.estimators import AdaptiveFilter, first_values
from distal.kernels import mean_of, variances_of
from distal.rig import Rig, gain_of
from distal.rig.learned_map import CONSTANT


class LearnedShift:
    """The filter of a rig, run over the readings that commands would give: what its maps add.

    Args:
        rig: one with a learned `discrepancy`.
    """

    def __init__(self, rig: Rig, compiled: bool = True) -> None:
        self._estimator = AdaptiveFilter(rig, compiled)

    @property
    def is_constant(self) -> bool:
        """Whether the map is the same everywhere."""
        return self._estimator.discrepancy is not None and self._estimator.discrepancy.terms == (
            CONSTANT,
        )

    def __call__(
        self, time: Floats, readings: Mapping[str, Mapping[str, Floats]]
    ) -> tuple[Floats, Floats]:
        """Return what maps add to the joints' angles [rad] and their variances, (k, n_joints) each.

        Args:
            readings: what a sensor measures → drive → values of that, (k,).
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
