"""`distal control` as a user runs it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from distal import load_rig, read_log
from tests.cli.test_cli import refused, run  # noqa: F401

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


@pytest.mark.filterwarnings("ignore:.*where its drive cannot be so soon")
def test_three_feedbacks_side_by_side(run, tmp_path: Path) -> None:
    scenario, out, one = (tmp_path / name for name in ("short.toml", "out", "one"))
    scenario.write_text(SHORT)
    said = run(f"control {scenario} --out {out}").out
    rows = re.findall(r"(?m)^ *(encoder|adaptive|ratio) +\S+ +(\S+)", said)
    assert [name for name, _ in rows] == ["encoder", "adaptive", "ratio"]
    assert 0.0 < float(rows[0][1]) < 10.0
    for name, _ in rows:
        assert len(read_log(out / f"{name}.csv", load_rig("paper-2008"))) == 200
    assert (out / "control.png").stat().st_size > 10_000
    assert "elastic" in run(f"control {scenario} --out {one} --feedback elastic").out
    assert sorted(path.name for path in one.iterdir()) == ["control.png", "elastic.csv"]


def test_a_scenario_without_a_controller_is_refused(run, tmp_path: Path) -> None:
    out = tmp_path / "nowhere"
    said = "series-1: has no [control]; see distal scenario show control-paper"
    refused(run(f"control series-1 --out {out}"), said)
    assert not out.exists()
