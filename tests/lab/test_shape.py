"""The chain that a page draws: what it holds of a rig."""

from __future__ import annotations

import numpy as np
from tools.lab.chain_shape import chain_shape

from distal import load_rig


def test_tendons_cross_the_joints_with_their_arms() -> None:
    shape = chain_shape(load_rig("finger-underactuated"), 1.0)
    (tendon,) = shape["tendons"]  # type: ignore[misc]
    crossings = tendon["crossings"]  # type: ignore[has-type]
    np.testing.assert_allclose(crossings, [[0, 0.009], [1, 0.007], [2, 0.005]], rtol=1e-9)
