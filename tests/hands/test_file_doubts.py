"""What the ends of the motors' travel contradict in a hand's file, and what is changed with consent
only.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from distal import Rig
from distal.hands import Fault, calibrate
from distal.hands.calibrate import doubts_of
from distal.hands.hand import _without_zero
from distal.hands.power_on_routine import Sweep
from distal.rig.hand_tables import Row, hand_of
from tests.support.hands import calibrated, rig_of
from tests.support.servo_hands import orca_like

RIGHT = {
    "low": np.deg2rad(-25.0),
    "high": np.deg2rad(100.0),
    "spool_radius": 8e-3,
    "joint_radius": 8e-3,
    "zero": 2.0,
    "range_std": np.deg2rad(0.5),
    "ratio_std": 0.005,
}


def rig(counts: float | None = None, std: float = 0.5, **first: float) -> Rig:
    """Return a hand of two joints, of whose file the first line is changed."""
    known = {**RIGHT, "zero_std": np.deg2rad(std), "counts": counts}
    rows = [
        Row(joint="a", motor="m1", **{**known, **first}),
        Row(joint="b", motor="m2", **{**known, "zero": 3.5, "low": -0.3}),
    ]
    slack = {"tendons.*.slack": {"value": 0.0, "std": 5e-5}}
    return hand_of(rows, "hand", "table").rig.with_values(slack)


def sweeps(low: float, high: float, met: bool = True) -> tuple[Sweep, ...]:
    """Return sweeps between two places [rad]."""
    ends = {1: high, -1: low}
    return tuple(Sweep(way, 0, 0.0, 0.001, ends[way], met or way == 1) for way in (1, -1, 1, -1, 1))


FIRST = sweeps(2.0 + np.deg2rad(-25.0), 2.0 + np.deg2rad(100.0))
SECOND = sweeps(3.5 - 0.3, 3.5 + np.deg2rad(100.0))
"""What the motors of a hand do of which the file is right."""


def found(
    of: Rig, low: float = -25.0, high: float = 100.0, zero: float = 2.0, met: bool = True
) -> tuple[Fault, ...]:
    """Return the doubts where the first motor meets its ends at some angles of its joint [deg]."""
    first = sweeps(zero + np.deg2rad(low), zero + np.deg2rad(high), met)
    return doubts_of(of, {"m1": first, "m2": SECOND})


def test_a_right_file_is_not_accused() -> None:
    assert found(rig()) == ()
    assert found(rig(), low=-24.0, high=101.0) == ()


@pytest.mark.parametrize(
    ("file", "met", "kind", "says", "corrects"),
    [
        ({"high": 1.6}, {}, "slack", "its range is -25.0° to 99.", "joints.a.stops"),
        ({"low": -0.3}, {}, "slack", "its range is -24.", "joints.a.stops"),
        ({"high": 1.88}, {}, "file", "its range is -25.0° to 100.", "joints.a.stops"),
        ({"zero": 2.1}, {}, "zero", "its zero is -0.016 turns off, or both ends", None),
        ({}, {"zero": 2.0 + 2 * np.pi}, "zero", "its zero is 1.000 turns off", None),
        (
            {"spool_radius": 16e-3},
            {},
            "slack",
            "its radius is 8 mm, or its gear 2",
            "drives.m1.radius",
        ),
        ({"spool_radius": 6e-3}, {}, "file", "its radius is 8 mm", "drives.m1.radius"),
        (
            {},
            {"low": -100.0, "high": 25.0},
            "file",
            "it turns the other way",
            "sensors.m1_position.sign",
        ),
    ],
)
def test_each_mistake_is_named_first_with_its_correction(
    file: dict[str, float], met: dict[str, float], kind: str, says: str, corrects: str | None
) -> None:
    (doubt,) = found(rig(**file), **met)
    assert (doubt.kind, doubt.drive) == (kind, "m1")
    assert doubt.sentence.split(" of the joint off: ")[1].startswith(says)
    assert ("--accept" in doubt.sentence) == bool(doubt.values)
    if corrects is not None:
        assert corrects in doubt.values
        corrected = rig(**file).with_values(doubt.values)
        turn = corrected.sensors_of("position")[0].sign
        ends = np.deg2rad([met.get("low", -25.0), met.get("high", 100.0)])
        low, high = sorted(turn * (2.0 + ends))
        assert doubts_of(corrected, {"m1": sweeps(low, high), "m2": SECOND}) == ()


def test_motors_that_are_exchanged_are_named_at_both() -> None:
    met = {"m1": SECOND, "m2": FIRST}
    doubts = doubts_of(rig(), met)
    assert ["exchanged with m2" in doubts[0].sentence, "exchanged with m1" in doubts[1].sentence]
    assert doubts_of(rig().with_values(doubts[0].values), met) == ()


def test_an_end_that_was_not_met_is_no_end() -> None:
    """A torn tendon does not make a file wrong; a spool that is too large in the file does."""
    assert found(rig(), low=-90.0, met=False) == ()
    (doubt,) = found(rig(spool_radius=16e-3), low=-10.0, met=False)
    assert "its radius is 8" in doubt.sentence


def test_what_the_file_does_not_know_is_not_wrong() -> None:
    """A zero that is a guess; and turns of an encoder that wraps."""
    assert found(rig(std=60.0), zero=5.0) == ()
    assert found(rig(counts=4096.0), zero=2.0 + 2 * np.pi) == ()


@pytest.mark.slow
def test_only_with_consent_is_a_file_changed() -> None:
    """The file of a calibrated hand, in which a motor then turns the other way."""
    known, hands = orca_like([3], ("index_mcp", "ring_abd"))
    ((first, log),) = calibrated(known, hands, rig_of(known), together=True)
    right = first.rig
    assert calibrate(log, right).faults == ()
    sensors = ("m1_position", "m1_current")
    zero = -right.sensors[0].bias.value
    turned = {f"sensors.{name}.sign": -1 for name in sensors} | {"sensors.m1_position.bias": zero}
    wrong = right.with_values(turned)
    read = replace(log, channels=log.channels | {name: -log.channels[name] for name in sensors})
    kept = calibrate(read, wrong)
    assert [fault.kind for fault in kept.faults] == ["file"]
    assert kept.rig.sensors[0].sign == -1
    assert _without_zero(kept.rig) == ["m1"]  # so that Hand sends nothing
    mended = calibrate(read, wrong, accept=True)
    assert mended.faults == ()
    assert mended.notes[-1].startswith("corrected: m1")
    assert [one.sign for one in mended.rig.sensors] == [one.sign for one in right.sensors]
    assert mended.rig.sensors[0].bias.value == pytest.approx(-zero, abs=0.05)
    assert _without_zero(mended.rig) == []
    assert [joint.stops for joint in mended.rig.joints] == [joint.stops for joint in right.joints]
