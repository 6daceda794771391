"""What the mask of a sample says of a value, and what filters and gaps make of it."""

from __future__ import annotations

import numpy as np
import pytest

from distal import Rig
from distal.estimators import AdaptiveFilter
from distal.estimators.estimator_protocol import rows_with_gaps
from distal.kernels.layout import (
    COMPARED_ONLY,
    MISSING,
    READ,
    bridge,
    is_bridge,
    is_read,
    is_there,
    share_used,
)


def test_each_value_of_a_mask_says_one_thing() -> None:
    masks = [READ, MISSING, COMPARED_ONLY, bridge(3)]
    assert [bool(is_read(mask)) for mask in masks] == [True, False, False, False]
    assert [bool(is_there(mask)) for mask in masks] == [True, False, True, True]
    assert [float(share_used(mask)) for mask in masks] == [1.0, 0.0, 0.0, 0.0]
    assert is_bridge(bridge(2))
    assert not is_bridge(READ)


def test_a_gap_is_bridged_by_displacements_and_nothing_else() -> None:
    samples = np.array([[1.0, 5.0], [2.0, 6.0], [np.nan, 7.0]])
    rows, last = rows_with_gaps("test", np.array([0.0, 0.03, 0.01]), samples, 0.01, 1)
    masks = rows[:, 3:]
    assert list(last) == [0, 3, 4]
    assert [tuple(mask) for mask in masks] == [
        (READ, READ),
        (bridge(3), MISSING),
        (bridge(2), MISSING),
        (READ, READ),
        (MISSING, READ),
    ]


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
    (read,), _ = estimator.kernel.scan(belief.kernel_state, row, estimator.parameters)
    row[1 + width + force] = mask
    (kernel_state,), (y,) = estimator.kernel.scan(belief.kernel_state, row, estimator.parameters)
    row[1 + width + force] = MISSING
    (missing,), _ = estimator.kernel.scan(belief.kernel_state, row, estimator.parameters)
    np.testing.assert_array_equal(kernel_state[: n + n * n], missing[: n + n * n])
    assert np.isfinite(y[0]) == (mask == COMPARED_ONLY)
    assert not np.array_equal(read[:n], missing[:n])
