"""Options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

RigOption = Annotated[str, typer.Option("--rig", help="A shipped rig's name (see `distal rigs`) or a TOML file.")]
SetOption = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="PATH=VALUE", help="Replace a value of the rig; VALUE is TOML. Repeatable."),
]
SeedOption = Annotated[int, typer.Option("--seed", min=0, help="Seed of the sensors' errors.")]
PlotOption = Annotated[Path | None, typer.Option("--plot", help="Draw a picture (PNG, SVG or PDF).")]


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
