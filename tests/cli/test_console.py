"""What takes long is said on stderr: a bar on a terminal, else lines; what is quick says
nothing.
"""

from __future__ import annotations

import logging
import os
import pty
import subprocess
import sys
import time
from pathlib import Path

import casadi as ca
import pytest

from distal import estimate
from distal.cli import console, main
from distal.kernels import Kernel


def waited_for(capfd: pytest.CaptureFixture[str], text: str) -> str:
    """Return what came on stderr by the time that a text is there, at most after five seconds."""
    said, until = "", time.monotonic() + 5.0
    while text not in said and time.monotonic() < until:
        time.sleep(0.01)
        said += capfd.readouterr().err
    return said


def test_a_line_where_a_stage_lasts(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(console, "QUIET", 0.05)
    with console.working("first") as show:
        show("second")  # the first one was over at once
        said = waited_for(capfd, "…")
    assert said == "second …\n"


def test_what_is_quick_says_nothing(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(console, "QUIET", 0.2)
    with console.working("first"):
        pass
    with pytest.raises(ValueError, match="wrong"), console.working("second"):
        raise ValueError("wrong")
    time.sleep(0.4)
    assert capfd.readouterr().err == ""
    assert logging.getLogger("distal.kernels").handlers == []


def test_many_short_stages_are_not_a_line_each(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A batch of 50 in a second is one line, that comes though no stage lasts."""
    monkeypatch.setattr(console, "QUIET", 0.2)
    with console.progress_bar("estimating", 50) as advance:
        for done in range(50):
            time.sleep(0.01)
            advance(done)
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith("estimating: ")
    assert line.endswith(" of 50 …")


def test_a_compiler_is_named(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    from distal.kernels import compiler

    build = compiler._build

    def slow(*arguments: object) -> Path:
        time.sleep(0.3)
        return build(*arguments)  # type: ignore[arg-type]

    monkeypatch.setenv("DISTAL_CACHE", str(tmp_path / "kernels"))
    monkeypatch.setattr(console, "QUIET", 0.1)
    monkeypatch.setattr(compiler, "_build", slow)
    kernel_state, x, p = ca.SX.sym("kernel_state"), ca.SX.sym("x"), ca.SX.sym("p")
    function = ca.Function("added", [kernel_state, x, p], [kernel_state + x * p, kernel_state])
    with console.working("estimating with adaptive"):
        assert Kernel(function).backend == "compiled"
        said = capfd.readouterr().err
    line, *_ = said.splitlines()
    assert line == "estimating with adaptive: compiling, once: it is kept for the next time …"


def test_a_long_step_is_said_again_and_again(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each time after twice the silence, so that minutes are not hundreds of lines."""
    monkeypatch.setattr(console, "QUIET", 0.05)
    with console.working("compiling for others"):
        time.sleep(0.6)
    lines = capfd.readouterr().err.splitlines()
    assert 3 <= len(lines) <= 4
    assert set(lines) == {"compiling for others …"}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("simulate template --out log.csv", "simulating …"),
        ("simulate template --runs 2 --out logs", "simulating"),
        ("rig draw finger-2n --out rig.png", "drawing …"),
        ("export-c finger-2n --out c", "writing C …"),
    ],
)
def test_commands_say_what_they_do(
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    words: str,
    said: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(console, "QUIET", 1e-3)
    monkeypatch.setattr(sys, "argv", ["distal", *words.split()])
    with pytest.raises(SystemExit) as stopped:
        main()
    assert not stopped.value.code
    assert said in capfd.readouterr().err


def test_the_lab_and_an_estimate_say_it_too(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """All estimators of a log of a chain, and its test; the lab, whose compiler is left out
    here.
    """
    monkeypatch.chdir(tmp_path)
    page = tmp_path / "lab.html"

    def slow_page(*_: object) -> None:
        time.sleep(0.2)
        page.write_text("")

    def slow_estimate(*args: object, **options: object) -> object:
        time.sleep(0.2)  # or it is done before the line can be shown
        return estimate(*args, **options)  # type: ignore[arg-type]

    monkeypatch.setattr("distal.run.estimate", slow_estimate)
    monkeypatch.setattr("distal.lab.lab_page", slow_page)
    monkeypatch.setattr("distal.lab.check_ziglang", lambda: None)
    commands = [
        ("simulate finger --out log.csv", "simulating"),
        (
            "estimate log.csv --rig finger-2n -e inextensible -e elastic",
            "estimating with inextensible",
        ),
        ("lab finger-2n --out lab.html", "compiling them to WebAssembly"),
    ]
    for words, said in commands:
        monkeypatch.setattr(console, "QUIET", 1e-3)
        # beside other load a line may be shown before the estimator has its name
        monkeypatch.setattr(sys, "argv", ["distal", *words.split()])
        with pytest.raises(SystemExit) as stopped:
            main()
        assert not stopped.value.code
        assert said in capfd.readouterr().err


def test_a_bar_on_a_terminal_leaves_the_output_where_it_goes(tmp_path: Path) -> None:
    """Standard error is a terminal, standard output a file: what is printed meanwhile stands in the
    file.
    """
    code = """
from distal.cli.console import progress_bar, say, working
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


def test_nothing_is_said_of_what_has_ended(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A thread that still compiles a kernel may tell of it later, beside another command."""
    monkeypatch.setattr(console, "QUIET", 0.01)
    with console.working("compiling") as show:
        time.sleep(0.1)
    assert "compiling" in capsys.readouterr().err
    show("compiling still")
    time.sleep(0.1)
    assert capsys.readouterr().err == ""
