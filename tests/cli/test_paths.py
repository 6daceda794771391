"""No output replaces an input or another output, and what cannot be written is said before the work
begins.

Each command is a row of `COMMANDS`: its words, and the file that it writes. What can be one file,
and where none can stand, is tested by tests/logs/test_outputs.py; here, that each command asks for
all that it reads and writes.
"""

from __future__ import annotations

import os
import re
from importlib import resources
from pathlib import Path

import pytest

import distal.control
import distal.export
import distal.fitting
import distal.logs
import distal.run
import distal.simulation
from distal.export import export_files
from distal.rig import edited_text
from distal.simulation import scenario_text
from tests.cli.test_cli import refused, run  # noqa: F401

LOG = "t,x1,u1,x2,u2\n" + "".join(f"{0.01 * i:.2f},{1e-4 * i},2.0,1e-3,2.0\n" for i in range(30))
SCENARIO = scenario_text("series-2").replace('rig = "paper-2008-printed"', 'rig = "rig.toml"')
assert "rig.toml" in SCENARIO

INPUTS = {
    "log.csv": LOG,
    "other.csv": LOG,
    "rig.toml": "# distal export-c\n" + edited_text("paper-2008-printed"),
    "truth.csv": "t,theta\n0,0\n1,0.1\n",
    "do.toml": SCENARIO,
}

ALL = "--rig in/rig.toml --truth in/truth.csv"
COMMANDS = {
    f"estimate in/log.csv {ALL} --out": "estimate.csv",
    f"estimate in/log.csv {ALL} --plot": "picture.png",
    f"estimate in/log.csv in/other.csv {ALL} --out": "out/log.csv",
    "simulate in/do.toml --out": "sim.csv",
    "simulate in/do.toml --runs 2 --out": "out/run_1.csv",
    f"fit in/log.csv in/other.csv {ALL} --out": "fitted.toml",
    "export-c in/rig.toml --name joint --out": "out/README.md",
}
"""Words up to the output, and the file that is written, of a folder one in it."""


class WorkBegan(Exception):
    """A command began to work, although it should have refused."""


