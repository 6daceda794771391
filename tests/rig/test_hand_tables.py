"""Rigs of hands from a table, from an ORCA hand's files, from an Aero Hand's SDK as a table."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from math import radians
from pathlib import Path

import pytest
import yaml

from distal.errors import RigError
from distal.rig import (
    Imported,
    build_rig,
    from_orca,
    from_table,
    orca_order,
    parse_toml,
)

TABLE = """joint,motor,spool_radius [mm],joint_radius [mm],direction,low [deg],high [deg]
index_mcp,1,7,8,1,-20,95
index_pip,two,6.5,7.5,-1,0,105
"""


@pytest.fixture
def read(tmp_path: Path) -> Callable[[str], Imported]:
    """Read a table from a file."""

    def call(text: str) -> Imported:
        path = tmp_path / "hand.csv"
        path.write_text(text)
        return from_table(path)

    return call


def test_a_table_becomes_a_rig_with_its_numbers(read) -> None:
    rig = read(TABLE).rig
    assert [joint.name for joint in rig.joints] == ["index_mcp", "index_pip"]
    assert rig.joints[0].stops == pytest.approx((radians(-20), radians(95)))
    motor = rig.drives[0]
    assert (motor.kind, motor.name, motor.radius.value) == ("capstan", "motor_1", 7e-3)
    arms = [tendon.arms()["index_mcp"] for tendon in rig.tendons[:2]]
    assert arms == pytest.approx([8e-3, -8e-3])
    signs = {sensor.name: sensor.sign for sensor in rig.sensors_of("position")}
    assert signs == {"motor_1_position": 1, "two_position": -1}


@pytest.mark.parametrize("separator", [";", "\t"])
def test_a_spreadsheets_other_separators_and_notes_are_read(read, separator: str) -> None:
    assert read("# our hand\n\n" + TABLE.replace(",", separator)).rig == read(TABLE).rig


def test_the_text_is_the_rig_and_marks_each_guess(read) -> None:
    imported = read(TABLE)
    assert build_rig(parse_toml(imported.text, "text", RigError), "hand") == imported.rig
    assert imported.text.count("not in the table:") > 10
    for guess in ("slack of tendons", "torque constants", "friction of joints"):
        assert guess in imported.missing
        assert guess in imported.text


def test_one_tendon_over_three_joints_has_springs_and_no_second_tendon(read) -> None:
    rig = read("""joint,motor,spool_radius,joint_radius,back,low,high,follows,ratio
