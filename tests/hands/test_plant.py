"""The plant of hands that tests and benchmarks use: its C and its NumPy are the same."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.servo_hands import MOVING, Hands, aero_like, orca_like


def hands_of(kind: str) -> Hands:
    if kind == "springs":
        return aero_like([3, 5])[1]
    hands = orca_like([3, 4], ("index_mcp", "index_pip"))[1]
    hands.slips[0, 0], hands.broken[1, 2] = 0.07, True
    return hands


@pytest.mark.parametrize("kind", ["pairs of tendons", "springs"])
def test_c_and_numpy_move_the_same(kind: str) -> None:
    """Slack, a spool that slips, a broken tendon, stops."""
    compiled, plain = hands_of(kind), hands_of(kind)
    plain.compiled = False
    rng = np.random.default_rng(0)
    for _ in range(4):
        goals = compiled.goals_of(1.5 * rng.normal(size=compiled.positions.shape))
        for _ in range(10):
            read = compiled.step(goals), plain.step(goals)
        np.testing.assert_allclose(read[0]["currents"], read[1]["currents"], atol=1e-9)
    for name in MOVING:
        np.testing.assert_allclose(getattr(compiled, name), getattr(plain, name), atol=1e-10)
