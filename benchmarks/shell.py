"""What a user runs: `distal` in a folder, and the files that it writes."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import tomlkit

from distal import Log, Rig, load_rig, write_log
from distal.fitting.fitted_file import plain_value


def command(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run `distal` in a folder, as a shell does."""
    return subprocess.run(
        [sys.executable, "-m", "distal", *words], cwd=folder, capture_output=True, text=True
    )


def write_rig(rig: Rig, path: Path) -> None:
    """Write a rig as its owner has it in a file."""
    raw = plain_value(rig.model_dump(exclude_defaults=True))
    path.write_text(tomlkit.dumps(raw), encoding="utf-8")


def written(rig: Rig, logs: Sequence[Log], subcommand: str, *words: str) -> Rig:
    """Return the rig of the file that `distal fit` or `distal calibrate` writes from some logs.

    Raises:
        RuntimeError: the command did not end with its file.
    """
    with tempfile.TemporaryDirectory() as kept:
        folder = Path(kept)
        write_rig(rig, folder / "mine.toml")
        names = [f"run_{i}.csv" for i in range(len(logs))]
        for name, log in zip(names, logs):
            write_log(log, rig, folder / name)
        done = command(
            folder, subcommand, *names, "--rig", "mine.toml", "--out", "written.toml", *words
        )
        if done.returncode:
            raise RuntimeError(done.stderr.strip().splitlines()[-1])
        return load_rig(folder / "written.toml")
