"""What an encoder's own error, few logs and doubts make of a fit: bands that include it, stds that are kept."""

from __future__ import annotations

import numpy as np
import pytest

from distal import Log, Rig, load_rig
from distal.fitting.fitted_number import FittedNumber, assignments
from distal.fitting.map_samples import reference_std, with_reference_error
from distal.logs import FROM_SENSOR, TruthKind, TruthSource
from distal.regression.band import share_of_few


def log(source: TruthSource | str) -> Log:
    time = np.arange(10) / 100.0
    return Log(time, {}, {"theta": np.zeros(10)}, "log", source)


@pytest.fixture
def rig() -> Rig:
    return load_rig("da-vinci-grasper")


def test_an_encoders_offset_is_in_the_bands(rig: Rig) -> None:
    """c² s² becomes c² s² + σ_b² in either map, and stays where the truth is of no sensor."""
    offset = np.deg2rad(0.35)
    for learned in (rig.affine, rig.discrepancy):
        assert learned is not None
        inflated = learned.model_copy(update={"band": (2.0,)})
        wider = with_reference_error(inflated, rig, [log(TruthSource(TruthKind.SENSOR, "column 'x'"))])
        before = 2.0 * learned.joints[0].std
        assert 2.0 * wider.joints[0].std == pytest.approx(np.hypot(before, offset))
        assert with_reference_error(inflated, rig, [log("another file")]) is inflated


def test_what_the_reference_errs_by(rig: Rig) -> None:
    noise = np.deg2rad(np.hypot(0.1, 0.09 / np.sqrt(12.0)))
    assert reference_std(rig, log(FROM_SENSOR)) == pytest.approx(noise, rel=1e-6)
    assert reference_std(rig, log("the simulation")) == 0.0


@pytest.mark.parametrize("hold", [False, True])
def test_how_sure_a_file_is(hold: bool) -> None:
    """Its stds are the standard errors; held, filters take the values as they are."""
    start = load_rig("capstan-joint").with_values({"joints.0.friction.coefficient": {"value": 0.2, "std": 0.1}})
    path = "joints.0.friction.coefficient"
    found = FittedNumber("it", (path,), "", 0.2, 0.1, 0.3, 0.05, True, False, (0.3,), held_error=0.05)
    written = assignments([found], start, hold)["joints.jaw.friction.coefficient"]
    assert written["value"] == 0.3
    assert written["std"] == pytest.approx(0.05)
    assert written.get("hold", False) is hold


def test_a_file_holds_what_is_told_only_together_with_others() -> None:
    """Its value and std stay those of the prior, so that the next fit may vary it; estimators take it as known."""
    start = load_rig("capstan-joint").with_values({"joints.0.friction.coefficient": {"value": 0.2, "std": 0.1}})
    path = "joints.0.friction.coefficient"
    found = FittedNumber(path, (path,), "", 0.2, 0.1, 0.2, 0.1, False, False, (0.2,), held=True)
    after = start.with_values(assignments([found], start)).joints[0].friction
    assert after is not None
    assert (after.coefficient.value, after.coefficient.std, after.coefficient.hold) == (0.2, 0.1, True)


def test_few_logs_share_the_filters_doubt_as_the_worst_needs() -> None:
    """Errors of 0.2 and 0.4 stds need 0.4 at 95 %; Student's factor comes on top, and all of it is the most."""
    rng = np.random.default_rng(2)
    logs = [[(size * rng.normal(size=40000), np.ones(40000), np.ones(40000))] for size in (0.2, 0.4)]
    assert share_of_few(logs) == pytest.approx(0.4, rel=0.02)
    assert share_of_few([[(5.0 * e, u, v) for e, u, v in log] for log in logs]) == 1.0
