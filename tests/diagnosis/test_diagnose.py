"""A diagnosis with log and rig: what explains a disagreement, what hangs on the start, what no
sensor tests.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks.cases import paper_log, paper_rig
from benchmarks.ladder import log_of
from benchmarks.strangers.foreign_plants import finger_log, finger_rig

from distal import (
    Log,
    Rig,
    diagnose,
    estimate,
    learn_map,
    load_rig,
    load_scenario,
    make_estimator,
    read_log,
    scenario_rig,
    simulate,
)
from distal.diagnosis import Finding
from distal.diagnosis.comparison import disagreement
from distal.diagnosis.diagnose import elsewhere, out_of_range
from distal.diagnosis.finding_texts import COMPLIANCE, SCALE, ZERO
from distal.diagnosis.rerun import ModelChange, Rerun
from distal.diagnosis.untested import untestable
from distal.diagnosis.what_if import overconfidence
from distal.estimators import AdaptiveFilter
from distal.run.offline import estimator_for


@pytest.fixture(scope="module")
def rig() -> Rig:
    return paper_rig("as the rig")


@pytest.fixture(scope="module")
def log() -> Log:
    return paper_log("servo", "as the rig", 0)


def scaled(log: Log, **factors: float) -> Log:
    channels = {name: values * factors.get(name, 1.0) for name, values in log.channels.items()}
    return Log(log.time, channels, dict(log.truth), log.source)


def found(log: Log, rig: Rig) -> tuple[Finding, ...]:
    return diagnose(estimate(log, rig), log, rig).findings


class TestRerun:
    """A run with a change is the run of the log, or of the rig, that is changed so."""

    def test_unchanged_it_is_the_estimate(self, rig: Rig, log: Log) -> None:
        result, rerun = estimate(log, rig), Rerun(log, estimator_for(log, rig, "adaptive"))  # type: ignore[arg-type]
        np.testing.assert_array_equal(rerun.base.means, result.means)
        np.testing.assert_array_equal(rerun.base.innovations, result.innovations)

    def test_a_channel(self, rig: Rig, log: Log) -> None:
        rerun = Rerun(log, estimator_for(log, rig, "adaptive"))  # type: ignore[arg-type]
        other = rerun(ModelChange(channels={"u1": 1.1}))
        np.testing.assert_array_equal(other.means, estimate(scaled(log, u1=1.1), rig).means)

    def test_a_number(self, rig: Rig, log: Log) -> None:
        rerun = Rerun(log, estimator_for(log, rig, "adaptive"))  # type: ignore[arg-type]
        path = "tendons.0.insertion.radius"
        other = rerun(ModelChange(parameters={path: 1.1}))
        radius = rig.tendons[0].insertion.radius.value
        # the joint's own load is computed from the rig's values, and a float factor rounds: not to
        # the last bit
        wide = estimate(log, rig.with_values({path: 1.1 * radius}))
        np.testing.assert_allclose(other.means[:, 0], wide.theta, atol=2e-4)

    def test_a_number_that_is_estimated_begins_elsewhere_too(self, rig: Rig, log: Log) -> None:
        path = "joints.0.friction.coefficient"
        rerun = Rerun(log, estimator_for(log, rig, "adaptive"))  # type: ignore[arg-type]
        doubled = rig.with_values({path: 2.0 * rig.joints[0].friction.coefficient.value})
        np.testing.assert_allclose(
            rerun(ModelChange(parameters={path: 2.0})).means[:, 0],
            estimate(log, doubled).theta,
            atol=2e-4,
        )

    def test_two_columns_that_are_exchanged_or_late(self, rig: Rig, log: Log) -> None:
        rerun = Rerun(log, estimator_for(log, rig, "adaptive"))  # type: ignore[arg-type]
        pair = {"u1": log.channels["u2"], "u2": log.channels["u1"]}
        swapped = Log(log.time, {**log.channels, **pair}, dict(log.truth), log.source)
        np.testing.assert_array_equal(
            rerun(ModelChange(exchanged=("u1", "u2"))).means, estimate(swapped, rig).means
        )
        late = np.interp(log.time + 0.02, log.time, log.channels["u1"])
        later = Log(log.time, {**log.channels, "u1": late}, dict(log.truth), log.source)
        np.testing.assert_array_equal(
            rerun(ModelChange(later={"u1": 0.02})).means, estimate(later, rig).means
        )

    def test_two_changes_are_one(self, rig: Rig, log: Log) -> None:
        first = ModelChange(channels={"u1": 2.0, "u2": 3.0}, added={"x1": 1.0}, later={"u1": 0.1})
        both = first & ModelChange(channels={"u1": 0.25}, added={"x1": 2.0}, exchanged=("x1", "x2"))
        assert both.channels == {"u1": 0.5, "u2": 3.0}
        assert both.added == {"x1": 3.0}
        assert both.later == {"u1": 0.1}
        assert both.exchanged == ("x1", "x2")

    def test_a_start(self, rig: Rig, log: Log) -> None:
        rerun = Rerun(log, estimator_for(log, rig, "adaptive"))  # type: ignore[arg-type]
        other = rerun(ModelChange(shifts={"common factor of tendons.stiffness": 0.1}))
        at = rerun.estimator.state_names.index("common factor of tendons.stiffness")
        assert 1.0 < other.means[0, at] <= 1.2
        assert np.any(other.means[:, 0] != rerun.base.means[:, 0])

    def test_several_side_by_side_are_those_one_by_one(self, rig: Rig, log: Log) -> None:
        rerun = Rerun(log, estimator_for(log, rig, "adaptive"))  # type: ignore[arg-type]
        factors = np.linspace(0.8, 1.2, 9)  # more than there are lanes
        changes = [
            ModelChange(channels={"u1": factor}, parameters={"tendons.0.stiffness": factor})
            for factor in factors
        ]
        for change, one in zip(changes, rerun.each(changes), strict=True):
            np.testing.assert_array_equal(one.means, rerun(change).means)
            np.testing.assert_array_equal(
                one.innovation_variances, rerun(change).innovation_variances
            )


class TestExplanations:
    """The one thing that is wrong is named."""

    @pytest.mark.parametrize(
        ("factors", "subject", "words"),
        [
            ({"x2": -1.0}, "x2", "x2 looks as if its sign, or the side of its tendon, were wrong"),
            pytest.param(
                {"u1": -1.0}, "u1", "u1 looks as if its sign were wrong", marks=pytest.mark.slow
            ),
            ({"u1": 1 / 4.4482216}, "u1", "u1 looks like pounds"),
            pytest.param(
                {"u2": 1000.0}, "u2", "u2 looks like millinewtons", marks=pytest.mark.slow
            ),
        ],
    )
    def test_a_sign_or_a_unit(
        self, factors: dict[str, float], subject: str, words: str, rig: Rig, log: Log
    ) -> None:
        wrong = scaled(log, **factors)
        kinds = {(one.kind, one.subject): one.text for one in found(wrong, rig)}
        assert kinds[("looks like", subject)] == words
        assert (
            words in diagnose(estimate(wrong, rig), wrong, rig).text
        )  # and it is not among "and 2 more"

    def test_two_signs_that_nothing_tells_apart_are_both_named(self) -> None:
        scenario = load_scenario("lab-bench")
        bench = scenario_rig(scenario)
        log = scaled(simulate(bench, scenario, 2), motor_torque=-1.0)
        (finding,) = [one for one in found(log, bench) if one.kind == "looks like"]
        assert "motor_torque looks as if its sign were wrong" in finding.text
        assert "motor_angle looks as if its sign were wrong" in finding.text

    @pytest.mark.slow
    def test_a_right_log_is_not_explained(self, rig: Rig, log: Log) -> None:
        verdict = diagnose(estimate(log, rig), log, rig)
        assert verdict.consistent
        assert not any(one.contradicts for one in verdict.findings)


class TestCannotTest:
    """A moment arm that both tendons share moves no force, and the estimate by its share."""

    def test_moment_arms_are_named(self, rig: Rig, log: Log) -> None:
        rerun = Rerun(log, make_estimator("adaptive", rig), None)
        subjects = [one.subject for one in untestable(rerun)]
        assert len(subjects) <= 3
        assert f"{SCALE} of all drives" in subjects

    @pytest.mark.parametrize(
        ("number", "group"),
        [
            ("sensors.encoder.gear=19", SCALE),
            ("tendons.cable.stiffness=3000", COMPLIANCE),
            ("zero", ZERO),
        ],
    )
    def test_what_is_wrong_and_not_seen_is_in_a_group(
        self, data: Path, tmp_path: Path, number: str, group: str
    ) -> None:
        """A gear of 19 for 30, a quarter of the stiffness, a zero 20° off: no innovation tells any
        of them.
        """
        rig = load_rig(data / "newcomer" / "joint.toml", [] if number == "zero" else [number])
        log = replace(read_log(log_of("joint", 5006, tmp_path), rig), truth={})
        if number == "zero":
            log = replace(log, channels={**log.channels, "encoder": log.channels["encoder"] + 0.35})
        said = diagnose(estimate(log, rig), log, rig)
        assert said.consistent
        subjects = [one.subject for one in said.findings if one.kind == "cannot test"]
        assert f"{group} of motor" in subjects
        assert len(subjects) <= 3

    def test_a_change_that_moves_less_than_half_of_the_band_is_not_named(
        self, rig: Rig, log: Log
    ) -> None:
        """What is shifted by a share of what it covers moves the angle by as much: of a wide band
        by less than half.
        """
        estimator = estimator_for(log, rig, "adaptive")
        assert isinstance(estimator, AdaptiveFilter)
        rerun = Rerun(log, estimator)
        wide = replace(rerun.base, variances=np.full_like(rerun.base.variances, 100.0))
        rerun.base = wide
        assert untestable(rerun) == []

    def test_what_is_named_is_true(self, rig: Rig, log: Log) -> None:
        """With arms 20 % too large in the rig, the estimate is a sixth too small, and innovations
        as they were.
        """
        arms = {
            f"tendons.{i}.insertion.radius": 1.2 * rig.tendons[i].insertion.radius.value
            for i in range(2)
        }
        right, wrong = estimate(log, rig), estimate(log, rig.with_values(arms))
        assert wrong.rms_error() > 3 * right.rms_error()
        ratios = [
            np.nanmean(each.innovations**2 / each.innovation_variances) for each in (right, wrong)
        ]
        assert abs(ratios[0] - ratios[1]) < 0.1


class TestFurther:
    """Displacements, ranges, kinematic estimates and starts."""

    def test_a_displacement_where_no_drive_can_be(self, rig: Rig, log: Log) -> None:
        assert elsewhere(log, rig) == []
        wrong = elsewhere(scaled(log, x1=57.3), rig)
        assert [(one.kind, one.subject) for one in wrong] == [("cannot be there", "x1")]

    def test_outside_the_range_of_a_fit(self, rig: Rig, log: Log) -> None:
        low, high = float(log.channels["u1"].min()), float(log.channels["u1"].max())
        assert out_of_range(log, {"u1": (low, high)}) == []
        beyond = out_of_range(log, {"u1": (low, (low + high) / 2), "not there": (0.0, 1.0)})
        assert [(one.kind, one.subject) for one in beyond] == [("out of range", "u1")]
        verdict = diagnose(
            estimate(log, rig), log, rig, ranges={"u1": (low, (low + high) / 2)}, what_if=False
        )
        assert not verdict.consistent

    def test_elastic_agrees_with_a_right_rig_and_not_with_a_wrong_side(
        self, rig: Rig, log: Log
    ) -> None:
        assert disagreement(estimate(log, rig), log, rig) == []
        wrong = scaled(log, x2=-1.0)
        assert [one.subject for one in disagreement(estimate(log, rig), wrong, rig)] == ["elastic"]

    @pytest.mark.slow
    def test_a_band_that_hangs_on_the_start(self, rig: Rig, log: Log) -> None:
        """A rig whose stds are what its log forgets; then the same runs with bands ten times too
        narrow.
        """
        rerun = Rerun(log, estimator_for(log, rig, "adaptive"))  # type: ignore[arg-type]
        assert overconfidence(rerun) == []
        base = rerun.base
        object.__setattr__(base, "variances", base.variances / 100.0)
        assert [one.kind for one in overconfidence(rerun)] == ["overconfident"]


@pytest.mark.slow
def test_what_logs_taught_is_asked_too() -> None:
    """A map in the rig file that says otherwise, and readings that its logs never had, are told by
    name.
    """
    log = finger_log(3, 8.0)
    logs = [finger_log(seed, 8.0) for seed in range(3)]
    rig = learn_map(logs, finger_rig(), "readings").rig
    result = estimate(log, rig, compiled=False)
    away = np.zeros(result.means.shape[1])
    away[0] = 1.0
    sure = replace(result, means=result.means + away, variances=0.01 * result.variances)
    found = diagnose(sure, log, rig, compiled=False, what_if=False)
    assert any(
        one.kind == "other estimate" and one.subject == "regression" for one in found.findings
    )
    assert not any(one.kind == "out of range" for one in found.findings)
    far = Log(
        log.time, {**log.channels, "motor_angle": log.channels["motor_angle"] + 1.5}, log.truth
    )
    found = diagnose(estimate(far, rig, compiled=False), far, rig, compiled=False, what_if=False)
    assert any(
        one.kind == "out of range" and one.subject == "motor_angle" for one in found.findings
    )
