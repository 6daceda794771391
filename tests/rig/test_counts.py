"""Encoders that count and currents: what a log's numbers are, and errors written in them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from distal import Rig, load_rig
from distal.errors import RigError
from distal.rig import build_rig, log_factor, step_of
from distal.sensor_errors import variance
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


def test_counts_are_angles_of_the_capstan() -> None:
    """One turn of the capstan is 50 of the motor, 204,800 counts; what an encoder cannot tell is
    one of them.
    """
    sensor = with_sensors(ENCODER, {}).sensors[0]
    assert 204_800 * log_factor(sensor) == pytest.approx(2 * np.pi)
    assert sensor.resolution == pytest.approx(50 * COUNT)
    assert step_of(sensor) == pytest.approx(COUNT)
    for unit, turn in (("rev", 1.0), ("turn", 1.0), ("deg", 360.0), ("rad", 2 * np.pi)):
        other = with_sensors({"unit": unit, "gear": 50}, {}).sensors[0]
        assert 50 * turn * log_factor(other) == pytest.approx(2 * np.pi)
        assert other.resolution == 0.0


def test_errors_in_counts_and_in_si() -> None:
    errors = {
        "noise": "2 count",
        "linearity": "3 counts",
        "resolution": "4 count",
        "bias": {"value": "5 count", "std": "6 count"},
    }
    sensor = with_sensors({**ENCODER, **errors}, {}).sensors[0]
    found = [sensor.noise, sensor.linearity, sensor.resolution, sensor.bias.value, sensor.bias.std]
    np.testing.assert_allclose(found, COUNT * np.array([2, 3, 4 * 50, 5, 6]))
    assert with_sensors({**ENCODER, "noise": "0.1 deg"}, {}).sensors[0].noise == pytest.approx(
        np.deg2rad(0.1)
    )
    assert with_sensors({**ENCODER, "noise": 1e-3}, {}).sensors[0].noise == 1e-3


def test_the_gear_applies_to_the_motors_constant_only() -> None:
    sensor = with_sensors(
        {}, {**MOTOR, "noise": "20 mA", "bias": {"value": 0, "std": "0.1 A"}}
    ).sensors[1]
    assert log_factor(sensor) == pytest.approx(24e-3 * 50 * 1e-3)
    assert sensor.noise == pytest.approx(0.02 * 24e-3 * 50)
    assert sensor.bias.std == pytest.approx(0.1 * 24e-3 * 50)
    at_capstan = with_sensors(
        {}, {"unit": "A", "torque_constant": "1.2 N m/A", "noise": "20 mA"}
    ).sensors[1]
    assert log_factor(at_capstan) == pytest.approx(1.2)
    assert at_capstan.noise == pytest.approx(0.024)
    assert with_sensors({}, {"noise": "5 mN m"}).sensors[1].noise == pytest.approx(5e-3)


def test_a_rig_that_is_written_and_read_again_is_the_same() -> None:
    rig = with_sensors({**ENCODER, "noise": "2 count"}, {**MOTOR, "noise": "20 mA"})
    assert build_rig(rig.model_dump(), rig.name) == rig
    assert rig.with_values({"sensors.motor_angle.noise": "4 count"}).sensors[
        0
    ].noise == pytest.approx(4 * COUNT)


def test_the_resolution_is_that_of_the_sensors_own_shaft() -> None:
    """Before the gear, whatever it is written in: 4096 counts in a turn are 0.0879° of the motor, a
    50th of the capstan.
    """
    degree = 360 / 4096
    written = [
        with_sensors({**ENCODER, "resolution": "1 count"}, {}),
        with_sensors({**ENCODER, "resolution": f"{degree} deg"}, {}),
        with_sensors({"unit": "deg", "gear": 50, "resolution": f"{degree} deg"}, {}),
        with_sensors({"unit": "deg", "gear": 50, "resolution": np.deg2rad(degree)}, {}),
    ]
    for rig in (
        *written,
        *(one.with_values({}) for one in written),
    ):  # and once more through a dump
        sensor = rig.sensors[0]
        assert step_of(sensor) == pytest.approx(COUNT)
        assert variance(sensor) == pytest.approx(COUNT**2 / 12)
        read = measure(sensor, np.linspace(0.0, 0.1, 10_000), (0.0, 0.1), np.random.default_rng(0))
        assert np.diff(np.unique(read)).min() == pytest.approx(COUNT)


@pytest.mark.parametrize(
    ("angle", "torque"),
    [
        (
            {
                **ENCODER,
                "gear": "50 to 1",
                "noise": "2 count",
                "bias": {"value": 0, "std": "3 count"},
            },
            {},
        ),
        ({**ENCODER, "counts_per_turn": "many", "noise": "2 count"}, {}),
        ({}, {**MOTOR, "gear": "50 to 1", "noise": "20 mA"}),
        ({}, {**MOTOR, "torque_constant_motor": "24 mN", "noise": "20 mA"}),
    ],
)
def test_one_mistake_is_one_message(angle: dict[str, Any], torque: dict[str, Any]) -> None:
    with pytest.raises(RigError) as caught:
        with_sensors(angle, torque)
    assert str(caught.value).startswith("counting: sensors.motor_")
    assert "also" not in str(caught.value)


@pytest.mark.parametrize(
    ("angle", "torque", "said"),
    [
        ({"unit": "count"}, {}, r"sensors\.motor_angle: unit: 'count' needs 'counts_per_turn'"),
        (
            {"counts_per_turn": 4096},
            {},
            r'counts_per_turn: is for a log in counts; give unit = "count" too',
        ),
        ({**ENCODER, "counts_per_turn": 0}, {}, r"counts_per_turn: must be positive, 0 came"),
        (
            {**ENCODER, "counts_per_turn": "many"},
            {},
            r"counts_per_turn: 'many' does not start with a number",
        ),
        ({**ENCODER, "gear": -3}, {}, r"gear: must be positive"),
        ({**ENCODER, "noise": "x count"}, {}, r"noise: 'x count' does not start with a number"),
        ({"unit": "deg", "noise": "2 count"}, {}, r"noise: unit 'count' is no angle"),
        ({}, {"gear": 50}, r"gear: applies to torque_constant_motor only"),
        ({}, {"gear": 50, "torque_constant": 1.0}, r"gear: applies to torque_constant_motor only"),
        ({}, {**MOTOR, "torque_constant": 1.0}, r"give one of them"),
        ({}, {"noise": "20 mA"}, r"noise: unit 'mA' has the wrong dimension"),
        ({}, {"unit": "count"}, r"sensors\.motor_torque: unit: 'count' needs"),
    ],
)
def test_what_is_refused(angle: dict[str, Any], torque: dict[str, Any], said: str) -> None:
    with pytest.raises(RigError, match=said):
        with_sensors(angle, torque)
