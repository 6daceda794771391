"""Logs as they come: units and cells that are wrong, slow cameras, stuck and wild references."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import distal
from distal.from_logs import rig_from_logs
from tests.from_logs.logs import drafted, finger, fingers, write, written


def test_a_time_in_another_unit_than_its_name_says_changes_no_size(tmp_path: Path) -> None:
    right = drafted(fingers(), tmp_path).rig
    wrong = [
        {"time [s]" if name == "t_ms" else name: column for name, column in log.items()}
        for log in fingers()
    ]
    (tmp_path / "wrong").mkdir()
    found = drafted(wrong, tmp_path / "wrong")
    assert any("taken as ms" in column.evidence for column in found.columns)
    assert found.rig.log.time.unit == "ms"
    for one, other in zip(found.rig.drives, right.drives):
        assert one.damping.value == pytest.approx(other.damping.value)
        assert one.friction == other.friction
    assert found.rig.sensors[0].rate == pytest.approx(100.0, rel=0.01)


def test_a_log_at_a_fifth_of_the_rate_is_no_mistake(tmp_path: Path) -> None:
    changed = fingers()
    changed[2] = {name: column[::5] for name, column in changed[2].items()}
    arms = drafted(changed, tmp_path).rig.tendons[0].arms()
    assert arms["mcp"] == pytest.approx(8e-3, rel=0.03)


@pytest.mark.parametrize(
    ("header", "unit"), [("F_a [Nfoo]", "Nfoo"), ("x_a [gon]", "gon"), ("mcp [LSB]", "LSB")]
)
def test_a_unit_in_brackets_that_nobody_knows_is_refused(
    tmp_path: Path, header: str, unit: str
) -> None:
    old = {"F": "F_a", "x": "x_a_mm", "m": "mcp_deg"}[header[0]]
    changed = [
        {header if name == old else name: column for name, column in log.items()}
        for log in fingers()
    ]
    with pytest.raises(distal.DistalError, match=f"the unit '{unit}' is not known"):
        drafted(changed, tmp_path)


def test_arms_that_cannot_be_are_refused(tmp_path: Path) -> None:
    changed = [log | {"x_a_mm": 1e3 * log["x_a_mm"]} for log in fingers()]
    with pytest.raises(distal.DistalError, match=r"x_a_mm moves by \d+ mm for each rad"):
        drafted(changed, tmp_path)


def test_a_column_of_text_is_named_and_left_out(tmp_path: Path) -> None:
    paths = written(fingers(), tmp_path)
    for path in paths:
        lines = path.read_text().splitlines()
        words = ["note", *(["ok"] * (len(lines) - 1))]
        path.write_text("\n".join(f"{line},{word}" for line, word in zip(lines, words)))
    assert any("note" in note for note in rig_from_logs(paths).notes)


def test_a_joint_that_one_log_lacks_keeps_its_arms(tmp_path: Path) -> None:
    changed = fingers()
    changed[2]["pip_deg"] = np.full_like(changed[2]["pip_deg"], np.nan)
    found = drafted(changed, tmp_path)
    arms = next(t for t in found.rig.tendons if t.name == "b").arms()
    assert arms["pip"] == pytest.approx(-5e-3, rel=0.03)
    assert any("pip_deg has no values in" in note and "run_2" in note for note in found.notes)
    del changed[2]["pip_deg"]
    assert drafted(changed, tmp_path).rig.joint_names == ["mcp", "pip"]
    changed[2]["F_a"] = np.full_like(changed[2]["F_a"], np.nan)
    with pytest.raises(distal.DistalError, match=r"'F_a' has no values in .*run_2"):
        drafted(changed, tmp_path)


def test_a_camera_of_ten_hertz_with_empty_cells_is_enough(tmp_path: Path) -> None:
    changed = fingers()
    for log in changed:
        for name in ("mcp_deg", "pip_deg"):
            slow = np.full_like(log[name], np.nan)
            slow[::10] = log[name][::10]
            log[name] = slow
    rig = drafted(changed, tmp_path).rig
    assert next(iter(rig.tendons)).arms()["mcp"] == pytest.approx(8e-3, rel=0.05)
    rates = {sensor.log_column: sensor.rate for sensor in rig.sensors}
    assert rates["mcp_deg"] == pytest.approx(10.0, rel=0.02)


def test_stuck_references_are_refused_and_wild_ones_left_out(tmp_path: Path) -> None:
    changed = fingers()
    changed[1]["mcp_deg"][500:1500] = changed[1]["mcp_deg"][500]
    with pytest.raises(distal.DistalError, match=r"run_1.csv: mcp_deg stays at .* is it stuck"):
        drafted(changed, tmp_path)
    changed = fingers()
    changed[0]["pip_deg"][100::400] = 9999.0
    found = drafted(changed, tmp_path)
    assert any("run_0.csv: pip_deg jumps away and back 5 times" in note for note in found.notes)
    arms = next(t for t in found.rig.tendons if t.name == "b").arms()
    assert arms["pip"] == pytest.approx(-5e-3, rel=0.03)


def test_columns_that_only_their_values_describe_are_asked_for(tmp_path: Path) -> None:
    names = dict(zip(finger(0), "tabcdefgh"))
    changed = [{names[name]: column for name, column in log.items()} for log in fingers()]
    paths = written(changed, tmp_path)
    with pytest.raises(distal.DistalError, match="if this is right, add: --drive a ") as no:
        rig_from_logs(paths)
    words = str(no.value).partition("add: ")[2].split()
    drives = [name for option, name in pairwise(words) if option == "--drive"]
    truth = words[words.index("--truth") + 1].split(",")
    columns = rig_from_logs(paths, drives=dict.fromkeys(drives, ""), truth=truth).columns
    sure = {column.header: column.sureness for column in columns}
    assert {sure[name] for name in (*drives, *truth)} == {"sure"}


def test_a_joint_that_was_forgotten_is_asked_for(tmp_path: Path) -> None:
    """Its name says nothing, and it moves as the drives do: as another joint, or as a copy."""
    changed = fingers()
    for log in changed:
        log["deviation"] = log.pop("pip_deg")
    paths = written(changed, tmp_path)
    with pytest.raises(distal.DistalError, match="deviation moves as the drives do") as no:
        rig_from_logs(paths)
    truth = str(no.value).partition("--truth ")[2].partition(", or none")[0].split(",")
    assert rig_from_logs(paths, truth=truth).rig.joint_names == ["mcp", "deviation"]
    assert rig_from_logs(paths, ignore=["deviation"]).rig.joint_names == ["mcp"]


def test_repeated_stamps_an_empty_file_and_ignoring_the_time(tmp_path: Path) -> None:
    changed = fingers()
    for log in changed:
        log["t_ms"] = np.repeat(log["t_ms"][::2], 2)
    assert drafted(changed, tmp_path).rig.log.time.repeated == "spread"
    with pytest.raises(distal.DistalError, match="'t_ms' is the only column that increases"):
        rig_from_logs(written(fingers(), tmp_path), ignore=["t_ms"])
    empty = tmp_path / "empty.csv"
    empty.write_text(",".join(finger(0)) + "\n")
    with pytest.raises(distal.DistalError, match="0 rows are too few"):
        rig_from_logs([empty])
    with pytest.raises(distal.DistalError, match="a drive is read in a length or an angle"):
        rig_from_logs(written(fingers(), tmp_path), drives={"x_a_mm": "bananas"})
    assert write(finger(0), tmp_path / "a b (c).csv").exists()
