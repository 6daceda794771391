"""The fit of a subsystem to its sweeps: what the ends say before it, where its search begins, and
what it finds on plants of others.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from benchmarks.hands import calibrated, log_of, motion, ratio, rig_of
from benchmarks.strangers.servo_hands import aero_like, orca_like

from distal import Rig, estimate
from distal.fitting import Options
from distal.fitting.parameter_estimates import problem_of
from distal.hands import calibrate, part_fit
from distal.hands.sweeps import Sweep, is_pair, sweeps_of
from distal.logs import Log
from distal.rig import Capstan, independent_parts
from distal.rig.hand_tables import Row, hand_of

ARMS, SPOOL, LOW, HIGH = (12e-3, 6e-3), 9e-3, 0.0, 1.5


def swept(way: int, contact: float, level: float = 0.04) -> Sweep:
    """Return a sweep that met something."""
    return Sweep(way, 100, level, contact, True)


def pair_rig() -> Rig:
    known, _ = orca_like([3], ("index_mcp",))
    return rig_of(known)


def finger(arms: Any = ARMS) -> Rig:
    """Return a finger of two or three joints with springs on one tendon."""
    rows = [
        Row(
            joint=name,
            motor="m",
            low=LOW,
            high=HIGH,
            spool_radius=SPOOL,
            joint_radius=float(arm),
            back="spring",
        )
        for name, arm in zip(("mcp", "pip", "dip"), arms)
    ]
    return hand_of(rows, "finger", "table").rig


SWEEPS = (swept(1, 2.0), swept(-1, -0.6), swept(1, 2.0), swept(-1, -0.6), swept(1, 2.0))


def test_the_zero_of_a_pair_puts_the_middle_of_its_travel_in_the_middle_of_the_range() -> None:
    rig = pair_rig()
    found = rig.with_values(part_fit._zeros(rig, {"m1": SWEEPS}))
    motor, arm = found.drives[0], found.tendons[0].arms()["index_mcp"]
    assert isinstance(motor, Capstan)
    zero = found.sensors_of("position")[0].bias
    low, high = rig.joints[0].travel
    assert (0.7 - zero.value) * motor.radius.value / arm == pytest.approx((low + high) / 2)
    # ends and slack are not known exactly, and the travel is not what the range needs
    known = np.hypot(arm * rig.joints[0].stops_std, rig.tendons[0].slack.std) / motor.radius.value
    needs = (arm * (high - low) + sum(t.slack.value for t in rig.tendons)) / motor.radius.value
    assert zero.std == pytest.approx(np.hypot(known, abs(2.6 - needs) / 2))


def test_the_zero_of_one_tendon_has_all_joints_at_their_stops_where_it_ends() -> None:
    rig = finger()
    assert not is_pair(rig, "m")
    found = rig.with_values(part_fit._zeros(rig, {"m": SWEEPS}))
    zero = found.sensors_of("position")[0].bias.value
    length = sum(ARMS) * HIGH + rig.tendons[0].slack.value
    assert (2.0 - zero) * SPOOL == pytest.approx(length)


def test_the_first_sweep_leaves_the_joint_at_that_end() -> None:
    rig = pair_rig()
    low, high = rig.joints[0].travel
    for way, end in ((1, high), (-1, low)):
        sweeps = {"m1": (swept(way, way * 1.0), *SWEEPS[1:], swept(-1, -0.6))}
        prior = rig.with_values(part_fit._at_ends(rig, sweeps))
        assert prior.joints[0].initial.value == pytest.approx(end)
        assert prior.joints[0].initial.std == pytest.approx(np.deg2rad(1.0))
        # the torque is known no better than the motor's friction
        assert prior.sensors_of("force")[0].noise == rig.drives[0].friction.constant.std > 0.01


THREE = np.array([12.5e-3, 7.5e-3, 9e-3])
SPRINGS, REST, STIFFNESS, ZERO = np.array([0.05, 0.06, 0.035]), np.deg2rad(-18.0), 1.5e4, 0.7


def swept_log(springs: Any, rub: float) -> Log:
    """Return a log of five sweeps of a motor with friction `rub` [N m], at rest by hand: T arm =
    k (θ − rest), within ranges.
    """
    tension = np.linspace(0.0, 20.0, 4000)
    angles = np.clip(REST + tension[:, None] * THREE / springs, LOW, HIGH)
    reached = (angles @ THREE + tension / STIFFNESS) / SPOOL
    there = np.linspace(-0.2, float(np.interp(18.0, tension, reached)), 600)
    pull = SPOOL * np.interp(there, reached, tension, left=0.0)
    ways = [(there, pull + rub), (there[::-1], pull[::-1] - rub)] * 3
    positions, torques = (np.concatenate([way[k] for way in ways[:5]]) for k in (0, 1))
    torques = torques + 1e-3 * np.random.default_rng(5).normal(size=len(torques))
    channels = {"m_position": positions + ZERO, "m_current": torques}
    return Log(0.01 * np.arange(len(positions)), channels, {}, "swept")


@pytest.mark.parametrize("order", [(1, 0, 2), (2, 0, 1)])
def test_bends_of_the_torque_say_which_spring_is_softer(order: tuple[int, ...]) -> None:
    """Friction of 30 mN m hides no bend: it is the same both ways. The rig begins with springs with
    which all joints close together.
    """
    true = SPRINGS[list(order)]
    changes: dict[str, object] = {
        "tendons.0.slack": {"value": 0.0, "std": 0.0},
        "tendons.0.stiffness": {"value": STIFFNESS, "std": 0.0},
        "drives.0.radius": {"value": SPOOL, "std": 0.0},
    }
    for k, stiffness in enumerate(4.5 * THREE):
        changes[f"joints.{k}.spring"] = {
            "stiffness": {"value": float(stiffness), "std": 0.6 * float(stiffness)},
            "rest_angle": {"value": float(REST), "std": 0.0},
        }
    rig = finger(THREE).bare().with_values(changes)
    log = swept_log(true, 0.03)
    sweeps = {"m": sweeps_of(log, rig, "m")}
    prior = rig.with_values(part_fit._at_ends(rig, sweeps))
    problem = problem_of([log], prior, Options(noise=False, workers=1))
    z = part_fit._start(problem, log, sweeps)
    found = dict(zip(problem.filter.estimator.parameter_names, problem.parameters(z)))
    stiffness = [found[f"joints.{k}.spring.stiffness"] for k in range(3)]
    np.testing.assert_allclose(stiffness, true, rtol=0.1)
    zero = next(value for path, value in found.items() if path.endswith(".bias"))
    assert zero == pytest.approx(ZERO, abs=0.05)
    # a motor that pulls the other way says nothing of springs
    turned = replace(log, channels=log.channels | {"m_current": -log.channels["m_current"]})
    assert not np.any(part_fit._start(problem, turned, sweeps))


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
