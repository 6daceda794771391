"""The tutorial's commands, run in their order as a reader would; what it shows of their output is
what they print.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

PAGE = (Path(__file__).parents[1] / "docs" / "tutorial.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```(sh|text)\n(.*?)```", PAGE, re.S)
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?")
NEAR = 0.3
"""Numbers of another machine may differ: the fit stops where it stops."""


def alike(shown: str, printed: str) -> bool:
    """Return whether a printed line is the shown one: words are the same, numbers near, and …
    stands for anything.
    """
    shown, printed = (" ".join(text.split()) for text in (shown, printed))
    pattern = "".join(
        NUMBER.pattern if NUMBER.fullmatch(part) else ".*" if part == "…" else re.escape(part)
        for part in re.split(rf"({NUMBER.pattern}|…)", shown)
    )
    if not re.fullmatch(pattern, printed):
        return False
    if "…" in shown:
        return True
    pairs = zip(NUMBER.findall(shown), NUMBER.findall(printed))
    return all(
        abs(float(a) - float(b)) <= NEAR * max(abs(float(a)), abs(float(b))) + 1e-9
        for a, b in pairs
    )


def test_lines_are_compared_as_they_should() -> None:
    assert alike("adaptive: 1.5° (…)", "adaptive:   1.4° (whatever)")
    assert not alike("adaptive: 1.5°", "adaptive: 2.5°")
    assert not alike("adaptive: 1.5°", "adaptable: 1.5°")


@pytest.mark.slow
def test_every_command_and_what_it_shows(tmp_path: Path) -> None:
    command = tmp_path / "bin" / "distal"
    command.parent.mkdir()
    command.write_text(f"#!{sys.executable}\nfrom distal_command import main\n\nmain()\n")
    command.chmod(0o755)
    position = tmp_path / "work"
    position.mkdir()
    settings = {**os.environ, "PATH": f"{command.parent}:{os.environ['PATH']}", "COLUMNS": "200"}
    printed, compared = "", 0
    for kind, text in BLOCKS:
        if kind == "sh":
            done = subprocess.run(
                ["bash", "-e", "-c", text],
                cwd=position,
                env=settings,
                capture_output=True,
                text=True,
                check=False,
            )
            assert done.returncode == 0, f"{text}: {done.stderr}"
            assert "warning" not in done.stderr, done.stderr
            printed = done.stdout
            continue
        if text.startswith("time_ms"):  # what a log looks like
            printed = (position / "monday" / "run_0.csv").read_text()
            assert printed.splitlines()[0] == text.splitlines()[0]
            continue
        for line in filter(None, text.splitlines()):
            assert any(alike(line, other) for other in printed.splitlines()), (
                f"{line!r} is not in:\n{printed}"
            )
            compared += 1
    assert compared > 10
    for name in (
        "first.png",
        "after.png",
        "angle.csv",
        "fitted.toml",
        "live.jsonl",
    ):
        assert (position / name).stat().st_size > 1000, name
