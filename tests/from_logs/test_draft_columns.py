"""The columns of logs for a rig file that does not name them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from distal.errors import LogError
from distal.from_logs import draft_columns
from distal.logs import read_log
from distal.rig import Rig, edited_text, from_table, load_rig
from tests.from_logs.logs import Floats, written

TABLE = """joint,motor,spool_radius [mm],joint_radius [mm],direction,low [deg],high [deg]
mcp,1,7,8,1,-20,95
pip,2,7,7.5,1,0,105
"""


def draft(folder: Path, lines: str = TABLE) -> tuple[Path, Rig]:
    """Return the file of a hand of two joints, whose drives are motor_1 and motor_2, and it."""
    table = folder / "hand.csv"
    table.write_text(lines, encoding="utf-8")
    path = folder / "hand.toml"
    path.write_text(from_table(table).text, encoding="utf-8")
    return path, load_rig(path)


def two_motors(seed: int, first: str, second: str) -> dict[str, Floats]:
    """Return a log in which two motors of such names turn two joints."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 10.0, 0.02)
    columns = {"time_s": time}
    for motor, joint, rate in ((first, "mcp", 0.7), (second, "pip", 0.4)):
        angle = 20.0 * np.sin(2.0 * np.pi * rate * time + rng.uniform(0.0, 6.28))
        columns[f"{motor} position [deg]"] = 1.1 * angle + rng.normal(0.0, 0.05, len(time))
        columns[f"{motor} current [mA]"] = 80.0 * np.sign(np.cos(rate * time)) + rng.normal(
            0.0, 5.0, len(time)
        )
        columns[f"{joint} angle [deg]"] = angle
    return columns


def drafted(folder: Path, first: str = "Motor 1", second: str = "Motor 2") -> list[Path]:
    """Write three logs of two motors."""
    return written([two_motors(k, first, second) for k in range(3)], folder)


def completed(path: Path, assignments: Sequence[str]) -> Rig:
    """Return the rig of a file with some assignments."""
    made = path.with_name("completed.toml")
    made.write_text(edited_text(path, assignments), encoding="utf-8")
    return load_rig(made)


def test_columns_are_found_by_the_names_of_drives_and_joints(tmp_path: Path) -> None:
    """They come with the units of their headers and with their rates, and the log can be read."""
    path, rig = draft(tmp_path)
    logs = drafted(tmp_path)
    with pytest.raises(LogError, match="is missing"):
        read_log(logs[0], rig)
    columns = draft_columns(rig, logs)
    assert len(columns.in_words) == len(rig.sensors) + 1
    whole = completed(path, columns.assignments)
    log = read_log(logs[0], whole)
    by_name = {sensor.name: sensor for sensor in whole.sensors}
    assert by_name["motor_2_position"].log_column == "Motor 2 position"
    assert by_name["motor_2_position"].unit == "deg"
    assert by_name["motor_1_current"].rate == pytest.approx(50.0, rel=0.01)
    assert len(log.time) == 500


def test_columns_of_drives_of_other_names_stay_unknown(tmp_path: Path) -> None:
    """Which of two motors is the first is no guess of the command's."""
    _, rig = draft(tmp_path)
    logs = drafted(tmp_path, "left", "right")
    columns = draft_columns(rig, logs)
    assert not any("motor_" in line for line in columns.assignments)
    assert any("encoder_pip" in line for line in columns.assignments)


def test_columns_that_the_rig_file_names_stay(tmp_path: Path) -> None:
    path, rig = draft(tmp_path)
    logs = drafted(tmp_path)
    whole = completed(path, draft_columns(rig, logs).assignments)
    assert draft_columns(whole, logs).assignments == ()


@pytest.mark.parametrize("name", ["l'angle", 'the "finger"'])
def test_the_only_column_of_a_kind_may_have_any_name(tmp_path: Path, name: str) -> None:
    """A quotation mark in it does not end the text in the rig file."""
    path, rig = draft(tmp_path, "\n".join(TABLE.splitlines()[:2]))
    logs = []
    for k in range(3):
        columns = two_motors(k, "left", "right")
        header = name.replace('"', '""')
        kept = {
            f'"{header} [deg]"': columns["mcp angle [deg]"],
            "left position [deg]": columns["left position [deg]"],
            "left current [mA]": columns["left current [mA]"],
        }
        logs.append({"time_s": columns["time_s"], **kept})
    found = draft_columns(rig, written(logs, tmp_path), truth=[name])
    columns = {sensor.log_column for sensor in completed(path, found.assignments).sensors}
    assert columns == {name, "left position", "left current"}


def test_two_sensors_of_one_drive_are_not_both_read_in_its_column(tmp_path: Path) -> None:
    path, _ = draft(tmp_path)
    text = path.read_text(encoding="utf-8")
    second = text[text.index('[[sensors]]\nname = "motor_1_position"') :]
    second = second[: second.index("[[sensors]]", 5)].replace("motor_1_position", "second")
    path.write_text(f"{text}\n{second}", encoding="utf-8")
    logs = drafted(tmp_path)
    lines = draft_columns(load_rig(path), logs).assignments
    assert not any("motor_1_position" in line or "second" in line for line in lines)
    assert any("motor_2_position" in line for line in lines)
