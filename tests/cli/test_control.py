"""`distal control` and `distal drift` as a user runs them."""

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
LONG = """
rig = "paper-2008"
duration = "2 min"
[drives.left]
weight = { mean = "4 N", amplitude = "1 N", frequency = "0.2 Hz" }
[drives.right]
weight = "4 N"
[schedule]
"tendons.*.stiffness" = { per_hour = "-1 %" }
[rezero]
every = "1 min"
lasts = "2 s"
angle = "0 deg"
std = "5 deg"
drives = { left = { weight = "4 N" } }
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


def test_hours_are_told_one_by_one(tmp_path: Path) -> None:
    (tmp_path / "long.toml").write_text(LONG)
    said = run("drift", str(tmp_path / "long.toml"), "--out", str(tmp_path / "out"))
    assert [
        line.split()[0]
        for line in said.splitlines()
        if line.strip().startswith(("nothing", "rezeroed")) and "simulated" not in line
    ] == ["nothing", "rezeroed"]
    rows = (tmp_path / "out" / "drift.csv").read_text().splitlines()
    assert len(rows) == 3
    assert rows[1].startswith("nothing known,1,")
    assert (tmp_path / "out" / "drift.png").exists()


def test_the_share_of_the_hours_that_are_done_is_shown() -> None:
    from types import SimpleNamespace

    from distal.cli.simulation_commands import _with_progress

    pieces = [SimpleNamespace(log=SimpleNamespace(time=[0.0, end])) for end in (900.0, 3600.0)]
    shown: list[str] = []
    assert list(_with_progress(pieces, shown.append, 3600.0, "rezeroed")) == pieces
    assert shown == [f"rezeroed: {share} % simulated and estimated" for share in (25, 100)]