mcp,1,9 mm,12 mm,spring,0 deg,90 deg,,
pip,1,9 mm,7 mm,spring,0 deg,90 deg,,
dip,,,,,0 deg,60 deg,pip,0.7
""").rig
    (tendon,) = rig.tendons
    assert tendon.arms() == pytest.approx({"mcp": 12e-3, "pip": 7e-3})
    mcp, pip, dip = rig.joints
    assert mcp.spring is not None
    assert pip.spring is not None
    assert dip.coupled is not None
    assert dip.coupled.ratio == pytest.approx(0.7)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("joint_radius [mm]", "joint_radios [mm]", "did you mean 'joint_radius'"),
        ("low [deg]", "low", "line 2: low: '-20' has no unit"),
        ("low [deg]", "low [mm]", "line 2: low: unit 'mm' is no angle"),
        ("-20,95", "95,-20", "from a lower to a higher angle"),
        ("-20,95", "-20,9500", r"is the unit right\?"),
        (",1,-20", ",2,-20", "must be 1 or -1, '2' came"),
        ("1,7,8", "1,0.007,8", "must be from 0.0001 to 0.5 m, 7e-06 came"),
        ("index_mcp,1", "index_mcp,", "needs a motor"),
        (
            "index_pip,two",
            "index_mcp,two",
            "joint 'index_mcp' has several lines with different 'low'",
        ),
        (
            "two,6.5",
            "1,7",
            r"motor 'motor_1' has several joints \(.*\): give each a motor, or 'spring' in 'back'",
        ),
        ("joint,motor", "joint,joint", "two columns are called 'joint'"),
        (TABLE.partition("\n")[2], "", "a line of names"),
    ],
)
def test_a_wrong_table_is_one_line(read, old: str, new: str, says: str) -> None:
    with pytest.raises(RigError, match=says):
        read(TABLE.replace(old, new))


def test_a_zero_in_counts_is_an_angle_and_columns_have_names(read) -> None:
    header = "joint,motor,low [deg],high [deg],counts,zero [count]"
    columns = "position_column,current_column,time_column"
    rig = read(f"{header},{columns}\na,1,0,90,4096,1024,raw,amps,stamp [ms]\n").rig
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
            read(f"{header}\na,1,0,90,{cells}\n")


CONFIG = {
    "joint_to_motor_map": {"mcp": 3, "pip": -1},
    "joint_roms": {"mcp": [-20, 90], "pip": [0, 100]},
    "joint_motor_travel_v21": {"mcp": 110.0, "pip": 90.0},
}


@pytest.fixture
def written(tmp_path: Path) -> Callable[..., Path]:
    """Write a config with other members, or another file, as YAML."""

    def call(name: str = "config", **content: object) -> Path:
        path = tmp_path / f"{name}.yaml"
        path.write_text(yaml.safe_dump(CONFIG | content if name == "config" else content))
        return path

    return call


def test_a_calibration_says_ratio_sign_and_zero(written) -> None:
    config, limits = written(), {3: [1.0, 3.0], 1: [0.5, 2.5]}
    with pytest.raises(RigError, match="calibrated: false"):
        from_orca(config, written("calibration", motor_limits=limits, calibrated=False))
    rig = from_orca(config, written("calibration", motor_limits=limits)).rig
    drives = {drive.name: drive for drive in rig.drives}
    positions = {sensor.of: sensor for sensor in rig.sensors_of("position")}
    for number, joint, sign in ((3, (-20, 90), 1), (1, (0, 100), -1)):
        ratio = 8e-3 / drives[f"motor_{number}"].radius.value  # type: ignore[union-attr]
        # the travel also holds stretch and play: the ratio is a little less
        assert 0.85 < ratio * radians(joint[1] - joint[0]) / 2.0 < 1.0
        position = positions[f"motor_{number}"]
        assert position.sign == sign
        # in the middle of its travel the motor's reading is that of the joint in the middle of its
        # range
        at = sign * sum(limits[number]) / 2 - position.bias.value
        assert at / ratio == pytest.approx(radians(sum(joint) / 2), abs=1e-6)


def test_a_config_alone_says_what_is_missing(written) -> None:
    imported = from_orca(written())
    assert any("2.1" in note for note in imported.notes)
    assert any("zero is not known" in note for note in imported.notes)
    assert imported.rig.sensors_of("position")[0].bias.std > radians(30)


@pytest.mark.parametrize(("revision", "sign"), [("auto", 1), (21, -1)])
def test_the_map_of_a_revision_counts_where_it_is_that_one(written, revision, sign: int) -> None:
    path = written(joint_to_motor_map_v21={"mcp": -3}, hardware_version=revision)
    assert sign in {s.sign for s in from_orca(path).rig.sensors_of("position") if s.of == "motor_3"}


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
        ({"joint_roms": {"mcp": [0, 10**400]}}, "input should be a valid number"),
        ({"joint_roms": {"mcp": [-0.35, 1.66], "pip": [0, 1.83]}}, "in radians"),
    ],
)
def test_a_wrong_config_is_one_line(written, change: dict[str, object], says: str) -> None:
    with pytest.raises(RigError, match=says):
        from_orca(written(**change))


def test_the_order_of_its_own_calibration_is_that_of_a_routine(written) -> None:
    steps = [
        {"step": 1, "joints": {"mcp": "flex", "abd": "flex"}},
        {"step": 2, "joints": {"mcp": "extend", "abd": "extend"}},
        {"step": 3, "joints": {"pip": "flex"}},
    ]
    assert orca_order(written(calibration_sequence=steps)) == [["abd", "mcp"], ["pip"]]
    with pytest.raises(RigError, match="calibration_sequence: is missing"):
        orca_order(written())


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


def test_an_sdk_is_asked_and_not_run_with_its_serial_port(read, tmp_path: Path) -> None:
    (tmp_path / "joints_to_actuations.py").write_text(SDK)
    (tmp_path / "aero_hand.py").write_text(HAND)
    script = Path(__file__).parents[2] / "examples" / "hands" / "aero_table.py"
    words = [sys.executable, script, tmp_path]
    imported = read(subprocess.run(words, capture_output=True, text=True, check=True).stdout)
    assert imported.notes == ()
    rig = imported.rig
    assert [drive.name for drive in rig.drives] == ["abd", "finger"]
    arms = {tendon.name: tendon.arms() for tendon in rig.tendons}
    assert arms["finger"] == pytest.approx({"abd": -2e-3, "mcp": 12e-3, "pip": 6e-3})
    # the motor that turns its joint directly holds it both ways
    assert arms["abd_plus"]["abd"] == -arms["abd_minus"]["abd"] == pytest.approx(10e-3)
    assert rig.joints[0].stops == pytest.approx((0.0, radians(100)))
    sensors = rig.sensors_of("position")
    assert {(sensor.unit, sensor.bias.value) for sensor in sensors} == {("deg", 0.0)}


def test_a_direction_that_is_left_out_is_said(read) -> None:
    (note,) = read("""joint,motor,direction,low [deg],high [deg],follows,ratio
a,1,-1,0,90,,
b,2,,0,90,,
c,,,0,60,b,0.6
""").notes
    assert note.startswith(
        "no direction of b: each angle is taken to grow with its motor's reading"
    )
    assert read(TABLE).notes == ()
