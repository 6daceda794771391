"""Everything that these benches take from distal, in one place; names that a later release moves
are looked for here.
"""

from __future__ import annotations

import inspect

from distal import (
    DistalError,
    Log,
    Rig,
    Scenario,
    estimate,
    load_rig,
    load_scenario,
    read_log,
    shipped_rigs,
    simulate,
)
from distal.diagnosis import Diagnosis
from distal.results import Estimate
from distal.rig import build_rig
from distal.simulation import build_scenario

try:
    from distal import diagnose  # type: ignore[attr-defined]
except ImportError:
    from distal.estimators import diagnose  # type: ignore[attr-defined]

from distal import fit

__all__ = [
    "DistalError",
    "Log",
    "Rig",
    "Scenario",
    "build_rig",
    "build_scenario",
    "diagnose",
    "diagnosed",
    "estimate",
    "fit",
    "load_rig",
    "load_scenario",
    "printed_rig",
    "read_log",
    "simulate",
]


def diagnosed(
    result: Estimate, log: Log, rig: Rig, homing: float | None = None, what_if: bool = True
) -> Diagnosis:
    """Return what the diagnosis says of an estimate, with all that it is able to ask in this
    release.
    """
    asked = inspect.signature(diagnose).parameters
    if "rig" not in asked:
        return diagnose(result)
    return diagnose(result, log, rig, homing=homing, compiled=False, what_if=what_if)


def printed_rig() -> Rig:
    """Return the paper's rig with the friction of its Table 1, whatever the shipped rig says of it
    by now.
    """
    name = "paper-2008-printed"
    return load_rig(name if name in shipped_rigs() else "paper-2008")
