"""The filter as an FMU: FMI 3.0 for co-simulation, with its sources and, where a compiler is, a binary of this platform."""

from __future__ import annotations

import io
import platform
import subprocess
import sys
import tempfile
import uuid
import zipfile
from collections.abc import Container, Iterator
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from xml.etree import ElementTree

from distal.errors import ExportError
from distal.estimators import make_estimator
from distal.export.fields import angle_fields, filled, torque_fields
from distal.export.health import spoken
from distal.export.source import Exported, c_filter
from distal.kernels import find_compiler
from distal.logs import LARGEST_READING, write_whole
from distal.rig import Rig, std_name
from distal.run.watch import HEALTH
from distal.units import base_powers
from distal.version import __version__


@dataclass(frozen=True)
class Fmu:
    """An FMU that was written.

    Args:
        inputs: names of the sensors, in order.
        outputs: names of what it puts out, in order.
        platforms: those that it has a binary for; for any other a tool builds it from its sources.
        without: why there is no binary; empty where there is one.
    """

    exported: Exported
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    platforms: tuple[str, ...]
    without: str = ""


def export_fmu(rig: Rig, out: str | Path, estimator: str = "adaptive", name: str | None = None) -> Fmu:
    """Write an estimator of a rig as an FMU for co-simulation, FMI 3.0.

    Inputs are the sensors [SI], NaN where a value is missing; outputs are angles, torques from outside, their standard
    deviations, and the health of the stream.

    Args:
        out: the file, which ends in .fmu.
        name: prefix of the names in C, and the model's identifier; default from the rig's title and the estimator.

    Raises:
        ExportError: the file's name does not end in .fmu, the name is no C identifier, or the estimator has no C.
        EstimationError: the estimator cannot run on this rig.
        OutputError: the file cannot be written.
    """
    if Path(out).suffix.lower() != ".fmu":
        raise ExportError(f"{out}: an FMU is one file; give a name that ends in .fmu")
    exported = c_filter(rig, estimator, False, name)
    variables = [*_variables(rig, exported)]
    outputs = [one for one in variables if one.causality == "output"]
    # the same filter has the same token, whenever it was written
    token = "{" + str(uuid.uuid5(uuid.NAMESPACE_OID, exported.source)) + "}"
    told = ", ".join(f"now->out.{one.field}" for one in outputs)
    template = resources.files("distal.export").joinpath("fmi3.c").read_text(encoding="utf-8")
    interface = filled(
        template,
        {
            "name": exported.name,
            "NAME": exported.name.upper(),
            "n_outputs": str(len(outputs)),
            "told": told,
            "token": token,
            "wild": f"{LARGEST_READING:.17g}",
        },
    )
    sources = {
        f"{exported.name}.h": exported.header,
        f"{exported.name}.c": exported.source,
        f"{exported.name}_fmi3.c": interface,
    }
    made = io.BytesIO()
    binary, without = _binary(exported.name, sources)
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("modelDescription.xml", _description(rig, exported, variables, token))
        archive.writestr("sources/buildDescription.xml", _build_description(exported.name))
        for file, text in sources.items():
            archive.writestr(f"sources/{file}", text)
        if binary is not None:
            archive.writestr(f"binaries/{_tuple()}/{exported.name}{_SUFFIX[sys.platform]}", binary)
    write_whole(out, made.getvalue())
    names = (*(one.name for one in outputs), _free("health", exported.channels))
    return Fmu(exported, exported.channels, names, (_tuple(),) if binary is not None else (), without)


@dataclass(frozen=True)
class _Variable:
    """A variable of the model: an input, or an output with its field in C."""

    name: str
    causality: str
    unit: str
    said: str
    field: str = ""


def _variables(rig: Rig, exported: Exported) -> Iterator[_Variable]:
    sensors = {sensor.name: sensor for sensor in rig.sensors}
    for channel in exported.channels:
        sensor = sensors[channel]
        yield _Variable(channel, "input", sensor.si, f"{sensor.measures} of {sensor.of}; NaN where missing")
    fields = [
        (value, joint.name, "angle", "rad") for joint, (value, _) in zip(rig.joints, angle_fields(rig), strict=True)
    ]
    runner = make_estimator(exported.estimator, rig, compiled=False)
    fields += [(field, field, "torque from outside", "N m") for _, field in torque_fields(runner)]
    for field, whose, what, unit in fields:
        for own, said in ((field, what), (std_name(field), f"standard deviation of the error of the {what}")):
            yield _Variable(_free(own, sensors), "output", unit, f"{said}, {whose}", own)


def _free(name: str, taken: Container[str]) -> str:
    """Return a name that no sensor has; a sensor may be called as an output is."""
    return name if name not in taken else _free(f"{name}_estimate", taken)


