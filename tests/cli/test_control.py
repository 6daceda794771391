"""`distal control` as a user runs it."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from distal import load_rig, read_log
from distal.cli.app import app
from distal.errors import ControlError

SHORT = """
rig = "paper-2008"
duration = "2 s"
[control]
period = "20 ms"
co_contraction = "4 N"

[control.joints.link]
reference = [["0 s", "0 deg"], ["0.5 s", "0 deg"], ["1 s", "8 deg"]]
proportional = "0.3 N m/rad"
torque_limit = "0.08 N m"
"""


def run(*arguments: str) -> str:
    made = CliRunner().invoke(app, arguments, env={"COLUMNS": "160"}, catch_exceptions=False)
    assert made.exit_code == 0, made.output
    return made.output


@pytest.mark.filterwarnings("ignore:.*where its drive cannot be so soon")
def test_three_feedbacks_side_by_side(tmp_path: Path) -> None:
    (tmp_path / "short.toml").write_text(SHORT)
    said = run("control", str(tmp_path / "short.toml"), "--out", str(tmp_path / "out"))
    rows = [
        line.split()
        for line in said.splitlines()
        if line.split()[:1] in (["encoder"], ["adaptive"], ["ratio"])
    ]
    assert [row[0] for row in rows] == ["encoder", "adaptive", "ratio"]
    assert 0.0 < float(rows[0][2]) < 10.0
    for name in ("encoder", "adaptive", "ratio"):
        log = read_log(tmp_path / "out" / f"{name}.csv", load_rig("paper-2008"))
        assert len(log) == 200
    assert (tmp_path / "out" / "control.png").stat().st_size > 10_000
    said = run(
        "control",
        str(tmp_path / "short.toml"),
        "--out",
        str(tmp_path / "one"),
        "--feedback",
        "elastic",
    )
    assert "elastic" in said
    assert sorted(path.name for path in (tmp_path / "one").iterdir()) == [
        "control.png",
        "elastic.csv",
    ]


def test_a_scenario_without_a_controller_is_refused() -> None:
    with pytest.raises(
        ControlError, match=r"series-1: has no \[control\]; see distal scenario show control-paper"
    ):
        CliRunner().invoke(app, ["control", "series-1", "--out", "nowhere"], catch_exceptions=False)
    assert not Path("nowhere").exists()
