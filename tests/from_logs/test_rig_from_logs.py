"""A rig from logs alone: structure, signs, sizes, and the mistakes that it names."""

from pathlib import Path

import numpy as np
import pytest

import distal
from distal.errors import RigError, one_line
from distal.from_logs import rig_from_logs
from distal.regression import played
from tests.from_logs.logs import Floats, drafted, finger, fingers, motion, written

ARMS = ((8e-3, 6e-3), (8e-3, -5e-3), (-9e-3, -4e-3))


def arms_of(rig: distal.Rig) -> dict[str, dict[str, float]]:
    return {tendon.name: tendon.arms() for tendon in rig.tendons}


def test_arms_signs_stiffness_and_noise_are_those_of_the_plant(tmp_path: Path) -> None:
    found = drafted(fingers(), tmp_path)
    arms = arms_of(found.rig)
    for name, expected in zip("abc", ARMS):
        assert [arms[name]["mcp"], arms[name]["pip"]] == pytest.approx(expected, rel=0.02)
    assert found.rig.tendons[0].stiffness.value == pytest.approx(9e3, rel=0.1)
    assert found.rig.sensors[0].noise == pytest.approx(np.hypot(5e-6, 0.05 / 9e3), rel=0.2)
    assert found.rig.taken == ()
    assert found.rig.log.time.unit == "ms"
    assert "not in the logs: friction of joints" in found.text
    # this plant has no springs; no log tells on which side of the drive's
    # friction a load cell stands
    assert all(joint.spring is None for joint in found.rig.joints)
    assert all(drive.friction.constant.value > 0.0 for drive in found.rig.drives)
    assert {tendon.stiffening.value for tendon in found.rig.tendons} == {0.0}
    path = tmp_path / "own.toml"
    path.write_text(found.text)
    assert distal.load_rig(path) == found.rig


@pytest.mark.parametrize("mirrored", ["x_b_mm", "F_b"])
def test_a_column_that_counts_the_other_way_in_all_logs_gets_a_sign(
    tmp_path: Path, mirrored: str
) -> None:
    logs = fingers()
    for log in logs:
        log[mirrored] = -log[mirrored]
    rig = drafted(logs, tmp_path).rig
    signs = {sensor.log_column: sensor.sign for sensor in rig.sensors}
    assert signs[mirrored] == -1
    assert signs["x_a_mm"] == 1
    assert list(arms_of(rig)["b"].values()) == pytest.approx(ARMS[1], rel=0.02)


def test_an_effort_of_no_scale_is_used_with_an_assumed_one(tmp_path: Path) -> None:
    """The log is read by the rig that comes of it, and efforts count as what a register holds."""
    logs = []
    for k in range(3):
        log = finger(k)
        for name in "abc":
            log[f"m_{name} [ticks]"] = np.round(4096.0 * log.pop(f"x_{name}_mm") / 31.4)
            log[f"{name}_servo_load [%]"] = np.round(5.0 * log.pop(f"F_{name}"), 1)
        logs.append(log)
    paths = written(logs, tmp_path)
    found = rig_from_logs(paths)
    assert "force" in found.rig.taken
    assert sum("of an assumed scale" in column.in_words for column in found.columns) == 3
    read = distal.read_log(paths[0], found.rig)
    (sensor,) = (s for s in found.rig.sensors if s.of == "a" and s.measures == "force")
    expected = logs[0]["a_servo_load [%]"] * sensor.torque_constant
    np.testing.assert_allclose(np.abs(read.channels[sensor.name]), np.abs(expected))


def test_a_rig_of_motors_with_currents_takes_both_scales(tmp_path: Path) -> None:
    logs = []
    for k in range(3):
        log = finger(k)
        for name in "abc":
            log[f"m_{name}_deg"] = np.rad2deg(log.pop(f"x_{name}_mm") / 5.0)
            log[f"cur_{name}_mA"] = 30.0 * log.pop(f"F_{name}")
        logs.append({name: log[name] for name in sorted(log, key=lambda name: name != "t_ms")})
    found = drafted(logs, tmp_path)
    assert found.rig.taken == ("length", "force")
    radius = found.rig.drives[0].radius.value  # type: ignore[union-attr]
    tendon = found.rig.tendons[0]
    assert tendon.arms()["mcp"] / radius == pytest.approx(8.0 / 5.0, rel=0.02)
    with pytest.raises(distal.DistalError, match=r"needs a true tension.*torque constant"):
        distal.Inverse(found.rig)


def without(log: dict[str, Floats], name: str) -> dict[str, Floats]:
    return {key: value for key, value in log.items() if key != name}


def swapped(log: dict[str, Floats], a: str, b: str) -> dict[str, Floats]:
    return log | {a: log[b], b: log[a]}


