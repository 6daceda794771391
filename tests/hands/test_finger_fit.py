"""The fit of a subsystem to its sweeps: what the ends say before it, where its search begins, and
what it finds on plants of others.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
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
from tests.support.hands import calibrated, log_of, motion, ratio, rig_of
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
    rows = [
        Row(
            joint=name,
            motor="m",
            low=LOW,
            high=HIGH,
            spool_radius=SPOOL,
            joint_radius=arm,
            back="spring",
        )
        for name, arm in zip(("mcp", "pip"), ARMS)
    ]
    return hand_of(rows, "finger", "table").rig


SWEEPS = (swept(1, 2.0), swept(-1, -0.6), swept(1, 2.0), swept(-1, -0.6), swept(1, 2.0))


def test_the_zero_of_a_pair_puts_the_middle_of_its_travel_in_the_middle_of_the_range() -> None:
    rig = pair_rig()
    found = rig.with_values(calibration._at_ends(rig, {"m1": SWEEPS}))
    motor, arm = found.drives[0], found.tendons[0].arms()["index_mcp"]
    assert isinstance(motor, Capstan)
    zero = found.sensors_of("position")[0].bias
    assert (0.7 - zero.value) * motor.radius.value / arm == pytest.approx(
        np.mean(rig.joints[0].travel), rel=1e-6
    )


@pytest.mark.parametrize("tension", [None, 3.0])
@pytest.mark.parametrize("far", [0.9, 1.0])
def test_radius_slack_and_zero_are_those_of_least_squares(
    far: float, tension: float | None
) -> None:
    rig = pair_rig()
    tendons = rig.tendons
    if tension is not None:
        values = {"slack": {"value": 0.0, "std": 0.0}, "pretension": {"value": tension, "std": 1.0}}
        rig = rig.with_values(
            {f"tendons.{t.name}.{key}": value for t in tendons for key, value in values.items()}
        )
    sweeps = tuple(swept(s.way, s.contact * far) for s in SWEEPS)
    found = rig.with_values(calibration._at_ends(rig, {"m1": sweeps}))
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
    found = rig.with_values(calibration._at_ends(rig, {"m": SWEEPS}))
    zero = found.sensors_of("position")[0].bias.value
    tendon = rig.tendons[0]
    stretch = 0.04 / SPOOL / tendon.stiffness.value
    length = sum(ARMS) * HIGH + tendon.slack.value + stretch / 2
    assert (2.0 - zero) * SPOOL == pytest.approx(length)


def test_a_tension_becomes_slack_of_pairs_alone_and_loads_as_before() -> None:
    for rig, motor in ((pair_rig(), "m1"), (finger(), "m")):
        tense = {"slack": {"value": 0.0, "std": 0.0}, "pretension": {"value": 3.0, "std": 1.0}}
        rig = rig.with_values(
            {f"tendons.{t.name}.{key}": value for t in rig.tendons for key, value in tense.items()}
        )
        found = rig.with_values(calibration._at_ends(rig, {motor: SWEEPS}))
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
    fixed: list[list[bool]] = []

    def search(problem: Any, start: Any, fixed_now: Any) -> Any:
        fixed.append(fixed_now.tolist())
        return SimpleNamespace(z=start + 1.0)

    monkeypatch.setattr(calibration, "search", lambda p, z, fixed: search(p, z, fixed))
    problem: Any = SimpleNamespace(size=3, parts=parts)
    assert calibration._likeliest(problem, pair_rig()).tolist() == [2.0, 2.0, 2.0]
    assert fixed == [[True, False, True], [False, False, True]]


def test_an_end_that_was_not_met_is_anywhere_beyond() -> None:
    rig = pair_rig()
    for tendon, way in zip(rig.tendons, (1, -1)):
        sweeps = [replace(sweep, resisted=sweep.way != way) for sweep in SWEEPS]
        at, length, std = winds_to(rig, tendon, SWEEPS)
        beyond = winds_to(rig, tendon, sweeps)
        need = needed(rig, "m1")
        assert at == (2.0 if way > 0 else -0.6)
        assert beyond == pytest.approx(
            (at + way * need / rig.drives[0].lever, length, np.hypot(std, need))
        )


def test_a_pair_under_tension_is_said_in_newtons(capsys: pytest.CaptureFixture[str]) -> None:
    rig = pair_rig()
    stiffness = rig.tendons[0].stiffness.value
    values = {f"tendons.{t.name}.slack": {"value": -2.5 / stiffness} for t in rig.tendons}
    _show(rig.with_values(values), set())
    assert " 2.5 N " in capsys.readouterr().out


def test_the_first_sweep_leaves_the_joint_at_that_end() -> None:
    rig = pair_rig()
    low, high = rig.joints[0].travel
    for way, end in ((1, high), (-1, low)):
        sweeps = {"m1": (swept(way, way * 1.0), *SWEEPS[1:], swept(-1, -0.6, noise=0.004))}
        prior = rig.with_values(calibration._at_ends(rig, sweeps))
        assert prior.joints[0].initial.value == pytest.approx(end)
        assert prior.joints[0].initial.std == pytest.approx(np.deg2rad(1.0))
        # the torque's noise is fitted, from that of the sweeps
        assert prior.sensors_of("force")[0].noise == 0.004


@dataclass
class Valley:
    """A problem with a minimum where the softer spring is at one joint, and a deeper one where the
    bends of the torque are at the other joint.
    """

    rig: Rig
    start: tuple[Number, Number]
    tensions: tuple[float, float]

    size: int = 2

    @property
    def parts(self) -> list[Any]:
        return [
            (
                SimpleNamespace(
                    paths=(number.path,),
                    noise=False,
                    value=lambda z, number=number: number.value * np.exp(z),
                    coordinate=lambda value, number=number: np.log(value / number.value),
                ),
                None,
            )
            for number in self.start
        ]

    @property
    def prior_stds(self) -> Any:
        return np.array([0.5, 0.5])

    @property
    def ends(self) -> list[Any]:
        """Both minima: the bends at 900 and 500 N, and the other way round."""
        return [
            np.log(np.array(bends) / self.tensions / [number.value for number in self.start])
            for bends in ((900.0, 500.0), (500.0, 900.0))
        ]

    def costs(self, points: Any) -> Any:
        away = [[np.sum((z - end) ** 2) for end in self.ends] for z in points]
        return np.array([min(first, second - 0.01) for first, second in away])


def test_bends_of_the_torque_are_tried_at_other_joints(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = finger()
    springs = [number(rig, f"joints.{i}.spring.stiffness") for i in (0, 1)]
    rest = rig.joints[0].spring
    assert rest is not None
    tensions = tuple((HIGH - rest.rest_angle.value) / arm for arm in ARMS)
    valley = Valley(rig, (springs[0], springs[1]), (tensions[0], tensions[1]))
    ((one, other, share),) = calibration._exchanges(valley, rig)  # type: ignore[arg-type]
    assert (one, other) == (0, 1)
    assert share == pytest.approx(tensions[1] / tensions[0])

    def most_likely(problem: Valley, start: Any) -> Any:
        nearest = min(problem.ends, key=lambda end: float(np.sum((start - end) ** 2)))
        return problem, SimpleNamespace(z=nearest)

    monkeypatch.setattr(calibration, "most_likely", most_likely)
    begin = calibration._likeliest(valley, rig)  # type: ignore[arg-type]
    np.testing.assert_allclose(begin, valley.ends[1])


@pytest.mark.more  # a calibration as a whole: test_power_on.py
def test_a_finger_is_better_known_than_by_its_motors_travel(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    known, hands = aero_like([3])
    rig = rig_of(known)
    monkeypatch.setattr("tests.support.hands.calibrate", lambda log, rig: log)
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
