"""The fit of a subsystem to its sweeps: what the ends say before it, where its search begins, and
what it finds on plants of others.
"""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares

from distal import Rig, estimate
from distal.cli.fit_command import _show
from distal.hands import calibrate
from distal.hands.power_on_routine import Sweep, is_pair, needed, winds_to
from distal.rig import Capstan, Number, independent_parts, number
from distal.rig.hand_tables import Row, hand_of
from tests.support.hands import log_of, motion, ratio, rig_of, routines_of
from tests.support.servo_hands import aero_like, orca_like

calibration = import_module("distal.hands.calibrate")  # the package has its function

ARMS, SPOOL, LOW, HIGH = (12e-3, 6e-3), 9e-3, 0.0, 1.5


def swept(way: int, contact: float, level: float = 0.04, noise: float = 0.003) -> Sweep:
    """Return a sweep that met something."""
    return Sweep(way, 100, level, noise, contact, True)


def pair_rig() -> Rig:
    known, _ = orca_like([3], ("index_mcp",))
    return rig_of(known)


def finger() -> Rig:
    """Return a finger of two joints with springs on one tendon."""
    same = {"motor": "m", "low": LOW, "high": HIGH, "spool_radius": SPOOL, "back": "spring"}
    rows = [Row(joint=name, joint_radius=arm, **same) for name, arm in zip(("mcp", "pip"), ARMS)]
    return hand_of(rows, "finger", "table").rig


def at_ends(rig: Rig, motor: str, sweeps: tuple[Sweep, ...] = ()) -> Rig:
    """Return the rig by what the ends of a motor's sweeps say of it."""
    return rig.with_values(calibration._at_ends(rig, {motor: sweeps or SWEEPS}))


def tense(rig: Rig, tension: float) -> Rig:
    """Return the rig with tendons of a pre-tension that is not slack."""
    slack, pretension = {"value": 0.0, "std": 0.0}, {"value": tension, "std": 1.0}
    return rig.with_values({"tendons.*.slack": slack, "tendons.*.pretension": pretension})


SWEEPS = (swept(1, 2.0), swept(-1, -0.6), swept(1, 2.0), swept(-1, -0.6), swept(1, 2.0))


@pytest.mark.parametrize("tension", [None, 3.0])
@pytest.mark.parametrize("far", [0.9, 1.0])
def test_radius_slack_and_zero_are_those_of_least_squares(
    far: float, tension: float | None
) -> None:
    rig = pair_rig()
    tendons = rig.tendons
    if tension is not None:
        rig = tense(rig, tension)
    sweeps = tuple(swept(s.way, s.contact * far) for s in SWEEPS)
    found = at_ends(rig, "m1", sweeps)
    drive = rig.drives[0]
    assert isinstance(drive, Capstan)
    ends = np.array(rig.joints[0].travel[::-1])
    arms = np.array([tendon.arms()["index_mcp"] for tendon in tendons])
    stiffness = tendons[0].stiffness.value
    slack, slack_std = 0.3e-3, 0.25e-3
    if tension is not None:
        slack, slack_std = -tension / stiffness, 1.0 / stiffness
    pull = 0.04 / drive.radius.value / stiffness
    std = np.hypot(arms[0] * np.deg2rad(1.0), pull / np.sqrt(12))

    def residuals(x: Any) -> Any:
        zero, radius, slacks = x[0], x[1], x[2:]
        winds = arms * ends + slacks + pull / 2
        met = far * np.array([2.0, -0.6])
        prior = [(radius - drive.radius.value) / drive.radius.std, *(slacks - slack) / slack_std]
        return [*prior, *(((met - zero) * (1, -1) * radius - winds) / std)]

    start = [0.7 * far, drive.radius.value, slack, slack]
    best = least_squares(residuals, start, x_scale=[1.0, 1e-2, 1e-4, 1e-4], xtol=1e-14)
    stds = np.sqrt(np.diag(np.linalg.inv(best.jac.T @ best.jac)))
    radius = found.drives[0].radius  # type: ignore[union-attr]
    parts = [found.sensors_of("position")[0].bias, radius, *(t.slack for t in found.tendons)]
    assert [part.value for part in parts] == pytest.approx(best.x, rel=0.02, abs=2e-6)
    assert [part.std for part in parts] == pytest.approx(stds, rel=0.03)


def test_the_zero_of_one_tendon_has_all_joints_at_their_stops_where_it_ends() -> None:
    rig = finger()
    assert not is_pair(rig, "m")
    found = at_ends(rig, "m")
    zero = found.sensors_of("position")[0].bias.value
    tendon = rig.tendons[0]
    stretch = 0.04 / SPOOL / tendon.stiffness.value
    length = sum(ARMS) * HIGH + tendon.slack.value + stretch / 2
    assert (2.0 - zero) * SPOOL == pytest.approx(length)


def test_a_tension_becomes_slack_of_pairs_alone_and_loads_as_before() -> None:
    for rig, motor in ((pair_rig(), "m1"), (finger(), "m")):
        rig = tense(rig, 3.0)
        found = at_ends(rig, motor)
        for tendon in found.tendons:
            assert tendon.pretension.value == (0.0 if is_pair(rig, motor) else 3.0)
            assert (tendon.slack.value < 0.0) == is_pair(rig, motor)
            stiffness = tendon.stiffness.value
            tension = tendon.pretension.value - stiffness * tendon.slack.value
            assert tendon.home_tension == pytest.approx(tension)
        load = sum(tendon.home_tension for tendon in found.tendons)
        friction = found.joints[0].friction
        assert friction is not None
        assert found.reference_load(0) == pytest.approx(friction.preload.value + load)


