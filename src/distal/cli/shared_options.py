"""What several commands share: their options; and their inputs and outputs, which are checked
before a command begins, see `distal.logs.check_outputs`.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from glob import escape, glob
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from distal.errors import OutputError

if TYPE_CHECKING:
    from distal.logs import Output


ESTIMATOR_NAMES = ("adaptive", "ekf", "ekf-2008", "elastic", "inextensible", "regression")
"""Names of all estimators, the keys of `distal.ESTIMATORS`; they stand here, too, so that a shell
completes them without importing the estimators.
"""


def estimators(incomplete: str) -> list[str]:
    """Return the names of estimators that begin with an incomplete word, for a shell's
    completion.
    """
    return [name for name in ESTIMATOR_NAMES if name.startswith(incomplete)]


def _completing(package: str) -> Callable[[str], list[str]]:
    """Return a function that completes a word to the names of a package's shipped files and to TOML
    files, without importing the package.
    """
    folder = Path(__file__).parents[1] / package / "library"

    def complete(incomplete: str) -> list[str]:
        pattern = f"{escape(incomplete)}*.toml"
        return sorted(path.stem for path in folder.glob(pattern)) + sorted(glob(pattern))

    return complete


rigs = _completing("rig")
"""Completion of rigs."""

scenarios = _completing("simulation")
"""Completion of scenarios."""

studies = _completing("study")
"""Completion of studies."""

RIG = "A shipped rig's name (see `distal rigs`) or a TOML file."
RigOption = Annotated[str, Option("--rig", help=RIG, autocompletion=rigs)]
RigArgument = Annotated[str, Argument(help=RIG, autocompletion=rigs)]
SCENARIO = "A shipped scenario's name (see `distal scenarios`) or a TOML file."
ScenarioArgument = Annotated[str, Argument(help=SCENARIO, autocompletion=scenarios)]
SetOption = Annotated[
    list[str],
    Option(
        "--set",
        default_factory=list,
        show_default=False,
        metavar="PATH=VALUE",
        help=(
            "Replace a value of the rig by names of its parts, e.g. "
            "joints.link.friction.coefficient=0.3 or "
            "'tendons.left.stiffness=\"2 N/mm\"'; repeatable."
        ),
    ),
]
SeedOption = Annotated[int, Option("--seed", min=0, help="Seed of the sensors' errors.")]


EstimatorOption = Annotated[
    str | None,
    Option("--estimator", "-e", help=f"{', '.join(ESTIMATOR_NAMES)}.", autocompletion=estimators),
]
HomingOption = Annotated[
    str | None,
    Option(
        "--homing",
        help="Use the reference for this long (e.g. 3s), then only compare with it.",
    ),
]
TruthOption = Annotated[
    str | None,
    Option("--truth", help="True joint angle: a column of LOG, or a file with t and theta in rad."),
]
PlotOption = Annotated[
    Path | None,
    Option(
        "--plot",
        help="Draw a picture (PNG, SVG or PDF): of the estimators that -e names, else of adaptive.",
    ),
]


def _angle_unit(unit: str | None) -> str | None:
    """Raise where a unit is not one of angles; the packages of results are not imported for
    this.
    """
    from distal.errors import EstimationError

    if unit not in (None, "rad", "deg"):
        raise EstimationError(f"--unit {unit}: angles are written in rad or deg")
    return unit


UnitOption = Annotated[
    str | None,
    Option(
        "--unit",
        callback=_angle_unit,
        help="Of the angles that are written: rad or deg. Default: as the log has them.",
    ),
]


def in_si(text: str, unit: str) -> float:
    """Return a quantity in SI, from a text such as ``500 mN``; a number without a unit is in SI
    already.

    Raises:
        UnitError: the text is no such quantity.
    """
    from distal.units import to_si

    try:
        return to_si(float(text), unit)
    except ValueError:
        return to_si(text, unit)


def joint_angle(text: str) -> tuple[str | None, float, float]:
    """Return the name of a joint, or None, its angle and the standard deviation [rad], from a text.

    The text is ``pip: -40 deg``, ``0 deg ± 1 deg`` or ``0 deg +- 1 deg``; without a standard
    deviation it is 0.

    Raises:
        UnitError: the text has no angle.
    """
    from distal.errors import UnitError

    name, colon, position = text.rpartition(":")
    text = position if colon else text
    parts = [part.strip() for part in re.split(r"±|\+-|\+/-", text)]
    if len(parts) > 2 or not all(parts):
        raise UnitError(f"an angle is written as '0 deg' or '0 deg ± 1 deg', {text!r} came")
    mean, *stds = (in_si(part, "rad") for part in parts)
    return name.strip() if colon else None, mean, stds[0] if stds else 0.0


def homing_time(text: str | None) -> float | None:
    """Return a time from a text such as ``3s``, ``200 ms`` or a bare number [s]; None stays None.

    Raises:
        UnitError: the text is no time, or one that is not above 0.
    """
    from distal.errors import UnitError

    if text is None:
        return None
    time = in_si(text, "s")
    if not time > 0.0:
        raise UnitError(f"--homing is a time above 0 s, {text} came")
    return time


LagOption = Annotated[
    str | None,
    Option(
        "--reference-lag",
        help="By how much the true angles are later than the drives, e.g. '40 ms', or 0; default: "
        "found in the logs.",
    ),
]


BAG = (".db3", ".mcap", ".bag", ".zstd", ".yaml")
"""Endings of the files of a ROS bag."""


def to_file(option: str, path: Path | None, kind: str = "") -> list[Output]:
    """Return the file that an option asks for; none where the option was not given.

    Args:
        kind: kind of output, see `ENDINGS`.
    """
    from distal.logs import Output

    return [] if path is None else [Output(path, option, kind=kind)]


def to_folder(option: str, folder: Path | None, names: Iterable[str]) -> list[Output]:
    """Return the files in the folder that an option asks for; none where the option was not
    given.
    """
    from distal.logs import outputs_in

    return [] if folder is None else outputs_in(folder, names, option)


def check_command_outputs(
    outputs: Sequence[Output],
    *,
    logs: Iterable[Path] = (),
    rig: str | None = None,
    scenario: str | None = None,
    truth: str | None = None,
) -> None:
    """Raise where an output would replace an input or another output, or cannot be written.

    Args:
        logs: paths of the logs that are read.
        rig: name of a shipped rig, or a path.
        scenario: name of a shipped scenario, or a path.
        truth: name of a column, or a path.

    Raises:
        OutputError: see `distal.logs.check_outputs` and `distal.logs.check_format`; or a path does
            not end as its kind of output does.
    """
    from distal import logs as files
    from distal.rig import description_path

    inputs: list[tuple[str, str | Path]]
    inputs = [("log", file) for log in logs for file in _files_of(log)]
    if rig is not None:
        inputs.append(("rig", description_path(rig, "distal.rig")))
    if scenario is not None:
        inputs.append(("scenario", description_path(scenario, "distal.simulation")))
    if truth is not None and (os.path.exists(truth) or Path(truth).suffix.lower() in files.TABLES):
        inputs.append(("truth", truth))
    files.check_outputs(outputs, inputs)
    for output in outputs:
        files.check_format(output.path)
        endings = ENDINGS.get(output.kind)
        if endings is not None and output.path.suffix.lower() not in endings:
            allowed = " or ".join(filter(None, endings))
            raise OutputError(f"{output.path}: {output.kind} ends in {allowed}")


def _files_of(log: Path) -> Iterator[Path]:
    """Yield the files from which a log is read; a ROS bag has several in its folder."""
    yield log
    folder = log.parent if log.suffix.lower() == ".db3" else log
    if folder.is_dir():
        yield from (file for file in sorted(folder.iterdir()) if file.suffix.lower() in BAG)


ENDINGS = {
    "a rig file": (".toml",),
    "a page": (".html", ".htm"),
    "a table": (".csv", ".txt", ".parquet", ".pq", ""),
}
"""Kind of output → endings of its path; a table may go to a pipe, whose path has none."""


def check_new(path: Path) -> None:
    """Raise an `OutputError` where a file exists already, since a user may have edited it."""
    if path.exists():
        raise OutputError(f"{path}: exists already; give another name or remove it")


def check_folder(out: Path, when: str) -> None:
    """Raise an `OutputError` where a folder is a file, or named like one."""
    from distal.logs import TABLES

    if os.path.isfile(out) or out.suffix.lower() in TABLES:
        raise OutputError(f"{out}: is a file, or named like one; {when}, --out is a folder")
