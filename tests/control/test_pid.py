"""The shipped controller: its law, its anti-windup, its moment arms, and what it does without an
angle.
"""

from __future__ import annotations

from dataclasses import replace
from math import nan

import casadi as ca
import numpy as np
import pytest

from distal import load_rig
from distal.control import PID, ClosedLoop, allocated, plot_control, trackings_of
from distal.logs import Log
from distal.model import Mechanism
from distal.run import Reading
from distal.simulation import JointControl

ARM = 9.53e-3
DEGREE = np.pi / 180


def joint(**gains: object) -> JointControl:
    return JointControl.model_validate(
        {"reference": "10 deg", "proportional": "1 N m/rad", **gains}
    )


def paper_pid(**gains: object) -> PID:
    """Return the controller of the paper's link, called every 10 ms."""
    return PID(load_rig("paper-2008"), {"link": joint(**gains)}, 0.01, 5.0)


def remembered(pid: PID, name: str) -> np.ndarray:
    """Return a part of what a controller remembers."""
    return pid._layout.view(pid._memory, name)


def seen(*angles: float, health: str = "ok", std: float = 0.01) -> Reading:
    return Reading(0.0, angles, (std,) * len(angles), health)  # type: ignore[arg-type]


def torque_of(commands: dict[str, float]) -> float:
    """At angle 0 both tendons of the paper's link pull at their radius."""
    return (commands["left"] - commands["right"]) * ARM


def shared(name: str, tension: float, angles: list[float], torques: list[float]) -> list[float]:
    """Return the drives' commands for torques."""
    mechanism = Mechanism(load_rig(name))
    found = allocated(mechanism, ca.SX(ca.DM(angles)), ca.SX(ca.DM(torques)), tension)
    p = mechanism.parameters
    return list(ca.Function("commands", [p.symbols], [found])(p.values).full().ravel())


def test_the_law_of_a_pid() -> None:
    """Two calls by hand: e = 10° then 6°, the speed smoothed by 0.3, the integral of the first
    error.
    """
    pid = paper_pid(integral="2 N m/(rad s)", derivative="0.1 N m s/rad")
    assert torque_of(pid(0.0, {}, seen(0.0))) == pytest.approx(10 * DEGREE, rel=1e-9)
    small = 1e-9 * DEGREE  # the arm is that of the angle
    second = torque_of(pid(0.01, {}, seen(small)))
    assert second == pytest.approx(
        10 * DEGREE + 2 * 10 * DEGREE * 0.01 - 0.1 * 0.3 * small / 0.01, rel=1e-6
    )


def test_tensions_share_a_torque_and_never_push() -> None:
    """T = c ± τ/2r while c allows it; beyond, both rise so that the slack one is at zero."""
    for torque in (0.0, 0.05, -0.05, 0.3, -0.3):
        left, right = shared("paper-2008", 5.0, [0.0], [torque])
        assert (left - right) * ARM == pytest.approx(torque, abs=1e-12)
        assert min(left, right) >= -1e-12
        assert left + right == pytest.approx(max(10.0, abs(torque) / ARM))


@pytest.mark.parametrize(
    ("name", "tension", "torques"),
    [
        ("finger-2n", 10.0, [0.05, -0.02]),
        ("finger-n-plus-1", 2.0, [0.1, 0.0, 0.0]),
        ("finger-n-plus-1", 2.0, [-0.1, 0.0, 0.0]),
        ("finger-n-plus-1", 2.0, [0.0, 0.05, -0.02]),
    ],
)
def test_a_finger_gets_its_torques_by_the_transposed_arms(
    name: str, tension: float, torques: list[float]
) -> None:
    """A T = τ for the arms of the rig, and no tendon pushes. Of tendons that are not opposed in
    pairs only the right sign of what is missing lifts them all.
    """
    rig = load_rig(name)
    arms = [[tendon.arms().get(joint, 0.0) for joint in rig.joint_names] for tendon in rig.tendons]
    tensions = np.array(shared(name, tension, [0.0] * len(torques), torques))
    assert tensions.min() >= -1e-9
    np.testing.assert_allclose(tensions @ arms, torques, atol=1e-8)


def test_a_capstan_turns_its_joint_both_ways() -> None:
    """Both tendons wind on one motor: U = τ R/r, whatever the tension."""
    rig = load_rig("capstan-joint")
    drive, tendon = rig.drives[0], rig.tendons[0]
    lever = drive.radius.value / tendon.total_arm  # type: ignore[union-attr]
    for torque, tension in ((0.02, 10.0), (-0.02, 3.0)):
        (command,) = shared("capstan-joint", tension, [0.0], [torque])
        assert command * np.sign(torque) == pytest.approx(0.02 * lever, rel=1e-3)


