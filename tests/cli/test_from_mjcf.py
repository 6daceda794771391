"""`distal rig from-mjcf` as a user runs it."""

from __future__ import annotations

from pathlib import Path

import pytest

from distal import load_rig
from tests.cli.test_cli import run  # noqa: F401
from tests.rig.mjcf.models import FINGER

pytest.importorskip("mujoco")


@pytest.fixture
def model(tmp_path: Path) -> Path:
    path = tmp_path / "finger.xml"
    path.write_text(FINGER)
    return path


def test_a_rig_file_that_the_other_commands_take(run, model: Path, tmp_path: Path) -> None:
    out = tmp_path / "finger.toml"
    ran = run("rig", "from-mjcf", model, "--out", out)
    assert ran.code == 0
    assert "no driven tendon turns thumb: held where the model has them" in ran.out
    assert "not in the model" in ran.out
    assert len(load_rig(out).joints) == 3
    assert run("rig", "check", out).code == 0
    assert run("rig", "draw", out, "--out", tmp_path / "finger.png").code == 0


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--chain", "proximl"], "no body is called 'proximl'"),
        (["--length-unit", "inch"], "--length-unit must be m, cm or mm, 'inch' came"),
    ],
)
def test_a_refusal_is_a_line(run, model: Path, tmp_path: Path, words: list[str], said: str) -> None:
    ran = run("rig", "from-mjcf", model, "--out", tmp_path / "rig.toml", *words)
    assert ran.code == 2
    assert said in ran.err
    assert len(ran.err.strip().splitlines()) == 1
    assert not (tmp_path / "rig.toml").exists()


def test_the_model_is_never_overwritten(run, model: Path) -> None:
    ran = run("rig", "from-mjcf", model, "--out", model)
    assert ran.code != 0
    assert model.read_text() == FINGER


def test_a_rig_file_is_never_overwritten(run, model: Path, tmp_path: Path) -> None:
    """It may have been changed by hand since."""
    out = tmp_path / "rig.toml"
    out.write_text("name = 'mine'\n")
    ran = run("rig", "from-mjcf", model, "--out", out)
    assert ran.code != 0
    assert str(out) in ran.err
    assert out.read_text() == "name = 'mine'\n"
