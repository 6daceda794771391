"""The filter as an FMU for co-simulation (FMI 3.0), with its C sources and with binaries for the
platforms that can be compiled for.

Shared libraries from C sources: for this platform by its own compiler, for others by ziglang
where it is installed.
"""

from __future__ import annotations

import importlib.util
import io
import platform
import subprocess
import sys
import tempfile
import uuid
import zipfile
from collections.abc import Container, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from xml.etree import ElementTree

from distal.errors import ExportError
from distal.estimators import KernelEstimator, make_estimator
from distal.export.health_source import spoken
from distal.export.names import angle_fields, filled, outputs, torque_fields
from distal.export.source import Exported, c_filter
from distal.kernels import find_compiler
from distal.kernels.compiler import LOG, SWITCHED_OFF
from distal.logs import LARGEST_READING, write_whole
from distal.rig import Rig, std_name
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
    architecture = {"amd64": "x86_64", "arm64": "aarch64", "i386": "x86", "i686": "x86"}.get(
        machine, machine
    )
    return f"{architecture}-{ {'win32': 'windows'}.get(sys.platform, sys.platform) }"


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
    if everywhere and importlib.util.find_spec("ziglang") is None:
        others = ", ".join(other for other in ZIG_TARGETS if other != here)
        reasons.append(f"{others} need ziglang: pip install ziglang")
    elif everywhere:
        zig = [sys.executable, "-m", "ziglang", "cc", "-s", "-target"]
        commands = {where: [*zig, target] for where, target in ZIG_TARGETS.items()}
    if not isinstance(compiler, str) and here.split("-")[1] in SUFFIX:
        commands[here] = compiler.command
    with tempfile.TemporaryDirectory() as folder:
        for file, text in sources.items():
            Path(folder, file).write_text(text, encoding="utf-8")
        files = [file for file in sources if file.endswith(".c")]
        with ThreadPoolExecutor() as pool:
            made = dict(
                zip(
                    commands,
                    pool.map(
                        lambda at: _made(folder, [*commands[at], *_FLAGS], files, at), commands
                    ),
                )
            )
    reasons += [f"{where}: {reason}" for where, reason in made.items() if isinstance(reason, str)]
    return {where: code for where, code in made.items() if isinstance(code, bytes)}, "; ".join(
        reasons
    )


