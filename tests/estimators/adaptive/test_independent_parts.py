"""Fingers that share nothing are estimated side by side, each as if it were alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from distal import LiveEstimator, Log, Rig, estimate, load_rig, simulate
from distal.estimators import AdaptiveFilter
from distal.estimators.adaptive.filter_function import subsystems_of
from distal.rig import independent_parts
from distal.rig.rig import _joints_of
from distal.simulation import Scenario
from tests.hand_rigs import hand


@pytest.fixture(scope="module")
def rig() -> Rig:
    return hand(["finger-underactuated", "capstan-joint"], {"sensors.*.rate": 200.0})


@pytest.fixture(scope="module")
def log(rig: Rig) -> Log:
    moved = {"f0_flexor": {"torque": [["0 s", "10 mN m"], ["1 s", "60 mN m"], ["2 s", "20 mN m"]]}}
    moved |= {
        rig.drives[1].name: {"torque": [["0 s", "0 N m"], ["1 s", "0.1 N m"], ["2 s", "-0.1 N m"]]}
    }
    return simulate(rig, Scenario(rig="hand", name="hand", duration=2.0, drives=moved), 5)


def test_parts_are_found(rig: Rig) -> None:
    first, second = independent_parts(rig)
    assert [joint.name for joint in first.rig.joints] == ["f0_mcp", "f0_pip", "f0_dip"]
    assert second.indices["joints"] == (3,)
    assert second.whole_path("joints.0.inertia") == "joints.3.inertia"
    assert second.whole_path("base.gravity.0") == "base.gravity.0"
    for name in ("paper-2008", "finger-2n", "wrist-instrument"):
        assert len(independent_parts(load_rig(name))) == 1


@pytest.mark.parametrize(
    "tie",
    [
        {"joints.3.parent": "f0_dip"},
        {"tendons.0.drive": "f1_motor", "sensors": None},
        {
            "tendons.0.stiffness": {"value": 1e4, "shared": {"name": "rope", "std": 0.1}},
            "tendons.1.stiffness": {"value": 1e4, "shared": {"name": "rope", "std": 0.1}},
        },
    ],
    ids=["a link", "a drive", "an error in common"],
)
def test_what_ties_parts(rig: Rig, tie: dict[str, object]) -> None:
    if "sensors" in tie:
        motor = rig.drives[1].name
        tendons = (rig.tendons[0].model_copy(update={"drive": motor}), *rig.tendons[1:])
        tied = rig.model_copy(update={"tendons": tendons, "drives": rig.drives[1:]})
    else:
        tied = rig.with_values(tie)
    assert len(independent_parts(tied)) == 1


def test_each_part_is_as_if_it_were_alone(rig: Rig, log: Log) -> None:
    whole = estimate(log, rig)
    for part in independent_parts(rig):
        # with the guards that the whole has
        guards = AdaptiveFilter(rig).states.context.robustness
        alone = estimate(log, part.rig, AdaptiveFilter(part.rig, robustness=guards))
        at = list(part.indices["joints"])
        np.testing.assert_allclose(whole.angles[:, at], alone.angles, rtol=0, atol=1e-12)
        np.testing.assert_allclose(whole.angle_stds[:, at], alone.angle_stds, rtol=0, atol=1e-12)
        for name in alone.measured:
            one, other = whole.measured.index(name), alone.measured.index(name)
            np.testing.assert_allclose(
                whole.innovations[:, one], alone.innovations[:, other], rtol=0, atol=1e-9
            )
    assert np.rad2deg(whole.rms_error()) < 2.0


def test_a_part_whose_sensors_die_does_not_disturb_the_others(rig: Rig, log: Log) -> None:
    late = log.time > 0.5
    dead = {
        name: np.where(late & name.startswith("f1_"), np.nan, read)
        for name, read in log.channels.items()
    }
    whole, less = estimate(log, rig), estimate(replace(log, channels=dead), rig)
    np.testing.assert_array_equal(whole.angles[:, :3], less.angles[:, :3])
    assert less.angle_stds[-1, 3] > 1.5 * whole.angle_stds[-1, 3]


def test_live_and_smoothed(rig: Rig, log: Log) -> None:
    from distal import smooth

    live, whole = LiveEstimator(rig), estimate(log, rig)
    rows = np.column_stack([log.channels[name] for name in live.channels])
    for time, row in zip(log.time, rows):
        live.step(float(time), row)
    np.testing.assert_array_equal(live.angles, whole.angles[-1])
    part = independent_parts(rig)[0]
    alone = smooth(log, part.rig)
    np.testing.assert_allclose(smooth(log, rig).angles[:, :3], alone.angles, rtol=0, atol=1e-9)


def test_inputs_of_a_fit_reach_their_part(rig: Rig) -> None:
    paths = ["joints.3.inertia", "tendons.0.stiffness", "sensors.0.noise"]
    whole = AdaptiveFilter(rig, inputs=paths)
    first, second = subsystems_of(whole.states)
    assert first.states.context.mechanism.parameters.inputs == (
        "tendons.0.stiffness",
        "sensors.0.noise",
    )
    assert second.states.context.mechanism.parameters.inputs == ("joints.0.inertia",)
    names = whole.states.context.mechanism.parameters.names
    assert (
        names[
            second.parameters[
                second.states.context.mechanism.parameters.names.index("joints.0.inertia")
            ]
        ]
        == paths[0]
    )


@pytest.mark.parametrize(
    "path", ["joints.0.inertia", "drives.0.radius", "tendons.0.stiffness", "tendons.1.stiffness"]
)
def test_an_error_belongs_to_the_joints_that_its_component_moves(path: str) -> None:
    """A drive and its tendons have names of their own here."""
    assert set(_joints_of(load_rig("capstan-joint"), path)) == {"jaw"}
