"""What takes long is said on stderr, where that is a terminal."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest

from distal.cli.shared_options import working


def test_elsewhere_nothing_is_said(capfd: pytest.CaptureFixture[str]) -> None:
    with working("first") as show:
        show("second")
    with pytest.raises(ValueError, match="wrong"), working("third"):
        raise ValueError("wrong")
    assert capfd.readouterr().err == ""


def test_a_spinner_on_a_terminal_leaves_the_output_where_it_goes(tmp_path: Path) -> None:
    """Standard error is a terminal, standard output a file: what is printed meanwhile stands in the
    file.
    """
    code = """
from distal.cli.shared_options import progress_bar, say, working
with working("thinking [1]"):
    say("one")
with progress_bar("counting", 2) as advance:
    advance(1)
    say("two")
"""
    near, far = pty.openpty()
    out = tmp_path / "out.txt"
    with out.open("w") as file:
        subprocess.run([sys.executable, "-c", code], stdout=file, stderr=far, check=True)
    os.close(far)
    shown = os.read(near, 65536).decode()
    assert "thinking [1]" in shown
    assert "counting" in shown
    assert out.read_text() == "one\ntwo\n"
