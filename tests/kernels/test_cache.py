"""The cache of compiled kernels: what lies in it is run, so it must be this user's alone."""

from __future__ import annotations

import os
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


@pytest.mark.parametrize("mode", [0o770, 0o707, 0o777, 0o1777, None])
def test_a_folder_of_others_is_not_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mode: int | None
) -> None:
    """Others can write to it, or it is another user's."""
    reason = f"others can write to it (mode {mode or 0:o}); chmod go-w helps"
    if mode is None:
        monkeypatch.setattr(os, "geteuid", lambda: tmp_path.stat().st_uid + 1)
        reason = "it belongs to another user"
    tmp_path.chmod(mode or 0o755)
    assert f"is not used: {reason}" in used(tmp_path, monkeypatch)
    assert not list(tmp_path.iterdir())
    if mode:
        tmp_path.chmod(0o755)
        check_own(tmp_path)


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
