"""What an encoder's own error, few logs and doubts make of a fit: bands that include it, stds that
are kept.
"""

from __future__ import annotations

import numpy as np
import pytest

from distal import Log, Rig, load_rig
from distal.fitting.learned_maps import (
    HeldOut,
    MapFit,
    filtered,
    reference_offset,
    reference_std,
    with_its_reference_error,
    without_offset,
)
from distal.fitting.parameters_and_priors import FittedParameter, assignments
from distal.logs import FROM_SENSOR, TruthKind, TruthSource
from distal.regression import Samples
from distal.rig import number


def log(source: TruthSource | str) -> Log:
    time = np.arange(10) / 100.0
    return Log(time, {}, {"theta": np.zeros(10)}, "log", source)


@pytest.fixture
def rig() -> Rig:
    return load_rig("da-vinci-grasper")


def test_an_encoders_offset_is_in_the_bands(rig: Rig) -> None:
    """σ² becomes σ² + σ_b² in either map, and stays where the truth is of no sensor."""
    offset = np.deg2rad(0.35)
    assert rig.map is not None
    read = log(TruthSource(TruthKind.SENSOR, "column 'x'"))
    for kind, maps in (("readings", rig.map.readings), ("filter", rig.map.filter)):
        scored = HeldOut(np.zeros(2), np.zeros(2), np.array([1e-4, 2e-4]))
        fit = MapFit(kind, maps, rig, {"jaw": [scored]})
        wider = with_its_reference_error(fit, [read])
        before = maps[0].arrays["noise"]
        np.testing.assert_allclose(wider.maps[0].arrays["noise"], before + offset**2)
        np.testing.assert_allclose(wider.held_out(0)[0].variances, scored.variances + offset**2)
        same = with_its_reference_error(fit, [log(TruthSource(position="another file"))])
        np.testing.assert_allclose(same.maps[0].arrays["noise"], before)


def test_what_the_reference_errs_by(rig: Rig) -> None:
    noise = np.deg2rad(np.hypot(0.1, 0.09 / np.sqrt(12.0)))
    assert reference_std(rig, [log(FROM_SENSOR)]) == pytest.approx(noise, rel=1e-6)
    assert reference_std(rig, [log(TruthSource(position="the simulation"))]) == 0.0
    assert reference_offset(rig, [log(FROM_SENSOR)]) == pytest.approx(np.deg2rad(0.35))
    assert reference_offset(rig, [log(TruthSource(position="the simulation"))]) == 0.0


@pytest.mark.parametrize("hold", [False, True])
@pytest.mark.parametrize(("value", "written"), [(0.3, 0.3), (6.4e-22, 0.0)])
def test_how_sure_a_file_is(hold: bool, value: float, written: float) -> None:
    """Its stds are the standard errors; held, filters take the values as they are. A file takes no
    number below 1e-20: a slack that a search made ever smaller is none.
    """
    path = "joints.0.friction.coefficient"
    start = load_rig("capstan-joint").with_values({path: {"value": 0.2, "std": 0.1}})
    found = FittedParameter("it", (path,), "", 0.2, 0.1, value, 0.05, False, (value,))
    after = number(start.with_values(assignments([found], start, hold)), path)
    assert after.value == written
    assert after.std == pytest.approx(0.05)
    assert after.parameter.hold is hold


def lacking(*lacks: float) -> Samples:
    """Return samples whose angles lack so much, one for each joint [rad]; NaN: no truth."""
    targets = np.tile(lacks, (10, 1))
    nothing = np.zeros(targets.shape)
    return Samples(np.arange(10) / 100.0, np.zeros((10, 1)), nothing, targets, nothing)


def test_what_all_logs_lack_is_the_encoders_up_to_two_of_its_stds(rig: Rig) -> None:
    """The mean over logs is taken off where it is at most 2 σ_b, whatever its sign; more of it is
    the model's error.
    """
    doubt = next(sensor for sensor in rig.sensors_of("angle")).bias.filter_std
    for share, taken in ((1.95, True), (-1.95, True), (2.05, False), (-2.05, False)):
        data = [lacking(share * doubt + 0.01), lacking(share * doubt - 0.01)]
        expected = [0.01, -0.01] if taken else [share * doubt + 0.01, share * doubt - 0.01]
        for samples, each in zip(without_offset(data, rig), expected):
            np.testing.assert_allclose(samples.targets, each, atol=1e-15)
    unknown = [lacking(np.nan)]
    assert without_offset(unknown, rig) == unknown
    # a log without truth has no say
    (_, second) = without_offset([lacking(np.nan), lacking(doubt)], rig)
    np.testing.assert_allclose(second.targets, 0.0, atol=1e-15)


def test_the_zero_of_a_reference_that_is_held_is_the_joints(rig: Rig) -> None:
    """The map corrects what all logs lack, and the band still has the std of the zero."""
    held = rig.with_values(
        {f"sensors.{rig.sensors.index(s)}.bias.hold": True for s in rig.sensors_of("angle")}
    )
    offset = np.deg2rad(0.35)
    (first, _) = without_offset([lacking(offset), lacking(offset)], held)
    np.testing.assert_allclose(first.targets, offset)
    assert held.map is not None
    (learned,) = held.map.filter
    read = log(TruthSource(TruthKind.SENSOR, "column 'x'"))
    (wider,) = with_its_reference_error(MapFit("filter", (learned,), held), [read]).maps
    np.testing.assert_allclose(wider.arrays["noise"], learned.arrays["noise"] + offset**2)
    assert reference_offset(held, [read]) == pytest.approx(offset)


@pytest.mark.parametrize(
    ("kind", "homing", "taken"),
    [("sensor", None, True), ("other", None, False), ("sensor", 1.0, False)],
)
def test_an_offset_is_taken_off_only_where_an_encoder_is_the_truth(
    kind: str, homing: float | None, taken: bool, rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A truth of another file has no encoder that may be askew, and a homing move takes off what
    there is.
    """
    monkeypatch.setattr("distal.fitting.learned_maps._filtered", lambda *arguments: lacking(1e-3))
    given = log(TruthSource(TruthKind(kind), "it"))
    data, refused = filtered([given, given], [rig.bare()] * 2, homing, False)
    assert (refused, list(data)) == ([], [0, 1])
    np.testing.assert_allclose(data[1].targets, 0.0 if taken else 1e-3, atol=1e-15)
