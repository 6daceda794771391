"""The library for Arduino and PlatformIO: its layout by the published rules, and the sketch of the
docs.
"""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest
from typer.testing import CliRunner

from distal import load_rig
from distal.cli.app import app
from distal.errors import OutputError
from distal.export import export_c

# https://arduino.github.io/arduino-cli/latest/library-specification and the rules of arduino-lint
REQUIRED = (
    "name",
    "version",
    "author",
    "maintainer",
    "sentence",
    "paragraph",
    "category",
    "url",
    "architectures",
)
CATEGORIES = (
    "Display",
    "Communication",
    "Signal Input/Output",
    "Sensors",
    "Device Control",
    "Timing",
    "Data Storage",
    "Data Processing",
    "Other",
    "Uncategorized",
)


BOARD = """
struct Port { void begin(long); void println(float); } extern Serial;
unsigned long micros();
"""


def test_the_layout_follows_the_rules(tmp_path: Path) -> None:
    """Those that arduino-lint checks with --compliance strict --library-manager submit, of what can
    be read here.
    """
    done = CliRunner().invoke(
        app, ["export-c", "template", "--out", str(tmp_path), "--arduino", "--float"]
    )
    assert done.exit_code == 0, done.output
    lines = (tmp_path / "library.properties").read_text().splitlines()
    fields = dict(line.split("=", 1) for line in lines)
    assert len(fields) == len(lines)
    for key in REQUIRED:
        assert fields[key].strip() == fields[key] != ""
    assert re.fullmatch(r"[a-zA-Z0-9][a-zA-Z0-9 _.\-]{0,62}", fields["name"])
    assert not fields["name"].lower().startswith("arduino")
    assert re.fullmatch(r"\d+\.\d+\.\d+", fields["version"])
    assert fields["category"] in CATEGORIES
    assert fields["url"].startswith("https://")
    assert not fields["paragraph"].startswith(fields["sentence"])
    assert (tmp_path / "src" / fields["includes"]).is_file()
    names = {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file()}
    stem = "src/template_adaptive"
    assert names == {"library.properties", "README.md", f"{stem}.h", f"{stem}.c"}


def test_titles_are_anything(tmp_path: Path) -> None:
    odd = load_rig("capstan-joint").model_copy(update={"name": 'a "b" \\ {c}\n*/ $name$'})
    export_c(odd, tmp_path / "odd", name="x" * 90, arduino=True)
    lines = (tmp_path / "odd" / "library.properties").read_text().splitlines()
    said = dict(line.split("=", 1) for line in lines)
    assert len(said["name"]) == 63
    assert "$name$" in said["sentence"]
    (tmp_path / "mine" / "src").mkdir(parents=True)
    (tmp_path / "mine" / "src" / "joint.c").write_text("mine")
    with pytest.raises(OutputError, match="was not written by export-c"):
        export_c(odd, tmp_path / "mine", name="joint", arduino=True)
    assert (tmp_path / "mine" / "src" / "joint.c").read_text() == "mine"


def test_what_the_user_edits_stays(tmp_path: Path) -> None:
    rig, said = load_rig("capstan-joint"), tmp_path / "library.properties"
    export_c(rig, tmp_path, "elastic", name="joint", arduino=True)
    said.write_text(said.read_text().replace("author=distal export-c", "author=me"))
    (tmp_path / "src" / "joint.c").write_text("/* distal export-c, old */")
    export_c(rig, tmp_path, "elastic", name="joint", arduino=True)
    assert "author=me" in said.read_text()
    assert "joint_step" in (tmp_path / "src" / "joint.c").read_text()


@pytest.mark.skipif(shutil.which("g++") is None, reason="g++ is not installed")
def test_the_sketch_of_the_docs_compiles(tmp_path: Path) -> None:
    page = Path(__file__).parents[2] / "docs" / "how-to" / "microcontroller.md"
    (sketch,) = re.findall(r"```cpp\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    (tmp_path / "sketch.cpp").write_text(BOARD + sketch)
    export_c(load_rig("template"), tmp_path, single=True, name="my_finger_adaptive", arduino=True)
    strict = ["-Wall", "-Wextra", "-Werror", "-fsyntax-only", "-Isrc", "sketch.cpp"]
    done = subprocess.run(["g++", *strict], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
