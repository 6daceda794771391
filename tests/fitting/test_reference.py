"""What an encoder's own error, few logs and doubts make of a fit: bands that include it, stds that
are kept.
"""

from __future__ import annotations

import numpy as np
import pytest

from distal import Log, Rig, load_rig
from distal.confidence import BAND
from distal.fitting.fitted_parameter import FittedParameter, assignments
from distal.fitting.map_samples import (
    filtered,
    partly_homed,
    reference_offset,
    reference_std,
    with_reference_error,
    without_offset,
)
from distal.logs import FROM_SENSOR, TruthKind, TruthSource
from distal.regression import Samples
from distal.regression.band import OWNS, conformal_factor, share_of_few, sized


def log(source: TruthSource | str) -> Log:
    time = np.arange(10) / 100.0
    return Log(time, {}, {"theta": np.zeros(10)}, "log", source)


@pytest.fixture
def rig() -> Rig:
    return load_rig("da-vinci-grasper")


def test_an_encoders_offset_is_in_the_bands(rig: Rig) -> None:
    """c² s² becomes c² s² + σ_b² in either map, and stays where the truth is of no sensor."""
    offset = np.deg2rad(0.35)
    for learned in (rig.affine, rig.discrepancy):
        assert learned is not None
        inflated = learned.model_copy(update={"band": (2.0,)})
        wider = with_reference_error(
            inflated, rig, [log(TruthSource(TruthKind.SENSOR, "column 'x'"))]
        )
        before = 2.0 * learned.joints[0].std
        assert 2.0 * wider.joints[0].std == pytest.approx(np.hypot(before, offset))
        assert with_reference_error(inflated, rig, [log("another file")]) is inflated


def test_what_the_reference_errs_by(rig: Rig) -> None:
    noise = np.deg2rad(np.hypot(0.1, 0.09 / np.sqrt(12.0)))
    assert reference_std(rig, log(FROM_SENSOR)) == pytest.approx(noise, rel=1e-6)
    assert reference_std(rig, log("the simulation")) == 0.0
    assert reference_offset(rig, log(FROM_SENSOR)) == pytest.approx(np.deg2rad(0.35))
    assert reference_offset(rig, log("the simulation")) == 0.0


@pytest.mark.parametrize("hold", [False, True])
def test_how_sure_a_file_is(hold: bool) -> None:
    """Its stds are the standard errors; held, filters take the values as they are."""
    start = load_rig("capstan-joint").with_values(
        {"joints.0.friction.coefficient": {"value": 0.2, "std": 0.1}}
    )
    path = "joints.0.friction.coefficient"
    found = FittedParameter(
        "it", (path,), "", 0.2, 0.1, 0.3, 0.05, True, False, (0.3,), held_error=0.05
    )
    written = assignments([found], start, hold)["joints.jaw.friction.coefficient"]
    assert written["value"] == 0.3
    assert written["std"] == pytest.approx(0.05)
    assert written.get("hold", False) is hold


def test_a_file_holds_what_is_told_only_together_with_others() -> None:
    """Its value and std stay those of the prior, so that the next fit may vary it; estimators take
    it as known.
    """
    start = load_rig("capstan-joint").with_values(
        {"joints.0.friction.coefficient": {"value": 0.2, "std": 0.1}}
    )
    path = "joints.0.friction.coefficient"
    found = FittedParameter(path, (path,), "", 0.2, 0.1, 0.2, 0.1, False, False, (0.2,), held=True)
    after = start.with_values(assignments([found], start)).joints[0].friction
    assert after is not None
    assert (after.coefficient.value, after.coefficient.std, after.coefficient.hold) == (
        0.2,
        0.1,
        True,
    )


def test_few_logs_share_the_filters_doubt_as_the_worst_needs() -> None:
    """Errors of 0.2 and 0.4 stds need 0.4 at 95 %; Student's factor comes on top, and all of it is
    the most.
    """
    rng = np.random.default_rng(2)
    logs = [
        [(size * rng.normal(size=40000), np.ones(40000), np.ones(40000))] for size in (0.2, 0.4)
    ]
    assert share_of_few(logs) == pytest.approx(0.4, rel=0.02)
    assert share_of_few([[(5.0 * e, u, v) for e, u, v in log] for log in logs]) == 1.0


def lacking(*lacks: float) -> Samples:
    """Return samples whose angles lack so much, one for each joint [rad]; NaN: no truth."""
    targets = np.tile(lacks, (10, 1))
    nothing = np.zeros(targets.shape)
    return Samples("log", np.arange(10) / 100.0, np.zeros((10, 1)), nothing, targets, nothing, 0.01)


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
    learned = held.discrepancy
    assert learned is not None
    read = log(TruthSource(TruthKind.SENSOR, "column 'x'"))
    wider = with_reference_error(learned, held, [read])
    before = learned.band[0] * learned.joints[0].std
    assert learned.band[0] * wider.joints[0].std == pytest.approx(np.hypot(before, offset))
    assert reference_offset(held, read) == pytest.approx(offset)


