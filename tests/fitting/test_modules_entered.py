"""How many modules a fit walks through: what a reader has to hold in mind."""

from __future__ import annotations

import sys
import threading
from pathlib import Path
from types import FrameType

import distal
from distal import fit
from tests.support.plant_and_rig import drawn_plant, logs_of, start_rig

MOST = 35
"""Largest number of modules of the layers that learn, see `LEARNING`, that a fit enters."""

LEARNING = ("fitting", "regression", "homing", "from_logs")


def test_a_fit_enters_few_modules_of_the_layers_that_learn() -> None:
    package = str(Path(distal.__file__).parent)
    entered = set[str]()

    def seen(frame: FrameType, event: str, argument: object) -> None:
        if event == "call" and frame.f_code.co_name != "<module>":
            entered.add(frame.f_code.co_filename)

    rig = start_rig()
    plant, _ = drawn_plant(1)
    logs = logs_of(rig, plant, 1, ("ramps", "servo"), 1.0)
    threading.setprofile(seen)
    sys.setprofile(seen)
    try:
        fit(logs, rig)
    finally:
        sys.setprofile(None)
        threading.setprofile(None)
    names = {name.removeprefix(f"{package}/") for name in entered if name.startswith(package)}
    learning = {name for name in names if name.split("/")[0] in LEARNING}
    assert "fitting/fit.py" in learning
    assert "regression/posterior.py" in learning
    assert len(learning) <= MOST, sorted(learning)
