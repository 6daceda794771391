"""A place that is not read for long becomes unknown, whatever the drive did before; no angle is
then said to be known.
"""

from __future__ import annotations

import numpy as np
import pytest

from distal import LiveEstimator, Log, estimate, load_rig, load_scenario, scenario_rig, simulate
from distal.estimators.adaptive.drive_tracking import MEMORY, REMEMBERED, faded, track_function
from distal.estimators.adaptive.guards import Robustness
from distal.kernels.layout import MISSING, READ
from distal.rig import build_rig


def test_the_place_becomes_unknown_at_a_constant_rate() -> None:
    """A drive that stood still: nothing but noise for half a second, then w (t − dead) as its
    std.
    """
    dt, dead, wandering, noise = 0.01, 0.5, 0.02, 1e-10
    step = track_function(Robustness.usual(1), judged=False)
    now, found = np.zeros(MEMORY), []
    for _ in range(200):
        silent = [0.0, MISSING, noise, dead, wandering, *np.zeros(11)]
        now = np.array(step(now, silent, dt, faded(dt))).ravel()[:MEMORY]
        found.append(now[4])
    time = dt * np.arange(1, 201)
    expected = np.maximum(noise, (wandering * np.maximum(time - dead, 0.0)) ** 2)
    np.testing.assert_allclose(found, expected, rtol=1e-9)


@pytest.mark.parametrize(
    ("name", "channel"), [("lab-bench", "motor_angle"), ("wrist", "phi_pitch")]
)
@pytest.mark.parametrize("share", [0.0, 0.25])
def test_nothing_wrong_is_said_to_be_sure(name: str, channel: str, share: float) -> None:
    """From the second sample on, or while it stands still: two seconds later the angle is not said
    to be known.
    """
    scenario = load_scenario(name)
    rig = scenario_rig(scenario)
    log = simulate(rig, scenario, 1).select(slice(0, 1000))
    since = max(1, int(share * len(log)))
    values = log.channels[channel].copy()
    values[since:] = np.nan
    silent = Log(log.time, {**log.channels, channel: values}, log.truth, "silent", log.truth_source)
    result = estimate(silent, rig)
    assert result.truths is not None
    late = log.time > log.time[since] + 2.0
    errors, stds = result.angles[late] - result.truths[late], result.angle_stds[late]
    assert np.rad2deg(stds[:, 0]).min() > 5.0
    if len(rig.joints) == 1:  # in chains the other joints, too, are misled: docs/results/chains.md
        assert np.mean(np.abs(errors[:, 0]) < 1.96 * stds[:, 0]) > 0.95


def test_the_usual_force_of_a_drive_at_its_stop_says_nothing() -> None:
    """Without a force sensor the nominal force is compared; at a stop the stop takes some of it."""
    raw = load_rig("paper-2008").model_dump()
    raw["sensors"] = [sensor for sensor in raw["sensors"] if sensor["measures"] != "force"]
    for drive in raw["drives"]:
        drive["nominal_force"] = {"value": 3.0, "std": 1.0}
    rig = build_rig(raw, "without force sensors")
    live = LiveEstimator(rig, compiled=False)
    left, right = (drive.stops for drive in rig.drives)
    assert left is not None
    assert right is not None
    for k in range(20):
        live.step(0.01 * k, np.array([left[0] - 1e-3, right[1] + 1e-3]))
    assert np.isfinite(live.covariance).all()
    assert np.deg2rad(1.0) < live.angle_std < np.deg2rad(20.0)


@pytest.mark.parametrize("usual", [0.0, 0.3])
def test_what_a_drive_usually_does_is_not_far_and_how_far_a_lost_one_goes(usual: float) -> None:
    """At rest it begins to move by 3 times its usual speed, or is lost for a while."""
    dt, noise = 0.01, 1e-10
    step = track_function(Robustness.usual(1), judged=False)

    def after(readings: list[float]) -> np.ndarray:
        now = np.zeros(MEMORY)
        for value in readings:
            seen = [0.0, MISSING] if np.isnan(value) else [value, READ]
            rest = [noise, 1e9, 0.0, usual**2, *np.zeros(10)]
            now = np.array(step(now, [*seen, *rest], dt, faded(dt))).ravel()[:MEMORY]
        return now

    shift, unknown = (REMEMBERED.index(name) for name in ("shift", "unknown"))
    begins = after([0.0, 0.0, 3 * 0.3 * dt])
    assert (begins[shift] > 0.0) == (usual == 0.0)
    lost = after([0.0, 0.0, *[np.nan] * 20])
    assert lost[unknown] == pytest.approx((20 * usual * dt) ** 2 + noise)
