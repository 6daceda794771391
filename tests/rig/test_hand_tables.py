"""Rigs of hands from a table, from an ORCA hand's files, from an Aero Hand's SDK as a table."""

from __future__ import annotations

import subprocess
import sys
from math import radians
from pathlib import Path

import pytest
import yaml

from distal.errors import RigError
from distal.rig import (
    build_rig,
    from_orca,
    from_table,
    orca_order,
    parse_toml,
)
from distal.rig.components import Capstan

TABLE = """joint,motor,spool_radius [mm],joint_radius [mm],direction,low [deg],high [deg]
index_mcp,1,7,8,1,-20,95
index_pip,two,6.5,7.5,-1,0,105
"""


def table(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "hand.csv"
    path.write_text(text)
    return path


def test_a_table_becomes_a_rig_with_its_numbers(tmp_path: Path) -> None:
    imported = from_table(table(tmp_path, TABLE))
    rig = imported.rig
    assert [joint.name for joint in rig.joints] == ["index_mcp", "index_pip"]
    assert rig.joints[0].stops == pytest.approx((radians(-20), radians(95)))
    motor = rig.drives[0]
    assert isinstance(motor, Capstan)
    assert motor.name == "motor_1"
    assert motor.radius.value == pytest.approx(7e-3)
    assert [tendon.arms()["index_mcp"] for tendon in rig.tendons[:2]] == pytest.approx(
        [8e-3, -8e-3]
    )
    assert {sensor.name: sensor.sign for sensor in rig.sensors_of("position")} == {
        "motor_1_position": 1,
        "two_position": -1,
    }


@pytest.mark.parametrize("separator", [";", "\t"])
def test_a_spreadsheets_other_separators_and_notes_are_read(tmp_path: Path, separator: str) -> None:
    text = "# our hand\n\n" + TABLE.replace(",", separator)
    assert from_table(table(tmp_path, text)).rig == from_table(table(tmp_path, TABLE)).rig


def test_the_text_is_the_rig_and_marks_each_guess(tmp_path: Path) -> None:
    imported = from_table(table(tmp_path, TABLE))
    assert build_rig(parse_toml(imported.text, "text", RigError), "hand") == imported.rig
    assert imported.text.count("not in the table:") > 10
    for guess in ("slack of tendons", "torque constants", "friction of joints"):
        assert guess in imported.missing
        assert guess in imported.text


def test_one_tendon_over_three_joints_has_springs_and_no_second_tendon(tmp_path: Path) -> None:
    text = (
        "joint,motor,spool_radius,joint_radius,back,low,high,follows,ratio\n"
        "mcp,1,9 mm,12 mm,spring,0 deg,90 deg,,\npip,1,9 mm,7 mm,spring,0 deg,90 deg,,\ndip,,,,,0 "
        "deg,60 deg,pip,0.7\n"
    )
    rig = from_table(table(tmp_path, text)).rig
    assert len(rig.tendons) == 1
    assert rig.tendons[0].arms() == pytest.approx({"mcp": 12e-3, "pip": 7e-3})
    assert all(rig.joints[i].spring is not None for i in (0, 1))
    assert rig.joints[2].coupled is not None
    assert rig.joints[2].coupled.ratio == pytest.approx(0.7)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("joint_radius [mm]", "joint_radios [mm]"), "did you mean 'joint_radius'"),
        (("low [deg]", "low"), "line 2: low: '-20' has no unit"),
        (("low [deg]", "low [mm]"), "line 2: low: unit 'mm' is no angle"),
        (("-20,95", "95,-20"), "from a lower to a higher angle"),
        (("-20,95", "-20,9500"), "is the unit right?"),
        ((",1,-20", ",2,-20"), "must be 1 or -1, '2' came"),
        (("1,7,8", "1,0.007,8"), "must be from 0.0001 to 0.5 m, 7e-06 came"),
        (("high [deg]", "high"), "line 2: high: '95' has no unit"),
        (("index_mcp,1", "index_mcp,"), "needs a motor"),
        (("index_pip,two", "index_mcp,two"), "several lines with different ranges"),
        (("joint,motor", "joint,joint"), "two columns are called 'joint'"),
    ],
)
def test_a_wrong_table_is_one_line(tmp_path: Path, change: tuple[str, str], says: str) -> None:
    with pytest.raises(RigError, match=says.replace("?", r"\?").replace("(", r"\(")):
        from_table(table(tmp_path, TABLE.replace(*change)))


