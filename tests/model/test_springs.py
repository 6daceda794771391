"""Extension springs, against their energy, and tendons that are slack at home."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from distal import Rig, load_rig
from distal.errors import RigError
from tests.model.helpers import look

EXTENSION = {
    "stiffness": 300.0,
    "free_length": 0.014,
    "radius": 0.009,
    "distance": 0.026,
    "line_angle": -0.9,
    "preload": 0.4,
}


def torque(rig: Rig, angle: float) -> float:
    return float(look(rig, lambda m, q, v: [m.passive_forces(q)])([angle])[0][0])


def energy(spring: dict[str, float], angle: float) -> float:
    """½ k (L − L₀)² + preload (L − L₀), where the spring pulls."""
    ends = spring["radius"] * np.exp(1j * (angle - spring["line_angle"])), spring["distance"]
    opened = abs(ends[0] - ends[1]) - spring["free_length"]
    least = -spring["preload"] / spring["stiffness"]  # where it goes slack
    opened = max(opened, least)
    return 0.5 * spring["stiffness"] * opened**2 + spring["preload"] * opened


@given(st.floats(-2.5, 2.5), st.sampled_from([0.01, 0.02, 0.03]))
def test_an_extension_spring_pulls_down_its_energy(angle: float, free: float) -> None:
    spring = {**EXTENSION, "free_length": free}
    rig = load_rig("pulley-antagonist").with_values({"joints.0.extension_spring": spring})
    step = 1e-5
    slope = (energy(spring, angle + step) - energy(spring, angle - step)) / (2 * step)
    assert torque(rig, angle) == pytest.approx(-slope, abs=2e-6)


def test_where_its_ends_are_in_line_it_does_not_turn() -> None:
    rig = load_rig("pulley-antagonist").with_values({"joints.0.extension_spring": EXTENSION})
    assert torque(rig, -0.9) == 0.0
    assert torque(rig, -0.8) < 0.0 < torque(rig, -1.0)
    same = {**EXTENSION, "radius": 0.026, "free_length": 1e-3}
    assert (
        torque(rig.with_values({"joints.0.extension_spring": same}), -0.9) == 0.0
    )  # the ends meet


def test_a_slack_tendon_pulls_from_its_slack_on() -> None:
    rig = load_rig("pulley-antagonist").with_values({"tendons.0.slack": "0.4 mm"})
    left, right = (tendon.stiffness.value for tendon in rig.tendons)
    at = look(rig, lambda m, q, v: [m.tensions(q, v)])
    np.testing.assert_allclose(at([0.0, 0.39e-3, 1e-3]), [[0.0, right * 1e-3]])
    np.testing.assert_allclose(at([0.0, 1.4e-3, 0.0]), [[left * 1e-3, 0.0]], atol=1e-12)
    with pytest.raises(
        RigError, match=r"tendons\.left\.slack: a tendon is slack at home, or pulled"
    ):
        rig.with_values({"tendons.0.pretension": 2.0})