DISAGREES = r"run_1.csv does not agree .* swapped, mirrored"
MISTAKES = {
    "t_ms steps by 0.01": lambda log: log | {"t_ms": log["t_ms"] / 1e3},
    "x_a_mm never changes": lambda log: log | {"x_a_mm": 0.0 * log["x_a_mm"] + 1.0},
    "swapped drives": lambda log: swapped(log, "x_a_mm", "x_b_mm"),
    "swapped joints": lambda log: swapped(log, "mcp_deg", "pip_deg"),
    "mirrored": lambda log: log | {"x_c_mm": -log["x_c_mm"]},
    "radians": lambda log: log | {name: np.deg2rad(log[name]) for name in ("mcp_deg", "pip_deg")},
    "one in radians": lambda log: log | {"mcp_deg": np.deg2rad(log["mcp_deg"])},
    "another rig": lambda log: finger(1, ((6e-3, 8e-3), (9e-3, -3e-3), (-5e-3, -7e-3))),
}


@pytest.mark.parametrize("change", list(MISTAKES))
def test_a_mistake_in_one_log_is_named(tmp_path: Path, change: str) -> None:
    logs = fingers()
    logs[1] = MISTAKES[change](logs[1])
    said = change if change.startswith(("t_", "x_")) else DISAGREES
    with pytest.raises(distal.DistalError, match=said):
        drafted(logs, tmp_path)


def test_missing_rows_are_named_and_wraps_undone(tmp_path: Path) -> None:
    gaps = [finger(0), finger(1), {n: np.delete(c, slice(300, 500)) for n, c in finger(2).items()}]
    assert any("rows are missing" in note for note in drafted(gaps, tmp_path).notes)
    for log in gaps:
        log["enc_a"] = np.mod(np.round(100 * log.pop("x_a_mm")), 512.0)
    draft = drafted(gaps, tmp_path)
    assert "counts_per_turn = 512" in draft.text


def test_two_joints_that_move_almost_alike_cannot_be_told_apart(tmp_path: Path) -> None:
    """The logs do not say which joint the second slider moves; it says so, and what would."""
    logs = []
    for k in range(3):
        log = finger(k, ((8e-3,), (-8e-3,), (9e-3,)), noise=1.5e-3)
        wander = 1.5 * np.sin(1.3 * log["t_ms"] / 1e3 + k)
        log["pip_deg"] = 0.9 * log["mcp_deg"] + wander
        logs.append({name: c for name, c in log.items() if not name.startswith("F_")})
    found = drafted(logs, tmp_path)
    assert any("cannot be told" in line and "moves alone" in line for line in found.untellable)
    assert {name for tendon in found.rig.tendons for name in tendon.joints} == {"mcp", "pip"}


def test_no_reference_and_no_drive_say_what_helps(tmp_path: Path) -> None:
    log = finger(0)
    paths = written([without(without(log, "mcp_deg"), "pip_deg")], tmp_path)
    said = r"no column is taken as a joint's angle.*x_a_mm: position.*--truth.*three logs of 40 s"
    with pytest.raises(distal.DistalError, match=said) as refused:
        rig_from_logs(paths)
    line = f"error: {refused.value}"
    assert line == one_line(line)  # nothing of it is cut out
    paths = written([{name: log[name] for name in ("t_ms", "mcp_deg", "pip_deg")}], tmp_path)
    with pytest.raises(distal.DistalError, match=r"drive's position.*--drive"):
        rig_from_logs(paths)


def test_a_log_that_differs_a_little_is_said_and_learned_from(tmp_path: Path) -> None:
    logs = fingers()
    logs[1] = finger(1, ((8.6e-3, 6e-3), (8e-3, -5e-3), (-9e-3, -4e-3)))
    notes = drafted(logs, tmp_path).notes
    assert any("run_1.csv differs from the other logs by" in note for note in notes)


def test_a_logs_own_truth_is_a_reference_that_the_rig_file_need_not_name(tmp_path: Path) -> None:
    logs = fingers()
    for log in logs:
        for name in ("mcp", "pip"):
            log[f"true_theta_{name}"] = np.deg2rad(log.pop(f"{name}_deg"))
    paths = written(logs, tmp_path)
    rig = rig_from_logs(paths).rig
    assert list(rig.joint_names) == ["mcp", "pip"]
    assert not rig.sensors_of("angle")
    log = distal.read_log(paths[0], rig)
    np.testing.assert_allclose(log.truth["theta_mcp"], logs[0]["true_theta_mcp"], atol=1e-8)


