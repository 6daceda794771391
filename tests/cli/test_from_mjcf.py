"""`distal rig from-mjcf` as a user runs it."""

from __future__ import annotations

from pathlib import Path

import pytest

from distal import load_rig
from tests.cli.test_cli import refused, run  # noqa: F401
from tests.rig.mjcf.models import FINGER

pytest.importorskip("mujoco")


@pytest.fixture
def model(tmp_path: Path) -> Path:
    path = tmp_path / "finger.xml"
    path.write_text(FINGER)
    return path


def test_a_rig_file_that_the_other_commands_take(run, model: Path, tmp_path: Path) -> None:
    out = tmp_path / "finger.toml"
    ran = run(f"rig from-mjcf {model} --out {out}")
    assert ran.code == 0
    assert "no driven tendon turns thumb: held where the model has them" in ran.out
    assert "not in the model" in ran.out
    assert len(load_rig(out).joints) == 3
    assert run(f"rig draw {out} --out {tmp_path / 'finger.png'}").code == 0


def test_a_refusal_is_a_line(run, model: Path, tmp_path: Path) -> None:
    said = "unit 'kg' has the wrong dimension; a unit like 'm' is allowed"
    refused(run(f"rig from-mjcf {model} --out {tmp_path / 'rig.toml'} --length-unit kg"), said)
    refused(run(f"rig from-mjcf {model} --out {tmp_path / 'rig.toml'} --chain a"), "no body")
    assert not (tmp_path / "rig.toml").exists()


def test_no_file_is_ever_overwritten(run, model: Path, tmp_path: Path) -> None:
    """A rig file may have been changed by hand since."""
    mine = tmp_path / "rig.toml"
    mine.write_text("name = 'mine'\n")
    for out in (mine, model):
        refused(run(f"rig from-mjcf {model} --out {out}"), str(out))
    assert (mine.read_text(), model.read_text()) == ("name = 'mine'\n", FINGER)
