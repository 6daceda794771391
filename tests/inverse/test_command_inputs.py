"""What commands read beside the parameters of the equations, typed out."""

from __future__ import annotations

from math import inf, pi

import pytest

from distal import load_rig
from distal.inverse.feedforward import command_inputs


def test_of_a_capstan() -> None:
    """Limits and radii of the drive, stops of the joint, the servo, stds of parameters."""
    rig = load_rig("capstan-joint").with_values(
        {
            "drives.motor.limit": "0.3 N m",
            "drives.motor.radius": {"value": "5 mm", "std": "0.1 mm"},
            "drives.motor.servo": {"bandwidth": "8 Hz", "delay": "5 ms", "stiffness": "4 N m/rad"},
            "joints.jaw.stops": ["-30 deg", "40 deg"],
        }
    )
    expected = {
        "command.drives.0.limit": 0.3,
        "command.drives.0.radius": 5e-3,
        "command.drives.0.soft": 0.25,
        "command.drives.0.radius.std": 1e-4,
        "command.lead": 1 / (2 * pi * 8.0) + 5e-3,
        "command.joints.0.low": -30 * pi / 180,
        "command.joints.0.high": 40 * pi / 180,
    }
    found = command_inputs(rig)
    assert {name: found[name] for name in expected} == pytest.approx(expected)


def test_what_is_not_stated_limits_nothing() -> None:
    found = command_inputs(load_rig("paper-2008").with_values({"drives.left.stops": None}))
    assert found["command.drives.0.limit"] == inf
    assert (found["command.drives.0.low"], found["command.drives.0.high"]) == (-inf, inf)
    assert found["command.lead"] == 0.0
