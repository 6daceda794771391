"""A controller in the loop: the same plant, sensors and filter as in an open loop, and commands
that act a period late.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from distal import (
    Scenario,
    closed_loop,
    estimate,
    load_rig,
    load_scenario,
    scenario_rig,
    simulate,
)
from distal.control import ControlledPlant, trackings_of
from distal.errors import ControlError, ScenarioError
from distal.rig import Rig
from distal.simulation import build_scenario
from distal.simulation import simulate_plant as simulate_alone

STILL = {
    "rig": "paper-2008",
    "duration": "1 s",
    "drives": {"left": {"force": "2 N"}, "right": {"force": "2 N"}},
}
GAINS = {
    "reference": [["0 s", "0 deg"], ["0.5 s", "0 deg"], ["1 s", "10 deg"]],
    "proportional": "0.3 N m/rad",
    "integral": "0.6 N m/(rad s)",
    "derivative": "0.02 N m s/rad",
    "torque_limit": "0.08 N m",
}
PID = {"co_contraction": "4 N", "joints": {"link": GAINS}}


@pytest.fixture(scope="module")
def rig() -> Rig:
    return load_rig("paper-2008")


def scenario(**more: Any) -> Scenario:
    return build_scenario({**STILL, **more})


OTHER_RATES = {"sensors.u1.rate": 30.0, "sensors.u2.rate": 25.0, "sensors.x1.lag": 0.2}


@pytest.mark.parametrize(("values", "atol"), [({}, 0.0), (OTHER_RATES, 1e-6)])
def test_without_commands_the_loop_is_the_open_loop(
    rig: Rig, values: dict[str, float], atol: float
) -> None:
    """Same motion, same readings to the last bit: the plant steps by the same intervals, the noise
    by the same draws. A force read 30 times a second is a line between these intervals.
    """
    mixed = rig.with_values(values)
    moved = scenario(
        drives={"left": {"force": [["0 s", "2 N"], ["0.3 s", "6 N"]]}, "right": {"force": "2 N"}}
    )
    alone = simulate_alone(mixed, moved, 3)
    looped = simulate(mixed, moved, 3, controller=Mock(return_value={}), period="10 ms")
    np.testing.assert_array_equal(alone.time, looped.time)
    for name, values in {**alone.truth, **alone.channels}.items():
        found = {**looped.truth, **looped.channels}[name]
        np.testing.assert_allclose(found, values, rtol=0, atol=atol, err_msg=name)


def test_what_the_filter_says_in_the_loop_is_what_it_says_of_the_log(rig: Rig) -> None:
    """Sample by sample or over the recorded log, where the controller is called less often than the
    sensors are read.
    """
    described = scenario(control={**PID, "period": "20 ms"})
    run = closed_loop(rig, described, 1)
    again = estimate(run.log, rig)
    at = np.searchsorted(again.time, run.time - 1e-9)
    np.testing.assert_allclose(run.estimates, again.angles[at], rtol=0, atol=1e-12)
    np.testing.assert_allclose(run.stds, again.angle_stds[at], rtol=1e-12)


def test_a_command_acts_one_period_after_the_call(rig: Rig) -> None:
    """The force of the drive changes in the interval that begins a period after the controller
    asked for it.
    """

    late = Mock(side_effect=[*[{"left": 0.0}] * 6, *[{"left": 3.0}] * 20])
    log = simulate(rig, scenario(), controller=late, period="50 ms")
    force = log.truth["force_left"]
    changed = log.time[np.flatnonzero(np.abs(force - force[0]) > 1.0)[0]]
    assert changed == pytest.approx(
        0.36
    )  # asked at 0.30, acts from 0.35 on, read at the end of an interval
    assert force[-1] - force[0] == pytest.approx(3.0)


def test_drives_saturate_lag_and_do_not_push(rig: Rig) -> None:
    """At its limit a slider pulls with that; u(t) = u∞ (1 − e^{−t/T}); a negative command is
    none.
    """
    limited = rig.with_values({"drives.left.limit": "5 N", "drives.left.lag": "0.1 s"})

    much = Mock(return_value={"left": 50.0, "right": -20.0})
    log = simulate(limited, scenario(), controller=much, period="10 ms")
    passed = log.time - 0.01
    expected = 2.0 + 5.0 * (1.0 - np.exp(-np.maximum(passed, 0.0) / 0.1))
    np.testing.assert_allclose(log.truth["force_left"][2:], expected[2:], atol=1e-9)
    np.testing.assert_allclose(log.truth["force_right"], 2.0, atol=1e-9)


def test_a_plant_goes_back_to_its_start(rig: Rig) -> None:
    plant, runs = ControlledPlant(rig, scenario(), 0.1), []
    for _ in range(2):
        runs.append([sample for _ in range(5) for sample in plant.step({"left": 4.0})])
        assert plant.time == pytest.approx(0.5)
        assert len(plant.log()) == 51
        plant.reset()
    for (stamp, values), (other, others) in zip(*runs):
        assert stamp == other
        np.testing.assert_array_equal(values, others)
    assert not np.array_equal(plant.reset(1)[0][1], runs[1][0][1])


def test_a_controller_may_end_a_run_only_with_a_line_that_says_why(rig: Rig) -> None:
    for controller, said in (
        (Mock(return_value={"left": float("nan")}), "'left' at 0.01 s is no number: nan"),
        (Mock(return_value={"lefd": 1.0}), r"'lefd', the rig has no such.* mean 'left'\?"),
        (Mock(return_value={"left": "3 N"}), "'left' at 0.01 s is no number: '3 N'"),
        (Mock(return_value=3.0), r"returns commands by drive, 3\.0 came at 0 s"),
        (Mock(side_effect=KeyError("gain")), "the controller failed at 0 s: KeyError: 'gain'"),
    ):
        with pytest.raises(ControlError, match=said):
            simulate(rig, scenario(), controller=controller, period="10 ms")
    for given, said in (
        ({"period": "5 s"}, "period: 5 s is longer than the scenario, 1 s"),
        ({"period": "0 s"}, "period: a time above 0 s, 0 s came"),
        ({"period": "5 N"}, "period: "),
        (
            {"estimator": "encodr"},
            "feedback: 'encodr' is none of encoder, ratio, .*did you mean 'encoder'",
        ),
    ):
        with pytest.raises(ControlError, match=said):
            simulate(rig, scenario(), controller=Mock(return_value={}), **given)
    with pytest.raises(ControlError, match="no controller: give one"):
        closed_loop(rig, scenario())
    with pytest.raises(ControlError, match="the rig has no joint 'linc'; did you mean 'link'"):
        closed_loop(rig, scenario(control={**PID, "joints": {"linc": GAINS}}))
    with pytest.raises(ScenarioError, match=r"control\.joints"):
        scenario(control={**PID, "joints": {}})


def test_the_inverse_as_feedback_leads_the_joint_along_a_smooth_reference() -> None:
    """The gains alone are late and wait for friction; the filter runs once, and says what it says
    over the log.
    """
    time = np.arange(0.0, 6.0, 0.05)
    desired = np.deg2rad(15.0) * np.sin(2 * np.pi * 0.3 * time) * np.minimum(time / 2.0, 1.0)
    shipped = load_scenario("control-paper", ['duration="6 s"'])
    rig = scenario_rig(shipped)
    assert shipped.control is not None
    link = shipped.control.joints["link"]
    smooth = replace(link.reference, times=tuple(time.tolist()), values=tuple(desired.tolist()))
    joints = {"link": link.model_copy(update={"reference": smooth})}
    control = shipped.control.model_copy(update={"joints": joints})
    described = shipped.model_copy(update={"control": control})
    run, pid = (closed_loop(rig, described, 1, feedback=name) for name in ("command", "adaptive"))
    again = estimate(run.log, rig)
    np.testing.assert_allclose(
        run.estimates, again.angles[: len(run.estimates)], rtol=0, atol=1e-12
    )
    errors = [float(np.rad2deg(trackings_of(one)[0].rms)) for one in (run, pid)]
    assert errors[0] < 0.4 * errors[1]
    assert np.all(np.column_stack([*run.commands.values()]) >= 0.0)  # a slider does not push


def test_a_controlled_scenario_is_no_open_loop(rig: Rig) -> None:
    """What does not close loops says so, instead of leaving the drives without commands."""
    described = scenario(control={**PID, "feedback": "encoder"})
    with pytest.raises(ScenarioError, match=r"has a \[control\], and its loop is not closed here"):
        simulate_alone(rig, described)
    identified = closed_loop(rig, described, feedback="encoder").log
    np.testing.assert_array_equal(
        simulate(rig, described).channels["x1"], identified.channels["x1"]
    )


def test_an_encoder_of_a_loop_counts_whole_degrees_unless_it_is_said_otherwise(rig: Rig) -> None:
    """What the controller is told is the true angle to the nearest step, its std that of
    rounding.
    """
    for said, step in (({}, 1.0), ({"encoder_resolution": "0.25 deg"}, 0.25)):
        run = closed_loop(rig, scenario(control={**PID, **said}), feedback="encoder")
        counts = np.rad2deg(run.estimates) / step
        np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)
        assert np.abs(np.rad2deg(run.estimates - run.angles)).max() <= step / 2 + 1e-9
        np.testing.assert_allclose(np.rad2deg(run.stds), step / np.sqrt(12.0))