def _made(folder: str, command: Sequence[str], files: Sequence[str], where: str) -> bytes | str:
    """Return the shared library that a compiler makes in a folder, or the reason why it fails."""
    command = [*command, *files, "-lm", "-o", f"made-{where}"]
    try:
        done = subprocess.run(
            command, cwd=folder, capture_output=True, text=True, errors="replace", timeout=600
        )
    except (OSError, subprocess.SubprocessError) as problem:
        return f"the C compiler did not run ({type(problem).__name__})"
    LOG.info("%s is done", where)
    if done.returncode != 0:
        return f"the C compiler failed: {(done.stderr.strip().splitlines() or ['no message'])[0]}"
    return Path(folder, f"made-{where}").read_bytes()


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
    estimator: str = "adaptive",
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
        estimator: name of the estimator.
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
    chosen = make_estimator(estimator, rig, compiled=False)
    variables = [*_variables(chosen, exported)]
    identified = [variable for variable in variables if variable.causality == "output"]
    # the same filter has the same token, whenever it was written
    token = "{" + str(uuid.uuid5(uuid.NAMESPACE_OID, exported.source)) + "}"
    values = {
        "name": exported.name,
        "NAME": exported.name.upper(),
        "n_outputs": str(len(identified)),
        "told": ", ".join(f"now->out.{variable.field}" for variable in identified),
        "prior": outputs(chosen, len(chosen.state_names), stepped=False),
        "not_yet": str(len(spoken())),
        "token": token,
        "wild": f"{LARGEST_READING:.17g}",
    }
    interface = filled(
        resources.files("distal.export").joinpath("fmi3.c").read_text(encoding="utf-8"), values
    )
    sources = {
        f"{exported.name}.h": exported.header,
        f"{exported.name}.c": exported.source,
        f"{exported.name}_fmi3.c": interface,
    }
    fmu = io.BytesIO()
    binaries, without = binaries_of(sources, everywhere)
    with zipfile.ZipFile(fmu, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("modelDescription.xml", _description(rig, exported, variables, token))
        archive.writestr("sources/buildDescription.xml", _build_description(exported.name))
        for file, text in sources.items():
            archive.writestr(f"sources/{file}", text)
        for platform, binary in binaries.items():
            archive.writestr(
                f"binaries/{platform}/{exported.name}{SUFFIX[platform.split('-')[1]]}", binary
            )
    write_whole(out, fmu.getvalue())
    names = (*(variable.name for variable in identified), _free("health", exported.channels))
    return Fmu(exported, exported.channels, names, tuple(binaries), without)


@dataclass(frozen=True)
class _Variable:
    """A variable of the model: an input, or an output with the field of the C output that holds
    it.
    """

    name: str
    causality: str
    unit: str
    description: str
    field: str = ""


def _variables(chosen: KernelEstimator, exported: Exported) -> Iterator[_Variable]:
    rig = chosen.rig
    sensors = {sensor.name: sensor for sensor in rig.sensors}
    for channel in exported.channels:
        sensor = sensors[channel]
        yield _Variable(
            channel, "input", sensor.si, f"{sensor.measures} of {sensor.of}; NaN where missing"
        )
    angles = (angle for angle, _ in angle_fields(rig))
    fields = [
        (angle, joint.name, "angle", "rad") for joint, angle in zip(rig.joints, angles, strict=True)
    ]
    fields += [(field, field, "torque from outside", "N m") for _, field in torque_fields(chosen)]
    for field, part, quantity, unit in fields:
        std = std_name(field), f"standard deviation of the error of the {quantity}"
        for name, description in ((field, quantity), std):
            yield _Variable(_free(name, sensors), "output", unit, f"{description}, {part}", name)


def _free(name: str, taken: Container[str]) -> str:
    """Return a name that no sensor has, since a sensor may have the name of an output."""
    return name if name not in taken else _free(f"{name}_estimate", taken)


def _description(rig: Rig, exported: Exported, variables: list[_Variable], token: str) -> bytes:
    root = ElementTree.Element(
        "fmiModelDescription",
        fmiVersion="3.0",
        modelName="".join(c if c.isprintable() else " " for c in rig.name),
        description="Where the joints are, from what is measured at the proximal end of the "
        "tendons. A sample is taken in "
        "when a step begins; outputs are predictions of the step's end, health is that of the "
        "sample",
        instantiationToken=token,
        generationTool=f"distal {__version__}",
        variableNamingConvention="flat",
    )
    ElementTree.SubElement(
        root,
        "CoSimulation",
        modelIdentifier=exported.name,
        canHandleVariableCommunicationStepSize="true",
        canGetAndSetFMUState="true",
        canSerializeFMUState="true",
    )
    units = ElementTree.SubElement(root, "UnitDefinitions")
    for unit in dict.fromkeys(["s", *(variable.unit for variable in variables)]):
        base = {key: str(power) for key, power in base_powers(unit).items()}
        ElementTree.SubElement(ElementTree.SubElement(units, "Unit", name=unit), "BaseUnit", base)
    types = ElementTree.SubElement(root, "TypeDefinitions")
    health = ElementTree.SubElement(types, "EnumerationType", name="Health")
    words = {word: HEALTH[word] for word in spoken()} | {
        "not_yet": "no sample was taken in: the outputs are the prior"
    }
    for code, (word, meaning) in enumerate(words.items()):
        ElementTree.SubElement(health, "Item", name=word, value=str(code), description=meaning)
    ElementTree.SubElement(
        root, "DefaultExperiment", startTime="0", stepSize=repr(exported.interval)
    )
    model = ElementTree.SubElement(root, "ModelVariables")
    names = {variable.name for variable in variables}
    ElementTree.SubElement(
        model,
        "Float64",
        name=_free("time", names),
        valueReference="0",
        causality="independent",
        variability="continuous",
        unit="s",
    )
    structure = ElementTree.SubElement(root, "ModelStructure")
    for reference, variable in enumerate(variables, 1):
        ElementTree.SubElement(model, "Float64", _attributes(variable, reference))
    ElementTree.SubElement(
        model,
        "Enumeration",
        name=_free("health", names),
        valueReference=str(len(variables) + 1),
        causality="output",
        declaredType="Health",
        variability="discrete",
        description="whether the stream can be trusted",
    )
    references = [i for i, variable in enumerate(variables, 1) if variable.causality == "output"]
    for kind in ("Output", "InitialUnknown"):
        for reference in (*references, len(variables) + 1):
            ElementTree.SubElement(structure, kind, valueReference=str(reference))
    return _written(root)


def _attributes(variable: _Variable, reference: int) -> dict[str, str]:
    is_input = variable.causality == "input"
    attributes = {
        "name": variable.name,
        "valueReference": str(reference),
        "causality": variable.causality,
    }
    attributes |= {"unit": variable.unit, "description": variable.description}
    attributes |= (
        {"variability": "continuous", "start": "NaN"} if is_input else {"variability": "discrete"}
    )
    return attributes


def _written(root: ElementTree.Element) -> bytes:
    ElementTree.indent(root)
    return bytes(ElementTree.tostring(root, "utf-8", xml_declaration=True))


def _build_description(name: str) -> bytes:
    root = ElementTree.Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = ElementTree.SubElement(root, "BuildConfiguration", modelIdentifier=name)
    files = ElementTree.SubElement(configuration, "SourceFileSet", language="C99")
    for file in (f"{name}.c", f"{name}_fmi3.c"):
        ElementTree.SubElement(files, "SourceFile", name=file)
    return _written(root)
