"""Sizes from logs of plants whose tendons, friction and links are known here alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from distal.from_logs.motion_data import smoothed, window_of
from distal.rig import Capstan, step_of
from tests.from_logs.logs import RATE, Floats, drafted

ARM = 8e-3
STIFFNESS = 5e3


def pair(
    seed: int,
    friction: float,
    share: float,
    stiffening: float,
    pretension: float = 0.0,
    noise: float = 0.0,
) -> dict[str, Floats]:
    """Return a log of a joint between two sliders that move and rest in turn.

    A cell reads T + d (f + μ T). While its slider moves, d is the direction; while it rests, d is
    any number between −1 and 1.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 30.0, 1.0 / RATE)
    knots = np.arange(0.0, 32.0, 1.0)
    ways = np.where(np.arange(len(knots)) % 3 == 0, 0.0, rng.uniform(-4e-3, 4e-3, len(knots)))
    place = np.interp(time, knots, np.cumsum(ways) - 0.5 * np.cumsum(np.roll(ways, 1)))
    columns = {"time_s": time}
    tension = 9.0 + 3.0 * np.sin(1.3 * time + seed) + 2.0 * np.sin(0.37 * time)
    angle = (place - stretch(tension, stiffening)) / ARM
    other = 9.0 + 4.0 * np.cos(0.9 * time + seed)
    for name, side, pull in (("a", 1.0, tension), ("b", -1.0, other)):
        slider = side * ARM * angle + stretch(pull, stiffening)
        speed = np.gradient(slider, time)
        held = np.interp(time, knots, rng.uniform(-1.0, 1.0, len(knots)))
        moving = np.abs(speed) > 0.02 * np.sqrt(np.mean(speed**2))
        direction = np.where(moving, np.sign(speed), held)
        slider -= stretch(np.array(pretension), stiffening)
        columns[f"x_{name}_mm"] = 1e3 * slider + rng.normal(0.0, 2e-3, len(time))
        read = pull + direction * (friction + share * pull)
        columns[f"F_{name}_N"] = read + rng.normal(0.0, noise, len(time))
    columns["joint_deg"] = np.rad2deg(angle) + rng.normal(0.0, 0.02, len(time))
    return columns


def stretch(tension: Floats, stiffening: float) -> Floats:
    """Return δ of T = k (exp(a δ) − 1)/a."""
    if stiffening == 0.0:
        return tension / STIFFNESS
    return np.asarray(np.log1p(stiffening * tension / STIFFNESS) / stiffening)


def test_friction_at_rest_does_not_make_tendons_stiffer(tmp_path: Path) -> None:
    """Over all samples the compliance would come out too small: read and true tension differ by
    up to 3 N at rest.
    """
    rig = drafted([pair(k, 3.0, 0.0, 0.0) for k in range(3)], tmp_path).rig
    for tendon, drive in zip(rig.tendons, rig.drives):
        assert tendon.stiffness.value == pytest.approx(STIFFNESS, rel=0.05)
        assert tendon.stiffening.value == 0.0
        assert tendon.path is not None
        # three equal parts: constant, by load in the drive, by load along the path
        assert 3.0 * drive.friction.constant.value == pytest.approx(3.0, rel=0.15)
        assert 3.0 * 9.0 * drive.friction.load.value == pytest.approx(3.0, rel=0.15)
        path = 3.0 * 9.0 * np.pi / 2.0 * tendon.path.friction.value
        assert path == pytest.approx(3.0, rel=0.15)


def test_noise_of_forces_does_not_make_tendons_stiffer(tmp_path: Path) -> None:
    """With the force among the causes, they would come out 15 % too stiff, and slack by 0.3 mm."""
    logs = [pair(k, 0.2, 0.0, 0.0, noise=1.5) for k in range(3)]
    rig = drafted(logs, tmp_path).rig
    for tendon in rig.tendons:
        assert tendon.stiffness.value == pytest.approx(STIFFNESS, rel=0.04)
        slack = tendon.slack.value - tendon.pretension.value / STIFFNESS
        assert slack == pytest.approx(0.0, abs=1e-4)


def test_friction_that_grows_with_the_load_and_a_tendon_that_stiffens(tmp_path: Path) -> None:
    rig = drafted([pair(k, 0.2, 0.1, 200.0, 2.0) for k in range(3)], tmp_path).rig
    for tendon, drive in zip(rig.tendons, rig.drives):
        assert drive.friction.load.value == pytest.approx(0.1, rel=0.15)
        assert drive.friction.constant.value < 0.4
        assert tendon.stiffening.value == pytest.approx(200.0, rel=0.2)
        # at its pre-tension it has the stiffness k + a T_pre
        assert tendon.pretension.value == pytest.approx(2.0, rel=0.2)
        assert tendon.stiffness.value == pytest.approx(STIFFNESS + 200.0 * 2.0, rel=0.1)
        assert tendon.path is None


