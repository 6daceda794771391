"""What the mask of a sample says of a value, and what filters and gaps make of it."""

from __future__ import annotations

import numpy as np
import pytest

from distal import Rig
from distal.estimators import AdaptiveFilter
from distal.kernels.layout import (
    COMPARED_ONLY,
    MISSING,
    READ,
)


@pytest.mark.parametrize("mask", [MISSING, COMPARED_ONLY])
def test_what_is_compared_only_has_an_innovation_and_corrects_nothing(
    pulley_rig: Rig, mask: float
) -> None:
    """The state after it is that of a sample in which the value is missing; a value that is read
    corrects.
    """
    estimator = AdaptiveFilter(pulley_rig, compiled=False)
    sample = np.array([1e-3 if name in ("x1", "x2") else 3.0 for name in estimator.channels])
    belief = estimator.initial(0.0, sample)
    width, force = len(estimator.channels), estimator.channels.index(estimator.measured[0])
    row = np.concatenate([[0.01], sample, np.full(width, READ)])
    n = belief.size
    filtered, innovations = [], []
    for given in (READ, MISSING, mask):
        row[1 + width + force] = given
        (state,), (y,) = estimator.kernel.scan(belief.kernel_state, row, estimator.parameters)
        filtered.append(state[: n + n * n])
        innovations.append(y[0])
    read, missing, found = filtered
    np.testing.assert_array_equal(found, missing)
    assert np.isfinite(innovations[2]) == (mask == COMPARED_ONLY)
    assert not np.array_equal(read[:n], missing[:n])