def test_the_search_of_a_pair_begins_with_friction_and_ends_with_noise(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    names = ("drives.0.radius", "drives.0.friction.constant", "sensors.1.noise")
    parts = [(SimpleNamespace(paths=(name,), noise="noise" in name), None) for name in names]
    asked: list[list[bool]] = []

    def search(problem: Any, start: Any, fixed: Any) -> Any:
        asked.append(fixed.tolist())
        return SimpleNamespace(z=start + 1.0)

    monkeypatch.setattr(calibration, "search", search)
    problem: Any = SimpleNamespace(size=3, parts=parts)
    assert calibration._likeliest(problem, pair_rig()).tolist() == [2.0, 2.0, 2.0]
    assert asked == [[True, False, True], [False, False, True]]


def test_an_end_that_was_not_met_is_anywhere_beyond() -> None:
    rig = pair_rig()
    need = needed(rig, "m1")
    for tendon, way, end in zip(rig.tendons, (1, -1), (2.0, -0.6)):
        sweeps = [replace(sweep, resisted=sweep.way != way) for sweep in SWEEPS]
        at, length, std = winds_to(rig, tendon, SWEEPS)
        assert at == end
        further = (at + way * need / rig.drives[0].lever, length, np.hypot(std, need))
        assert winds_to(rig, tendon, sweeps) == pytest.approx(further)


def test_a_pair_under_tension_is_said_in_newtons(capsys: pytest.CaptureFixture[str]) -> None:
    rig = pair_rig()
    stiffness = rig.tendons[0].stiffness.value
    _show(rig.with_values({"tendons.*.slack": {"value": -2.5 / stiffness}}), set())
    assert " 2.5 N " in capsys.readouterr().out


def test_the_first_sweep_leaves_the_joint_at_that_end() -> None:
    rig = pair_rig()
    low, high = rig.joints[0].travel
    for way, end in ((1, high), (-1, low)):
        sweeps = (swept(way, way * 1.0), *SWEEPS[1:], swept(-1, -0.6, noise=0.004))
        prior = at_ends(rig, "m1", sweeps)
        assert prior.joints[0].initial.value == pytest.approx(end)
        assert prior.joints[0].initial.std == pytest.approx(np.deg2rad(1.0))
        # the torque's noise is fitted, from that of the sweeps
        assert prior.sensors_of("force")[0].noise == 0.004


def test_bends_of_the_torque_are_tried_at_other_joints(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of two minima the one where the bends are at the other joints is deeper."""
    rig = finger()
    springs = [number(rig, f"joints.{i}.spring.stiffness") for i in (0, 1)]
    rest = rig.joints[0].spring
    assert rest is not None
    tensions = (HIGH - rest.rest_angle.value) / np.array(ARMS)
    first, deeper = (
        np.log(np.array(bends) / tensions / [spring.value for spring in springs])
        for bends in ((900.0, 500.0), (500.0, 900.0))
    )

    def cost(z: Any) -> Any:
        return min(np.sum((z - first) ** 2), np.sum((z - deeper) ** 2) - 0.01)

    def part(spring: Number) -> tuple[Any, None]:
        return SimpleNamespace(
            paths=(spring.path,),
            noise=False,
            value=lambda z: spring.value * np.exp(z),
            coordinate=lambda value: np.log(value / spring.value),
        ), None

    problem: Any = SimpleNamespace(
        size=2,
        prior_stds=np.array([0.5, 0.5]),
        parts=[part(spring) for spring in springs],
        costs=lambda points: np.array([cost(z) for z in points]),
    )
    ((one, other, share),) = calibration._exchanges(problem, rig)
    assert (one, other) == (0, 1)
    assert share == pytest.approx(tensions[1] / tensions[0])

    def most_likely(problem: Any, start: Any) -> Any:
        ends = sorted((first, deeper), key=lambda end: float(np.sum((start - end) ** 2)))
        return problem, SimpleNamespace(z=ends[0])

    monkeypatch.setattr(calibration, "most_likely", most_likely)
    np.testing.assert_allclose(calibration._likeliest(problem, rig), deeper)


@pytest.mark.more  # a calibration as a whole: test_power_on.py
def test_a_finger_is_better_known_than_by_its_motors_travel() -> None:
    known, hands = aero_like([3])
    rig = rig_of(known)
    (routine,) = routines_of(known, hands, rig)
    log = routine.log()
    positions = np.column_stack([log.channels[f"{motor}_position"] for motor in known.motors])
    # what is let out beyond is no travel
    low, high = positions.min(axis=0) + 0.3, positions.max(axis=0)
    run = motion(known, hands, (low[None], high[None]), 3)
    plain = ratio(known, run["positions"][:, 0], (low, high))
    part = next(part.rig for part in independent_parts(rig) if part.rig.drive_names == ["middle"])
    joints = [known.joints.index(name) for name in part.joint_names]
    result = estimate(log_of(known, run, 0), calibrate(log, part).rig)
    truth = run["angles"][:, 0, joints]
    off = result.angles - truth
    assert np.sqrt(np.mean(off**2)) < 0.6 * np.sqrt(np.mean((plain[:, joints] - truth) ** 2))
    assert np.mean(np.abs(off) < 1.96 * result.angle_stds) > 0.9
