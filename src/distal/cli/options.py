"""Options that several commands share."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Annotated

import typer

RigOption = Annotated[str, typer.Option("--rig", help="A shipped rig's name (see `distal rigs`) or a TOML file.")]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="PATH=VALUE",
        help=(
            "Replace a value of the rig by names of its parts, e.g. joints.link.friction.coefficient=0.3 or "
            "'tendons.left.stiffness=\"2 N/mm\"'; repeatable."
        ),
    ),
]
RepeatedOption = Annotated[
    str | None,
    typer.Option(
        "--repeated", help="Which of several rows with one stamp is kept: first or last. Default: none is read."
    ),
]


def settings(set_: list[str] | None, repeated: str | None) -> list[str]:
    """Return what is set in the rig, by --set and by options that stand for it.

    Args:
        set_: of the option --set.
        repeated: of the option --repeated.
    """
    return [*(set_ or ()), *([] if repeated is None else [f'log.time.repeated="{repeated}"'])]


SeedOption = Annotated[int, typer.Option("--seed", min=0, help="Seed of the sensors' errors.")]


def _allow_memory(size: str | None) -> str | None:
    """Set the limit for this process and those that it starts."""
    from distal.logs import MEMORY_VARIABLE, size_of

    if size is not None:
        size_of(size)
        os.environ[MEMORY_VARIABLE] = size
    return size


MemoryOption = Annotated[
    str | None,
    typer.Option(
        "--max-memory",
        metavar="SIZE",
        callback=_allow_memory,
        help=("What reading one log may take, e.g. 16GB; default 2 GB, since a small file can ask for all there is."),
    ),
]
EstimatorOption = Annotated[
    str, typer.Option("--estimator", "-e", help="adaptive, affine, ekf, ekf-2008, elastic or inextensible.")
]
TruthOption = Annotated[
    str | None,
    typer.Option("--truth", help="True joint angle: a column of LOG, or a file with t and theta in rad."),
]
PlotOption = Annotated[
    Path | None,
    typer.Option(
        "--plot", help=("Draw a picture (PNG, SVG or PDF): of the estimators that -e names, else of adaptive.")
    ),
]


def angle(text: str) -> tuple[float, float]:
    """Return an angle and its std, given as ``-40 deg``, ``0 deg ± 1 deg`` or ``0 deg +- 1 deg`` [rad].

    Args:
        text: as typed; a bare number is in radians.

    Raises:
        UnitError: it is no angle.
    """
    from distal.errors import UnitError
    from distal.units import to_si

    parts = [part.strip() for part in re.split(r"±|\+-|\+/-", text)]
    if len(parts) > 2 or not all(parts):
        raise UnitError(f"an angle is written as '0 deg' or '0 deg ± 1 deg', {text!r} came")
    values = []
    for part in parts:
        try:
            values.append(to_si(float(part), "rad"))
        except ValueError:
            values.append(to_si(part, "rad"))
    return values[0], values[1] if len(values) > 1 else 0.0


def joint_angle(text: str) -> tuple[str | None, tuple[float, float]]:
    """Return the joint, None if none is named, and its angle with std: ``pip: 0 deg ± 1 deg`` or ``0 deg`` (see `angle`).

    Args:
        text: as typed.

    Raises:
        UnitError: it is no angle.
    """
    name, colon, rest = text.partition(":")
    return (name.strip(), angle(rest)) if colon else (None, angle(text))


def seconds(text: str) -> float:
    """Return a time given as ``3s``, ``200 ms`` or a bare number [s].

    Args:
        text: as typed.

    Raises:
        UnitError: it is no time.
    """
    from distal.units import to_si

    try:
        return to_si(float(text), "s")
    except ValueError:
        return to_si(text, "s")
