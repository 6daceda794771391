"""Outputs are compared as files, not as names, and tried before they are needed; files are written
whole or not at all.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from distal.errors import OutputError
from distal.logs import check_outputs, shown, write_whole

NAMES = ("log", "in/../log", "way/log", "link", "link to a link", "hard link")
"""One file, by its name, over a folder, by a linked folder, and by links."""


@pytest.mark.parametrize("name", NAMES)
def test_a_file_is_the_same_by_all_its_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("log").touch()
    Path("in").mkdir()
    Path("way").symlink_to(tmp_path)
    Path("link").symlink_to("log")
    Path("link to a link").symlink_to("link")
    Path("hard link").hardlink_to("log")
    for other in (*NAMES, tmp_path / "log"):
        with pytest.raises(OutputError, match="is an input of this command"):
            check_outputs([Path(name)], [other])
        with pytest.raises(OutputError, match="is asked for twice"):
            check_outputs([Path(name), Path(other)])
    check_outputs([Path("another")], [name])
    Path("dangling").symlink_to("new")
    with pytest.raises(OutputError, match="is asked for twice"):
        check_outputs([Path("new"), Path("dangling")])


def test_places_where_no_file_can_stand(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("file").touch()
    Path("loop").symlink_to("loop")
    Path("dangling").symlink_to("none/new")
    read_only = [] if os.geteuid() == 0 else ["locked/new", "kept"]  # root may write everywhere
    Path("locked").mkdir(mode=0o500)
    Path("kept").touch(mode=0o400)
    for name, said in (
        (".", "is a folder"),
        ("file/new", "which is a file"),
        ("loop", "cannot be written"),
        ("none/new", "does not exist"),
        ("dangling", "does not exist"),
        *((name, "read-only") for name in read_only),
        *((name, ".") for name in ("a\0b", "a\ud800b", "x" * 300)),
    ):
        for attempt in (
            lambda path: check_outputs([path]),
            lambda path: write_whole(path, "text"),
        ):
            with pytest.raises(OutputError, match=said):
                attempt(Path(name))
    for folder, said in (("file/below", "which is a file"), ("file", "which is a file")):
        with pytest.raises(OutputError, match=said):
            check_outputs([Path(folder, "new")], makes_folder=True)


def test_text_with_half_a_character_is_written_all_the_same(tmp_path: Path) -> None:
    write_whole(tmp_path / "page.html", "log caf\udce9.csv")
    assert (tmp_path / "page.html").read_text() == "log caf?.csv"


def test_folders_are_not_made_by_a_check(tmp_path: Path) -> None:
    check_outputs(
        [tmp_path / "a" / "b" / name for name in ("one.csv", "two.csv")], makes_folder=True
    )
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(OutputError, match="asked for twice"):
        check_outputs(2 * [tmp_path / "a" / "b" / "one.csv"], makes_folder=True)


def test_a_pipe_is_written_as_it_is(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    check_outputs([pipe])
    with pytest.raises(OutputError, match="is an input"):
        check_outputs([pipe], [pipe])


def test_what_is_shown_is_one_line() -> None:
    assert shown("plain é.csv") == "plain é.csv"
    assert shown("a\nb\x1b\udce9") == r"a\nb\x1b\udce9"
    assert len(shown("x" * 5000)) < 100


def test_a_failure_leaves_what_was_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "out.csv"
    path.write_text("precious")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(OutputError, match="No space left"):
        write_whole(path, "new")
    assert path.read_text() == "precious"
    assert list(tmp_path.iterdir()) == [path]


def test_it_replaces_follows_links_and_keeps_the_mode(tmp_path: Path) -> None:
    path, link = tmp_path / "out.csv", tmp_path / "link"
    write_whole(path, "one")
    path.chmod(0o640)
    link.symlink_to(path)
    write_whole(link, b"two")
    assert link.is_symlink()
    assert path.read_text() == "two"
    assert path.stat().st_mode & 0o777 == 0o640
