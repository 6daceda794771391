"""A load cell at the motor's end of a capstan's tendon: newtons in the log, the torque of its lever
in the model.
"""

from __future__ import annotations

import numpy as np
import pytest

from distal import Rig, load_rig, simulate
from distal.errors import RigError
from distal.rig import build_rig, doubts, log_factor, log_unit
from distal.simulation import build_scenario

LEVER = 6e-3


def finger(**fields: object) -> Rig:
    """A chain of three joints with one tendon on a capstan of 6 mm, and a load cell in it.

    A cell in the tendon does not feel the friction of the motor: the rig has none.
    """
    raw = load_rig("finger-underactuated").model_dump(exclude_defaults=True)
    raw["drives"] = [{key: raw["drives"][0][key] for key in ("kind", "name", "inertia", "radius")}]
    cell = {"name": "pull", "measures": "force", "of": "flexor", "unit": "N", "lever": "6 mm"}
    raw["sensors"] = [raw["sensors"][0], {**cell, "noise": "0.2 N", **fields}]
    return build_rig(raw, "finger")


def test_the_cell_reads_newtons_of_the_tendon() -> None:
    sensor = finger().sensors[1]
    assert log_factor(sensor) == pytest.approx(LEVER)
    assert log_unit(sensor) == "N"
    assert sensor.noise == pytest.approx(0.2 * LEVER)
    kilo = finger(unit="kN", noise="1e-4 kN").sensors[1]
    assert (log_factor(kilo), kilo.noise) == pytest.approx((1e3 * LEVER, 0.1 * LEVER))
    assert build_rig(finger().model_dump(), "again").sensors == finger().sensors


def test_the_plant_pulls_at_the_cell() -> None:
    """But for its noise and the rotor's inertia, after the start."""
    servo = {"angle": {"amplitude": 1.0, "frequency": 0.5}, "stiffness": 2.0, "damping": 0.02}
    scenario = {
        "rig": "finger-underactuated",
        "duration": 2.0,
        "drives": {"flexor": {"servo": servo}},
    }
    log = simulate(finger(), build_scenario(scenario, "curl"), 3)
    tension = log.truth["tension_flexor"]
    assert np.ptp(tension) > 5.0
    assert np.nanstd((log.channels["pull"] / LEVER - tension)[20:]) < 0.3


@pytest.mark.parametrize(
    ("assignment", "said"),
    [
        ('unit="N"', "unit 'N' has the wrong dimension; .*a load cell in N needs its lever"),
        ('lever="6 N"', "lever: unit 'N' has the wrong dimension"),
        ('lever="6 mm"', "unit 'N m' has the wrong dimension; a unit like 'N' is allowed"),
    ],
)
def test_what_is_refused(assignment: str, said: str) -> None:
    with pytest.raises(RigError, match=said):
        load_rig("finger-underactuated", [f"sensors.tau_flexor.{assignment}"])


def test_a_cell_that_reads_no_torque_of_its_drive_is_asked_about() -> None:
    """With two tendons on a capstan one cell is half of the truth; on side −1 a pull is a negative
    torque.
    """
    cell = {"sensors.1.unit": "N", "sensors.1.lever": "6 mm", "sensors.1.noise": "0.2 N"}
    (said,) = doubts(load_rig("capstan-joint").with_values(cell))
    assert "sensor motor_torque is a load cell in one tendon, but motor pulls 2" in said
    assert not [*doubts(finger())]
    flipped = {f"tendons.flexor.crossings.{i}.side": -1 for i in range(3)}
    (said,) = doubts(finger().with_values(flipped))
    assert said.endswith("a pull is a negative torque: is sign = -1 missing?")
    assert not [*doubts(finger(sign=-1).with_values(flipped))]
