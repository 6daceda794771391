"""What sensors of drives read of a motion, and from where to where they can: naive twins."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from distal import load_rig
from distal.rig import position_range
from distal.rig.components import REACH
from distal.rig.sensors import FORCE, POSITION, drive_travel, largest_effort


def test_a_command_is_ahead_of_its_drive_by_its_speed_times_the_lag() -> None:
    """A drive at 2 that moves with 3/s, commanded 0.1 s ahead, is told 2.3; its encoder reads 2."""
    motion: Any = SimpleNamespace(positions=[2.0, 3.0], rates=[3.0, 3.0], efforts=[7.0, 8.0])
    for lag, read in ((0.0, 2.0), (0.1, 2.3)):
        sensor: Any = SimpleNamespace(lag=lag)
        assert POSITION.read(sensor, motion, 0) == pytest.approx(read)
        assert POSITION.read(sensor, motion, 1) == pytest.approx(read + 1.0)
    assert FORCE.read(None, motion, 1) == 8.0


def test_a_capstan_turns_as_far_as_its_joint_takes_it() -> None:
    """±1.2 rad of the joint at r/R; a slider the same about the stretch by its nominal force; stops
    come first.
    """
    rig = load_rig("capstan-joint")
    arm, radius = rig.tendons[0].total_arm, rig.drives[0].radius.value  # type: ignore[union-attr]
    assert drive_travel(rig, 0) == pytest.approx((-REACH * arm / radius, REACH * arm / radius))
    stopped = rig.with_values({"drives.0.stops": [-1.0, 2.5]})
    assert drive_travel(stopped, 0) == (-1.0, 2.5)
    slider = load_rig("paper-2008").with_values(
        {"drives.*.stops": None, "drives.*.nominal_force": 4.03}
    )
    centre, reach = 4.03 / slider.tendons[0].stiffness.value, REACH * slider.tendons[0].total_arm
    assert drive_travel(slider, 0) == pytest.approx((centre - reach, centre + reach))


@pytest.mark.parametrize(("name", "tendon"), [("finger-2n", 3), ("finger-underactuated", 0)])
def test_a_tendon_over_several_joints_moves_as_far_as_their_stops_allow(
    name: str, tendon: int
) -> None:
    """Σ of each arm times the end of its joint that draws it in, and the one that lets it out."""
    rig = load_rig(name).with_values({"drives.*.stops": None})
    stops = {joint.name: joint.travel for joint in rig.joints}
    drive, pulled = rig.drives[tendon], rig.tendons[tendon]
    assert len(pulled.joints) > 1
    ends = [[arm * end for end in stops[joint]] for joint, arm in pulled.arms().items()]
    expected = np.array([sum(map(min, ends)), sum(map(max, ends))])
    if drive.kind == "capstan":
        expected = expected * pulled.winding / drive.radius.value
    else:
        expected = expected + drive.nominal_force.value / pulled.stiffness.value
    assert drive_travel(rig, tendon) == pytest.approx(expected)


def test_the_largest_effort_is_the_limit_or_twice_that_at_rest() -> None:
    """Of a motor in both directions, of a slider only to pull."""
    rig = load_rig("capstan-joint")
    radius, pretension = rig.drives[0].radius.value, rig.tendons[0].pretension.value  # type: ignore[union-attr]
    rest = 2 * 2 * pretension * radius
    for changes, largest in (
        ({}, rest),
        ({"drives.0.nominal_force": 0.5}, 1.0),
        ({"drives.0.nominal_force": -0.5}, 1.0),
        ({"drives.0.limit": 0.3}, 0.3),
        ({"tendons.*.pretension": 0.0}, 0.0),
    ):
        changed = rig.with_values(changes)
        assert largest_effort(changed, 0) == pytest.approx(largest)
        assert FORCE.travel(changed, 0) == pytest.approx((-largest, largest))
    slider = load_rig("paper-2008").with_values({"drives.*.nominal_force": 4.0})
    assert FORCE.travel(slider, 1) == pytest.approx((0.0, 8.0))


def test_a_place_is_possible_a_little_beyond_the_stops_or_far_beyond_what_the_joint_takes_it() -> (
    None
):
    """By 5 % of the travel of a drive with stops, by ten times that of one without, and by the
    sensor's errors.
    """
    errors = {"noise": 0.01, "linearity": 0.02, "bias": {"value": 0.3, "std": 0.0}}
    rig = load_rig("capstan-joint").with_values(
        {f"sensors.motor_angle.{name}": error for name, error in errors.items()}
    )
    position, force = rig.sensors[0], rig.sensors[1]
    low, high = drive_travel(rig, 0)
    room = 10.0 * (high - low) + 0.02 + 10 * 0.01
    assert position_range(rig, position) == pytest.approx((low - room + 0.3, high + room + 0.3))
    stopped = rig.with_values({"drives.0.stops": [-1.0, 3.0]})
    room = 0.05 * 4.0 + 0.02 + 10 * 0.01
    assert position_range(stopped, position) == pytest.approx((-1.0 - room + 0.3, 3.0 + room + 0.3))
    assert position_range(rig, force)[0] < -1e100
    assert position_range(rig, force)[1] > 1e100
