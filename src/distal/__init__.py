"""Where a tendon-driven joint is, without a sensor in the joint."""

from importlib import import_module
from typing import TYPE_CHECKING

from distal.errors import DistalError, DistalWarning
from distal.version import __version__ as __version__

if TYPE_CHECKING:
    from distal.control import ClosedLoop, closed_loop, simulate
    from distal.diagnosis import diagnose
    from distal.estimators import ESTIMATORS, KernelEstimator, make_estimator
    from distal.export import export_c, export_fmu
    from distal.fitting import (
        Fit,
        fit,
        learn,
    )
    from distal.from_logs import RigFromLogs, rig_from_logs
    from distal.homing import at_known_angle, homing_filter
    from distal.inverse import Commands, Inverse, LiveInverse
    from distal.logs import Log, read_log, write_log
    from distal.results import Estimate, plot_estimates
    from distal.rig import Rig, load_rig, shipped_rigs
    from distal.run import (
        LiveEstimator,
        LogUnits,
        Monitor,
        estimate,
        estimate_batch,
        log_health,
        smooth,
    )
    from distal.simulation import (
        Scenario,
        load_scenario,
        scenario_rig,
        shipped_scenarios,
    )

__all__ = [
    "ESTIMATORS",
    "ClosedLoop",
    "Commands",
    "DistalError",
    "DistalWarning",
    "Estimate",
    "Fit",
    "Inverse",
    "KernelEstimator",
    "LiveEstimator",
    "LiveInverse",
    "Log",
    "LogUnits",
    "Monitor",
    "Rig",
    "RigFromLogs",
    "Scenario",
    "at_known_angle",
    "closed_loop",
    "diagnose",
    "estimate",
    "estimate_batch",
    "export_c",
    "export_fmu",
    "fit",
    "homing_filter",
    "learn",
    "load_rig",
    "load_scenario",
    "log_health",
    "make_estimator",
    "plot_estimates",
    "read_log",
    "rig_from_logs",
    "scenario_rig",
    "shipped_rigs",
    "shipped_scenarios",
    "simulate",
    "smooth",
    "write_log",
]

_NAMES = {
    "control": ("ClosedLoop", "closed_loop", "simulate"),
    "diagnosis": ("diagnose",),
    "estimators": ("ESTIMATORS", "KernelEstimator", "make_estimator"),
    "export": ("export_c", "export_fmu"),
    "fitting": (
        "Fit",
        "fit",
        "learn",
    ),
    "from_logs": ("RigFromLogs", "rig_from_logs"),
    "homing": ("at_known_angle", "homing_filter"),
    "inverse": ("Commands", "Inverse", "LiveInverse"),
    "logs": ("Log", "read_log", "write_log"),
    "results": ("Estimate", "plot_estimates"),
    "rig": ("Rig", "load_rig", "shipped_rigs"),
    "run": (
        "LiveEstimator",
        "LogUnits",
        "Monitor",
        "estimate",
        "estimate_batch",
        "log_health",
        "smooth",
    ),
    "simulation": (
        "Scenario",
        "load_scenario",
        "scenario_rig",
        "shipped_scenarios",
    ),
}
"""Package → public names in it. A package is imported when one of its names is first used: `import
distal` is light.
"""

_PACKAGES = {name: package for package, names in _NAMES.items() for name in names}


def __getattr__(name: str) -> object:
    if name not in _PACKAGES:
        raise AttributeError(f"module 'distal' has no attribute '{name}'")
    value = globals()[name] = getattr(import_module(f"distal.{_PACKAGES[name]}"), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
