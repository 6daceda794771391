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
