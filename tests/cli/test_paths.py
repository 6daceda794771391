"""No output replaces an input or another output, and what cannot be written is said before the work
begins.

Each command is a row of `COMMANDS`: what it reads, the file that it writes, and its words. The
tests go over all rows, all inputs of a row, and all ways in which two names can be one file.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
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
from distal.rig import rig_text
from distal.simulation import scenario_text
from tests.cli.test_cli import refused, run  # noqa: F401

LOG = "t,x1,u1,x2,u2\n" + "".join(f"{0.01 * i:.2f},{1e-4 * i},2.0,1e-3,2.0\n" for i in range(30))
TRUTH = "t,theta\n0,0\n1,0.1\n"
RIG = "# distal export-c\n" + rig_text("paper-2008-printed")[0]
SCENARIO = scenario_text("series-2").replace('rig = "paper-2008-printed"', 'rig = "{rig}"')
assert "{rig}" in SCENARIO

Words = Callable[[dict[str, str], str], list[str]]


@dataclass(frozen=True)
class Command:
    """A command and one of its outputs: names of inputs, the file that is written, and the words
    for both.

    A file in a folder is written as "folder/name", and the words get the folder.
    """

    inputs: tuple[str, ...]
    writes: str
    words: Words

    @property
    def folder(self) -> bool:
        return "/" in self.writes


COMMANDS = {
    "estimate --out": Command(
        ("log", "rig", "truth"),
        "estimate.csv",
        lambda i, out: [
            "estimate",
            i["log"],
            "--rig",
            i["rig"],
            "--truth",
            i["truth"],
            "--out",
            out,
        ],
    ),
    "estimate --plot": Command(
        ("log", "rig", "truth"),
        "picture.png",
        lambda i, out: [
            "estimate",
            i["log"],
            "--rig",
            i["rig"],
            "--truth",
            i["truth"],
            "--plot",
            out,
        ],
    ),
    "estimate LOGS --out": Command(
        ("log", "other", "rig", "truth"),
        "out/log.csv",
        lambda i, out: [
            "estimate",
            i["log"],
            i["other"],
            "--rig",
            i["rig"],
            "--truth",
            i["truth"],
            "--out",
            out,
        ],
    ),
    "simulate --out": Command(
        ("scenario", "rig"), "sim.csv", lambda i, out: ["simulate", i["scenario"], "--out", out]
    ),
    "simulate --runs": Command(
        ("scenario", "rig"),
        "out/run_1.csv",
        lambda i, out: ["simulate", i["scenario"], "--runs", "2", "--out", out],
    ),
    "fit --out": Command(
        ("log", "other", "rig", "truth"),
        "fitted.toml",
        lambda i, out: [
            "fit",
            i["log"],
            i["other"],
            "--rig",
            i["rig"],
            "--truth",
            i["truth"],
            "--out",
            out,
        ],
    ),
    "export-c --out": Command(
        ("rig",),
        "out/README.md",
        lambda i, out: ["export-c", i["rig"], "--name", "joint", "--out", out],
    ),
}
PAIRS = [(name, read) for name, command in COMMANDS.items() for read in command.inputs]


class WorkBegan(Exception):
    """A command began to work, although it should have refused."""


@pytest.fixture(autouse=True)
def _no_work(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> None:
    """Where work would begin, the test fails: `WorkBegan` is no error that the command line
    knows.
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


@pytest.fixture
def inputs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """Inputs of every kind in the working folder, name → path."""
    monkeypatch.chdir(tmp_path)
    names = {
        "log": "log.csv",
        "other": "other.csv",
        "rig": "rig.toml",
        "truth": "truth.csv",
        "scenario": "do.toml",
    }
    texts = {"log": LOG, "other": LOG, "rig": RIG, "truth": TRUTH, "scenario": SCENARIO}
    made = {}
    for kind, name in names.items():
        path = tmp_path / "in" / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(texts[kind].replace("{rig}", str(tmp_path / "in" / "rig.toml")))
        made[kind] = str(path)
    return made


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


def words_of(command: Command, given: dict[str, str], target: str) -> list[str]:
    return command.words(given, os.path.dirname(target) if command.folder else target)


def _moved(given: dict[str, str], read: str, target: Path) -> None:
    """Let an input stand where the output will be."""
    os.rename(given[read], target)
    if read == "rig":
        scenario = Path(given["scenario"])
        scenario.write_text(scenario.read_text().replace(given["rig"], str(target)))
    given[read] = str(target)


def absolute(given: dict[str, str], read: str, target: Path) -> str:
    _moved(given, read, target)
    return str(target)


def relative(given: dict[str, str], read: str, target: Path) -> str:
    _moved(given, read, target)
    return os.path.relpath(target)


def dotted(given: dict[str, str], read: str, target: Path) -> str:
    _moved(given, read, target)
    return f"./in/../{os.path.relpath(target)}"


