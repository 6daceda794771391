"""Springs of fingers with one tendon, by where a motor's torque bends; by hand, and on plants of
others.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from benchmarks.hands import calibrated, log_of, motion, ratio, rig_of
from benchmarks.strangers.servo_hands import aero_like

from distal import Rig, estimate
from distal.hands import calibrate
from distal.hands.springs_from_stops import _curve, springs_of
from distal.hands.sweeps import sweeps_of
from distal.logs import Log
from distal.model import Mechanism
from distal.rig import independent_parts
from distal.rig.hand_tables import Row, hand_of

ARMS, SPOOL, LOW, HIGH = np.array([12.5e-3, 7.5e-3, 9e-3]), 9e-3, 0.0, np.pi / 2
SPRINGS, REST, STIFFNESS = np.array([0.05, 0.06, 0.035]), np.deg2rad(-18.0), 1.5e4


def finger(springs: Any = SPRINGS) -> Rig:
    """Return a finger of three joints with springs on one tendon."""
    rows = [
        Row(
            joint=name,
            motor="one",
            low=LOW,
            high=HIGH,
            spool_radius=SPOOL,
            joint_radius=float(arm),
            back="spring",
        )
        for name, arm in zip(("mcp", "pip", "dip"), ARMS)
    ]
    none = {"value": 0.0, "std": 0.0}
    changes: dict[str, object] = {
        "tendons.0.slack": none,
        "tendons.0.stiffness": {"value": STIFFNESS, "std": 0.0},
    }
    for k, stiffness in enumerate(springs):
        changes[f"joints.{k}.spring"] = {
            "stiffness": {"value": float(stiffness), "std": 0.6 * float(stiffness)},
            "rest_angle": {"value": REST, "std": 0.0},
        }
    return hand_of(rows, "hand", "table").rig.bare().with_values(changes)


def closed(tension: Any, springs: Any = SPRINGS) -> tuple[Any, Any]:
    """Return a motor's place [rad] and torque without friction [N m] by hand: T arm = k (θ − rest),
    within ranges.
    """
    angles = np.clip(REST + tension[:, None] * ARMS / springs, LOW, HIGH)
    return (angles @ ARMS + tension / STIFFNESS) / SPOOL, tension * SPOOL


def test_the_curve_of_rest_is_springs_stops_and_stretch() -> None:
    mechanism = Mechanism(finger())
    largest = 30.0
    positions, torques = (
        np.array(part).ravel()
        for part in _curve(mechanism, 0, [0, 1, 2])(largest, mechanism.parameters.values)
    )
    expected = closed(np.linspace(0.0, largest, len(positions)))
    np.testing.assert_allclose(positions, expected[0], atol=1e-9)
    np.testing.assert_allclose(torques, expected[1], atol=1e-12)
    assert np.ptp(positions) > 5.0


def swept(springs: Any, rub: float, rng: np.random.Generator) -> Log:
    """Return a log of five sweeps of a motor with friction `rub` [N m]."""
    tension = np.linspace(0.0, 20.0, 4000)
    reached, pulls = closed(tension, springs)
    there = np.linspace(-0.2, float(np.interp(18.0, tension, reached)), 600)
    pull = np.interp(there, reached, pulls, left=0.0)
    ways = [(there, pull + rub), (there[::-1], pull[::-1] - rub)] * 3
    positions, torques = (np.concatenate([way[k] for way in ways[:5]]) for k in (0, 1))
    noisy = torques + 1e-3 * rng.normal(size=len(torques))
    return Log(
        np.arange(len(positions)) * 0.01,
        {"one_position": positions + 0.7, "one_current": noisy},
        {},
        "swept",
    )


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1), (1, 2, 0)])
def test_bends_say_which_spring_is_softer(order: tuple[int, ...]) -> None:
    """Friction of 30 mN m hides no bend: it is the same both ways. The finger's rig begins with
    equal shares.
    """
    true = SPRINGS[list(order)]
    log, rig = swept(true, 0.03, np.random.default_rng(5)), finger(4.5 * ARMS)
    found = springs_of(log, rig, "one", sweeps_of(log, rig, "one"))
    assert found is not None
    stiffness = [found.values[f"joints.{k}.spring.stiffness"] for k in range(3)]
    np.testing.assert_allclose(stiffness, true, rtol=0.08)
    assert found.values[
        next(path for path in found.values if path.endswith("bias"))
    ] == pytest.approx(0.7, abs=0.05)
    assert all(0.1 <= std / value < 0.5 for std, value in zip(found.stds.values(), stiffness))


def test_bends_are_tried_at_other_joints(monkeypatch: pytest.MonkeyPatch) -> None:
    """From one start alone the search ends with two springs in each other's place."""
    monkeypatch.setattr("distal.hands.springs_from_stops.FACTORS", (1.0,))
    true = SPRINGS[[1, 0, 2]]
    log, rig = swept(true, 0.03, np.random.default_rng(5)), finger(4.5 * ARMS)
    found = springs_of(log, rig, "one", sweeps_of(log, rig, "one"))
    assert found is not None
    np.testing.assert_allclose(
        [found.values[f"joints.{k}.spring.stiffness"] for k in range(3)], true, rtol=0.08
    )


def test_others_have_none() -> None:
    """A pair of tendons, one joint, and joints without springs of their own."""
    log = swept(SPRINGS, 0.03, np.random.default_rng(5))
    pair = hand_of(
        [Row(joint="a", motor="one", low=LOW, high=HIGH, spool_radius=SPOOL, joint_radius=8e-3)],
        "h",
        "t",
    ).rig
    alone = hand_of(
        [Row(joint="a", motor="one", low=LOW, high=HIGH, spool_radius=SPOOL, back="spring")],
        "h",
        "t",
    ).rig
    for rig in (pair.bare(), alone.bare()):
        assert springs_of(log, rig, "one", sweeps_of(log, finger(), "one")) is None


def test_a_motor_that_pulls_the_other_way_has_none() -> None:
    log, rig = swept(SPRINGS, 0.0, np.random.default_rng(5)), finger()
    turned = Log(
        log.time, log.channels | {"one_current": -log.channels["one_current"]}, {}, "turned"
    )
    assert springs_of(turned, rig, "one", sweeps_of(log, rig, "one")) is None


@pytest.mark.slow
def test_a_finger_is_better_known_than_by_its_motors_travel(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    known, hands = aero_like([3])
    rig = rig_of(known)
    monkeypatch.setattr("benchmarks.hands.calibrate", lambda log, rig: log)
    ((_, log),) = calibrated(known, hands, rig)
    positions = np.column_stack([log.channels[f"{motor}_position"] for motor in known.motors])
    low, high = (
        positions.min(axis=0)[None] + 0.3,
        positions.max(axis=0)[None],
    )  # what is let out beyond is no travel
    run = motion(known, hands, (low, high), 3)
    plain = ratio(known, run["positions"][:, 0], (low[0], high[0]))
    part = next(
        part.rig
        for part in independent_parts(rig)
        if [drive.name for drive in part.rig.drives] == ["middle"]
    )
    joints = [known.joints.index(joint.name) for joint in part.joints]
    result = estimate(log_of(known, run, 0), calibrate(log, part).rig)
    truth = run["angles"][:, 0, joints]
    off = result.angles - truth
    assert np.sqrt(np.mean(off**2)) < 0.6 * np.sqrt(np.mean((plain[:, joints] - truth) ** 2))
    assert np.mean(np.abs(off) < 1.96 * result.angle_stds) > 0.9
