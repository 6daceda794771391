"""The filter as an FMU for co-simulation (FMI 3.0), with its C sources and with binaries for the
platforms that can be compiled for: this one by its own compiler, others by ziglang where it is
installed.
"""

from __future__ import annotations

import io
import platform
import tempfile
import uuid
import zipfile
from collections.abc import Container, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from xml.sax.saxutils import quoteattr

from distal.errors import ExportError
from distal.export.c_source import (
    Exported,
    c_filter,
    comment,
    filled,
    outputs,
    sensors_of,
    spoken,
)
from distal.kernels import find_compiler
from distal.kernels.compiler import SWITCHED_OFF, CompileError, run_compiler, zig_compiler
from distal.logs import LARGEST_READING, write_whole
from distal.rig import Rig
from distal.run.health import HEALTH
from distal.units import base_powers
from distal.version import __version__

ZIG_TARGETS = {
    "x86_64-linux": "x86_64-linux-gnu.2.17",
    "aarch64-linux": "aarch64-linux-gnu.2.17",
    "x86_64-windows": "x86_64-windows-gnu",
    "x86_64-darwin": "x86_64-macos",
    "aarch64-darwin": "aarch64-macos",
}
"""Platform by FMI's name → target by zig's name. On Linux it is for an old C library, 2.17, so that
the binary runs on every Linux in use.
"""

SUFFIX = {"linux": ".so", "darwin": ".dylib", "windows": ".dll"}
"""Operating system → ending of a shared library's name."""

_FLAGS = (
    "-std=c99",
    "-O2",
    "-ffp-contract=off",
    "-fno-math-errno",
    "-fvisibility=hidden",
    "-fPIC",
    "-shared",
)


def this_platform() -> str:
    """Return FMI's name of the platform on which this program runs."""
    machine = platform.machine().lower()
    architecture = {"amd64": "x86_64", "arm64": "aarch64"}.get(machine, machine)
    return f"{architecture}-{platform.system().lower()}"


def binaries_of(sources: Mapping[str, str], everywhere: bool) -> tuple[dict[str, bytes], str]:
    """Return platform → shared library compiled from C sources, and a text that says why platforms
    are missing.

    The text is empty where none is missing.

    Args:
        sources: name of a file → its text.
        everywhere: whether the platforms of `ZIG_TARGETS` are wanted, too.
    """
    compiler = find_compiler()
    here = this_platform()
    if compiler == SWITCHED_OFF:
        return {}, compiler
    commands: dict[str, Sequence[str]] = {}
    reasons = [compiler] if isinstance(compiler, str) else []
    for where, target in ZIG_TARGETS.items() if everywhere else ():
        zig = zig_compiler(target)
        if zig is not None:
            commands[where] = zig
    if everywhere and not commands:
        others = ", ".join(other for other in ZIG_TARGETS if other != here)
        reasons.append(f"{others} need ziglang: pip install ziglang")
    if not isinstance(compiler, str) and here.split("-")[1] in SUFFIX:
        commands[here] = compiler.command
    files = [file for file in sources if file.endswith(".c")]
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor() as pool:
        for file, text in sources.items():
            Path(folder, file).write_text(text, encoding="utf-8")

        def compiled(where: str) -> bytes | str:
            library = Path(folder, f"made-{where}")
            command = [*commands[where], *_FLAGS, *files, "-lm", "-o", library.name]
            try:
                run_compiler(command, folder)
            except CompileError as problem:
                return f"{where}: {problem}"
            return library.read_bytes()

        results = dict(zip(commands, pool.map(compiled, commands)))
    reasons += [reason for reason in results.values() if isinstance(reason, str)]
    binaries = {where: code for where, code in results.items() if isinstance(code, bytes)}
    return binaries, "; ".join(reasons)


@dataclass(frozen=True)
class Fmu:
    """An FMU that was written.

    Args:
        exported: the filter in C that it holds.
        inputs: names of its inputs, the sensors, in order.
        outputs: names of its outputs, in order.
        platforms: FMI's names of the platforms for which it has a binary; on others, a tool builds
            one from its sources.
        without: why it has no binaries for other platforms; empty where none is missing.
    """

    exported: Exported
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    platforms: tuple[str, ...]
    without: str = ""


