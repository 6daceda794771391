"""Names of release 0.1 in `distal.estimators`: each error names a place where the name is."""

from __future__ import annotations

import importlib

import pytest

import distal.estimators
from distal.estimators.moved import MOVED, RENAMED

GONE = {
    "BAND", "COLOURS", "DASHES", "Diagnosis", "Estimate", "HEALTH", "HOMED", "LiveEstimator",
    "Monitor", "ParticleFilter", "Reading", "TRUTH_NOISE", "UnscentedFilter", "WILD_FORCE",
    "added_reference", "check_homing", "diagnose", "draw_estimate", "estimate", "estimate_batch",
    "figure", "first_values", "parameter_states", "plot_estimates", "plot_kind", "samples_of",
    "save_figure", "smooth", "with_channel", "with_reference",
}  # fmt: skip
"""All public names of `distal.estimators` in release 0.1 that it has no more, but for SLOW, which nothing replaces."""


def test_every_name_that_went_is_answered() -> None:
    assert {name for names in MOVED.values() for name in names} | RENAMED.keys() == GONE


@pytest.mark.parametrize(("place", "name"), [(place, name) for place, names in MOVED.items() for name in names])
def test_a_name_that_moved_is_where_the_error_says(place: str, name: str) -> None:
    with pytest.raises(AttributeError, match=rf"is {place}\.{name} since release 0\.2$"):
        getattr(distal.estimators, name)
    assert hasattr(importlib.import_module(place), name)


@pytest.mark.parametrize("name", RENAMED)
def test_a_name_that_changed_is_where_the_error_says(name: str) -> None:
    with pytest.raises(AttributeError, match=r"since release 0\.2$"):
        getattr(distal.estimators, name)
    place, _, new = RENAMED[name].rpartition(".")
    holder = distal.estimators.Robustness() if place == "Robustness()" else importlib.import_module(place)
    assert hasattr(holder, new)


def test_other_names_are_just_unknown() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'nosuch'"):
        getattr(distal.estimators, "nosuch")  # noqa: B009
