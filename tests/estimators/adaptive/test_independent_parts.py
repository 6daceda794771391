"""Fingers that share nothing are estimated side by side, each as if it were alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from distal import Log, Rig, estimate, load_rig, simulate, smooth
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
    first, second = (
        [[0.0, 0.01], [1.0, 0.06], [2.0, 0.02]],
        [[0.0, 0.0], [1.0, 0.1], [2.0, -0.1]],
    )
    moved = {"f0_flexor": {"torque": first}, rig.drives[1].name: {"torque": second}}
    log = simulate(rig, Scenario(rig="hand", name="hand", duration=2.0, drives=moved), 5)
    # each part has values of its own missing
    rng = np.random.default_rng(0)
    holed = {
        name: np.where(rng.random(len(log)) < 0.1, np.nan, read)
        for name, read in log.channels.items()
    }
    return replace(log, channels=holed)


def test_parts_are_found(rig: Rig) -> None:
    first, second = independent_parts(rig)
    assert [joint.name for joint in first.rig.joints] == ["f0_mcp", "f0_pip", "f0_dip"]
    assert second.indices["joints"] == (3,)
    assert second.whole_path("joints.0.inertia") == "joints.3.inertia"
    assert second.whole_path("base.gravity.0") == "base.gravity.0"
    for name in ("paper-2008", "finger-2n", "wrist-instrument"):
        assert len(independent_parts(load_rig(name))) == 1


def test_a_link_a_drive_or_an_error_in_common_ties_parts(rig: Rig) -> None:
    first, *others = rig.tendons
    pulled = first.model_copy(update={"drive": rig.drives[1].name})
    shared = {"value": 1e4, "shared": {"name": "rope", "std": 0.1}}
    for tied in (
        rig.with_values({"joints.3.parent": "f0_dip"}),
        rig.model_copy(update={"tendons": (pulled, *others), "drives": rig.drives[1:]}),
        rig.with_values({f"tendons.{i}.stiffness": shared for i in (0, 1)}),
    ):
        assert len(independent_parts(tied)) == 1


def test_each_part_is_as_if_it_were_alone(rig: Rig, log: Log) -> None:
    whole, smoothed = estimate(log, rig), smooth(log, rig)
    # with the guards that the whole has
    guards = AdaptiveFilter(rig).states.context.robustness
    for part in independent_parts(rig):
        alone = estimate(log, part.rig, AdaptiveFilter(part.rig, robustness=guards))
        at = list(part.indices["joints"])
        np.testing.assert_allclose(whole.angles[:, at], alone.angles, rtol=0, atol=1e-12)
        np.testing.assert_allclose(whole.angle_stds[:, at], alone.angle_stds, rtol=0, atol=1e-12)
        of_part = [whole.measured.index(name) for name in alone.measured]
        np.testing.assert_allclose(
            whole.innovations[:, of_part], alone.innovations, rtol=0, atol=1e-9
        )
        own, other = whole.covariances[:, at][:, :, at], np.setdiff1d(range(4), at)
        np.testing.assert_allclose(own, alone.covariances[:, : len(at), : len(at)], atol=1e-12)
        assert np.all(whole.covariances[:, at][:, :, other] == 0.0)
    assert np.rad2deg(whole.rms_error()) < 2.0
    first = independent_parts(rig)[0]
    np.testing.assert_allclose(
        smoothed.angles[:, :3], smooth(log, first.rig).angles, rtol=0, atol=1e-9
    )


def test_inputs_of_a_fit_reach_their_part(rig: Rig) -> None:
    paths = ["joints.3.inertia", "tendons.0.stiffness", "sensors.0.noise"]
    whole = AdaptiveFilter(rig, inputs=paths)
    parts = subsystems_of(whole.states)
    own = [part.states.context.mechanism.parameters for part in parts]
    assert own[0].inputs == ("tendons.0.stiffness", "sensors.0.noise")
    assert own[1].inputs == ("joints.0.inertia",)
    at = parts[1].at["p"][own[1].names.index("joints.0.inertia")]
    assert whole.states.context.mechanism.parameters.names[at] == paths[0]


@pytest.mark.parametrize(
    "path", ["joints.0.inertia", "drives.0.radius", "tendons.0.stiffness", "tendons.1.stiffness"]
)
def test_an_error_belongs_to_the_joints_that_its_component_moves(path: str) -> None:
    """A drive and its tendons have names of their own here."""
    assert set(_joints_of(load_rig("capstan-joint"), path)) == {0}
