"""Where a calibration begins: numbers that agree with contacts and slopes, and a joint at the end
of the first sweep.
"""

from __future__ import annotations

import importlib

import numpy as np
import pytest
from benchmarks.hands import rig_of
from benchmarks.strangers.servo_hands import orca_like

from distal.hands.starts import contacts, is_pair, pair_starts, single_starts
from distal.hands.sweeps import Sweep
from distal.rig import Capstan, Rig
from distal.rig.hand_tables import Row, hand_of

part_fit = importlib.import_module("distal.hands.part_fit")


def swept(way: int, contact: float, level: float = 0.04) -> Sweep:
    """Return a sweep that met something."""
    return Sweep(way, 0, 100, level, contact, 2.0, 1e-3, True)


def pair_rig() -> Rig:
    known, _ = orca_like([3], ("index_mcp",))
    return rig_of(known)


SWEEPS = (swept(1, 2.0), swept(-1, -0.6), swept(1, 2.0), swept(-1, -0.6), swept(1, 2.0))


@pytest.mark.parametrize("stretched", [False, True])
def test_each_start_of_a_pair_explains_its_travel_and_its_middle(stretched: bool) -> None:
    rig = pair_rig()
    starts = pair_starts(rig, "m1", SWEEPS, stretched)
    assert len({round(start["drives.0.radius"], 9) for start in starts}) == (
        1 if stretched else len(starts)
    )
    low, high = rig.joints[0].travel
    for start in starts:
        found = rig.with_values(
            {path: value for path, value in start.items() if "pretension" not in path}
        )
        motor, arm = found.drives[0], found.tendons[0].arms()["index_mcp"]
        assert isinstance(motor, Capstan)
        play = 0.0 if stretched else sum(tendon.slack.value for tendon in found.tendons)
        # the travel that is left after play turns the joint through its range, but for a stretch of
        # a degree
        turned = (2.6 * motor.radius.value - play) / arm
        assert turned == pytest.approx(high - low, abs=np.deg2rad(1.0))
        middle = (0.7 - start["sensors.0.bias"]) * motor.radius.value / arm
        assert middle == pytest.approx((low + high) / 2, abs=1e-9)


def test_the_first_sweep_leaves_the_joint_at_that_end() -> None:
    rig = pair_rig()
    low, high = rig.joints[0].travel
    for way, end in ((1, high), (-1, low)):
        sweeps = {"m1": [swept(way, way * 1.0), *SWEEPS[1:]]}
        starts = pair_starts(rig, "m1", sweeps["m1"], False)
        prior = part_fit._prior(rig, ["m1"], sweeps, starts, None, "slack")
        assert prior.joints[0].initial.value == pytest.approx(end)
        assert prior.joints[0].initial.std == pytest.approx(np.deg2rad(1.0))


def test_springs_begin_as_stiff_as_the_pull_at_the_top_holds_them() -> None:
    rows = [
        Row(
            joint=name,
            motor="m",
            low=0.0,
            high=1.5,
            spool_radius=9e-3,
            joint_radius=arm,
            back="spring",
        )
        for name, arm in (("mcp", 12e-3), ("pip", 6e-3))
    ]
    rig = hand_of(rows, "finger", "table").rig
    assert not is_pair(rig, "m")
    sweeps = [swept(way, 3.0 * (way > 0), 0.09 if way > 0 else -0.03) for way in (1, -1, 1, -1, 1)]
    starts = single_starts(rig, "m", sweeps)
    middle = starts[len(starts) // 2]
    stiffness = [middle[f"joints.{i}.spring.stiffness"] for i in (0, 1)]
    # both close together: k (middle - rest) = arm T, with the tension of (0.09 + 0.03)/2 N m on a
    # spool of 9 mm
    assert stiffness[0] / stiffness[1] == pytest.approx(2.0)
    spring = rig.joints[0].spring
    assert spring is not None
    assert stiffness[0] * (0.75 - spring.rest_angle.value) == pytest.approx(12e-3 * 0.06 / 9e-3)
    assert middle["drives.0.friction.constant"] == pytest.approx(0.7 * 0.03)
    assert contacts(sweeps, 1) == (3.0, 3.0)
