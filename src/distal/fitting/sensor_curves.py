"""The systematic errors of position sensors as curves over their travel, learned from logs of known
angle.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from distal.arrays import Floats
from distal.errors import FitError
from distal.estimators import StateKind
from distal.fitting.problem import Problem
from distal.logs import true_angles
from distal.rig import Sensor

LINEARITY_LEFT = 1.5
"""Factor on the remaining linearity that the filter states, since curves change a little from day
to day. Source: judgement.
"""

AGREE = 4.0
"""RMS deviation of a log's weights from those of all logs, in the log's own standard deviations,
above which the curves do not agree. Source: judgement.
"""


def curves(problem: Problem, z: Floats) -> dict[str, object]:
    """Return path → value of the position sensors' curves and remaining linearities, at the end z
    of a fit, (n,).

    The filter estimates each sensor's deviation as Σ w_j cos(π j ξ) over its travel. The estimates
    of w at the ends of the logs of known angle are joined: Λ = Λ₀ + Σ (Λ_i − Λ₀), w = Λ⁻¹ (Λ₀ w₀ +
    Σ (Λ_i w_i − Λ₀ w₀)), Λ = P⁻¹.

    Raises:
        FitError: no position sensor has a linearity, no log has a known angle, or the curves of the
            logs differ, so that the sensor was not the same.
    """
    joints = problem.filter.rig.joint_names
    with_truth = [
        j for j, data in enumerate(problem.data) if true_angles(data.log, joints) is not None
    ]
    sensors = [
        s for s in problem.filter.rig.sensors if s.measures == "position" and s.linearity > 0.0
    ]
    if not with_truth or not sensors:
        raise FitError(
            "curves need a log with truth and a position sensor with a linearity; give both, or "
            "leave --curves out"
        )
    ends = [(problem.data[j].log.source, *problem.states(j, z)) for j in with_truth]
    changes: dict[str, object] = {}
    for sensor in sensors:
        changes |= _of_sensor(problem, sensor, ends)
    return changes


def _of_sensor(
    problem: Problem, sensor: Sensor, ends: Sequence[tuple[str, Floats, Floats]]
) -> dict[str, object]:
    """Return a sensor's curve and its remaining linearity, from the name of each log and the mean
    and the covariance of the states at its end.
    """
    estimator = problem.filter.estimator
    states = zip(estimator.state_kinds, estimator.state_parts)
    at = np.flatnonzero(
        [kind is StateKind.LINEARITY and part == sensor.name for kind, part in states]
    )
    block = np.ix_(at, at)
    start = estimator.states.means[at]
    spread = estimator.states.stds[at]
    prior = np.diag(1.0 / spread**2)
    precision = prior.copy()
    weighted = prior @ start
    for _, means, covariances in ends:
        information = np.linalg.inv(covariances[block])
        precision += information - prior
        weighted += information @ means[at] - prior @ start
    precision = (precision + precision.T) / 2
    weights = np.linalg.solve(precision, weighted)
    for source, means, covariances in ends if len(ends) > 1 else ():
        away = means[at] - weights
        # weights that a log does not show have the prior's covariance, and agree
        distance = float(away @ np.linalg.solve(covariances[block] + 1e-18 * np.eye(len(at)), away))
        if distance > AGREE**2 * len(at):
            raise FitError(
                f"{source}: the curve of sensor '{sensor.name}' is not that of the other logs; "
                "was it mounted anew? Leave --curves out"
            )
    share = float(np.sqrt(np.trace(np.linalg.inv(precision)) / np.sum(spread**2)))
    return {
        f"sensors.{sensor.name}.curve": [float(f"{w:.4g}") for w in weights],
        f"sensors.{sensor.name}.linearity": float(
            f"{min(LINEARITY_LEFT * share, 1.0) * sensor.linearity:.3g}"
        ),
    }
