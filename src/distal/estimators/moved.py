"""Names that stood in this package in release 0.1: an error says where they are now."""

from __future__ import annotations

MOVED = {
    "distal": (
        "LiveEstimator",
        "Monitor",
        "diagnose",
        "estimate",
        "estimate_batch",
        "plot_estimates",
        "smooth",
        "Estimate",
    ),
    "distal.results": ("BAND", "COLOURS", "DASHES", "Diagnosis", "draw_estimate", "figure", "plot_kind", "save_figure"),
    "distal.running": (
        "HEALTH",
        "HOMED",
        "Reading",
        "TRUTH_NOISE",
        "added_reference",
        "check_homing",
        "first_values",
        "samples_of",
        "with_channel",
    ),
    "benchmarks.rivals": ("ParticleFilter", "UnscentedFilter"),
}
"""Where they stand since release 0.2."""

RENAMED = {
    "WILD_FORCE": "Robustness().wild_force",
    "parameter_states": "distal.estimators.adaptive.uncertain_parameters",
    "with_reference": "distal.running.with_references",
}
"""What they are called since release 0.2."""


def __getattr__(name: str) -> object:
    """Refuse a name that has moved, and say where to.

    Args:
        name: that was asked for.

    Raises:
        AttributeError: always: it has moved, or there is no such name.
    """
    for place, names in MOVED.items():
        if name in names:
            raise AttributeError(f"distal.estimators.{name} is {place}.{name} since release 0.2")
    if name in RENAMED:
        raise AttributeError(f"distal.estimators.{name} is {RENAMED[name]} since release 0.2")
    raise AttributeError(f"module 'distal.estimators' has no attribute '{name}'")