def by_a_linked_folder(given: dict[str, str], read: str, target: Path) -> str:
    _moved(given, read, target)
    Path("way").symlink_to(target.parent)
    return f"way/{target.name}"


def symlink(given: dict[str, str], read: str, target: Path) -> str:
    target.symlink_to(given[read])
    return str(target)


def link_to_a_link(given: dict[str, str], read: str, target: Path) -> str:
    Path("between").symlink_to(given[read])
    target.symlink_to(Path("between").absolute())
    return str(target)


def hard_link(given: dict[str, str], read: str, target: Path) -> str:
    target.hardlink_to(given[read])
    return str(target)


def input_is_a_link(given: dict[str, str], read: str, target: Path) -> str:
    """The input's name is a link to the output's; the bytes stand where the output will be."""
    kept = given[read]
    os.rename(kept, target)
    Path(kept).symlink_to(target)
    return str(target)


WAYS = (
    absolute,
    relative,
    dotted,
    by_a_linked_folder,
    symlink,
    link_to_a_link,
    hard_link,
    input_is_a_link,
)


def _ways() -> Iterator[object]:
    """Return all pairs in all ways; a quarter of them is fast, with every pair in two ways, and
    every way often.
    """
    for i, (name, read) in enumerate(PAIRS):
        for j, way in enumerate(WAYS):
            marks = () if (i + j) % 4 == 0 else pytest.mark.slow
            yield pytest.param(name, read, way, marks=marks, id=f"{name} {read}-{way.__name__}")


@pytest.mark.parametrize(("name", "read", "way"), list(_ways()))
def test_no_output_replaces_an_input(
    run,
    inputs: dict[str, str],
    tmp_path: Path,
    name: str,
    read: str,
    way: Callable[[dict[str, str], str, Path], str],
) -> None:
    command = COMMANDS[name]
    target = tmp_path / command.writes
    target.parent.mkdir(exist_ok=True)
    words = words_of(command, inputs, way(inputs, read, target))
    before = state(tmp_path)
    said = run(*words)
    # a second log that is called as the first one's estimate is refused for its name already
    refused(said, "" if "another log has the name" in said.err else "is an input of this command")
    assert state(tmp_path) == before


@pytest.mark.parametrize("name", COMMANDS)
def test_other_names_are_taken_and_the_work_begins(
    run,
    inputs: dict[str, str],
    tmp_path: Path,
    name: str,
) -> None:
    """The same commands with a free name go on to where the tests above must not come; nothing is
    made on the way.
    """
    command = COMMANDS[name]
    before = state(tmp_path)
    for target in (command.writes, f"./{command.writes}", str(tmp_path / command.writes)):
        with pytest.raises(WorkBegan):
            run(*words_of(command, inputs, target))
    made = {path: held for path, held in state(tmp_path).items() if path != str(tmp_path / "out")}
    assert made == before


@dataclass(frozen=True)
class Two:
    """A command with two outputs: the files, and its words."""

    one: str
    other: str
    words: Words


TWO = {
    "estimate --out --plot": Two(
        "one.csv",
        "two.png",
        lambda i, at: [
            "estimate",
            i["log"],
            "--rig",
            i["rig"],
            "--out",
            f"{at}/one.csv",
            "--plot",
            f"{at}/two.png",
        ],
    ),
    "estimate LOGS": Two(
        "log.csv",
        "other.csv",
        lambda i, at: ["estimate", i["log"], i["other"], "--rig", i["rig"], "--out", at],
    ),
    "simulate --runs": Two(
        "run_0.csv",
        "run_1.csv",
        lambda i, at: ["simulate", i["scenario"], "--runs", "2", "--out", at],
    ),
    "export-c": Two(
        "README.md", "joint.c", lambda i, at: ["export-c", i["rig"], "--name", "joint", "--out", at]
    ),
}


@pytest.mark.parametrize("how", ["symlink", "dangling", "hard link"])
@pytest.mark.parametrize("name", TWO)
def test_no_two_outputs_are_one_file(
    run,
    inputs: dict[str, str],
    tmp_path: Path,
    name: str,
    how: str,
) -> None:
    two, out = TWO[name], tmp_path / "out"
    out.mkdir()
    with pytest.raises(WorkBegan):
        run(*two.words(inputs, str(out)))
    if how != "dangling":
        (out / two.one).write_text("distal export-c")
    if how == "hard link":
        (out / two.other).hardlink_to(out / two.one)
    else:
        (out / two.other).symlink_to(two.one)
    before = state(tmp_path)
    refused(run(*two.words(inputs, str(out))), "is asked for twice", "give two names")
    assert state(tmp_path) == before


def test_options_that_ask_for_one_place(run, inputs: dict[str, str], tmp_path: Path) -> None:
    log, rig = inputs["log"], ("--rig", inputs["rig"])
    twin = tmp_path / "log.parquet"
    twin.write_text(LOG)
    before = state(tmp_path)
    for words, said in (
        (
            ("estimate", log, *rig, "--out", "a.png", "--plot", "./a.png"),
            "asked for twice, first by --out",
        ),
        (("estimate", log, twin, *rig, "--out", "out"), "another log has the name 'log'"),
        (("estimate", log, log, *rig, "--out", "out"), "more than once"),
        (("estimate", log, *rig, "--out", f"{log}/estimate.csv"), "which is a file"),
    ):
        refused(run(*words), said)
        assert state(tmp_path) == before


