"""The library for Arduino and PlatformIO: its layout by the published rules, and a sketch that
compiles for a Cortex-M.
"""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from distal import load_rig
from distal.cli.app import app
from distal.errors import OutputError, RigError
from distal.export import Exported, export_arduino
from distal.export.arduino import SKETCH
from distal.rig import build_rig, set_value
from tests.export.helpers import missing_tools
from tests.export.test_microcontroller import CORTEX, FIRMWARE

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


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("libraries") / "template_adaptive"


@pytest.fixture(scope="module")
def made(folder: Path) -> Exported:
    return export_arduino(load_rig("template"), folder, name="template_adaptive")


def test_the_layout_follows_the_rules(folder: Path, made: Exported) -> None:
    """Those that arduino-lint checks with --compliance strict --library-manager submit, of what can
    be read here.
    """
    assert made.real.single
    lines = (folder / "library.properties").read_text().splitlines()
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
    assert (folder / "src" / fields["includes"]).is_file()
    names = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    assert names == {
        "library.properties",
        "README.md",
        "LICENSE",
        f"src/{made.name}.h",
        f"src/{made.name}.c",
        f"examples/{SKETCH}/{SKETCH}.ino",
    }
    assert "replay" not in (folder / "README.md").read_text()


def test_titles_are_anything(tmp_path: Path) -> None:
    odd = load_rig("capstan-joint").model_copy(update={"name": 'a "b" \\ {c}\n*/ $name$'})
    export_arduino(odd, tmp_path / "odd", name="x" * 90)
    lines = (tmp_path / "odd" / "library.properties").read_text().splitlines()
    said = dict(line.split("=", 1) for line in lines)
    assert len(said["name"]) == 63
    assert "$name$" in said["sentence"]
    (tmp_path / "mine" / "src").mkdir(parents=True)
    (tmp_path / "mine" / "LICENSE").write_text("mine")
    with pytest.raises(OutputError, match="was not written by export-c"):
        export_arduino(odd, tmp_path / "mine")
    assert (tmp_path / "mine" / "LICENSE").read_text() == "mine"
    (tmp_path / "file").write_text("mine")
    with pytest.raises(OutputError, match="which is a file"):
        export_arduino(odd, tmp_path / "file")


@pytest.mark.slow
@pytest.mark.skipif(
    bool(missing_tools()) or shutil.which("arm-none-eabi-g++") is None,
    reason=f"not installed: {missing_tools() or 'arm-none-eabi-g++'}",
)
@pytest.mark.parametrize(
    "name",
    ["template", "capstan-joint", pytest.param("wrist-instrument", marks=pytest.mark.more)],
)
def test_the_sketch_compiles_for_a_board(name: str, tmp_path: Path) -> None:
    """As C++ with all warnings, on a board of a few functions; of one joint it takes at most 32 kB
    of flash.
    """
    rig = load_rig(name)
    made = export_arduino(rig, tmp_path / "library", name="joint")
    source = tmp_path / "library"
    warned = ["-Wall", "-Wextra", "-Werror", "-ffunction-sections", "-fdata-sections"]
    cpu = [flag for flag in CORTEX if not flag.startswith("-std")]
    plus = [
        "-fno-exceptions",
        "-fno-rtti",
        f"-I{FIRMWARE}",
        f"-I{source / 'src'}",
        "-include",
        "Arduino.h",
        "-x",
        "c++",
    ]
    compiled = {
        "joint.o": [
            "arm-none-eabi-gcc",
            "-std=c99",
            *cpu,
            *warned,
            str(source / "src" / "joint.c"),
        ],
        "startup.o": ["arm-none-eabi-gcc", *cpu, *warned, str(FIRMWARE / "startup.c")],
        "sketch.o": [
            "arm-none-eabi-g++",
            *cpu,
            *warned,
            *plus,
            str(source / "examples" / SKETCH / f"{SKETCH}.ino"),
        ],
        "board.o": ["arm-none-eabi-g++", *cpu, *warned, *plus, str(FIRMWARE / "board.cpp")],
    }
    commands = [[*command, "-c", "-o", object_] for object_, command in compiled.items()]
    linked = [
        "-nostartfiles",
        "--specs=nano.specs",
        "-Wl,--gc-sections",
        "-T",
        str(FIRMWARE / "mps2.ld"),
    ]
    commands += [["arm-none-eabi-gcc", *cpu, *linked, *compiled, "-lm", "-o", "sketch.elf"]]
    for command in commands:
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
    sizes = subprocess.run(
        ["arm-none-eabi-size", "sketch.elf"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    text, data = map(int, sizes.stdout.splitlines()[1].split()[:2])
    assert made.estimator.channels
    assert 4_000 < text + data <= (32 if len(rig.joints) == 1 else 80) * 1024


def test_factors_of_counts_and_currents_are_the_rigs(tmp_path: Path) -> None:
    """An encoder that counts the other way has a negative factor; what the rig does not say is to
    be set.
    """
    changed = {"sensors.0.sign": -1, "sensors.0.unit": "count", "sensors.0.counts_per_turn": 4000}
    raw = load_rig("capstan-joint").model_dump()
    for path, value in changed.items():
        set_value(raw, path, value, RigError)
    export_arduino(build_rig(raw, "turned"), tmp_path, name="joint")
    sketch = (tmp_path / "examples" / SKETCH / f"{SKETCH}.ino").read_text()
    assert f"PER_COUNT_0 = {-2 * np.pi / 4000:.9g};" in sketch
    assert "PER_STEP_1 = 0.01;" in sketch
    assert sketch.count("SET YOURS") == 1


def test_what_the_user_edits_stays(tmp_path: Path) -> None:
    rig, sketch = load_rig("capstan-joint"), tmp_path / "examples" / SKETCH / f"{SKETCH}.ino"
    export_arduino(rig, tmp_path, name="joint")
    sketch.write_text(sketch.read_text().replace("A_0 = 2", "A_0 = 20"))
    (tmp_path / "src" / "joint.c").write_text("/* distal export-c, old */")
    export_arduino(rig, tmp_path, name="joint")
    assert "A_0 = 20" in sketch.read_text()
    assert "joint_step" in (tmp_path / "src" / "joint.c").read_text()
    with pytest.raises(OutputError, match="is of another library than finger"):
        export_arduino(rig, tmp_path, name="finger")


def test_the_command(tmp_path: Path) -> None:
    done = CliRunner().invoke(
        app, ["export-c", "capstan-joint", "--arduino", str(tmp_path / "joint")]
    )
    assert done.exit_code == 0, done.output
    assert "float" in done.output
    sketch = (tmp_path / "joint" / "examples" / SKETCH / f"{SKETCH}.ino").read_text()
    assert "out.angle_std" in sketch
    for bad in (
        ["export-c", "capstan-joint"],
        ["export-c", "capstan-joint", "--out", "a", "--arduino", "b"],
    ):
        done = CliRunner().invoke(app, bad)
        assert done.exit_code != 0
        assert "--arduino" in done.output
