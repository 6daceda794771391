"""The commands of the page "my hand": from a table or a maker's files to a calibrated rig."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from distal import load_rig, write_log
from distal.cli.app import app
from distal.errors import LogError, OutputError, RigError
from tests.support.hands import calibrated, rig_of
from tests.support.servo_hands import orca_like

TABLE = """joint,motor,spool_radius [mm],joint_radius [mm],direction,low [deg],high [deg]
index_mcp,m1,7.272727,8,1,-25,100
ring_abd,m2,7.608696,7,1,-27,27
"""


def run(*arguments: str) -> Result:
    """Run a command."""
    return CliRunner().invoke(app, list(arguments))


def test_an_orca_hand(tmp_path: Path) -> None:
    config, out = tmp_path / "config.yaml", tmp_path / "hand.toml"
    config.write_text("joint_to_motor_map: {mcp: 3}\njoint_roms: {mcp: [-20, 90]}\n")
    done = run("rig", "from-orca", str(config), "--out", str(out))
    assert done.exit_code == 0, done.output
    assert "zero is not known" in done.output
    before, other = out.read_text(), tmp_path / "other.toml"
    done = run("rig", "from-orca", str(config), "--out", str(out))
    assert isinstance(done.exception, OutputError)
    assert out.read_text() == before
    config.write_text("joint_to_motor_map: {mcp: 3}\n")
    done = run("rig", "from-orca", str(config), "--out", str(other))
    assert isinstance(done.exception, RigError)
    assert not other.exists()
    assert isinstance(
        run("rig", "from-orca", str(config), "--out", str(config)).exception, OutputError
    )


@pytest.mark.slow
def test_a_routine_becomes_a_calibrated_rig_and_says_what_moved(tmp_path: Path) -> None:
    known, hands = orca_like([3], ("index_mcp", "ring_abd"))
    rig = rig_of(known)
    ((_, log),) = calibrated(known, hands, rig)
    table, hand, routine, out = (
        tmp_path / name for name in ("hand.csv", "hand.toml", "routine.csv", "out.toml")
    )
    table.write_text(TABLE)
    write_log(log, rig, routine)
    done = run("rig", "from-table", str(table), "--out", str(hand))
    assert done.exit_code == 0, done.output
    assert "slack of tendons" in done.output
    assert run("rig", "check", str(hand)).exit_code == 0
    done = run("calibrate", str(routine), "--rig", str(hand), "--out", str(out))
    assert done.exit_code == 0, done.output
    assert "index_mcp" in done.output
    assert "of play" in done.output
    found = load_rig(out)
    assert out.read_text().startswith(
        "# Fitted by `distal calibrate` to the power-on routine routine.csv"
    )
    assert "# not in the table" in out.read_text()
    assert found.sensors_of("position")[0].bias.std < 0.1
    still = run("calibrate", str(table), "--rig", str(hand), "--out", str(out))
    assert isinstance(still.exception, LogError)
    assert load_rig(out) == found
    # the same hand with a file in which a motor turns the other way
    zero = found.sensors_of("position")[0].bias.value
    turned = ("position.sign=-1", "current.sign=-1", f"position.bias={-zero}")
    wrong = [f"--set=sensors.m1_{change}" for change in turned]
    again = ("calibrate", str(routine), "--rig", str(out), "--out", str(tmp_path / "again.toml"))
    done = run(*again, *wrong)
    assert "it turns the other way" in " ".join(done.output.split())
    assert load_rig(tmp_path / "again.toml").sensors[0].sign == -1
    done = run(*again, *wrong, "--accept")
    assert "corrected: m1" in " ".join(done.output.split())
    assert load_rig(tmp_path / "again.toml").sensors[0].sign == 1
