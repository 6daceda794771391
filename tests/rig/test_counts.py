"""Encoders that count and currents: what a log's numbers are, and errors written in them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from distal import Rig, load_rig
from distal.errors import RigError
from distal.rig import Sensor, build_rig, log_factor, step_of
from distal.sensor_models import variance
from tests.helpers import measure

ENCODER = {"unit": "count", "counts_per_turn": 4096, "gear": 50}
MOTOR = {"unit": "mA", "torque_constant_motor": "24 mN m/A", "gear": 50}
COUNT = 2 * np.pi / 4096 / 50


def with_sensors(angle: dict[str, Any], torque: dict[str, Any]) -> Rig:
    raw = load_rig("capstan-joint").model_dump(exclude_defaults=True)
    first, second, *others = raw["sensors"]
    kept = [{key: one[key] for key in ("name", "measures", "of")} for one in (first, second)]
    return build_rig(
        {**raw, "sensors": [{**kept[0], **angle}, {**kept[1], **torque}, *others]}, "counting"
    )


def angle_of(**fields: object) -> Sensor:
    return with_sensors({"gear": 50, **fields}, {}).sensors[0]


def torque_of(**fields: object) -> Sensor:
    return with_sensors({}, fields).sensors[1]


def test_counts_are_angles_of_the_capstan() -> None:
    """One turn of the capstan is 50 of the motor, 204,800 counts; what an encoder cannot tell is
    one of them.
    """
    sensor = angle_of(**ENCODER)
    assert 204_800 * log_factor(sensor) == pytest.approx(2 * np.pi)
    assert sensor.resolution == pytest.approx(50 * COUNT)
    assert step_of(sensor) == pytest.approx(COUNT)
    for unit, turn in (("rev", 1.0), ("turn", 1.0), ("deg", 360.0), ("rad", 2 * np.pi)):
        other = angle_of(unit=unit)
        assert 50 * turn * log_factor(other) == pytest.approx(2 * np.pi)
        assert other.resolution == 0.0


def test_errors_in_counts_and_in_si() -> None:
    errors = {"noise": "2 count", "linearity": "3 counts", "resolution": "4 count"}
    sensor = angle_of(**ENCODER, **errors, bias={"value": "5 count", "std": "6 count"})
    found = [sensor.noise, sensor.linearity, sensor.resolution, sensor.bias.value, sensor.bias.std]
    np.testing.assert_allclose(found, COUNT * np.array([2, 3, 4 * 50, 5, 6]))
    assert angle_of(**ENCODER, noise="0.1 deg").noise == pytest.approx(np.deg2rad(0.1))
    assert angle_of(**ENCODER, noise=1e-3).noise == 1e-3


def test_the_gear_applies_to_the_motors_constant_only() -> None:
    sensor = torque_of(**MOTOR, noise="20 mA", bias={"value": 0, "std": "0.1 A"})
    found = [log_factor(sensor), sensor.noise, sensor.bias.std]
    np.testing.assert_allclose(found, 24e-3 * 50 * np.array([1e-3, 0.02, 0.1]))
    at_capstan = torque_of(unit="A", torque_constant="1.2 N m/A", noise="20 mA")
    assert (log_factor(at_capstan), at_capstan.noise) == pytest.approx((1.2, 0.024))
    assert torque_of(noise="5 mN m").noise == pytest.approx(5e-3)


def test_a_rig_that_is_written_and_read_again_is_the_same() -> None:
    rig = with_sensors({**ENCODER, "noise": "2 count"}, {**MOTOR, "noise": "20 mA"})
    assert build_rig(rig.model_dump(), rig.name) == rig
    again = rig.with_values({"sensors.motor_angle.noise": "4 count"})
    assert again.sensors[0].noise == pytest.approx(4 * COUNT)


DEGREE = 360 / 4096


@pytest.mark.parametrize(
    "fields",
    [
        {**ENCODER, "resolution": "1 count"},
        {**ENCODER, "resolution": f"{DEGREE} deg"},
        {"unit": "deg", "resolution": f"{DEGREE} deg"},
        {"unit": "deg", "resolution": np.deg2rad(DEGREE)},
    ],
)
def test_the_resolution_is_that_of_the_sensors_own_shaft(fields: dict[str, object]) -> None:
    """Before the gear, whatever it is written in: 4096 counts in a turn are 0.0879° of the motor, a
    50th of the capstan. Once more through a dump.
    """
    rig = with_sensors({"gear": 50, **fields}, {})
    for sensor in (rig.sensors[0], rig.with_values({}).sensors[0]):
        assert step_of(sensor) == pytest.approx(COUNT)
        assert variance(sensor) == pytest.approx(COUNT**2 / 12)
        read = measure(sensor, np.linspace(0.0, 0.1, 10_000), (0.0, 0.1), np.random.default_rng(0))
        assert np.diff(np.unique(read)).min() == pytest.approx(COUNT)


@pytest.mark.parametrize(
    ("angle", "torque", "said"),
    [
        ({"unit": "count"}, {}, r"angle\.unit: 'count' needs 'counts_per_turn'"),
        ({"counts_per_turn": 4096}, {}, r'counts_per_turn: is for a log in counts; give unit = "c'),
        ({**ENCODER, "counts_per_turn": 0}, {}, r"counts_per_turn: must be positive, 0 came"),
        (
            {**ENCODER, "counts_per_turn": "many", "noise": "2 count"},
            {},
            r"counts_per_turn: 'many' does not start with a number",
        ),
        ({**ENCODER, "gear": -3}, {}, r"gear: must be positive"),
        ({"unit": "deg", "noise": "2 count"}, {}, r"noise: unit 'count' is no angle"),
        ({}, {"gear": 50}, r"gear: applies to torque_constant_motor only"),
        ({}, {**MOTOR, "gear": "50 to 1", "noise": "20 mA"}, r"gear: unit 'to 1'"),
        ({}, {**MOTOR, "torque_constant": 1.0}, r"give one of them"),
        ({}, {**MOTOR, "torque_constant_motor": "24 mN", "noise": "20 mA"}, r"motor: unit 'mN'"),
        ({}, {"noise": "20 mA"}, r"noise: unit 'mA' has the wrong dimension"),
        ({}, {"unit": "count"}, r"torque\.unit: 'count' needs"),
    ],
)
def test_what_is_refused(angle: dict[str, Any], torque: dict[str, Any], said: str) -> None:
    """One mistake is one message."""
    with pytest.raises(RigError, match=rf"^counting: sensors\.motor_.*{said}") as caught:
        with_sensors(angle, torque)
    assert "also" not in str(caught.value)