@pytest.fixture(autouse=True)
def _no_work(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Let inputs of every kind stand in the working folder. Where work would begin, the test fails:
    `WorkBegan` is no error that the command line knows.
    """

    def begin(*_: object, **__: object) -> None:
        raise WorkBegan

    for module, names in (
        (distal.logs, ("read_log", "write_whole")),
        (distal.run, ("LiveEstimator", "estimate", "estimate_batch", "smooth")),
        (distal.control, ("simulate", "closed_loop")),
        (distal.fitting, ("fit",)),
        (distal.export, ("export_c",)),
    ):
        for name in names:
            monkeypatch.setattr(module, name, begin)
    monkeypatch.chdir(tmp_path)
    Path("in").mkdir()
    for name, text in INPUTS.items():
        Path("in", name).write_text(text)


def state(folder: Path) -> dict[str, tuple[int, int, bytes | str]]:
    """Return everything below a folder: what it is, which file it is, and what it holds."""
    found: dict[str, tuple[int, int, bytes | str]] = {}
    for path in sorted(folder.rglob("*")):
        about = path.lstat()
        held = (
            os.readlink(path) if path.is_symlink() else path.read_bytes() if path.is_file() else b""
        )
        found[str(path)] = about.st_mode, about.st_ino, held
    return found


def asked(command: str) -> str:
    """Return a command with its output."""
    folder, _, name = COMMANDS[command].rpartition("/")
    return f"{command} {folder or name}"


def read_by(command: str) -> list[str]:
    """Return what a command reads, also by its scenario."""
    return re.findall(r"in/\S+", command.replace("do.toml", "do.toml in/rig.toml"))


@pytest.mark.parametrize(
    ("command", "read"), [(command, read) for command in COMMANDS for read in read_by(command)]
)
def test_no_output_replaces_an_input(run, tmp_path: Path, command: str, read: str) -> None:
    target = Path(COMMANDS[command])
    target.parent.mkdir(exist_ok=True)
    target.hardlink_to(read)
    before = state(tmp_path)
    refused(run(asked(command)), "is an input of this command")
    assert state(tmp_path) == before


@pytest.mark.parametrize("command", COMMANDS)
def test_other_names_are_taken_unless_no_file_can_stand_there(
    run, tmp_path: Path, command: str
) -> None:
    """The same commands with a free name go on to where the tests above must not come; nothing is
    made on the way.
    """
    before = state(tmp_path)
    with pytest.raises(WorkBegan):
        run(asked(command))
    made = {path: held for path, held in state(tmp_path).items() if path != str(tmp_path / "out")}
    assert made == before
    Path(COMMANDS[command]).mkdir(parents=True)
    refused(run(asked(command)), "is a folder")


@pytest.mark.parametrize(
    ("command", "one", "other"),
    [
        (f"estimate in/log.csv {ALL} --out out/one.csv --plot out/two.png", "one.csv", "two.png"),
        (f"estimate in/log.csv in/other.csv {ALL} --out out", "log.csv", "other.csv"),
        ("simulate in/do.toml --runs 2 --out out", "run_0.csv", "run_1.csv"),
        ("export-c in/rig.toml --name joint --out out", "README.md", "joint.c"),
    ],
)
def test_no_two_outputs_are_one_file(
    run, tmp_path: Path, command: str, one: str, other: str
) -> None:
    Path("out").mkdir()
    Path("out", other).symlink_to(one)
    before = state(tmp_path)
    refused(run(command), "is asked for twice", "give two names")
    assert state(tmp_path) == before


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--out a.png --plot ./a.png", "asked for twice; give two names"),
        ("in/log.parquet --out out", "another log has the name 'log'"),
        ("in/log.csv --out out", "more than once"),
        ("--out in/log.csv/estimate.csv", "which is a file"),
        ("--truth none.csv --out none.csv", "is an input"),
    ],
)
def test_options_that_ask_for_one_place(run, tmp_path: Path, words: str, said: str) -> None:
    Path("in/log.parquet").write_text(LOG)
    before = state(tmp_path)
    refused(run(f"estimate in/log.csv --rig in/rig.toml {words}"), said)
    assert state(tmp_path) == before


def test_a_column_is_no_input(run) -> None:
    with pytest.raises(WorkBegan):
        run("estimate in/log.csv --rig in/rig.toml --truth theta --out theta")


def test_a_shipped_file_is_an_input_too(run) -> None:
    rig = Path(str(resources.files("distal.rig") / "library" / "paper-2008-printed.toml"))
    scenario = Path(str(resources.files("distal.simulation") / "library" / "series-2.toml"))
    before = rig.read_bytes(), scenario.read_bytes()
    refused(run(f"fit in/log.csv --rig paper-2008-printed --out {rig}"), "is an input")
    refused(run(f"simulate series-2 --out {scenario}"), "is an input")
    refused(run(f"simulate series-2 --out {rig}"), "is an input")
    assert (rig.read_bytes(), scenario.read_bytes()) == before


@pytest.mark.parametrize("log", ["bag", "bag/bag_0.db3"])
def test_the_files_of_a_bag_are_inputs(run, tmp_path: Path, log: str) -> None:
    Path("bag").mkdir()
    for name in ("metadata.yaml", "bag_0.db3"):
        Path("bag", name).write_text("x")
    before = state(tmp_path)
    for out in ("metadata.yaml", "bag_0.db3"):
        refused(run(f"estimate {log} --rig in/rig.toml --out bag/{out}"), "is an input")
        assert state(tmp_path) == before
    with pytest.raises(WorkBegan):
        run(f"estimate {log} --rig in/rig.toml --out bag/estimate.csv")


@pytest.mark.parametrize("name", export_files("joint"))
def test_an_exports_files_are_checked_one_by_one(run, name: str) -> None:
    Path("out").mkdir()
    mine = Path("out", name)
    mine.write_text("mine")
    refused(run("export-c in/rig.toml --name joint --out out"), "was not written by export-c")
    assert mine.read_text() == "mine"
    mine.unlink()
    mine.hardlink_to("in/rig.toml")
    refused(run("export-c in/rig.toml --name joint --out out"), "is an input")
