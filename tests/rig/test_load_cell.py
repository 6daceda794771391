"""A load cell at the motor's end of a capstan's tendon: newtons in the log, the torque of its lever
in the model.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from distal import Rig, estimate, load_rig, read_log, simulate, write_log
from distal.errors import RigError
from distal.export import c_filter
from distal.logs import Log
from distal.rig import build_rig, doubts, log_factor, log_unit
from distal.simulation import build_scenario
from tests.export.test_export import build, needs_compiler, replayed

LEVER = 6e-3


def finger(cell: bool, sign: int = 1) -> Rig:
    """A chain of three joints with one tendon on a capstan of 6 mm, its torque measured or its
    tendon's tension.

    A cell in the tendon does not feel the friction of the motor: the rig has none.
    """
    raw = load_rig("finger-underactuated").model_dump(exclude_defaults=True)
    raw["drives"] = [{key: raw["drives"][0][key] for key in ("kind", "name", "inertia", "radius")}]
    sensor = {"name": "pull", "measures": "force", "of": "flexor", "rate": 200.0, "sign": sign}
    written = (
        {"unit": "N", "lever": "6 mm", "noise": "0.2 N"}
        if cell
        else {"unit": "N m", "noise": 0.2 * LEVER}
    )
    return build_rig({**raw, "sensors": [raw["sensors"][0], {**sensor, **written}]}, "finger")


@pytest.fixture(scope="module")
def log() -> Log:
    servo = {"angle": {"amplitude": 1.0, "frequency": 0.5}, "stiffness": 2.0, "damping": 0.02}
    scenario = {
        "rig": "finger-underactuated",
        "duration": 2.0,
        "drives": {"flexor": {"servo": servo}},
    }
    return simulate(finger(True), build_scenario(scenario, "curl"), 3)


def test_the_cell_reads_newtons_of_the_tendon() -> None:
    sensor = finger(True).sensors[1]
    assert log_factor(sensor) == pytest.approx(LEVER)
    assert log_unit(sensor) == "N"
    assert sensor.noise == pytest.approx(0.2 * LEVER)
    kilo = (
        finger(True)
        .with_values({"sensors.pull.unit": "kN", "sensors.pull.noise": "1e-4 kN"})
        .sensors[1]
    )
    assert (log_factor(kilo), kilo.noise) == pytest.approx((1e3 * LEVER, 0.1 * LEVER))
    assert build_rig(finger(True).model_dump(), "again").sensors == finger(True).sensors


@needs_compiler
def test_plant_log_filter_and_c_agree(log: Log, tmp_path: Path) -> None:
    """The log holds the tension at the capstan; estimates are those from a torque sensor."""
    rig, twin = finger(True), finger(False)
    write_log(log, rig, tmp_path / "log.csv")
    head, *rows = (line.split(",") for line in (tmp_path / "log.csv").read_text().splitlines())
    written = np.array([float(row[head.index("pull")]) for row in rows])
    assert (
        np.std((written - log.truth["tension_flexor"])[20:]) < 0.3
    )  # its noise and the rotor's inertia, after the start
    assert np.ptp(log.truth["tension_flexor"]) > 5.0
    np.testing.assert_allclose(written * LEVER, log.channels["pull"], rtol=1e-9)
    again = read_log(tmp_path / "log.csv", rig)
    known = estimate(again, rig)
    np.testing.assert_allclose(known.angles, estimate(log, twin).angles, atol=1e-9)
    rows_of_c = replayed(
        build(c_filter(rig, "adaptive", False), tmp_path, "-O0"), tmp_path / "log.csv"
    )
    angles = [1 + 2 * joint for joint in range(3)]
    np.testing.assert_allclose(rows_of_c[:, angles], known.angles, atol=1e-9)


@pytest.mark.parametrize(
    ("assignment", "said"),
    [
        (
            'sensors.tau_flexor.unit="N"',
            "unit 'N' has the wrong dimension; .*a load cell in N needs its lever",
        ),
        (
            'sensors.tau_flexor.unit="A"',
            "unit 'A' has the wrong dimension; .*a current a torque_constant",
        ),
        (
            'sensors.tau_flexor={ name = "i", measures = "force", of = "flexor", unit = "A", '
            'noise = "20 mA" }',
            "sensors.i.unit: unit 'A' has the wrong dimension; .*a current a torque_constant$",
        ),
        ('sensors.tau_flexor.lever="6 N"', "lever: unit 'N' has the wrong dimension"),
        (
            'sensors.tau_flexor.lever="6 mm"',
            "unit 'N m' has the wrong dimension; a unit like 'N' is allowed",
        ),
    ],
)
def test_what_is_refused(assignment: str, said: str) -> None:
    with pytest.raises(RigError, match=said):
        load_rig("finger-underactuated", [assignment])


def test_one_conversion_only() -> None:
    raw = finger(True).model_dump()
    raw["sensors"] = [*raw["sensors"]]
    raw["sensors"][1]["torque_constant"] = 0.1
    with pytest.raises(
        RigError,
        match="lever: is of a load cell, a torque constant of a motor's current; give one of them",
    ):
        build_rig(raw, "both")


def test_a_cell_that_reads_no_torque_of_its_drive_is_asked_about() -> None:
    """With two tendons on a capstan one cell is half of the truth; on side −1 a pull is a negative
    torque.
    """
    raw = load_rig("capstan-joint").model_dump(exclude_defaults=True)
    raw["sensors"] = [*raw["sensors"]]
    raw["sensors"][1] |= {"unit": "N", "lever": "6 mm", "noise": "0.2 N"}
    (said,) = doubts(build_rig(raw, "two tendons"))
    assert "sensor motor_torque is a load cell in one tendon, but motor pulls 2" in said
    assert doubts(finger(True)) == []
    flipped = {f"tendons.flexor.crossings.{i}.side": -1 for i in range(3)}
    (said,) = doubts(finger(True).with_values(flipped))
    assert said.endswith("a pull is a negative torque: is sign = -1 missing?")
    assert doubts(finger(True, sign=-1).with_values(flipped)) == []
