"""The float filter on a Cortex-M4F, emulated: size, memory, instructions, and the same angles."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from distal import Rig, estimate, load_scenario, scenario_rig, simulate
from distal.codegen import Plain
from distal.estimators import make_estimator
from distal.export import Exported, c_filter
from distal.export.c_source import c_command
from distal.run import samples_of
from distal.simulation import Scenario
from tests.export.helpers import C99, missing_tools

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(bool(missing_tools()), reason=f"not installed: {missing_tools()}"),
]
FIRMWARE = Path(__file__).parent / "firmware"
CORTEX = ["-Os", "-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard"]
SECTIONS = ["-ffunction-sections", "-fdata-sections", "-Wdouble-promotion"]
LINKED = ["-nostartfiles", "--specs=nano.specs", "-Wl,--gc-sections", "-lm"]
BOARD = ["-M", "mps2-an386", "-cpu", "cortex-m4", "-nographic", "-icount", "shift=0"]
HOST = ["-semihosting-config", "enable=on,target=native", "-kernel"]
SAMPLES = 300


@dataclass(frozen=True)
class Measured:
    """What the emulated processor did.

    Args:
        flash: bytes of code, constants and initial data, with startup and mathematics library.
        ram: bytes of state, stack and the library's data.
        instructions: of a step, mean and most.
        error_degrees: largest difference of an angle to double precision [°].
        std_error: largest difference of a std to double precision, as a share of it.
    """

    flash: float
    ram: float
    instructions: tuple[float, float]
    error_degrees: float
    std_error: float


def literal(value: float) -> str:
    return "NAN" if np.isnan(value) else f"{value:.9e}f"


def said_by(folder: Path, *words: str) -> str:
    """Return what a tool says."""
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


def measure(
    rig: Rig,
    scenario: Scenario,
    name: str,
    folder: Path,
    made: Exported | None = None,
    flags: Sequence[str] = (),
    beside: str = "",
) -> tuple[Measured, Exported]:
    """Build the smallest product and a program with a log, look at one and run the other.

    Args:
        beside: the beginning of the C names of what runs beside the filter, whose files are there.
    """
    made = made or c_filter(rig, name, True, "filter")
    log = simulate(rig, scenario, 6).select(slice(0, SAMPLES))
    samples = samples_of(log, make_estimator(name, rig, compiled=False).channels)
    steps = ", ".join(literal(dt) for dt in np.diff(log.time, prepend=log.time[0]))
    rows = ",\n".join("{" + ", ".join(map(literal, row)) + "}" for row in samples)
    head = f"#include <math.h>\n#define SAMPLES {len(samples)}\nstatic const float "
    data = f"samples[][{samples.shape[1]}] = {{\n{rows}}};\n"
    log_text = f"{head}steps[] = {{{steps}}};\nstatic const float {data}"
    for file, text in {**made.files, "log.h": log_text}.items():
        (folder / file).write_text(text)
    prefix, angles = beside or "filter", made.fields[: len(rig.joints)]
    told = ",".join(f"out.{part}" for field in angles for part in (field.name, field.std))
    names = [
        f'-DFILTER_HEADER="{prefix}.h"',
        f"-DFILTER(x)={prefix}_##x",
        f"-DFILTER_TOLD(out)={told}",
    ]
    common = [*C99, *CORTEX, *SECTIONS, *names, *flags, f"-I{folder}", str(FIRMWARE / "startup.c")]
    sources = [file.name for file in folder.glob("*.c")]
    linked = [*LINKED, "-T", str(FIRMWARE / "mps2.ld"), "-lm"]
    for program in ("sized", "replayed"):
        files = [str(FIRMWARE / f"{program}.c"), *sources]
        said_by(folder, "arm-none-eabi-gcc", *common, *files, *linked, "-o", f"{program}.elf")
    sizes = re.findall(
        r"^(\.\S+)\s+(\d+)", said_by(folder, "arm-none-eabi-size", "-A", "sized.elf"), re.M
    )
    sections = {name: int(size) for name, size in sizes}
    symbols = said_by(folder, "arm-none-eabi-nm", "sized.elf")
    assert "__aeabi_d" not in symbols  # nothing of double precision
    run = said_by(folder, "qemu-system-arm", *BOARD, *HOST, "replayed.elf")
    (ticks,) = re.findall(r"^ticks (.*)", run, re.M)
    used, most, stack, million = (int(word, 16) for word in ticks.split())
    bits = "".join(re.findall(r"^(?:[0-9a-f]{8} )+$", run, re.M))
    found = np.frombuffer(bytes.fromhex(bits), ">f4").reshape(SAMPLES, -1)
    known = estimate(log, rig, name)
    per_tick = 1e6 / million  # SysTick counts 25 MHz of a clock of 1 GHz, one instruction each
    return Measured(
        sum(sections.get(name, 0) for name in (".text", ".ARM.exidx", ".data")),
        sections.get(".data", 0) + sections.get(".bss", 0) + stack,
        (used * per_tick / SAMPLES, most * per_tick),
        float(np.rad2deg(np.abs(found[:, ::2] - known.angles).max())),
        float(np.abs(found[:, 1::2] / known.angle_stds - 1).max()),
    ), made


@pytest.mark.parametrize(
    ("name", "flash", "ram", "instructions"),
    [
        ("series-2", 22, 4.3, 18_500),
        ("wrist", 60, 17, 168_000),
        pytest.param("finger", 52, 18, 150_000, marks=pytest.mark.more),
    ],
)
def test_it_fits_and_is_right(
    name: str, flash: float, ram: float, instructions: float, tmp_path: Path
) -> None:
    """Most flash [kB], RAM [kB] and instructions of a step; all angles as in Python to 0.02°."""
    scenario = load_scenario(name)
    measured, _ = measure(scenario_rig(scenario), scenario, "adaptive", tmp_path)
    assert measured.error_degrees <= 0.02
    assert measured.std_error <= 0.01
    assert 10_000 < measured.flash <= flash * 1024
    assert measured.ram <= ram * 1024
    assert 5_000 < measured.instructions[0] < measured.instructions[1] <= instructions


BOTH = """
#include "filter.h"
#include "command.h"
typedef filter_real both_real;
typedef filter_output both_output;
typedef struct { filter_state filter; command_state command; } both_state;
static void both_begin(both_state* both, const float* values) {
  filter_begin(&both->filter, values);
  command_begin(&both->command);
}
static int both_step(both_state* both, float dt, const float* values, filter_output* out) {
  static const float desired[COMMAND_JOINTS] = {0.1f};
  command_output commands;
  const int code = filter_step(&both->filter, dt, values, out);
  command_step(&both->command, &both->filter, dt, values, out, desired, 1, &commands);
  return code;
}
"""


@pytest.mark.more
def test_commands_take_few_instructions(tmp_path: Path) -> None:
    """Filter and commands in one step, less the filter alone: 30,000 instructions are allowed for
    one joint.
    """
    scenario = load_scenario("series-2")
    rig, means = scenario_rig(scenario), []
    texts = {**c_command(rig, "command", "filter", Plain(single=True)).files, "both.h": BOTH}
    for beside, files in (("", {}), ("both", texts)):
        for file, text in files.items():
            (tmp_path / file).write_text(text)
        measured, _ = measure(rig, scenario, "adaptive", tmp_path, beside=beside)
        means.append(measured.instructions[0])
    assert 0 < means[1] - means[0] < 30_000
