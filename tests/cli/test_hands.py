"""The commands of the page "my hand": from a table or a maker's files to a calibrated rig."""

from __future__ import annotations

from pathlib import Path

import pytest

from distal import load_rig, write_log
from tests.cli.test_cli import refused, run  # noqa: F401
from tests.support.hands import calibrated, rig_of
from tests.support.servo_hands import orca_like

TABLE = """joint,motor,spool_radius [mm],joint_radius [mm],direction,low [deg],high [deg]
index_mcp,m1,7.272727,8,1,-25,100
ring_abd,m2,7.608696,7,1,-27,27
"""


def test_an_orca_hand(run, tmp_path: Path) -> None:
    config, out, other = (tmp_path / name for name in ("config.yaml", "hand.toml", "other.toml"))
    config.write_text("joint_to_motor_map: {mcp: 3}\njoint_roms: {mcp: [-20, 90]}\n")
    assert "zero is not known" in run(f"rig from-orca {config} --out {out}").out
    for there in (out, config):
        before = there.read_text()
        refused(run(f"rig from-orca {config} --out {there}"), str(there))
        assert there.read_text() == before
    config.write_text("joint_to_motor_map: {mcp: 3}\n")
    refused(run(f"rig from-orca {config} --out {other}"), "joint_roms")
    assert not other.exists()


@pytest.mark.slow
def test_a_routine_becomes_a_calibrated_rig_and_says_what_moved(run, tmp_path: Path) -> None:
    known, hands = orca_like([3], ("index_mcp", "ring_abd"))
    rig = rig_of(known)
    ((_, log),) = calibrated(known, hands, rig)
    table, hand, routine, out, again = (
        tmp_path / name
        for name in ("hand.csv", "hand.toml", "routine.csv", "out.toml", "again.toml")
    )
    table.write_text(TABLE)
    write_log(log, rig, routine)
    assert "slack of tendons" in run(f"rig from-table {table} --out {hand}").out
    done = run(f"calibrate {routine} --rig {hand} --out {out}")
    assert done.code == 0, done.err
    assert "index_mcp" in done.out
    assert "of play" in done.out
    found, text = load_rig(out), out.read_text()
    assert text.startswith("# Fitted by `distal calibrate` to the power-on routine routine.csv")
    assert "# not in the table" in text
    assert found.sensors_of("position")[0].bias.std < 0.1
    refused(run(f"calibrate {table} --rig {hand} --out {out}"), "hand.csv")
    assert load_rig(out) == found
    # the same hand with a file in which a motor turns the other way
    zero = found.sensors_of("position")[0].bias.value
    turned = ("position.sign=-1", "current.sign=-1", f"position.bias={-zero}")
    wrong = " ".join(f"--set sensors.m1_{change}" for change in turned)
    for consent, said, sign in (
        ("", "it turns the other way", -1),
        ("--accept", "corrected: m1", 1),
    ):
        done = run(f"calibrate {routine} --rig {out} --out {again} {wrong} {consent}")
        assert said in " ".join((done.out + done.err).split())
        assert load_rig(again).sensors[0].sign == sign
