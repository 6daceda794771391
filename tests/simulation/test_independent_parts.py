"""Fingers that share nothing are simulated side by side, each as if it were alone."""

from __future__ import annotations

import numpy as np
import pytest

from distal import Rig, load_rig, simulate
from distal.model import Mechanism
from distal.rig import independent_parts
from distal.simulation import Scenario
from distal.simulation.plant import parts_of_plant
from tests.hand_rigs import hand


@pytest.mark.parametrize(
    "fingers",
    [
        ("finger-underactuated", "capstan-joint"),
        pytest.param(("finger-underactuated", "paper-2008"), marks=pytest.mark.more),
    ],
)
def test_each_part_moves_as_if_it_were_alone(fingers: tuple[str, str]) -> None:
    """Interval and sub-steps are the same for all, so those of one alone are set to them."""
    rig = hand(fingers, {"sensors.*.rate": 200.0, "stepping.largest_step": 1e-4})
    assert len(parts_of_plant(Mechanism(rig))) == 2
    pulls = {"slider": ("force", ["1 N", "6 N"]), "capstan": ("torque", ["0 N m", "40 mN m"])}
    moved = {
        d.name: {pulls[d.kind][0]: [["0 s", pulls[d.kind][1][0]], ["0.5 s", pulls[d.kind][1][1]]]}
        for d in rig.drives
    }
    whole = simulate(rig, Scenario(rig="hand", name="hand", duration=0.8, drives=moved), 2)
    for part in independent_parts(rig):
        own = {drive.name: moved[drive.name] for drive in part.rig.drives}
        alone = simulate(part.rig, Scenario(rig="part", name="part", duration=0.8, drives=own), 2)
        for name, joint in zip([joint.name for joint in part.rig.joints], part.rig.joints):
            column = f"theta_{name}" if len(part.rig.joints) > 1 else "theta"
            np.testing.assert_allclose(
                whole.truth[f"theta_{joint.name}"], alone.truth[column], rtol=0, atol=1e-9
            )
        for drive in part.rig.drives:
            np.testing.assert_allclose(
                whole.truth[f"force_{drive.name}"],
                alone.truth[f"force_{drive.name}"],
                rtol=0,
                atol=1e-8,
            )
            np.testing.assert_allclose(
                whole.truth[f"position_{drive.name}"],
                alone.truth[f"position_{drive.name}"],
                rtol=0,
                atol=1e-10,
            )


def test_sensors_of_joints_stay_with_their_finger() -> None:
    """A torque on a joint, as an angle, goes with the part that has the joint, where a hand is
    taken apart.
    """
    hand = load_rig("hand")
    joints = [hand.joints[0].name, hand.joints[-1].name]
    added = [
        {"name": f"torque_{of}", "measures": "torque", "of": of, "noise": 0.01} for of in joints
    ]
    raw = hand.model_dump()
    raw["sensors"] = [*raw["sensors"], *added]
    parts = independent_parts(Rig.model_validate(raw))
    assert len(parts) > 1
    for of in joints:
        (part,) = (part for part in parts if of in [joint.name for joint in part.rig.joints])
        assert f"torque_{of}" in [sensor.name for sensor in part.rig.sensors]