LENGTH = 0.04
CENTRE = 2.0 * LENGTH / 3.0


def waves(rng: np.random.Generator, time: Floats) -> Floats:
    """Return an angle of four sines of 1 to 4 Hz, its speed and its acceleration, (3, k)."""
    found = np.zeros((3, len(time)))
    for rate in rng.uniform(1.0, 4.0, 4):
        phase, w = rng.uniform(0, 6.28), 2.0 * np.pi * rate
        sine = 0.12 * np.sin(w * time + phase)
        found += sine, 0.12 * w * np.cos(w * time + phase), -(w**2) * sine
    return found


def chain(
    seed: int,
    masses: tuple[float, float],
    gravity: tuple[float, float] = (0.0, 0.0),
    friction: float = 0.0,
    tare: float = 0.0,
    own: float = 0.0,
) -> dict[str, Floats]:
    """Return a log of two joints in series with two tendons each, whose links are point masses: the
    torques by Lagrange's equations of a planar double pendulum. Gravity is along x and z; positive
    angles turn x to −z. Both joints have dry friction and an inertia of their own, as of a rotor;
    the cells read less by a tare.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 20.0, 1.0 / 200.0)
    q, v, a = np.stack([waves(rng, time), waves(rng, time)], axis=1)
    one, two = masses
    cos, sin = np.cos(q[1]), np.sin(q[1])
    both = two * LENGTH * CENTRE
    second = two * CENTRE**2 * (a[0] + a[1]) + both * (cos * a[0] + sin * v[0] ** 2)
    first = one * CENTRE**2 * a[0] + two * LENGTH**2 * a[0] + second
    first += both * (cos * (a[0] + a[1]) - sin * (v[0] + v[1]) ** 2)
    angle_one, angle_two = q[0], q[0] + q[1]
    weight_one = gravity[0] * np.sin(angle_one) + gravity[1] * np.cos(angle_one)
    weight_two = gravity[0] * np.sin(angle_two) + gravity[1] * np.cos(angle_two)
    second += two * CENTRE * weight_two + friction * np.sign(v[1]) + own * a[1]
    first += (one * CENTRE + two * LENGTH) * weight_one + two * CENTRE * weight_two
    first += friction * np.sign(v[0]) + own * a[0]
    across = second / 6e-3
    along = (first - 7e-3 * across) / 8e-3
    pulls = (8.0 + along / 2, 8.0 - along / 2, 8.0 + across / 2, 8.0 - across / 2)
    arms = ((8e-3, 0.0), (-8e-3, 0.0), (7e-3, 6e-3), (-7e-3, -6e-3))
    columns = {"time_s": time}
    for name, pull, (near, far) in zip(("mf", "me", "pf", "pe"), pulls, arms):
        slack_free = near * q[0] + far * q[1] + pull / 2e4
        columns[f"x_{name}_mm"] = 1e3 * slack_free + rng.normal(0.0, 2e-3, len(time))
        zero = tare if name in ("me", "pe") else 0.0
        columns[f"F_{name}_N"] = pull - zero + rng.normal(0.0, 0.05, len(time))
    for name, angle in zip(("mcp", "pip"), q):
        columns[f"{name}_deg"] = np.rad2deg(angle) + rng.normal(0.0, 0.01, len(time))
    return columns


@pytest.mark.parametrize("last", ["pip_deg", "mcp_deg"])
def test_joints_whose_tendons_pass_over_others_are_in_series(tmp_path: Path, last: str) -> None:
    """Whichever has the last column. Masses are those of point masses at 2/3 of 40 mm."""
    logs = [chain(k, (0.012, 0.02)) for k in range(3)]
    for log in logs:
        log[last] = log.pop(last)
    mcp, pip = drafted(logs, tmp_path).rig.joints
    assert (mcp.name, pip.name) == ("mcp", "pip")
    assert (mcp.parent, pip.parent) == ("base", "mcp")
    assert mcp.link is not None
    assert pip.link is not None
    for link, mass in ((mcp.link, 0.012), (pip.link, 0.02)):
        assert abs(link.mass.value - mass) < 2.0 * link.mass.std
        assert link.mass.std < 0.2 * mass


@pytest.mark.parametrize("tare", [0.0, 3.0])
def test_weight_shows_which_way_gravity_points(tmp_path: Path, tare: float) -> None:
    """Also where two cells read 3 N too little, which is no weight."""
    logs = [chain(k, (0.03, 0.03), (2.0, -9.0), tare=tare) for k in range(3)]
    along_x, across, along_z = drafted(logs, tmp_path).rig.base.gravity
    assert across == 0.0
    assert (along_x, along_z) == pytest.approx((2.0, -9.0), abs=0.9)


def test_logs_that_do_not_show_weight_leave_gravity_a_guess(tmp_path: Path) -> None:
    found = drafted([chain(k, (0.03, 0.03)) for k in range(3)], tmp_path)
    assert found.rig.base.gravity == (0.0, 0.0, 0.0)
    assert "which way gravity points" in found.guesses


def test_friction_of_joints_beside_that_of_their_load(tmp_path: Path) -> None:
    """Four tendons of 8 N press the first joint's axle of 2 mm, two the second one's."""
    rig = drafted([chain(k, (0.02, 0.02), friction=8e-3) for k in range(3)], tmp_path)
    for joint, load in zip(rig.rig.joints, (32.0, 16.0)):
        assert joint.friction is not None
        torque = joint.friction.coefficient.value * joint.friction.radius.value * load
        assert torque == pytest.approx(8e-3, rel=0.15)


def test_light_links_are_left_out_where_slow_logs_do_not_tell_their_masses(tmp_path: Path) -> None:
    logs = [chain(k, (0.0, 0.0)) for k in range(3)]
    for log in logs:
        log["time_s"] = 20.0 * log["time_s"]
    rig = drafted(logs, tmp_path).rig
    assert all(joint.link is None for joint in rig.joints)


def test_inertias_that_no_joint_carries_for_another_are_no_links(tmp_path: Path) -> None:
    """An inertia of 3·10⁻⁵ kg m² is that of 40 g at 2/3 of 40 mm, which joints would carry."""
    logs = [chain(k, (0.0, 0.0), own=3e-5) for k in range(3)]
    rig = drafted(logs, tmp_path).rig
    for joint in rig.joints:
        assert joint.link is None
        assert joint.inertia.value == pytest.approx(3e-5, rel=0.15)


def motor_and_joint(
    seed: int, inertia: float, rotor: float, load: float = 0.0, spring: float = 0.0
) -> dict[str, Floats]:
    """Return a log of a motor whose spool of 6 mm turns a joint's pulley of 5 mm by two tendons,
    against a constant load and a spring [N m/rad]; its torque is read in the motor, which rubs and
    is damped.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 20.0, 1.0 / 200.0)
    angle, speed, acceleration = waves(rng, time)
    torque = inertia * acceleration + 5e-3 * np.sign(speed) + load + spring * angle
    turned = (5.0 * angle + torque / 5e-3 / (2.0 * 1.5e4) * 1e3) / 6.0
    turning = np.gradient(turned, time)
    effort = torque * 6.0 / 5.0 + 1e-3 * np.sign(turning) + 1e-3 * turning
    effort += rotor * np.gradient(turning, time)
    return {
        "time_s": time,
        "phi_m_rad": np.round((turned + rng.normal(0.0, 1e-4, len(time))) / 5e-4) * 5e-4,
        "tau_m_Nm": effort + rng.normal(0.0, 1e-3, len(time)),
        "theta_deg": np.rad2deg(angle) + rng.normal(0.0, 0.01, len(time)),
    }


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_the_inertia_and_damping_of_a_motor_are_not_the_joints(tmp_path: Path, way: float) -> None:
    """The taken spool of 8 mm changes no torque on the motor, and none on the joint. The torque may
    be read with the other sign: stiffness does not show it in these logs, friction does.
    """
    logs = [motor_and_joint(k, inertia=4e-6, rotor=2e-5) for k in range(3)]
    for log in logs:
        log["tau_m_Nm"] = way * log["tau_m_Nm"]
    rig = drafted(logs, tmp_path).rig
    (drive,) = rig.drives
    assert isinstance(drive, Capstan)
    assert drive.inertia.value == pytest.approx(2e-5, rel=0.2)
    assert drive.damping.value == pytest.approx(1e-3, rel=0.2)
    assert rig.joints[0].inertia.value == pytest.approx(4e-6, rel=0.5)
    assert [sensor.sign for sensor in rig.sensors if sensor.measures == "force"] == [way]