def _description(rig: Rig, exported: Exported, variables: list[_Variable], token: str) -> bytes:
    root = ElementTree.Element(
        "fmiModelDescription",
        fmiVersion="3.0",
        modelName=_plain(rig.name),
        description="Where the joints are, from what is measured at the proximal end of the tendons",
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
    for unit in dict.fromkeys(["s", *(one.unit for one in variables)]):
        base = {key: str(power) for key, power in base_powers(unit).items()}
        ElementTree.SubElement(ElementTree.SubElement(units, "Unit", name=unit), "BaseUnit", base)
    types = ElementTree.SubElement(root, "TypeDefinitions")
    health = ElementTree.SubElement(types, "EnumerationType", name="Health")
    for value, word in enumerate(spoken()):
        ElementTree.SubElement(health, "Item", name=word, value=str(value), description=HEALTH[word])
    ElementTree.SubElement(root, "DefaultExperiment", startTime="0", stepSize=repr(exported.interval))
    model = ElementTree.SubElement(root, "ModelVariables")
    ElementTree.SubElement(
        model,
        "Float64",
        name=_free("time", {one.name for one in variables}),
        valueReference="0",
        causality="independent",
        variability="continuous",
        unit="s",
    )
    structure = ElementTree.SubElement(root, "ModelStructure")
    for reference, one in enumerate(variables, 1):
        own = {"name": one.name, "valueReference": str(reference), "causality": one.causality, "unit": one.unit}
        own |= {"description": one.said, "variability": "continuous" if one.causality == "input" else "discrete"}
        ElementTree.SubElement(model, "Float64", own | ({"start": "NaN"} if one.causality == "input" else {}))
    last = {
        "name": _free("health", {one.name for one in variables}),
        "valueReference": str(len(variables) + 1),
        "causality": "output",
        "declaredType": "Health",
    }
    said = "whether the stream can be trusted"
    ElementTree.SubElement(model, "Enumeration", last | {"variability": "discrete", "description": said})
    told = [i for i, one in enumerate(variables, 1) if one.causality == "output"] + [len(variables) + 1]
    for kind in ("Output", "InitialUnknown"):
        for reference in told:
            ElementTree.SubElement(structure, kind, valueReference=str(reference))
    return _written(root)


def _written(root: ElementTree.Element) -> bytes:
    ElementTree.indent(root)
    return bytes(ElementTree.tostring(root, "utf-8", xml_declaration=True))


def _plain(text: str) -> str:
    return "".join(c if c.isprintable() else " " for c in text)


def _build_description(name: str) -> bytes:
    root = ElementTree.Element("fmiBuildDescription", fmiVersion="3.0")
    how = ElementTree.SubElement(root, "BuildConfiguration", modelIdentifier=name)
    files = ElementTree.SubElement(how, "SourceFileSet", language="C99")
    for file in (f"{name}.c", f"{name}_fmi3.c"):
        ElementTree.SubElement(files, "SourceFile", name=file)
    return _written(root)


_SUFFIX = {"linux": ".so", "darwin": ".dylib", "win32": ".dll"}
_SYSTEMS = {"linux": "linux", "darwin": "darwin", "win32": "windows"}


def _tuple() -> str:
    """Return this platform as FMI names it."""
    machine = platform.machine().lower()
    own = {"amd64": "x86_64", "arm64": "aarch64", "i386": "x86", "i686": "x86"}.get(machine, machine)
    return f"{own}-{_SYSTEMS.get(sys.platform, sys.platform)}"


def _binary(name: str, sources: dict[str, str]) -> tuple[bytes | None, str]:
    """Return the shared library of the sources, or None and why there is none."""
    compiler = find_compiler()
    if isinstance(compiler, str):
        return None, compiler
    if sys.platform not in _SUFFIX:
        return None, f"binaries are built for {', '.join(_SYSTEMS.values())}"
    with tempfile.TemporaryDirectory() as folder:
        for file, text in sources.items():
            Path(folder, file).write_text(text, encoding="utf-8")
        files = [file for file in sources if file.endswith(".c")]
        flags = ["-std=c99", "-O2", "-ffp-contract=off", "-fno-math-errno", "-fvisibility=hidden", "-fPIC", "-shared"]
        command = [*compiler.command, *flags, *files, "-lm", "-o", "made"]
        try:
            done = subprocess.run(command, cwd=folder, capture_output=True, text=True, errors="replace", timeout=300)
        except (OSError, subprocess.SubprocessError) as problem:
            return None, f"the C compiler did not run ({type(problem).__name__})"
        if done.returncode != 0:
            return None, f"the C compiler failed: {(done.stderr.strip().splitlines() or ['no message'])[0]}"
        return Path(folder, "made").read_bytes(), ""
