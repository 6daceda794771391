"""The float filter on a Cortex-M4F, emulated: size, memory, instructions, and the same angles."""

from __future__ import annotations

import re
import struct
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from distal import Rig, estimate, load_rig, load_scenario, scenario_rig, simulate
from distal.estimators import make_estimator
from distal.export import Exported, c_filter
from distal.run import samples_of
from distal.simulation import Scenario, build_scenario
from tests.export.helpers import missing_tools

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(bool(missing_tools()), reason=f"not installed: {missing_tools()}"),
]
FIRMWARE = Path(__file__).parent / "firmware"
CORTEX = [
    "-std=c99",
    "-Os",
    "-mcpu=cortex-m4",
    "-mthumb",
    "-mfpu=fpv4-sp-d16",
    "-mfloat-abi=hard",
    "-fno-math-errno",
]
SAMPLES = 300


@dataclass(frozen=True)
class Measured:
    """What the emulated processor did.

    Args:
        flash: bytes of code, constants and initial data, with startup and mathematics library.
        ram: bytes of state, stack and the library's data.
        instructions: of a step, mean and most.
        rows: angle and std of each joint, a row for each sample.
        error_degrees: largest difference of an angle to double precision [°].
    """

    flash: int
    ram: int
    instructions: tuple[float, float]
    rows: np.ndarray
    error_degrees: float


def cases() -> list[tuple[str, Rig, Scenario]]:
    """Return rigs to measure, and what moves them."""
    made = []
    for name in ("paper-2008-printed", "pulley-antagonist", "capstan-joint", "da-vinci-grasper"):
        if name == "paper-2008-printed":
            scenario = load_scenario("series-2")
        else:
            servo = {
                "angle": {"amplitude": 0.5, "frequency": 0.4},
                "stiffness": 20.0,
                "damping": 0.3,
            }
            pull = {"weight": {"mean": "3 N", "amplitude": "1 N", "frequency": "0.5 Hz"}}
            drives = (
                {"left": pull, "right": {"weight": "3 N"}}
                if name == "pulley-antagonist"
                else {"motor": {"servo": servo}}
            )
            scenario = build_scenario({"rig": name, "duration": 4.0, "drives": drives}, name)
        made.append((name, scenario_rig(scenario), scenario))
    return [*made, *chains()]


def chains() -> list[tuple[str, Rig, Scenario]]:
    """Return chains of joints, and what moves them."""
    made = [
        (name, scenario_rig(scenario), scenario)
        for name, scenario in (
            ("wrist-instrument", load_scenario("wrist")),
            ("finger-2n", load_scenario("finger")),
        )
    ]
    rig = load_rig("finger-n-plus-1")
    drives = {}
    for k, drive in enumerate(rig.drives):
        position = {"amplitude": "2 mm" if k % 2 else "-2 mm", "frequency": "0.4 Hz"}
        drives[drive.name] = {
            "force": "10 N",
            "servo": {"position": position, "stiffness": 5000.0, "damping": 10.0},
        }
    described = {"rig": "finger-n-plus-1", "duration": 4.0, "drives": drives}
    return [*made, ("finger-n-plus-1", rig, build_scenario(described, "finger-n-plus-1"))]


def literal(value: float) -> str:
    return "NAN" if np.isnan(value) else f"{value:.9e}f"


