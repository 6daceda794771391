"""A fit to rigs with physics that the model lacks: it ends with something to use, as good as the
obvious, in its band.
"""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.strangers.foreign_plants import finger_log, finger_rig, hand_log, hand_rig

from distal import Log, estimate, fit, learn_discrepancy
from distal.errors import FitError
from distal.fitting.leave_out import AFFINE, ALONE, WRITTEN
from distal.regression import conformal_factor
from distal.regression.band import LARGEST_FACTOR, SMALLEST_FACTOR


@pytest.mark.slow
@pytest.mark.filterwarnings(
    "ignore::distal.errors.DistalWarning"
)  # numbers far from their priors: the model is wrong
@pytest.mark.parametrize(
    ("log_of", "rig_of"),
    [pytest.param(finger_log, finger_rig, marks=pytest.mark.more), (hand_log, hand_rig)],
)
def test_a_rig_with_other_physics(log_of: object, rig_of: object) -> None:
    """On logs that nothing has seen: not clearly worse than `affine`, 88 % or more inside, a band
    of at most 5 errors.
    """
    logs = [log_of(seed) for seed in range(5)]  # type: ignore[operator]
    found = fit(logs[:3], rig_of(), noise=True)  # type: ignore[operator]
    assert len(found.compared) == 3
    names = [name for name, _, _ in found.scores()]
    assert names[0] == WRITTEN
    assert {ALONE, AFFINE, "least squares with plays"} <= set(names)
    ours, theirs = (
        [estimate(log, found.rig, name) for log in logs[3:]] for name in ("adaptive", "affine")
    )
    rms, obvious = (np.mean([one.rms_error() for one in each]) for each in (ours, theirs))
    assert rms < 1.1 * obvious
    assert np.mean([one.inside_band() for one in ours]) >= 0.88
    assert np.mean([1.96 * one.theta_std.mean() for one in ours]) < 5 * rms


def factor_of(logs: list[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> float:
    return conformal_factor(logs, SMALLEST_FACTOR, LARGEST_FACTOR)


def test_a_band_is_sized_by_the_errors_of_logs_left_out() -> None:
    """95 % of errors need c or less: of white errors of size 3, c = 3, whatever the share of the
    filter's own.
    """
    rng = np.random.default_rng(1)
    errors = [3.0 * rng.normal(size=20000) for _ in range(4)]
    own = np.zeros(20000)
    assert factor_of([(e, np.ones(20000), own) for e in errors]) == pytest.approx(3.0, rel=0.02)
    assert factor_of([(e, np.ones(20000), own + 5.0) for e in errors]) == pytest.approx(
        2.0, rel=0.04
    )
    # all logs alike: one that is three times as long does not decide
    long, short = 9.0 * rng.normal(size=60000), np.zeros(20000)
    parts = [(long, np.ones(60000), np.zeros(60000)), *[(short, np.ones(20000), own)] * 19]
    assert factor_of(parts) == pytest.approx(0.5, abs=0.01)


def test_without_an_angle_there_is_nothing_to_learn() -> None:
    log = finger_log(0, 4.0)
    with pytest.raises(FitError, match="none of the 1 logs has the joint's angle"):
        learn_discrepancy([Log(log.time, log.channels, {}, "bare")], finger_rig())


def test_few_logs_are_said() -> None:
    logs = [finger_log(seed, 6.0) for seed in range(2)]
    found = learn_discrepancy(logs, finger_rig(), compiled=False)
    assert any("2 logs or groups of logs" in note for note in found.notes)
    assert not found.left_out
    assert found.rig.discrepancy is not None
    assert found.text == "discrepancy: learned from 2 logs"


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::distal.errors.DistalWarning")
def test_units_are_left_out_as_a_whole() -> None:
    """Two logs of each of three units: each unit is left out once, and both of its logs are
    compared.
    """
    logs = []
    for seed in range(6):
        log = finger_log(seed, 7.0)
        logs.append(Log(log.time, log.channels, log.truth, f"unit_{seed // 2} {seed}"))
    found = fit(logs, finger_rig(), units=r"unit_(\d)")
    assert [one.log for one in found.compared] == [log.source for log in logs]
    assert any("3 logs or groups of logs" in note for note in found.maps["discrepancy"].notes)
    with pytest.raises(FitError, match="at least 2 groups"):
        fit(logs, finger_rig(), units=r"(unit)")
