"""What `benchmarks.mujoco_tendons` makes of fitted rigs: it counts errors as it says, and its rival
finds the numbers of a model.
"""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install '.[mujoco]'")


from benchmarks.mujoco_tendons import (
    off,
)


def test_errors_count_after_homing() -> None:
    """A constant error is known then; what comes on top of it counts."""
    time = np.arange(6.0)
    truth = np.zeros((6, 1))
    angles = truth + 0.5
    angles[4:] += 0.1
    np.testing.assert_allclose(off(time, angles, truth, 2.0)[:, 0], [0, 0, 0.1, 0.1], atol=1e-12)
    np.testing.assert_allclose(off(time, angles, truth, 0.0), angles)