@pytest.mark.parametrize(("column", "guessed"), [("tau_m_Nm", False), ("current_m_A", True)])
def test_damping_that_a_current_shows_is_not_the_drives_alone(
    tmp_path: Path, column: str, guessed: bool
) -> None:
    logs = [motor_and_joint(k, inertia=4e-6, rotor=2e-5) for k in range(3)]
    for log in logs:
        log[column] = log.pop("tau_m_Nm")
    found = drafted(logs, tmp_path)
    assert ("damping of motors" in found.guesses) == guessed


@pytest.mark.parametrize(("load", "count"), [(7.5e-3, 2), (3e-2, 1)])
def test_a_drive_that_pulls_both_ways_has_two_tendons(
    tmp_path: Path, load: float, count: int
) -> None:
    """Under a load of 7.5 mN m the smaller pull is an eighth of the larger one."""
    logs = [motor_and_joint(k, inertia=0.0, rotor=0.0, load=load) for k in range(3)]
    efforts = np.concatenate([log["tau_m_Nm"] for log in logs])
    low, high = np.quantile(efforts, [0.05, 0.95])
    assert (-0.15 < low / high < -0.07) == (count == 2)
    tendons = drafted(logs, tmp_path).rig.tendons
    assert len(tendons) == count
    if count == 2:  # the least with which both stay taut at nearly all of these efforts
        tense = np.quantile(np.abs(efforts), 0.9) / 8e-3 / 2.0
        assert tendons[0].pretension.value == pytest.approx(tense, rel=0.02)  # of thinned logs


