"""Logs of the plants in `$DISTAL_DATA/newcomer`."""

from __future__ import annotations

import importlib.util
import os
from pathlib import Path
from typing import Any


def log_of(name: str, seed: int, folder: Path) -> Path:
    """Write a log of one of the given plants, and return its path."""
    spec = importlib.util.spec_from_file_location(
        name, Path(os.environ["DISTAL_DATA"]) / "newcomer" / f"{name}_plant.py"
    )
    assert spec is not None
    assert spec.loader is not None
    plant: Any = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(plant)
    path = folder / f"{name}.csv"
    if name == "joint":
        plant.write(str(path), *plant.traj_random(20, -5, 75, seed), seed + 50)
    else:
        plant.write(str(path), seed, T=15)
    return path