def measure(
    rig: Rig,
    scenario: Scenario,
    name: str,
    folder: Path,
    made: Exported | None = None,
    flags: Sequence[str] = (),
) -> tuple[Measured, Exported]:
    """Build the smallest product and a program with a log, look at one and run the other."""
    made = made or c_filter(rig, name, True, "filter")
    log = simulate(rig, scenario, 6).select(slice(0, SAMPLES))
    samples = samples_of(log, make_estimator(name, rig, compiled=False).channels)
    (folder / "filter.c").write_text(made.source)
    (folder / "filter.h").write_text(made.header)
    steps = ", ".join(literal(dt) for dt in np.diff(log.time, prepend=log.time[0]))
    rows = ",\n".join("{" + ", ".join(map(literal, row)) + "}" for row in samples)
    (folder / "log.h").write_text(
        f"#include <math.h>\n#define SAMPLES {len(samples)}\nstatic const float steps[] = "
        f"{{{steps}}};\n"
        f"static const float samples[][{samples.shape[1]}] = {{\n{rows}}};\n"
    )
    identified = ",".join(
        f"out.{part}"
        for field in made.fields[: len(rig.joints)]
        for part in (field.name, field.std)
    )
    names = [
        '-DFILTER_HEADER="filter.h"',
        "-DFILTER(x)=filter_##x",
        f"-DFILTER_TOLD(out)={identified}",
    ]
    common = [
        *CORTEX,
        "-Wall",
        "-Wextra",
        "-Werror",
        "-Wdouble-promotion",
        "-ffunction-sections",
        "-fdata-sections",
        *names,
        *flags,
    ]
    linked = [
        "-nostartfiles",
        "--specs=nano.specs",
        "-Wl,--gc-sections",
        "-T",
        str(FIRMWARE / "mps2.ld"),
        "-lm",
    ]
    for program in ("sized", "replayed"):
        sources = [str(FIRMWARE / "startup.c"), str(FIRMWARE / f"{program}.c"), "filter.c"]
        command = [
            "arm-none-eabi-gcc",
            *common,
            f"-I{folder}",
            *sources,
            *linked,
            "-o",
            f"{program}.elf",
        ]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
    look: dict[str, Any] = {"cwd": folder, "capture_output": True, "text": True, "check": True}
    sizes = subprocess.run(["arm-none-eabi-size", "-A", "sized.elf"], **look)
    sections = {
        line.split()[0]: int(line.split()[1])
        for line in sizes.stdout.splitlines()
        if line.startswith(".")
    }
    symbols = subprocess.run(["arm-none-eabi-nm", "sized.elf"], **look)
    assert "__aeabi_d" not in symbols.stdout  # nothing of double precision
    board = ["-M", "mps2-an386", "-cpu", "cortex-m4", "-nographic", "-icount", "shift=0"]
    host = ["-semihosting-config", "enable=on,target=native", "-kernel", "replayed.elf"]
    run = subprocess.run(
        ["qemu-system-arm", *board, *host],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert run.returncode == 0, run.stderr[-400:]
    lines = (run.stdout + run.stderr).splitlines()
    ticks = [
        [int(word, 16) for word in line.split()[1:]] for line in lines if line.startswith("ticks")
    ]
    used, most, stack, million = ticks[0]
    bits = [line.split() for line in lines if re.fullmatch(r"([0-9a-f]{8} )+", line)]
    angles = np.array(
        [[struct.unpack(">f", bytes.fromhex(word))[0] for word in pairs] for pairs in bits]
    )
    per_tick = 1e6 / million  # SysTick counts 25 MHz of a clock of 1 GHz, one instruction each
    flash = sum(sections.get(name, 0) for name in (".text", ".ARM.exidx", ".data"))
    ram = sections.get(".data", 0) + sections.get(".bss", 0) + stack
    error = np.rad2deg(np.abs(angles[:, ::2] - estimate(log, rig, name).angles).max())
    return Measured(
        flash, ram, (used * per_tick / len(angles), most * per_tick), angles, float(error)
    ), made


def test_it_fits_and_is_right(tmp_path: Path) -> None:
    """At most 22 kB of flash, 4.3 kB of RAM and 18,500 instructions per step; angles to 0.02°."""
    rig = scenario_rig(load_scenario("series-2"))
    measured, _ = measure(rig, load_scenario("series-2"), "adaptive", tmp_path)
    assert len(measured.rows) == SAMPLES
    known = estimate(simulate(rig, load_scenario("series-2"), 6), rig, "adaptive")
    np.testing.assert_allclose(measured.rows[:, 0], known.theta[:SAMPLES], atol=np.deg2rad(0.02))
    np.testing.assert_allclose(
        measured.rows[:, 1], known.theta_std[:SAMPLES], atol=np.deg2rad(0.02), rtol=0.01
    )
    assert measured.flash <= 22 * 1024
    assert measured.ram <= 4.3 * 1024
    assert 5_000 < measured.instructions[0] < measured.instructions[1] <= 18_500


LIMITS = {
    "wrist-instrument": (60, 17, 168_000),
    "finger-2n": (52, 18, 150_000),
    "finger-n-plus-1": (64, 32, 300_000),
}
"""Most flash [kB], RAM [kB] and instructions of a step; a torque on each joint that forces may tell
of is a state more.
"""


@pytest.mark.parametrize(
    "name",
    ["wrist-instrument", *(pytest.param(n, marks=pytest.mark.more) for n in list(LIMITS)[1:])],
)
def test_a_chain_fits_and_is_right(name: str, tmp_path: Path) -> None:
    """All angles as in Python to 0.02°."""
    _, rig, scenario = next(case for case in chains() if case[0] == name)
    measured, _ = measure(rig, scenario, "adaptive", tmp_path)
    assert measured.rows.shape == (SAMPLES, 2 * len(rig.joints))
    assert np.ptp(measured.rows[:, 0]) > np.deg2rad(1.0)  # it moves
    assert measured.error_degrees <= 0.02
    flash, ram, instructions = LIMITS[name]
    assert 10_000 < measured.flash <= flash * 1024
    assert measured.ram <= ram * 1024
    assert measured.instructions[1] <= instructions
