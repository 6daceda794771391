"""Homing of a filter: the rig's parameters by the filter, then its maps by Bayes' rule; the run
reads no reference.
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest

from distal import Log, Rig, estimate, load_rig, simulate
from distal.errors import EstimationError
from distal.estimators import AdaptiveFilter
from distal.homing import Run, home, with_prior_maps, with_references
from distal.regression import Samples
from distal.run import samples_of
from distal.simulation import build_scenario
from tests.helpers import rms_degrees
from tests.learned_maps import constant_map, drawn_map, resting, with_arrays

homing_of_a_run = sys.modules["distal.homing"]
RADIUS = 9.53e-3


@pytest.fixture(scope="module")
def log() -> Log:
    time = np.arange(0.0, 3.0, 0.005)
    angle = 0.5 * np.sin(2 * np.pi * 0.7 * time)
    torque = 0.06 * np.sin(2 * np.pi * 0.7 * time + 0.4)
    return Log(time, {"motor_angle": angle, "motor_torque": torque}, {"theta": 0.6 * angle + 0.05})


@pytest.fixture(scope="module")
def rig() -> Rig:
    return load_rig("capstan-joint").with_map(filter=[resting(drawn_map())])


def test_a_homing_move_takes_off_what_it_shows(rig: Rig, log: Log) -> None:
    """A constant error that the prior allows is gone after the move, and the move itself is not
    judged.
    """
    unsure = constant_map("jaw", ("motor_angle", "motor_torque"), 0.2, 0.01)
    covariance = unsure.arrays["covariance"].copy()
    covariance[0, 0, 0] = 0.04
    described = rig.with_map(filter=[with_arrays(unsure, covariance=covariance)])
    before, after = (
        estimate(log, described, compiled=False, homing=homing) for homing in (None, 1.0)
    )
    late = log.time >= 1.0
    assert np.isnan(after.errors()[~late]).all()
    assert abs(np.mean(after.errors()[late])) < 0.5 * abs(np.mean(before.errors()[late]))
    assert np.mean(after.theta_std[late]) < np.mean(before.theta_std[late])


def test_what_a_contacts_map_sees_begins_at_zero(rig: Rig) -> None:
    """The map's time is that since the log's first sample, and a gap keeps the last reading."""
    time = 5.0 + np.arange(0.0, 1.0, 0.1)
    angle = np.where(np.arange(10) == 4, np.nan, 0.1 * np.arange(10))
    log = Log(time, {"motor_angle": angle, "motor_torque": np.ones(10)})
    seen = Samples.of_readings(log, angle[:, None], np.zeros((10, 1)))
    np.testing.assert_allclose(seen.time, time - 5.0, atol=1e-12)
    np.testing.assert_allclose(np.diff(seen.held[3:6, 0]), [0.0, 0.2], atol=1e-12)


@pytest.fixture(scope="module")
def wide(pulley_rig: Rig) -> Rig:
    """A stranger's rig: radius known to 40 %, each stiffness to 60 %, each place to 3 mm, and no
    force sensors.
    """
    places = [s for s in pulley_rig.model_dump()["sensors"] if s["measures"] != "force"]
    values = {
        "tendons.*.insertion.radius": {"value": RADIUS, "shared": {"name": "disk", "std": "40 %"}},
        "tendons.*.stiffness": {"value": 806.0, "std": "60 %"},
        "sensors.x1.bias.std": "3 mm",
        "sensors.x2.bias.std": "3 mm",
    }
    return pulley_rig.with_values({"sensors": places}).with_values(values)


@pytest.fixture(scope="module")
def of_stranger(pulley_rig: Rig) -> Log:
    """A plant whose radius is half as much again, one tendon twice as stiff, the other twice as
    soft.
    """
    plant = {f"tendons.{i}.insertion.radius": 1.5 * RADIUS for i in (0, 1)}
    plant |= {"tendons.0.stiffness": 1450.0, "tendons.1.stiffness": 320.0}
    left = {"weight": {"mean": "3 N", "amplitude": "1 N", "frequency": "0.5 Hz"}}
    drives = {"left": left, "right": {"weight": "3 N"}}
    raw = {"rig": "pulley-antagonist", "duration": 4.0, "drives": drives, "plant": plant}
    return simulate(pulley_rig, build_scenario(raw, "stranger"), 1)


@pytest.mark.parametrize("zero", [0.0, np.deg2rad(40.0)])
def test_a_rig_that_is_hardly_known_is_right_after_the_move(
    of_stranger: Log, wide: Rig, zero: float
) -> None:
    """Also where the zero is off by tens of degrees, which no parameter of the rig tells."""
    truth = of_stranger.truth["theta"] + zero
    moved = replace(of_stranger, truth={"theta": truth})
    result = estimate(moved, wide, homing=2.0, compiled=False)
    late = moved.time >= 2.0
    errors = (result.theta - truth)[late]
    assert rms_degrees(errors) < 0.5
    assert np.mean(np.abs(errors) < 1.96 * result.theta_std[late]) > 0.9


def test_parameters_with_which_the_filter_diverges_are_not_taken(
    of_stranger: Log, wide: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The run then begins with those of the rig file, and only its map is conditioned."""
    described, references = with_references(wide, of_stranger)
    estimator = AdaptiveFilter(with_prior_maps(described), compiled=False, references=references)
    truths = of_stranger.truth["theta"][:, None]
    read = samples_of(of_stranger, estimator.channels[:-1])
    samples = np.column_stack([read, np.where(of_stranger.time[:, None] < 2.0, truths, np.nan)])
    start = estimator.initial(0.0, samples[0])
    run = Run(of_stranger, estimator, samples, start)
    homed = home(estimator, run, truths, 2.0)
    lasting = np.flatnonzero(estimator.states.lasting)
    assert not np.array_equal(homed.start.kernel_state[lasting], start.kernel_state[lasting])
    assert np.isnan(homed.samples[:, -1]).all()
    lost = homed.start.kernel_state.copy()
    lost[0] = np.nan
    far = replace(homed.start, kernel_state=lost)
    monkeypatch.setattr(homing_of_a_run, "_with_parameters", lambda *_: far)
    again = home(estimator, run, truths, 2.0)
    np.testing.assert_array_equal(again.start.kernel_state[lasting], start.kernel_state[lasting])
    for learned in again.estimator.maps.filter:
        assert np.isfinite(learned.arrays["mean"]).all()


def test_regression_learns_nothing_where_no_drive_moves(of_stranger: Log, wide: Rig) -> None:
    """Its band would say that the joint stays where it is."""
    early = of_stranger.time < 1.0
    still = {name: np.where(early, read[0], read) for name, read in of_stranger.channels.items()}
    log = replace(of_stranger, channels=still)
    with pytest.raises(EstimationError, match=r"no drive moves.*adaptive"):
        estimate(log, wide, "regression", homing=1.0)
    estimate(log, wide, homing=1.0, compiled=False)
