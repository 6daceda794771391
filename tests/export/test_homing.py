"""A filter that homes while it runs, live and in C: at the beginning, and again against a stop."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from distal import (
    LiveEstimator,
    Log,
    Monitor,
    Rig,
    estimate,
    homing_filter,
    load_scenario,
    simulate,
)
from distal import scenario_rig as rig_of
from distal.errors import EstimationError, ExportError
from distal.estimators import first_values
from distal.export import c_filter
from distal.rig import angle_names
from distal.run import samples_of
from tests.export.helpers import build, needs_compiler, stepped
from tests.learned_maps import with_drawn

WINDOW = 0.5
STD = 0.02


def case(name: str, duration: str) -> tuple[Rig, Log]:
    scenario = load_scenario(name, [f'duration="{duration}"'])
    rig = rig_of(scenario)
    return rig, simulate(rig, scenario, 3)


def homed_rows(
    rig: Rig, log: Log, known: np.ndarray
) -> tuple[LiveEstimator, np.ndarray, np.ndarray]:
    """Return a live filter after a log in which angles are known or missing, (n, joints), and its
    angles and stds.
    """
    live = LiveEstimator(rig, homing_filter(rig, STD))
    angles, stds = [], []
    for k, time in enumerate(log.time):
        sample = [log.channels[name][k] for name in live.channels if name in log.channels]
        live.step(float(time), np.array([*sample, *known[k]]))
        angles.append(live.angles.copy())
        stds.append(live.angle_stds)
    return live, np.array(angles), np.array(stds)


@pytest.mark.parametrize("name", ["lab-bench", pytest.param("wrist", marks=pytest.mark.slow)])
def test_live_as_over_a_log(name: str) -> None:
    """The same numbers as those of the filter over the whole log with the reference, state by state
    to 1e-6.
    """
    rig, log = case(name, "3 s")
    nj = len(rig.joints)
    known = np.where(log.time[:, None] < WINDOW, np.zeros(nj), np.nan)
    live, angles, stds = homed_rows(rig, log, known)
    homing = homing_filter(rig, STD)
    samples = np.column_stack([samples_of(log, homing.channels[:-nj]), known])
    means, covariances, *_ = homing.scan(
        homing.initial(0.0, first_values(samples)), log.time, samples
    )
    variances = np.diagonal(covariances, axis1=1, axis2=2)
    np.testing.assert_allclose(angles, means[:, :nj], atol=1e-6)
    np.testing.assert_allclose(stds, np.sqrt(variances[:, :nj]), atol=1e-6)
    np.testing.assert_allclose(live.mean, means[-1], rtol=1e-6, atol=1e-9)
    end = int(0.9 * WINDOW * log.rate)
    assert stds[end, 0] < estimate(log, rig).angle_stds[end, 0]  # it tells something


@needs_compiler
@pytest.mark.parametrize(
    ("name", "is_mapped"),
    [
        ("lab-bench", True),
        ("wrist", False),
        pytest.param("lab-bench", False, marks=pytest.mark.more),
        pytest.param("wrist", True, marks=pytest.mark.more),
    ],
)
def test_in_c_as_live(name: str, is_mapped: bool, tmp_path: Path) -> None:
    """Told where each joint stands at the beginning, and once more later. Learned maps are
    conditioned on it.
    """
    rig, log = case(name, "3 s")
    rig = with_drawn(rig) if is_mapped else rig
    made, nj = c_filter(rig, home=STD), len(rig.joints)
    read, homes = made.estimator.channels[:-nj], made.estimator.channels[-nj:]
    assert homes == (("home",) if nj == 1 else tuple(f"home_{name}" for name in rig.joint_names))
    truth = np.column_stack([log.truth[key] for key in angle_names(rig.joint_names)])
    known = (log.time < WINDOW) | ((log.time > 2.0) & (log.time < 2.3))
    at = np.where(known[:, None], truth, np.nan)
    _, angles, stds = homed_rows(rig, log, at)
    samples = np.column_stack([samples_of(log, read), at])
    steps = np.diff(log.time, prepend=log.time[0])
    rows = np.vstack([first_values(samples), samples])
    found = stepped(build(made, tmp_path, "-O2"), steps, rows).fields[:, : 2 * nj]
    np.testing.assert_allclose(found[:, ::2], angles, atol=1e-9)
    np.testing.assert_allclose(found[:, 1::2], stds, atol=1e-9)
    # again against a stop: the band shrinks
    before, after = np.searchsorted(log.time, [1.99, 2.29])
    assert np.all(stds[after] < stds[before])


def test_a_known_angle_is_never_missing() -> None:
    rig, log = case("lab-bench", "2 s")
    monitor = Monitor(LiveEstimator(rig, homing_filter(rig, STD)))
    plain = Monitor(LiveEstimator(rig))
    for k, time in enumerate(log.time):
        sample = np.array([log.channels[name][k] for name in plain.channels])
        word = monitor.take(
            float(time), np.array([*sample, 0.0 if time < WINDOW else np.nan])
        ).health
        assert word in (plain.take(float(time), sample).health, "untested", "ok")


def test_what_cannot_home_is_refused() -> None:
    rig, _ = case("lab-bench", "1 s")
    for bad in (-1.0, float("nan"), 1e9):
        with pytest.raises(EstimationError, match="a homing angle is known"):
            homing_filter(rig, bad)
    with pytest.raises(ExportError, match="adaptive homes while it runs"):
        c_filter(rig, "elastic", home=0.1)
