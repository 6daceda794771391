"""A fit to rigs with physics that the model lacks: it ends with something to use, as good as the
obvious, in its band.
"""

from __future__ import annotations

import numpy as np
import pytest

from distal import Log, estimate, fit
from distal.fitting.candidates import AS_GIVEN, REGRESSION, WRITTEN
from tests.support.foreign_plants import finger_log, finger_rig, hand_log, hand_rig


@pytest.mark.slow
@pytest.mark.filterwarnings(
    "ignore::distal.errors.DistalWarning"
)  # numbers far from their priors: the model is wrong
@pytest.mark.parametrize(
    ("log_of", "rig_of"),
    [pytest.param(finger_log, finger_rig, marks=pytest.mark.more), (hand_log, hand_rig)],
)
@pytest.mark.more
def test_a_rig_with_other_physics(log_of: object, rig_of: object) -> None:
    """On logs that nothing has seen: not clearly worse than `regression`, 88 % or more inside, a
    band of at most 5 errors.
    """
    logs = [log_of(seed) for seed in range(5)]  # type: ignore[operator]
    found = fit(logs[:3], rig_of(), noise=True)  # type: ignore[operator]
    assert len(found.compared) == 3
    names = [name for name, _, _ in found.scores()]
    assert names[0] == WRITTEN
    assert {AS_GIVEN, REGRESSION, "least squares with lags"} <= set(names)
    ours, theirs = (
        [estimate(log, found.rig, name) for log in logs[3:]] for name in ("adaptive", "regression")
    )
    rms, obvious = (np.mean([one.rms_error() for one in each]) for each in (ours, theirs))
    assert rms < 1.1 * obvious
    assert np.mean([one.inside_band() for one in ours]) >= 0.88
    assert np.mean([1.96 * one.theta_std.mean() for one in ours]) < 5 * rms


@pytest.mark.more
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
    found = fit(logs, finger_rig(), groups=r"unit_(\d)")
    assert [one.log for one in found.compared] == [log.source for log in logs]
    assert found.maps["filter"].maps[0].logs == 6