def test_a_shipped_file_is_an_input_too(run, inputs: dict[str, str]) -> None:
    rig = Path(str(resources.files("distal.rig") / "library" / "paper-2008-printed.toml"))
    scenario = Path(str(resources.files("distal.simulation") / "library" / "series-2.toml"))
    before = rig.read_bytes(), scenario.read_bytes()
    refused(run("fit", inputs["log"], "--rig", "paper-2008-printed", "--out", rig), "is an input")
    refused(run("simulate", "series-2", "--out", scenario), "is an input")
    refused(run("simulate", "series-2", "--out", rig), "is an input")
    assert (rig.read_bytes(), scenario.read_bytes()) == before


def test_the_files_of_a_bag_are_inputs(run, inputs: dict[str, str], tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    bag.mkdir()
    for name in ("metadata.yaml", "bag_0.db3"):
        (bag / name).write_text("x")
    for log in (bag, bag / "bag_0.db3"):
        for out in ("metadata.yaml", "bag_0.db3"):
            before = state(tmp_path)
            refused(run("estimate", log, "--rig", inputs["rig"], "--out", bag / out), "is an input")
            assert state(tmp_path) == before
        with pytest.raises(WorkBegan):
            run("estimate", log, "--rig", inputs["rig"], "--out", bag / "estimate.csv")


def test_a_column_is_no_input(run, inputs: dict[str, str]) -> None:
    with pytest.raises(WorkBegan):
        run("estimate", inputs["log"], "--rig", inputs["rig"], "--truth", "theta", "--out", "theta")
    refused(
        run(
            "estimate",
            inputs["log"],
            "--rig",
            inputs["rig"],
            "--truth",
            "none.csv",
            "--out",
            "none.csv",
        ),
        "is an input",
    )


def positions(tmp_path: Path) -> Iterator[tuple[str, str]]:
    """Return folders and names in them that are no place for a file, and what is said of them."""
    (tmp_path / "a folder").mkdir()
    (tmp_path / "a file").write_text("kept")
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    yield str(tmp_path / "a file" / "below"), "a file"
    if os.geteuid() != 0:  # root may write everywhere
        locked = tmp_path / "locked"
        locked.mkdir(mode=0o500)
        yield str(locked), "cannot be written"


@pytest.mark.parametrize("name", COMMANDS)
def test_places_that_cannot_be_written(
    run,
    inputs: dict[str, str],
    tmp_path: Path,
    name: str,
) -> None:
    command = COMMANDS[name]
    suffix = Path(command.writes).suffix
    found = list(positions(tmp_path))
    taken = tmp_path / "taken" / Path(command.writes).name
    taken.mkdir(parents=True)
    loop = tmp_path / "loops" / Path(command.writes).name
    loop.parent.mkdir()
    loop.symlink_to(loop)
    before = state(tmp_path)
    for folder, said in found:
        target = f"{folder}/new/name" if command.folder else f"{folder}/new{suffix}"
        refused(run(*words_of(command, inputs, target)), said)
    refused(run(*words_of(command, inputs, str(taken))), "is a folder")
    refused(run(*words_of(command, inputs, str(loop))), "cannot be written")
    if command.folder:
        refused(run(*words_of(command, inputs, str(tmp_path / "a file" / "name"))), "is a file")
    else:
        refused(
            run(*words_of(command, inputs, str(tmp_path / "none" / f"new{suffix}"))),
            "does not exist",
        )
        dangling = tmp_path / f"dangling{suffix}"
        dangling.symlink_to(tmp_path / "none" / "new")
        refused(run(*words_of(command, inputs, str(dangling))), "does not exist")
        dangling.unlink()
    assert state(tmp_path) == before


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write what is read-only")
def test_a_read_only_file(run, inputs: dict[str, str], tmp_path: Path) -> None:
    kept = tmp_path / "kept.csv"
    kept.write_text("kept")
    kept.chmod(0o400)
    refused(run("estimate", inputs["log"], "--rig", inputs["rig"], "--out", kept), "read-only")


def test_an_exports_files_are_checked_one_by_one(
    run, inputs: dict[str, str], tmp_path: Path
) -> None:
    for name in export_files("joint"):
        out = tmp_path / f"out {name}"
        out.mkdir()
        os.link(inputs["rig"], out / name)
        refused(run("export-c", inputs["rig"], "--name", "joint", "--out", out), "is an input")
        (out / name).unlink()
        (out / name).write_text("mine")
        refused(
            run("export-c", inputs["rig"], "--name", "joint", "--out", out),
            "was not written by export-c",
        )
        assert (out / name).read_text() == "mine"
