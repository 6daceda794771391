"""Which cause is named, on logs of which one thing is wrong, and that nothing untrue is said."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
import pytest

from distal import (
    Log,
    Rig,
    diagnose,
    estimate,
    load_rig,
    load_scenario,
    read_log,
    scenario_rig,
    simulate,
)
from distal.diagnosis import Diagnosis, Finding
from distal.diagnosis.cause_search import PerturbedRuns, Search
from distal.diagnosis.causes import Cause, causes_of, named_cause
from distal.estimators import AdaptiveFilter
from distal.rig import log_factor
from distal.run.offline import estimator_for
from tests.helpers import changed
from tests.support.given_plants import log_of

DEGREES = np.pi / 180


@pytest.fixture(scope="module")
def joint(data: Path) -> Rig:
    """A geared motor, a sheathed cable and a spring, whose plant shares no code with the model."""
    return load_rig(data / "newcomer" / "joint.toml")


@pytest.fixture(scope="module")
def log(data: Path, joint: Rig, tmp_path_factory: pytest.TempPathFactory) -> Log:
    assert data
    return read_log(log_of("joint", 5006, tmp_path_factory.mktemp("logs")), joint)


def blind(log: Log) -> Log:
    return replace(log, truth={})


def said(log: Log, rig: Rig) -> Diagnosis:
    return diagnose(estimate(log, rig), log, rig)


def looks(found: Diagnosis) -> list[Finding]:
    return [each for each in found.findings if each.kind in ("looks like", "would explain")]


def stuck(log: Log) -> Log:
    held = log.channels["encoder"].copy()
    held[400:1600] = held[400]
    return changed(log, encoder=held)


def swapped(log: Log, rig: Rig) -> Log:
    """Return the log as it is read where two columns are exchanged in the file."""
    sensors = {sensor.name: sensor for sensor in rig.sensors}
    factor = log_factor(sensors["encoder"]) / log_factor(sensors["current"])
    encoder, current = log.channels["encoder"], log.channels["current"]
    return changed(log, encoder=current * factor, current=encoder / factor)


@pytest.mark.parametrize("hide", [False, True])
def test_a_position_that_is_stuck_is_never_consistent(joint: Rig, log: Log, hide: bool) -> None:
    """For 12 s, while the current goes on; it was called consistent."""
    wrong = stuck(blind(log) if hide else log)
    found = said(wrong, joint)
    (finding,) = [each for each in found.findings if each.kind == "stuck"]
    assert finding.text.startswith("encoder has one value from 4.0 to 16.0 s")
    assert not found.consistent
    assert looks(found) == []


def test_a_position_that_rests_while_its_force_does_is_not_stuck(joint: Rig, log: Log) -> None:
    """A motor that stands still: the force varies less than elsewhere."""
    held = stuck(log)
    current = held.channels["current"].copy()
    current[400:1600] = current[400:1600].mean() + 1e-3 * current[400:1600]
    found = said(changed(held, current=current), joint)
    assert not any(each.kind == "stuck" for each in found.findings)


def test_a_position_that_is_off_is_named_with_its_size(joint: Rig, log: Log) -> None:
    """By 20°; with the truth hidden nothing shows it, and that is said in place of "consistent"."""
    wrong = changed(log, encoder=log.channels["encoder"] + 20.0 * DEGREES)
    (finding,) = looks(said(wrong, joint))
    assert finding.subject == "encoder"
    assert float(finding.text.split("looks ")[1].split("°")[0]) == pytest.approx(20.0, abs=1.0)
    assert finding.text.endswith("off: its zero, or the pre-tension")
    text = said(blind(wrong), joint).text
    assert "zero or pre-tension of motor" in text.split("cannot be felt: ")[1]
    assert "consistent" not in text
    assert "N mm" not in text


@pytest.mark.parametrize("hide", [False, True])
def test_two_columns_that_are_exchanged(joint: Rig, log: Log, hide: bool) -> None:
    """An angle read as a current and a current as an angle: it was "motor_force looks like N
    mm".
    """
    wrong = swapped(blind(log) if hide else log, joint)
    found = looks(said(wrong, joint))
    assert [each.text for each in found] == ["encoder and current look swapped"]


def test_what_makes_the_filter_leave_a_sensor_out_explains_nothing(joint: Rig, log: Log) -> None:
    """Exchanged columns that are exchanged back in the wrong unit are readings that the filter
    throws away; an encoder in the wrong unit is so too.
    """
    wrong = swapped(log, joint)
    runs = PerturbedRuns(wrong, cast(AdaptiveFilter, estimator_for(wrong, joint, "adaptive")))
    (base,) = runs([{}])
    (swap,) = [cause for cause in causes_of(runs.estimator, 0.01) if cause.kind == "swap"]
    search = Search(runs, base, of_truth=True)
    assert search([{swap: 1.0}])
    assert search([{replace(swap, ratios=swap.ratios[::-1]): 1.0}]) == []


def test_a_known_angle_speaks_against_what_innovations_allow() -> None:
    """Of a motor and its torque either may have the wrong sign, says the torque; the angle tells
    which.
    """
    plan = load_scenario("lab-bench")
    bench = scenario_rig(plan)
    seen = simulate(bench, plan, 2)
    wrong = changed(seen, motor_torque=-seen.channels["motor_torque"])
    assert [each.text for each in looks(said(wrong, bench))] == [
        "motor_torque looks as if its sign were wrong"
    ]
    texts = [each.text for each in looks(said(blind(wrong), bench))]
    assert len(texts) == 2
    assert texts[1].endswith("(these cannot be told apart)")
    assert any("motor_torque looks as if its sign" in text for text in texts)


@pytest.fixture(scope="module")
def finger_log() -> Log:
    return simulate(load_rig("finger-2n"), load_scenario("finger", ['duration="6 s"']), 5)


@pytest.mark.parametrize("gear", [20.0, 45.0])
def test_a_gear_is_named_with_its_ratio(joint: Rig, log: Log, gear: float) -> None:
    """The log was written with 30:1; a right motor is off by up to 3 % by stretch."""
    rig = joint.with_values({"sensors.encoder.gear": gear})
    read = changed(log, encoder=log.channels["encoder"] * 30.0 / gear)
    (finding,) = looks(said(read, rig))
    assert finding.text.endswith(f"where the rig file has {gear:g}")
    ratio = float(finding.text.split("about ")[1].split(",")[0])
    assert ratio == pytest.approx(30.0, rel=0.05)


def test_small_readings_are_no_unit(joint: Rig, log: Log) -> None:
    """A current with a jump: it is smaller, and then agrees, with any unit that makes it small; as
    readings in that unit the log is no likelier.
    """
    jump = np.where(log.time < 10.0, 0.0, 3.0 * np.std(log.channels["current"]))
    wrong = blind(changed(log, current=log.channels["current"] + jump))
    found = said(wrong, joint)
    assert looks(found) == []
    assert found.text.startswith("sensor current disagrees from 10 s on")


def test_nothing_is_said_of_a_right_log(joint: Rig, log: Log) -> None:
    """A rig that fits its log: no cause, no contradiction, and no "consistent" for what no reading
    shows; with a truth at most what would explain an error that the band allows.
    """
    found = said(blind(log), joint)
    assert not any(each.contradicts for each in found.findings)
    assert looks(found) == []
    assert found.text.startswith("current agrees with the rig, 100 % compared; cannot be felt: ")
    assert not any(each.contradicts for each in said(log, joint).findings)


def test_a_friction_is_named(finger_log: Log) -> None:
    """Three times what the plant has; its size is that of a kink, to half."""
    rig = load_rig("finger-2n")
    path = "joints.0.friction.coefficient"
    rubs = rig.with_values({path: 3.0 * rig.joints[0].friction.coefficient.value})
    (finding,) = looks(said(finger_log, rubs))[:1]
    assert finding.subject == "friction of mcp"
    assert float(finding.text.split("about ")[1].split()[0]) == pytest.approx(1 / 3, rel=0.5)


def test_two_things_that_are_wrong_are_both_named(finger_log: Log) -> None:
    log = finger_log.select(slice(0, 800))
    wrong = {name: 1.5 * log.channels[name] for name in ("x_mcp_f", "x_pip_e")}
    found = looks(said(changed(log, **wrong), load_rig("finger-2n")))
    assert {each.subject for each in found} == {"x_mcp_f", "x_pip_e"}


def test_a_friction_within_its_std_contradicts_nothing() -> None:
    """0.05 for 0.02 ± 50 %: the first innovations drift, none does once it is known; 0.15 is too
    much.
    """
    plan = load_scenario("lab-bench")
    rig = scenario_rig(plan)
    for friction, right in ((0.05, True), (0.15, False)):
        plant = rig.with_values({"drives.0.friction.constant": friction})
        log = simulate(plant, plan.model_copy(update={"plant": {}, "duration": 12.0}), 1)
        assert said(log, rig).consistent is right


def test_arms_that_no_force_shows_cannot_be_felt() -> None:
    """Both of one joint: with a radius 20 % too large the innovations are as they were."""
    rig = load_rig("paper-2008")
    log = simulate(rig, load_scenario("series-2", ['duration="8 s"']), 1)
    found = said(blind(log), rig)
    beyond = [each.subject for each in found.findings if each.kind == "cannot test"]
    assert any(each.startswith("gear, spool, moment arm, unit or sign of") for each in beyond)
    assert len(beyond) <= 3


@pytest.mark.parametrize(
    ("name", "sensor", "factor", "words"),
    [
        ("paper-2008", "u1", 1 / 4.448, "pounds"),
        ("paper-2008", "u1", 4.448, "newtons that are read as pounds"),
        ("capstan-joint", "motor_torque", 1000.0, "N mm"),
        ("capstan-joint", "motor_angle", 180 / np.pi, "degrees"),
    ],
)
def test_units_are_named(name: str, sensor: str, factor: float, words: str) -> None:
    rig = load_rig(name)
    unit = rig.sensors[rig.sensor_names.index(sensor)].si
    cause = Cause("scale", sensor, (sensor,), unit=unit)
    finding = named_cause("looks like", rig, cause, 1.0 / factor - 1.0)
    assert finding.text == f"{sensor} looks like {words}"
