"""What is read while a joint rests in a stop teaches nothing: where that is, and that a fit does
not hang on it.
"""

from __future__ import annotations

import numpy as np
import pytest

from distal import Log, Rig, load_rig, simulate
from distal.fitting import Options
from distal.fitting.learned_maps import filtered
from distal.fitting.likelihood import AFTER_STOP, NEAR_STOP, in_stops
from distal.fitting.parameter_search import problem_of
from distal.simulation import Scenario
from tests.support.plant_and_rig import drawn_plant, logs_of, start_rig

STOPS = (-0.3, 0.4)


def test_a_joint_is_in_its_stop_until_it_has_left_it() -> None:
    rig = load_rig("capstan-joint").with_values({"joints.0.stops": list(STOPS)})
    times = np.arange(8) / 50.0
    margin = NEAR_STOP + 2.0 * next(s.bias.filter_std for s in rig.sensors if s.measures == "angle")
    inside = 0.4 - margin - 1e-6
    angles = np.array([inside, 0.4 - 0.5 * margin, 0.41, inside, inside, inside, inside, np.nan])
    expected = np.array([False, True, True, True, True, False, False, False])
    assert pytest.approx(0.05) == AFTER_STOP  # two samples of 50 Hz, and a half
    np.testing.assert_array_equal(in_stops(times, angles[:, None], rig)[:, 0], expected)
    np.testing.assert_array_equal(in_stops(times, -angles[:, None] + 0.1, rig)[:, 0], expected)
    free = rig.with_values({"joints.0.stops": None})
    assert not in_stops(times, angles[:, None], free).any()


def test_forces_in_a_stop_are_not_compared() -> None:
    log = logs_of(start_rig(), drawn_plant(3)[0], 3, ("ramps",), 4.0)[0]
    theta = log.truth["theta"]
    rig = start_rig().with_values(
        {"joints.0.stops": [float(np.quantile(theta, q)) for q in (0.2, 0.8)]}
    )
    stopped = in_stops(log.time, theta[:, None], rig)[:, 0]
    assert 0.05 < stopped.mean() < 0.95
    problem = problem_of([log], rig, Options(compiled=False, workers=1))
    channels = problem.filter.channels
    for force in rig.sensors_of("force"):
        read = problem.data[0].samples[:, channels.index(force.name)]
        np.testing.assert_array_equal(np.isfinite(read[1:]), ~stopped[1:])


def test_a_joint_in_its_stop_does_not_silence_its_neighbours() -> None:
    """Of three joints one rests in its stop all the time: forces stay, its own angle is left out,
    it keeps a truth.
    """
    rig, log = finger_with_a_stopped_joint()
    problem = problem_of([log], rig, Options(compiled=False, workers=1))
    later, estimator = problem.data[0].samples[1:], problem.filter
    read = {name: later[:, k] for k, name in enumerate(estimator.channels)}
    force = next(sensor.name for sensor in rig.sensors_of("force"))
    assert np.isfinite(read[force]).all()
    angles = {sensor.of: read[sensor.name] for sensor in problem.filter.references}
    assert np.isnan(angles["dip"]).all()
    assert np.isfinite(angles["mcp"]).mean() > 0.5
    found, refused = filtered([log], [rig], None, False)
    assert not refused
    known = np.isfinite(found[0].targets).mean(axis=0)
    assert known.min() > 0.5


def finger_with_a_stopped_joint() -> tuple[Rig, Log]:
    """Return the underactuated finger with a motion in which its last joint never leaves a stop."""
    rig = load_rig("finger-underactuated").with_values({"sensors.*.rate": 50.0})
    drives = {"flexor": {"torque": [["0 s", "20 mN m"], ["2 s", "60 mN m"], ["4 s", "20 mN m"]]}}
    log = simulate(rig, Scenario(rig="finger", name="finger", duration=4.0, drives=drives), 1)
    lowest = float(log.truth["theta_dip"].max())
    return rig.with_values({"joints.dip.stops": [lowest + 0.01, lowest + 1.0]}), log