@pytest.mark.parametrize(
    ("kind", "homing", "taken"),
    [("sensor", None, True), ("file", None, False), ("sensor", 1.0, False)],
)
def test_an_offset_is_taken_off_only_where_an_encoder_is_the_truth(
    kind: str, homing: float | None, taken: bool, rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A truth of another file has no encoder that may be askew, and a homing move takes off what
    there is.
    """
    monkeypatch.setattr("distal.fitting.map_samples._filtered", lambda *arguments: lacking(1e-3))
    given = log(TruthSource(TruthKind(kind), "it"))
    data, refused = filtered([given, given], [rig.bare()] * 2, homing, False)
    assert (refused, list(data)) == ([], [0, 1])
    np.testing.assert_allclose(data[1].targets, 0.0 if taken else 1e-3, atol=1e-15)
    assert data[1].reference_std == (0.0 if homing is not None else reference_std(rig, given))


def test_a_homing_move_over_half_of_the_range_is_on_the_side_where_it_begins(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Between the first angle and the middle of the range; of all logs a dozen are used, spread
    evenly, if long enough.
    """
    finger, used = load_rig("finger-2n"), list[list[np.ndarray]]()

    def run(
        logs: list[Log], rigs: list[Rig], homing: float, compiled: bool, usable: list[np.ndarray]
    ) -> object:
        used.append(usable)
        return {k: lacking(0.0) for k in range(len(logs))}, []

    monkeypatch.setattr("distal.fitting.map_samples.filtered", run)
    time = 5.0 + np.arange(100) / 100.0
    first, second = 0.2 + 0.4 * np.cos(2 * np.pi * (time - 5.0)), np.where(time < 5.5, -0.3, 1.1)
    gone = np.where(time > 5.8, np.nan, first)
    given = Log(time, {}, {"theta_mcp": gone, "theta_pip": second}, "log")
    short = Log(time[:15], {}, {"theta_mcp": first[:15], "theta_pip": second[:15]}, "short")
    logs = [given] * 30 + [short]
    found = partly_homed(logs, [finger] * 31, 0.4, False)
    known = np.isfinite(gone)
    seen = gone[known]
    half = (seen.min() + seen.max()) / 2
    expected = (~known | (gone >= half)) & (second <= 0.4)
    assert list(found) == sorted({round(30 * k / 11) for k in range(11)})
    for samples in found.values():
        np.testing.assert_array_equal(samples.usable, expected)
    # of the first 20 ms too few samples are on that side
    assert partly_homed(logs, [finger] * 31, 0.1, False) == {}
    assert partly_homed(logs, [finger] * 31, None, False) == {}


def test_the_filters_own_std_counts_by_what_its_errors_are_of_it() -> None:
    """Errors twice as large of a filter twice as unsure need the same share of its std."""
    rng = np.random.default_rng(2)
    errors = 0.4 * rng.normal(size=40000)
    shares = [
        share_of_few([[(scale * errors, np.ones(40000), np.full(40000, scale**2))]])
        for scale in (1.0, 2.0, 0.1)
    ]
    assert shares == pytest.approx([0.4] * 3, rel=0.02)  # a quantile of 40000 values errs by 0.6 %


def test_a_bands_factor_holds_95_percent_of_each_log() -> None:
    """The smallest c with |e| ≤ 1.96 √(c² u + v) for 95 %, each log weighing the same however long
    it is; within bounds.
    """
    rng = np.random.default_rng(3)
    logs = [
        (size * rng.normal(size=n), np.full(n, 0.5), np.full(n, 0.2))
        for size, n in ((1.0, 503), (2.0, 47), (0.5, 4999))
    ]

    def held(c: float) -> float:
        return float(
            np.mean([np.mean(np.abs(e) <= BAND * np.sqrt(c**2 * u + v)) for e, u, v in logs])
        )

    c = conformal_factor(logs, 0.1, 100.0)
    assert held(c * (1 + 1e-9)) >= 0.95
    assert held(c * (1 - 1e-9)) < 0.95
    assert conformal_factor(logs, 0.1, 0.5 * c) == 0.5 * c
    assert conformal_factor(logs, 2.0 * c, 100.0) == 2.0 * c
    assert conformal_factor([], 0.1, 100.0) == 1.0


def test_the_share_of_the_filters_std_is_that_of_the_narrowest_band(rig: Rig) -> None:
    """Where its variance says when errors are large, all of it; where it is large and errors are
    not, none.
    """
    assert rig.discrepancy is not None
    learned = rig.discrepancy.model_copy(update={"band": (2.0,), "own": 1.0})
    rng = np.random.default_rng(4)
    v = np.where(np.arange(4000) % 2, 4.0, 0.01)
    honest = [[(np.sqrt(v + 0.01) * rng.normal(size=4000), np.full(4000, 0.01), v)]] * 3
    blind = [[(0.1 * rng.normal(size=4000), np.full(4000, 0.01), v)]] * 3
    assert sized(learned, honest, True)[0].own == max(OWNS)
    assert sized(learned, blind, True)[0].own == min(OWNS)
    found, _ = sized(learned, blind, True)
    parts = [(e, u, found.own**2 * v) for ((e, u, v),) in blind]
    assert found.band[0] == pytest.approx(2.0 * conformal_factor(parts, 1e-3, 1e3))
    # of a map without a filter nothing is shared
    alone = [[(0.1 * rng.normal(size=4000), np.full(4000, 0.01), np.zeros(4000))]]
    assert sized(learned, alone, True)[0].own == 1.0


def test_what_a_fit_brings_to_nothing_is_written_as_zero() -> None:
    """A rig file takes no number below 1e-20: a slack that a search made ever smaller is none."""
    start = load_rig("capstan-joint").with_values(
        {"joints.0.friction.coefficient": {"value": 0.2, "std": 0.1}}
    )
    path = "joints.0.friction.coefficient"
    found = FittedParameter(
        "it", (path,), "", 0.2, 0.1, 6.4e-22, 0.05, True, False, (6.4e-22,), held_error=0.05
    )
    after = start.with_values(assignments([found], start)).joints[0].friction
    assert after is not None
    assert after.coefficient.value == 0.0