def test_the_integral_stands_while_the_torque_is_cut() -> None:
    """A minute at the limit leaves no integral behind: the first call within it has that of one
    period.
    """
    pid = paper_pid(integral="1 N m/(rad s)", torque_limit="0.05 N m")
    for k in range(6000):
        assert torque_of(pid(0.01 * k, {}, seen(0.0))) == pytest.approx(0.05)
    remembered(pid, "speed")[:] = 0.0
    assert torque_of(pid(60.0, {}, seen(10 * DEGREE))) == pytest.approx(0.0, abs=1e-3)


def test_a_small_error_counts_as_none() -> None:
    """But for 1e-5 N m: the arms differ a little at that angle."""
    for angle, torque in ((8.5, 0.0), (0.0, 8.0)):
        commands = paper_pid(deadband="2 deg")(0.0, {}, seen(angle * DEGREE))
        assert torque_of(commands) == pytest.approx(torque * DEGREE, abs=1e-5)


def test_a_joint_that_rests_goes_on_resting_until_its_error_has_doubled() -> None:
    """The estimate of a joint at rest wanders: its controller does not follow."""
    pid = paper_pid(deadband="2 deg", integral="5 N m/(rad s)")
    ways = ((7.0, False), (8.5, True), (6.5, True), (5.9, False), (6.5, False))
    for k, (angle, rests) in enumerate(ways):
        before = remembered(pid, "effort")[0]
        pid(0.01 * k, {}, seen(angle * DEGREE))
        assert (remembered(pid, "effort")[0] == before) == rests


def test_without_an_angle_the_last_commands_are_held() -> None:
    """NaN, a lost filter, a dead sensor."""
    pid = paper_pid()
    before = pid(0.0, {}, seen(0.0))
    lost = seen(nan, health="bad")
    for k, bad in enumerate((lost, lost, seen(0.1, std=1.0), seen(0.1, health="dead"))):
        assert pid(0.01 * (k + 1), {}, bad) == before
    assert pid(0.05, {}, seen(5 * DEGREE)) != before


def made(reference: np.ndarray, angle: np.ndarray, time: np.ndarray) -> ClosedLoop:
    log = Log(time, {}, {"theta": angle}, "made up")
    return ClosedLoop(
        load_rig("paper-2008"),
        log,
        "encoder",
        time,
        angle[:, None],
        angle[:, None] + 0.01,
        0.0 * angle[:, None],
        {"left": 0 * time + 3.0, "right": 0 * time + 4.0},
        {"link": reference},
    )


def test_figures_of_a_step_response() -> None:
    """A step of 20° with an overshoot of 3° for 0.7 s."""
    time = np.arange(0, 6, 0.01)
    reference = np.where(time < 2, 0.0, 20 * DEGREE)
    angle = np.where(time < 2, 0.0, np.where(time < 2.7, 23 * DEGREE, 20 * DEGREE))
    (one,) = trackings_of(made(reference, angle, time))
    assert one.effort == pytest.approx(np.sqrt(12.5))
    assert one.estimate_rms == pytest.approx(0.01)
    assert one.rms == pytest.approx(3 * DEGREE * np.sqrt(70 / 600))


def test_the_figure_shows_angles_and_deviations() -> None:
    time = np.arange(0, 3, 0.01)
    reference, off = 20 * np.sin(time), np.where(time < 1, 2, -1)
    best = made(reference * DEGREE, (reference + off) * DEGREE, time)
    best = replace(best, feedback="adaptive")
    worse = made(reference * DEGREE, (reference + off + 4) * DEGREE, time)
    top, middle, low = plot_control([best, worse]).axes
    labels = [str(line.get_label()) for line in top.get_lines()]
    assert labels[1:] == ["fed back by adaptive", "fed back by encoder"]
    for axis, line, drawn in (
        (top, 0, reference),
        (top, 2, reference + off + 4),
        (middle, 0, off),
        (low, 0, 3.0),
    ):
        np.testing.assert_allclose(axis.get_lines()[line].get_ydata(), drawn, atol=1e-9)
    # the deviations' axis is three times as high as those of the best
    assert middle.get_ylim() == pytest.approx((-6.0, 6.0))
    room = 0.4 * np.ptp(reference)
    assert top.get_ylim() == pytest.approx((min(reference) - room, max(reference) + room))
    still = replace(best, references={"link": 0 * time})
    assert plot_control([still]).axes[0].get_ylim() == pytest.approx((-0.4, 0.4))
