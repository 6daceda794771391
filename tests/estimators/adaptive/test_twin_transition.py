"""Predictions and transitions for a smoother, against the twin:
docs/reference/adaptive-equations.md, section 9.
"""

from __future__ import annotations

import numpy as np
import pytest

from distal import Log
from distal.estimators import AdaptiveFilter
from distal.run import smooth
from tests.estimators.adaptive import rigs
from tests.estimators.adaptive.agreement import TOLERANCE
from tests.estimators.adaptive.rigs import sliders
from tests.estimators.adaptive.test_twin import DEFAULT, WHOLE, spoiled_log
from tests.estimators.adaptive.twin import Twin


@pytest.mark.parametrize("name", ["all of sliders", "hysteresis", "position"])
def test_the_transition_that_a_smoother_needs(name: str) -> None:
    """Predicted mean, predicted covariance and Φ of every part of an interval, bridges of gaps
    too.
    """
    rig, _ = WHOLE[name]
    time, samples = spoiled_log(rig, size=0.3)
    references = rig.sensors_of("angle")
    found = AdaptiveFilter(rig, compiled=False, references=references, trace=True)
    rows, _ = found.rows(np.diff(time, prepend=time[0]), samples)
    _, ys = found.kernel.scan(
        found.initial(time[0], samples[0]).kernel_state, rows, found.parameters
    )
    twin = Twin(rig, DEFAULT, references)
    twin.run(time, samples)
    n, first = twin.n, 2 * len(found.measured)
    assert len(twin.parts) == len(rows)
    for part, y in zip(twin.parts, ys, strict=True):
        mean, covariance = y[first : first + n], y[first + n : first + n + n * n].reshape(n, n)
        transition = y[first + n + n * n :].reshape(n, n).T  # columns lie one after the other
        scale = np.maximum(np.maximum(twin.prior_stds, np.sqrt(np.diag(covariance))), np.abs(mean))
        assert np.max(np.abs(part.predicted_mean - mean) / scale) < TOLERANCE
        apart = np.abs(part.predicted_covariance - covariance)
        assert np.max(apart / np.outer(scale, scale)) < TOLERANCE
        # an entry turns a number of one size into one of another
        assert np.max(np.abs(part.transition - transition) * scale / scale[:, None]) < TOLERANCE


def test_the_smoother_goes_back_by_its_equation() -> None:
    """(28) over the twin's own predictions; the inverse of P⁻ leaves less than the filter's ten
    digits.
    """
    rig = sliders(rigs.TORQUE, rigs.LINEARITY, rigs.FACTORS)
    time, samples = spoiled_log(rig)
    twin = Twin(rig, DEFAULT)
    taken = {id(sample) for sample in twin.run(time, samples)}
    own = [k for k, part in enumerate(twin.parts) if id(part) in taken]
    means = [part.mean for part in twin.parts]
    covariances = [part.covariance for part in twin.parts]
    sizes = np.outer(twin.prior_stds, twin.prior_stds)
    kinds = np.array([state.kind for state in twin.states])
    guards, slow = kinds == "friction", np.isin(kinds, ("parameter", "factor"))
    assert guards.any()  # their rows of C are zero
    assert slow.any()  # and these ones' rows and columns
    block = np.ix_(~slow, ~slow)
    for k in range(len(twin.parts) - 2, -1, -1):
        after, phi, p = twin.parts[k + 1], twin.parts[k + 1].transition, twin.parts[k].covariance
        inverse = np.zeros((twin.n, twin.n))
        inverse[block] = np.linalg.inv((after.predicted_covariance / sizes)[block])
        c = p @ phi.T @ (inverse / sizes)
        c[guards | slow] = 0.0
        q = after.predicted_covariance - phi @ p @ phi.T
        left = np.eye(twin.n) - c @ phi
        means[k] = twin.parts[k].mean + c @ (means[k + 1] - after.predicted_mean)
        covariances[k] = left @ p @ left.T + c @ (covariances[k + 1] + q) @ c.T
    log = Log(time, {sensor.name: samples[:, i] for i, sensor in enumerate(twin.channels)})
    smoothed = smooth(log, rig, compiled=False)
    apart = np.array(means)[own] - smoothed.means, np.array(covariances)[own] - smoothed.covariances
    assert np.max(np.abs(apart[0]) / twin.prior_stds) < 1e-6
    assert np.max(np.abs(apart[1]) / sizes) < 1e-6