@pytest.mark.parametrize("disturbance", [0.0, 0.04])
def test_inertia_and_damping_that_stand_clear_of_their_errors_are_written(
    tmp_path: Path, disturbance: float
) -> None:
    """The torque of two tendons accelerates the joint: I = 2 g m², b = 0.03 N m s; a random torque
    as large as theirs [N m] hides them from the residual alone.
    """
    logs = []
    for k in range(3):
        log = finger(k, ((8e-3,), (-8e-3,)))
        time = log["t_ms"] / 1e3
        angle = 0.5 * np.sin(2.0 * time + k) + 0.1 * np.sin(9.0 * time)
        speed = np.cos(2.0 * time + k) + 0.9 * np.cos(9.0 * time)
        acceleration = -2.0 * np.sin(2.0 * time + k) - 8.1 * np.sin(9.0 * time)
        rng = np.random.default_rng(k)
        torque = 2e-3 * acceleration + 0.03 * speed + disturbance * rng.normal(size=len(time))
        made = {"t_ms": log["t_ms"]}
        for name, side in (("a", 1.0), ("b", -1.0)):
            tension = 12.0 + side * torque / 16e-3
            pulled = side * 8e-3 * angle + tension / 9e3
            made[f"x_{name}_mm"] = 1e3 * (pulled + rng.normal(0.0, 5e-6, len(time)))
            made[f"F_{name}"] = tension + rng.normal(0.0, 0.05, len(time))
        made["mcp_deg"] = np.rad2deg(angle) + rng.normal(0.0, 0.02, len(time))
        logs.append(made)
    joint = drafted(logs, tmp_path).rig.joints[0]
    assert joint.inertia.value == pytest.approx(2e-3, rel=0.15)
    assert joint.damping.value == pytest.approx(0.03, rel=0.15)


def test_a_drive_stays_that_tells_of_a_joint_which_does_not_tell_of_it(tmp_path: Path) -> None:
    """A soft body: its tilt is a sum of what three motors do, and none follows from the tilt."""
    logs = []
    for k in range(3):
        rng = np.random.default_rng(k)
        time = np.arange(0.0, 20.0, 0.01)
        motors = [np.sin(rate * time + rng.uniform(0.0, 6.0)) for rate in (1.0, 1.7, 2.3)]
        tilt = 20.0 * motors[0] + 9.0 * motors[1] + 9.0 * motors[2]
        names = [f"motor{i} [rad]" for i in (1, 2, 3)]
        columns = {"t [s]": time, **dict(zip(names, motors))}
        idle = np.sin(3.1 * time + rng.uniform(0.0, 6.0))
        columns["motor4 [rad]"] = idle
        columns["tilt [deg]"] = tilt + rng.normal(0.0, 0.3, len(time))
        logs.append(columns)
    found = drafted(logs, tmp_path)
    assert len(found.rig.drives) == 3
    assert any("motor4 [rad] moves none of the joints" in note for note in found.notes)


def underactuated(seed: int) -> dict[str, Floats]:
    """Return a log of two motors and three joints: the tip moves a share with the middle joint,
    lags behind it by a play, and hardly moves the second motor.
    """
    rng = np.random.default_rng(seed)
    time, angles = motion(seed, 2)
    tip = 0.7 * played(angles[:, 1], 0.1)
    first, second = angles[:, 0] - 0.8 * angles[:, 1], 0.5 * angles[:, 0] + angles[:, 1]
    motors = np.column_stack([first, second + 0.03 * tip])
    columns = {"t [s]": time, "m1 [rad]": motors[:, 0], "m2 [rad]": motors[:, 1]}
    for name, column in zip(("mcp", "pip", "dip"), (*angles.T, tip)):
        columns[f"{name} [deg]"] = np.rad2deg(column) + rng.normal(0.0, 0.1, len(time))
    return columns


def test_a_joint_that_moves_with_the_others_is_moved_by_a_drive_and_doubted(tmp_path: Path) -> None:
    found = drafted([underactuated(k) for k in range(3)], tmp_path)
    assert found.rig.joint_names == ["mcp", "pip", "dip"]
    doubts = [
        line for line in found.untellable if line.startswith("dip moves with the other joints")
    ]
    assert len(doubts) == 1
    assert "cannot be told which drive moves it, m2 [rad] is a guess" in doubts[0]


def test_an_angle_that_no_drive_tells_is_refused(tmp_path: Path) -> None:
    logs = [underactuated(k) for k in range(3)]
    for k, columns in enumerate(logs):
        columns["dip [deg]"] = np.rad2deg(motion(50 + k, 1)[1][:, 0])
    with pytest.raises(RigError, match=r"no drive moves dip.*--ignore"):
        drafted(logs, tmp_path)


def test_registers_without_a_sign_are_decoded(tmp_path: Path) -> None:
    """A driver that reads a register without its sign gives the draft of the good logs."""
    logs = fingers()
    for log in logs:
        log["enc_a"] = np.round(400 * log.pop("x_a_mm")) - 600
    good = drafted(logs, tmp_path)
    assert all(log["enc_a"][0] < 0 < log["enc_a"].max() for log in logs)
    for log in logs:
        log["enc_a"] = np.where(log["enc_a"] < 0, log["enc_a"] + 2.0**16, log["enc_a"])
    assert drafted(logs, tmp_path).text == good.text
