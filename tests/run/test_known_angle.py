"""An angle that is known while a filter runs: it conditions the map, as a homing move does."""

from __future__ import annotations

from copy import deepcopy

import numpy as np
import pytest

from distal import Log, homing_filter, load_rig
from distal.estimators import AdaptiveFilter
from distal.homing import plain_samples
from distal.regression import Shape, given
from distal.rig import MapArrays
from tests.learned_maps import drawn_map


@pytest.mark.parametrize("std", [0.0, 0.02])
def test_a_filter_that_homes_conditions_its_map_as_a_whole_move_does(std: float) -> None:
    """Sample by sample and all at once are the same, with the constant error of the mark, where the
    weights of slips, on which the variance of their intervals depends, are certain.
    """
    drawn = drawn_map()
    slips = Shape.of(drawn).features["slips"]
    arrays = deepcopy(drawn.arrays.by_name)
    arrays["mean"][:, slips] = arrays["covariance"][:, slips] = 0.0
    arrays["covariance"][:, :, slips] = 0.0
    arrays["covariance"][:, 0, 0] += 1.0  # so that no zero is a surprise
    drawn = drawn.model_copy(update={"arrays": MapArrays(**arrays)})
    rig = load_rig("capstan-joint").with_map(filter=[drawn])
    homing = homing_filter(rig, std, compiled=False)
    time = 0.005 * np.arange(200)
    readings = np.column_stack([0.3 * np.sin(5 * time), 0.02 * np.cos(3 * time)])
    angles = np.where(time < 0.6, 0.1, np.nan)[:, None]
    samples = np.column_stack([readings, angles])
    start = homing.initial(0.0, samples[0])
    means, covariances, *_ = homing.scan(start, time, samples)
    log = Log(time, dict(zip(homing.channels, readings.T)))
    plain = AdaptiveFilter(rig, compiled=False)
    unaided = plain_samples(plain, plain.initial(0.0, readings[0]), log, readings, angles)
    # the first sample has no interval, and tells nothing
    known = (time > 0.0) & (time < 0.6)
    after = given(rig.map.filter[0], unaided, known, {"jaw": std})
    with_it = plain.with_maps(rig.map.model_copy(update={"filter": (after,)}))
    expected, spreads, *_ = with_it.scan(with_it.initial(0.0, readings[0]), time, readings)
    late = time > 0.6
    np.testing.assert_allclose(means[late, 0], expected[late, 0], atol=1e-6)
    np.testing.assert_allclose(covariances[late, 0, 0], spreads[late, 0, 0], rtol=1e-4)
    usual = plain.scan(plain.initial(0.0, readings[0]), time, readings)[0]
    assert np.abs(usual[late, 0] - expected[late, 0]).max() > 1e-3
