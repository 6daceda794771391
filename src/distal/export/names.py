"""Names of exported filters: those that C functions, files and CMake targets may have on every
system.

Outputs of an exported filter: joint angles and external torques, under names that C allows.
"""

from __future__ import annotations

import re

from distal.errors import ExportError
from distal.estimators import KernelEstimator, external_torques_of
from distal.logs import shown
from distal.rig import Rig, angle_names, std_name


def filled(template: str, values: dict[str, str]) -> str:
    """Return a template in which each ``$name$`` is replaced by the value of that name.

    Blanks in the values themselves are not replaced.
    """
    return re.sub(r"\$(\w+)\$", lambda m: values[m[1]], template)


def comment(text: str) -> str:
    """Return a text without what would end a C comment, cut to 200 characters."""
    plain = "".join(c if c.isprintable() else " " for c in text)[:200]
    for ends, harmless in (("\\", "/"), ("??", "? ?"), ("*/", "* /"), ("/*", "/ *"), ("*/", "* /")):
        plain = plain.replace(ends, harmless)
    return " ".join(plain.split())


def angle_fields(rig: Rig) -> list[tuple[str, str]]:
    """Return for each joint the C names of its angle and of the angle's standard deviation in the
    filter's output.

    They are ``angle`` and ``angle_std`` for one joint. Otherwise they are those of `angle_names`,
    with _ for characters that C does not allow.
    """
    joints = rig.joint_names
    if len(joints) == 1:
        return [("angle", "angle_std")]
    names: list[str] = []
    for angle in angle_names(joints):
        plain = re.sub(r"[^A-Za-z0-9]", "_", angle)
        names.append(
            next(n for n in (plain, *(f"{plain}_{i}" for i in range(2, 10_000))) if n not in names)
        )
    return [(name, std_name(name)) for name in names]


def torque_fields(estimator: KernelEstimator) -> list[tuple[str, str]]:
    """Return for each external torque the name of its state and its C name in the filter's
    output.
    """
    states = [estimator.state_names[i] for i in external_torques_of(estimator).values()]
    return [(state, re.sub(r"[^A-Za-z0-9]", "_", state)) for state in states]


def members(estimator: KernelEstimator, name: str) -> str:
    """Return the C members of the output's struct: angles and external torques with their standard
    deviations.
    """
    lines = []
    rig = estimator.rig
    for (angle, std), joint in zip(angle_fields(rig), rig.joints):
        which = "the joint" if len(rig.joints) == 1 else comment(joint.name)
        lines += [f"  {name}_real {angle}; /* of {which} [rad] */"]
        lines += [f"  {name}_real {std}; /* standard deviation of its error [rad] */"]
    for _, field in torque_fields(estimator):
        lines += [f"  {name}_real {field}; /* on the joint [N m] */"]
        lines += [f"  {name}_real {std_name(field)}; /* standard deviation of its error [N m] */"]
    return "\n".join(lines)


def outputs(estimator: KernelEstimator, n: int, stepped: bool = True) -> str:
    """Return the C lines that fill the `members` from the kernel state.

    Args:
        n: number of states.
        stepped: whether a sample was taken in; before the first one, learned maps change nothing.
    """
    fields = [(j, *pair) for j, pair in enumerate(angle_fields(estimator.rig))]
    fields += [
        (estimator.state_names.index(state), f, std_name(f))
        for state, f in torque_fields(estimator)
    ]
    lines = []
    report = estimator.report
    for at, field, std in fields:
        estimate = f"state->kernel_state[{at}]"
        variance = f"state->kernel_state[{n + at * (n + 1)}]"
        if stepped and at in report.states:  # a learned map speaks of it
            k = report.states.index(at)
            gain = f"y[{report.gains[k]}]"
            estimate = f"y[{report.values[k]}]"
            variance = f"{gain} * {gain} * {variance} + y[{report.variances[k]}]"
        lines += [f"    out->{field} = {estimate};", f"    out->{std} = root({variance});"]
    return "\n".join(lines)


HEADERS = """
assert complex ctype errno fenv float inttypes iso646 limits locale math setjmp signal stdalign
stdarg stdatomic stdbool stdckdint stddef stdint stdio stdlib stdnoreturn string tgmath threads time
uchar wchar wctype
"""
"""Headers of C: a file of the same name would hide them."""

INCLUDED = """
alloca availability availabilitymacros concurrencysal corecrt corecrt_io corecrt_malloc corecrt_math
corecrt_memory corecrt_memcpy_s corecrt_search corecrt_share corecrt_stdio_config corecrt_terminate
corecrt_wio corecrt_wprocess corecrt_wstdio corecrt_wstdlib corecrt_wstring corecrt_wtime crtdefs
endian fcntl features malloc memory newlib picolibc pthread reent sal sched strings swab unistd
vadefs vcruntime vcruntime_new vcruntime_new_debug vcruntime_string yvals yvals_core
"""
"""Headers that those of C include on Linux, macOS, Windows and with newlib."""

TARGETS = """
all all_build clean cmake_check_build_system cmake_force default_target depend edit_cache help
install list_install_components m package package_source preinstall rebuild_cache replay run_tests
test zero_check
"""
"""Names that CMake or the export uses for targets, and ``m``, the mathematics library."""

TAKEN = frozenset((HEADERS + INCLUDED + TARGETS).split())
"""All names that a filter cannot have."""

DEVICES = re.compile(r"con|prn|aux|nul|com[0-9]|lpt[0-9]")
"""Names of devices, which no file can have on Windows."""


def c_name(text: str) -> str:
    """Return a C identifier made from a text, which C names may begin with."""
    plain = re.sub(r"[^a-z0-9]+", "_", text.lower()).strip("_")[:100].rstrip("_")
    if not plain or not plain[0].isalpha() or _taken(plain):
        plain = f"rig_{plain}"[:100].rstrip("_")
    return plain


def checked_name(name: str) -> str:
    """Return the name unchanged, if C names and files may begin with it.

    Raises:
        ExportError: the name is no C identifier of lower-case letters, digits and _, does not begin
            with a letter, or is taken.
    """
    if not re.fullmatch(r"[a-z][a-z0-9_]{0,99}", name):
        raise ExportError(
            f"'{shown(name)}' cannot begin the names of C functions; up to 100 lower-case "
            "letters, digits and _ can, "
            "a letter first"
        )
    if _taken(name):
        raise ExportError(
            f"'{name}' is the name of a header of C, a target of CMake or a device; give another "
            "one (--name)"
        )
    return name


def _taken(name: str) -> bool:
    return name in TAKEN or DEVICES.fullmatch(name) is not None
