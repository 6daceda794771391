"""Hysteresis of a transmission: the play operator, its moments, the plant, and the filter."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from distal import Log, Rig, load_rig, make_estimator, simulate
from distal.errors import RigError
from distal.model import clip_moments
from distal.simulation import build_scenario


@given(st.floats(-3, 3), st.floats(0.1, 2), st.floats(-2, 2), st.floats(0.05, 2))
def test_moments_of_a_clipped_normal(low: float, width: float, mean: float, std: float) -> None:
    """Against quadrature; slopes are the chances to be held and to be free."""
    x = np.linspace(-9, 9, 20001)
    weight = np.exp(-x * x / 2)
    weight /= weight.sum()
    clipped = np.clip(mean + std * x, low, low + width)
    moments = clip_moments(ca.DM(low), ca.DM(low + width), ca.DM(mean), ca.DM(std))
    expected = float(weight @ clipped)
    assert float(moments.mean) == pytest.approx(expected, abs=1e-5)
    inside = float(weight @ ((mean + std * x > low) & (mean + std * x < low + width)))
    assert float(moments.by_mean) == pytest.approx(inside, abs=2e-3)
    assert float(moments.by_low + moments.by_mean + moments.by_high) == pytest.approx(1.0)
    whole = float(weight @ (clipped - expected) ** 2)
    assert float(moments.rest) + (float(moments.by_mean) * std) ** 2 == pytest.approx(
        max(whole, (inside * std) ** 2), abs=2e-3
    )


LIMIT = 0.03
NO_FRICTION = (
    "drives.0.friction.constant",
    "drives.0.friction.load",
    "joints.0.friction.coefficient",
)


def sprung_capstan() -> Rig:
    """Return a joint held by a spring, whose only friction is inside its capstan drive."""
    values = {
        "drives.0.hysteresis": {"constant": LIMIT, "error": 2e-3},
        **{path: {"value": 0.0, "std": 0.0} for path in NO_FRICTION},
        "joints.0.damping": 2e-2,
        "joints.0.spring": {"stiffness": 0.3},
        "joints.0.external_torque.std": 0.1,
        "tendons.*.stiffness.shared.std": 0.0,
        "tendons.*.pretension.std": 0.0,
    }
    return load_rig("capstan-joint").with_values(values)


@pytest.fixture(scope="module")
def rig() -> Rig:
    return sprung_capstan()


def slow(rig: Rig) -> Log:
    """Return a log of the capstan turned to and fro, slowly: the spring loads the transmission both
    ways.
    """
    servo = {"angle": {"amplitude": 0.7, "frequency": 0.1}, "stiffness": 40.0, "damping": 0.5}
    raw = {
        "rig": "capstan-joint",
        "duration": 20.0,
        "drives": {"motor": {"servo": servo}},
    }
    return simulate(rig, build_scenario(raw, "slow"), 1)


def test_the_plant_is_a_play_operator(rig: Rig) -> None:
    """Quasi-static, what the tendons carry is clip(z, U − h, U + h) of the drive's torque, to 5 %
    of h.
    """
    log = slow(rig)
    torque = log.truth["force_motor"] - 2e-3 * np.gradient(log.truth["position_motor"], log.time)
    carried = 5e-3 * (log.truth["tension_flexor"] - log.truth["tension_extensor"])
    play, z = [], float(carried[0])
    for u in torque:
        z = min(max(z, u - LIMIT), u + LIMIT)
        play.append(z)
    settled = log.time > 2.0
    assert np.ptp(carried) > 3 * LIMIT  # it turns over both ways
    assert np.max(np.abs(np.array(play) - carried)[settled]) < 0.05 * LIMIT + 0.02 * np.ptp(carried)


def test_a_held_value_is_taken_as_it_is(rig: Rig) -> None:
    """`hold` keeps a std for fitting: the filter has no state for it, and a zero that is held costs
    nothing.
    """
    sure = load_rig("capstan-joint")
    held = sure.with_values({"tendons.0.stiffness.hold": True, "tendons.1.stiffness.hold": True})
    names, without = (make_estimator("adaptive", each, False).state_names for each in (sure, held))
    assert "common factor of tendons.stiffness" in names
    assert not any("stiffness" in name for name in without)
    with pytest.raises(RigError, match="hold: input should be a valid boolean"):
        sure.with_values({"tendons.0.stiffness": {"value": 1e4, "hold": "yes"}})