def export_fmu(
    rig: Rig,
    out: str | Path,
    estimator: str | None = None,
    name: str | None = None,
    everywhere: bool = True,
) -> Fmu:
    """Write an estimator of a rig as an FMU for co-simulation, FMI 3.0.

    Inputs are the sensor readings [SI], NaN where one is missing. Outputs are joint angles,
    external torques, their standard deviations, and the health of the stream. Before the first
    sample the outputs are the prior, with the health ``not_yet``; after a step they are predictions
    for its end.

    Args:
        out: the file, which ends in .fmu.
        estimator: name of the estimator; None: the rig's usual one.
        name: prefix of the C names, and the model's identifier; by default it is made from the
            rig's title and the estimator.
        everywhere: whether binaries for Linux, Windows and macOS are made, where ziglang is
            installed; otherwise there is one for this platform only.

    Raises:
        ExportError: the file's name does not end in .fmu, the name is no C identifier, or the
            estimator cannot be written in C.
        EstimationError: the estimator cannot run on this rig.
        OutputError: the file cannot be written.
    """
    if Path(out).suffix.lower() != ".fmu":
        raise ExportError(f"{out}: an FMU is one file; give a name that ends in .fmu")
    exported = c_filter(rig, estimator, False, name)
    channels = exported.estimator.channels
    names_in_c = [part for field in exported.fields for part in (field.name, field.std)]
    # the same filter has the same token, whenever it was written
    token = "{" + str(uuid.uuid5(uuid.NAMESPACE_OID, exported.source)) + "}"
    values = {
        "name": exported.name,
        "n_outputs": len(names_in_c),
        "told": [f"now->out.{field}" for field in names_in_c],
        "prior": outputs(exported.estimator, stepped=False),
        "not_yet": len(spoken()),
        "token": token,
        "wild": LARGEST_READING,
    }
    interface = resources.files("distal.export").joinpath("fmi3.c").read_text(encoding="utf-8")
    sources = {**exported.files, f"{exported.name}_fmi3.c": filled(interface, values)}
    binaries, without = binaries_of(sources, everywhere)
    fmu = io.BytesIO()
    with zipfile.ZipFile(fmu, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("modelDescription.xml", _description(exported, token))
        archive.writestr("sources/buildDescription.xml", filled(_BUILD, values))
        for file, text in sources.items():
            archive.writestr(f"sources/{file}", text)
        for where, binary in binaries.items():
            suffix = SUFFIX[where.split("-")[1]]
            archive.writestr(f"binaries/{where}/{exported.name}{suffix}", binary)
    write_whole(out, fmu.getvalue())
    names = tuple(_free(name, channels) for name in (*names_in_c, "health"))
    return Fmu(exported, channels, names, tuple(binaries), without)


def _free(name: str, taken: Container[str]) -> str:
    """Return a name that no sensor has, since a sensor may have the name of an output."""
    return name if name not in taken else _free(f"{name}_estimate", taken)


def _description(exported: Exported, token: str) -> str:
    """Return the description of the model: its variables are the inputs, then the outputs, the
    health last.
    """
    estimator = exported.estimator
    channels = estimator.channels
    variables: dict[str, dict[str, str]] = {
        sensor.name: {
            "causality": "input",
            "unit": sensor.si,
            "description": f"{sensor.measures} of {sensor.of}; NaN where missing",
            "variability": "continuous",
            "start": "NaN",
        }
        for sensor in sensors_of(estimator)
    }
    for field in exported.fields:
        std = f"standard deviation of the error of the {field.meaning}"
        for name, meaning in ((field.name, field.meaning), (field.std, std)):
            variables[_free(name, channels)] = {
                "causality": "output",
                "unit": field.unit,
                "description": meaning,
                "variability": "discrete",
            }
    units = dict.fromkeys(["s", *(attributes["unit"] for attributes in variables.values())])
    words = [*((word, HEALTH[word]) for word in spoken()), ("not_yet", _NOT_YET)]
    count = len(variables) + 1
    values = {
        "rig": quoteattr(comment(estimator.rig.name)),
        "token": token,
        "version": __version__,
        "name": exported.name,
        "step": repr(estimator.interval),
        "time": _free("time", channels),
        "health": _free("health", channels),
        "n": count,
        "units": "".join(
            f"<Unit name={quoteattr(unit)}>{_element('BaseUnit', **base_powers(unit))}</Unit>"
            for unit in units
        ),
        "words": "".join(
            _element("Item", name=word, value=code, description=meaning)
            for code, (word, meaning) in enumerate(words)
        ),
        "variables": "\n".join(
            _element("Float64", name=name, valueReference=i, **attributes)
            for i, (name, attributes) in enumerate(variables.items(), 1)
        ),
        "structure": "".join(
            _element(kind, valueReference=i)
            for kind in ("Output", "InitialUnknown")
            for i in range(len(channels) + 1, count + 1)
        ),
    }
    return filled(_MODEL, values)


def _element(tag: str, **attributes: object) -> str:
    """Return an XML element without content."""
    pairs = "".join(f" {key}={quoteattr(str(value))}" for key, value in attributes.items())
    return f"<{tag}{pairs}/>"


_NOT_YET = "no sample was taken in: the outputs are the prior"

_MODEL = """\
<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName=$rig$ instantiationToken="$token$"
 description="Where the joints are, from what is measured at the proximal end of the tendons. A
sample is taken in when a step begins; outputs are predictions of the step's end, health is that of
the sample" generationTool="distal $version$" variableNamingConvention="flat">
<CoSimulation modelIdentifier="$name$" canHandleVariableCommunicationStepSize="true"/>
<UnitDefinitions>$units$</UnitDefinitions>
<TypeDefinitions><EnumerationType name="Health">$words$</EnumerationType></TypeDefinitions>
<DefaultExperiment startTime="0" stepSize="$step$"/>
<ModelVariables>
<Float64 name="$time$" valueReference="0" causality="independent" unit="s"
 variability="continuous"/>
$variables$
<Enumeration name="$health$" valueReference="$n$" causality="output" declaredType="Health"
 variability="discrete" description="whether the stream can be trusted"/>
</ModelVariables>
<ModelStructure>$structure$</ModelStructure>
</fmiModelDescription>
"""

_BUILD = """\
<?xml version="1.0" encoding="UTF-8"?>
<fmiBuildDescription fmiVersion="3.0"><BuildConfiguration modelIdentifier="$name$">
<SourceFileSet language="C99"><SourceFile name="$name$.c"/><SourceFile name="$name$_fmi3.c"/>
</SourceFileSet></BuildConfiguration></fmiBuildDescription>
"""