def test_a_joint_that_is_pulled_both_ways_has_a_spring_where_its_torque_shows_one(
    tmp_path: Path,
) -> None:
    logs = [motor_and_joint(k, inertia=0.0, rotor=0.0, spring=0.02, load=2e-3) for k in range(3)]
    spring = drafted(logs, tmp_path).rig.joints[0].spring
    assert spring is not None
    assert spring.stiffness.value == pytest.approx(0.02, rel=0.15)
    assert spring.rest_angle.value == pytest.approx(-0.1, rel=0.3)
    logs = [motor_and_joint(k, inertia=0.0, rotor=0.0) for k in range(3)]
    assert drafted(logs, tmp_path).rig.joints[0].spring is None


def test_an_inertia_that_logs_do_not_show_is_as_small_as_they_show(tmp_path: Path) -> None:
    logs = [motor_and_joint(k, inertia=0.0, rotor=0.0) for k in range(3)]
    joint = drafted(logs, tmp_path).rig.joints[0]
    assert 0.0 < joint.inertia.value < 2e-6


def test_derivatives_are_taken_over_longer_times_where_angles_are_noisy() -> None:
    time = np.arange(0.0, 5.0, 0.005)
    angles = 0.3 * np.sin(2.0 * np.pi * 2.0 * time)
    # the second derivative of a cubic through n samples has noise σ √(720/n⁵)/dt² (large n)
    assert window_of(angles, 0.005, 1e-5) == 5
    long = window_of(angles, 0.005, 3e-3)
    assert 3e-3 * np.sqrt(720.0 / long**5) / 0.005**2 < 0.25 * 0.3 * (4.0 * np.pi) ** 2 / np.sqrt(2)


@pytest.mark.parametrize("order", [1, 2])
def test_values_are_smoothed_as_their_derivatives_are(order: int) -> None:
    """At 8 Hz local cubics over 65 ms lose a sixth of an acceleration, and hardly of a value."""
    time = np.arange(0.0, 2.0, 0.005)
    turning = 2.0 * np.pi * 8.0
    exact = (np.sin, np.cos, lambda phase: -np.sin(phase))[order](turning * time) * turning**order
    inside = slice(20, -20)
    derivative = smoothed(np.sin(turning * time), 13, 0.005, order)[inside]
    assert derivative == pytest.approx(
        smoothed(exact, 13, 0.005)[inside], abs=0.02 * turning**order
    )
    assert np.max(np.abs(derivative)) < 0.9 * turning**order


def test_a_position_that_stays_at_a_value_has_no_noise_at_rest(tmp_path: Path) -> None:
    """It is then not taken for dead when it rests; another one with the same noise would be."""
    logs = [pair(k, 3.0, 0.0, 0.0) for k in range(3)]
    for log in logs:
        log["x_a_mm"][500:600] = log["x_a_mm"][500]
    rig = drafted(logs, tmp_path).rig
    rests, moves = rig.sensors_of("position")
    assert rests.noise == pytest.approx(step_of(rests))
    assert moves.noise > 2.0 * step_of(moves)
