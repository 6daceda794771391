"""Names of exports: one that is accepted compiles with every compiler, one that would not is
refused.
"""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from distal import load_rig
from distal.codegen import Plain
from distal.errors import Content, ExportError, OutputError
from distal.export import c_name, export_c
from distal.export.c_source import checked_name, export_files, filled
from distal.logs import output_files

COMPILERS = [name for name in ("gcc", "clang", "arm-none-eabi-gcc") if shutil.which(name)]
WORDS = """
auto break case char const continue default do double else enum extern for goto if inline int long register
restrict return short signed sizeof static struct switch typedef union unsigned void volatile while asm bool
catch class delete explicit export false friend mutable namespace new operator private protected public
template this throw true try typeid typename using virtual wchar_t linux unix main sin sqrt exp memset printf
free state numbers measured root is_there dt out null eof
"""
KEYWORDS = WORDS.split()


@pytest.mark.parametrize(
    "name",
    ["_x", "X", "9a", "", "a-b", "é", "a" * 101, "a\n"],
)
def test_names_that_are_refused(name: str) -> None:
    with pytest.raises(ExportError):
        checked_name(name)


@pytest.mark.parametrize("title", ["9 lives", "", "é", "x" * 300, "My hand, left", "_"])
def test_a_name_of_any_title_is_accepted(title: str) -> None:
    assert checked_name(c_name(title)) == c_name(title)


def test_a_template_writes_values_as_c() -> None:
    """Texts, integers, truth values, numbers of the type, lists, rows, and a name in capitals."""
    values = {
        "name": "a $b$",
        "b": "text",
        "n": np.int64(3),
        "yes": np.array([True, False]),
        "x": -0.5,
        "rows": [(1.0, np.nan), [2, 3]],
        "none": (),
    }
    text = filled("$name$|$NAME$|$b$|$n$|$yes$|$x$|$rows$|$none$|${x}", values, Plain(single=True))
    assert text == "a $b$|A $B$|text|3|1, 0|(-0.5f)|{1.0f, NAN}, {2, 3}||${x}"
    assert filled("$x$", {"x": 1e-200}) == "9.9999999999999998e-201"


@pytest.mark.parametrize(
    ("value", "double", "single"),
    [
        (0.0, "0.0", "0.0f"),
        (-0.0, "(-0.0)", "0.0f"),
        (2.0, "2.0", "2.0f"),
        (-3.0, "(-3.0)", "(-3.0f)"),
        (0.1, "0.10000000000000001", "0.1f"),
        (1e300, "1.0000000000000001e+300", "3.40282346e+38f"),
        (-1e300, "(-1.0000000000000001e+300)", "(-3.40282346e+38f)"),
        (1e-300, "1e-300", "0.0f"),
        (-np.inf, "(-INFINITY)", "(-INFINITY)"),
        (np.nan, "(double)NAN", "NAN"),
    ],
)
def test_numbers_as_c(value: float, double: str, single: str) -> None:
    assert (Plain().constant(value), Plain(single=True).constant(value)) == (double, single)


@pytest.mark.skipif(not COMPILERS, reason="no compiler was found")
@pytest.mark.parametrize(
    "names",
    [
        pytest.param([*sorted(KEYWORDS)[::5], "x" * 100], id="some"),
        pytest.param([*KEYWORDS, "a"], id="all", marks=pytest.mark.more),
    ],
)
def test_accepted_names_compile(names: list[str], tmp_path: Path) -> None:
    """Keywords of C and C++, names of functions and of what the source uses itself, the longest
    name.
    """
    rig = load_rig("capstan-joint")
    export_c(rig, tmp_path, "elastic", name="finger")
    texts = {path: path.read_text() for path in tmp_path.iterdir()}
    flags = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-fsyntax-only"]
    for name in names:
        checked_name(name)
        folder = tmp_path / "made" / name
        folder.mkdir(parents=True)
        for path, text in texts.items():
            plain = text.replace("FINGER", name.upper()).replace("finger", name)
            (folder / path.name.replace("finger", name)).write_text(plain)
    sources = [str(path) for path in (tmp_path / "made").rglob("*.c")]
    for compiler in COMPILERS:
        for source in sources:
            done = subprocess.run(
                [compiler, *flags, "-I", str(Path(source).parent), source],
                capture_output=True,
                text=True,
                check=False,
            )
            assert done.returncode == 0, f"{compiler} {source}: {done.stderr[:500]}"
    if shutil.which("g++"):
        for name in names:
            header = str(tmp_path / "made" / name / f"{name}.h")
            done = subprocess.run(
                ["g++", "-fsyntax-only", "-Wall", "-Werror", "-x", "c++", header],
                capture_output=True,
                text=True,
                check=False,
            )
            assert done.returncode == 0, f"{name}: {done.stderr[:500]}"


def test_all_files_or_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A disk that is full at the second, third, … file: what stood there stays, and nothing is left
    beside it.
    """

    rig = load_rig("capstan-joint")
    export_c(rig, tmp_path, "elastic", name="finger")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    real = output_files.put
    for full in range(len(export_files("finger"))):
        opened = 0

        def limited(path: Path, content: Content) -> None:
            nonlocal opened
            opened += 1
            if opened > full:  # noqa: B023
                raise OSError(28, "No space left on device")
            real(path, content)

        monkeypatch.setattr(output_files, "put", limited)
        with pytest.raises(OutputError, match="No space left"):
            export_c(rig, tmp_path, "elastic", single=True, name="finger")
        monkeypatch.setattr(output_files, "put", real)
        assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
    export_c(rig, tmp_path, "elastic", single=True, name="finger")
    assert {path.name for path in tmp_path.iterdir()} == set(before)
    assert (tmp_path / "finger.c").read_bytes() != before["finger.c"]
