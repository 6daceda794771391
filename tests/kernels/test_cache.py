"""The cache of compiled kernels: what lies in it is run, so it must be this user's alone."""

from __future__ import annotations

import os
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

from distal.kernels import Kernel, cache_folder
from distal.kernels.compiler import check_own
from tests.kernels.test_kernels import small_function


def used(folder: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setenv("DISTAL_CACHE", str(folder))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        kernel = Kernel(small_function())
    return kernel.backend if kernel.backend == "compiled" else kernel.reason


@pytest.mark.parametrize("mode", [0o770, 0o707, 0o777, 0o1777])
def test_a_folder_that_others_can_write_is_not_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mode: int
) -> None:
    tmp_path.chmod(mode)
    said = used(tmp_path, monkeypatch)
    assert f"is not used: others can write to it (mode {mode:o}); chmod go-w helps" in said
    assert not list(tmp_path.iterdir())
    tmp_path.chmod(0o755)
    check_own(tmp_path)


def test_a_folder_of_another_user_is_not_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: tmp_path.stat().st_uid + 1)
    assert "is not used: it belongs to another user" in used(tmp_path, monkeypatch)
    assert not list(tmp_path.iterdir())


def test_a_folder_that_is_not_there_is_made_for_this_user_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert used(tmp_path / "a" / "b", monkeypatch) == "compiled"
    assert (tmp_path / "a" / "b").stat().st_mode & 0o077 == 0


def test_without_a_home(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISTAL_CACHE")

    def lost() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", lost)
    assert cache_folder().name == f"distal-{os.getuid()}"


@pytest.mark.more
@pytest.mark.slow  # a process of its own, whose user has no name and no folder
def test_commands_without_a_home(tmp_path: Path) -> None:
    kept = {
        key: value
        for key, value in os.environ.items()
        if key not in ("HOME", "XDG_CACHE_HOME", "DISTAL_CACHE")
    }
    program = (
        "import pwd; pwd.getpwuid = lambda number: {}[number]\nfrom distal.cli import main; main()"
    )
    for words in (
        ["doctor"],
        ["simulate", "series-2", "--out", "log.csv"],
        [
            "estimate",
            "log.csv",
            "--rig",
            "paper-2008-printed",
            "-e",
            "inextensible",
            "--plot",
            "plot.png",
        ],
    ):
        done = subprocess.run(
            [sys.executable, "-c", program, *words],
            env=kept,
            capture_output=True,
            text=True,
            check=False,
            cwd=tmp_path,
        )
        assert done.returncode == 0, done.stderr
        assert "Traceback" not in done.stderr
    assert (tmp_path / "plot.png").is_file()