def test_a_zero_in_counts_is_an_angle_and_columns_have_names(tmp_path: Path) -> None:
    header = "joint,motor,low [deg],high [deg],counts,zero [count]"
    columns = "position_column,current_column,time_column"
    row = "a,1,0,90,4096,1024,raw,amps,stamp [ms]"
    rig = from_table(table(tmp_path, f"{header},{columns}\n{row}\n")).rig
    position, current = rig.sensors_of("position")[0], rig.sensors_of("force")[0]
    assert (position.log_column, current.log_column) == ("raw", "amps")
    assert position.bias.value == pytest.approx(radians(90))
    assert (rig.log.time.column, rig.log.time.unit) == ("stamp", "ms")
    for cells, said in (
        (",1024", "a zero in counts needs 'counts' of one turn"),
        ("0,", "counts"),
        ("1e400,", ".*not finite"),
    ):
        with pytest.raises(RigError, match=f"line 2: {said}"):
            from_table(table(tmp_path, f"{header}\na,1,0,90,{cells}\n"))


def test_an_empty_table_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(RigError, match="a line of names"):
        from_table(table(tmp_path, "joint,motor\n"))


CONFIG = {
    "joint_to_motor_map": {"mcp": 3, "pip": -1},
    "joint_roms": {"mcp": [-20, 90], "pip": [0, 100]},
    "joint_motor_travel_v21": {"mcp": 110.0, "pip": 90.0},
}


def written(tmp_path: Path, name: str, content: object) -> Path:
    path = tmp_path / name
    path.write_text(yaml.safe_dump(content))
    return path


def test_a_calibration_says_ratio_sign_and_zero(tmp_path: Path) -> None:
    config = written(tmp_path, "config.yaml", CONFIG)
    limits = {"motor_limits": {3: [1.0, 3.0], 1: [0.5, 2.5]}}
    with pytest.raises(RigError, match="calibrated: false"):
        from_orca(config, written(tmp_path, "calibration.yaml", limits | {"calibrated": False}))
    rig = from_orca(config, written(tmp_path, "calibration.yaml", limits)).rig
    drives = {drive.name: drive for drive in rig.drives}
    for name, joint, sign in (("motor_3", (-20, 90), 1), ("motor_1", (0, 100), -1)):
        motor = drives[name]
        assert isinstance(motor, Capstan)
        ratio = 8e-3 / motor.radius.value
        # the travel also holds stretch and play: the ratio is a little less
        assert 0.85 < ratio * radians(joint[1] - joint[0]) / 2.0 < 1.0
        position = next(s for s in rig.sensors_of("position") if s.of == name)
        assert position.sign == sign
        middle = limits["motor_limits"][int(name[-1])]
        # in the middle of its travel the motor's reading is that of the joint in the middle of its
        # range
        at = position.sign * sum(middle) / 2 - position.bias.value
        assert at / ratio == pytest.approx(radians(sum(joint) / 2), abs=1e-6)


def test_a_config_alone_says_what_is_missing(tmp_path: Path) -> None:
    imported = from_orca(written(tmp_path, "config.yaml", CONFIG))
    assert any("2.1" in note for note in imported.notes)
    assert any("zero is not known" in note for note in imported.notes)
    bias = imported.rig.sensors_of("position")[0].bias
    assert bias.std > radians(30)


def test_the_map_of_a_revision_counts_where_it_is_that_one(tmp_path: Path) -> None:
    turned = CONFIG | {"joint_to_motor_map_v21": {"mcp": -3}}
    for revision, sign in (("auto", 1), (21, -1)):
        rig = from_orca(
            written(tmp_path, "config.yaml", turned | {"hardware_version": revision})
        ).rig
        assert next(s.sign for s in rig.sensors_of("position") if s.of == "motor_3") == sign


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"joint_roms": {"mcp": [-20, 90]}}, "'pip' needs two ends"),
        ({"joint_roms": {"mcp": [90, -20], "pip": [0, 1]}}, "must rise"),
        ({"joint_to_motor_map": {}}, "joint_to_motor_map: at least one is needed"),
        (
            {"joint_to_motor_map": {"mcp": "three"}},
            "joint_to_motor_map.mcp: .*integer, .*'three' came",
        ),
        (
            {"joint_motor_travel_v21": {"mcp": None, "pip": 3}},
            "joint_motor_travel_v21.mcp: .*number, None came",
        ),
        ({"joint_roms": {"mcp": [0, 10**400]}}, "input should be a valid number"),
        ({"joint_roms": {"mcp": [-0.35, 1.66], "pip": [0, 1.83]}}, "in radians"),
    ],
)
def test_a_wrong_config_is_one_line(tmp_path: Path, change: dict[str, object], says: str) -> None:
    with pytest.raises(RigError, match=says):
        from_orca(written(tmp_path, "config.yaml", CONFIG | change))


def test_the_order_of_its_own_calibration_is_that_of_a_routine(tmp_path: Path) -> None:
    steps = [
        {"step": 1, "joints": {"mcp": "flex", "abd": "flex"}},
        {"step": 2, "joints": {"mcp": "extend", "abd": "extend"}},
        {"step": 3, "joints": {"pip": "flex"}},
    ]
    path = written(tmp_path, "config.yaml", CONFIG | {"calibration_sequence": steps})
    assert orca_order(path) == [["abd", "mcp"], ["pip"]]
    with pytest.raises(RigError, match="calibration_sequence: is missing"):
        orca_order(written(tmp_path, "config.yaml", CONFIG))


def test_what_is_no_yaml_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "config.yaml"
    path.write_text("joint_roms: [1, 2")
    with pytest.raises(RigError, match="not valid YAML"):
        from_orca(path)


SDK = '''"""A made-up SDK with the names of a real one."""
MOTOR_PULLEY_RADIUS = 10.0


class JointsToActuationsModel:
    def hand_actuations(self, joints):
        return [joints[0], (12.0 * joints[1] + 6.0 * joints[2] - 2.0 * joints[0]) / MOTOR_PULLEY_RADIUS]
'''

HAND = """import serial
_JOINT_NAMES = ["abd", "mcp", "pip"]
_JOINT_LOWER_LIMITS = [0.0] * 3
_JOINT_UPPER_LIMITS = [100.0] + [90.0] * 2
_ACTUATIONS_NAMES = ["abd_act", "finger_act"]
"""


@pytest.fixture
def sdk(tmp_path: Path) -> Path:
    (tmp_path / "joints_to_actuations.py").write_text(SDK)
    (tmp_path / "aero_hand.py").write_text(HAND)
    return tmp_path


def test_an_sdk_is_asked_and_not_run_with_its_serial_port(sdk: Path) -> None:
    script = Path(__file__).parents[2] / "examples" / "hands" / "aero_table.py"
    made = subprocess.run([sys.executable, script, sdk], capture_output=True, text=True, check=True)
    imported = from_table(table(sdk, made.stdout))
    assert imported.notes == ()
    rig = imported.rig
    assert [drive.name for drive in rig.drives] == ["abd", "finger"]
    arms = {tendon.name: tendon.arms() for tendon in rig.tendons}
    assert arms["finger"] == pytest.approx({"abd": -2e-3, "mcp": 12e-3, "pip": 6e-3})
    # the motor that turns its joint directly holds it both ways
    assert arms["abd_plus"]["abd"] == -arms["abd_minus"]["abd"] == pytest.approx(10e-3)
    assert rig.joints[0].stops == pytest.approx((0.0, radians(100)))
    assert {sensor.unit for sensor in rig.sensors_of("position")} == {"deg"}
    assert {sensor.bias.value for sensor in rig.sensors_of("position")} == {0.0}


def test_a_motor_that_stands_twice_is_named(tmp_path: Path) -> None:
    with pytest.raises(
        RigError,
        match=r"motor 'motor_1' has several joints \(a, b\): give each a motor, or 'spring' in 'back'",
    ):
        from_table(
            table(tmp_path, TABLE.splitlines()[0] + "\na,1,7,8,1,-20,95\nb,1,7,8,1,-20,95\n")
        )


def test_a_direction_that_is_left_out_is_said(tmp_path: Path) -> None:
    text = (
        "joint,motor,direction,low [deg],high "
        "[deg],follows,ratio\na,1,-1,0,90,,\nb,2,,0,90,,\nc,,,0,60,b,0.6\n"
    )
    (note,) = from_table(table(tmp_path, text)).notes
    assert (
        note == "no direction of b: each angle is taken to grow with its motor's reading; look once"
    )
    assert from_table(table(tmp_path, TABLE)).notes == ()
