"""Candidates, each judged on logs left out by what the others tell."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest

from distal import Log, Rig, load_rig, load_scenario, simulate
from distal.fitting.candidates import (
    AS_GIVEN,
    BY_EQUATIONS,
    REGRESSION,
    WRITTEN,
    Training,
    filter_candidate,
    judge,
    parameters_without,
    with_terms,
)
from distal.fitting.fit import Fit
from distal.fitting.learned_maps import filtered, untouched
from distal.fitting.parameter_search import ParameterEstimates
from distal.fitting.parameters_and_priors import Options
from distal.regression import YARDSTICKS, Samples
from tests.support.foreign_plants import finger_log, finger_rig

SECONDS = 3.0
OPTIONS = Options(workers=1)


def learn(logs: list[Log], rig: Rig, options: Options) -> Fit:
    judged = with_terms(judge(logs, rig, options))
    return Fit.of(judged, judged.chosen)


@pytest.fixture(scope="module")
def others() -> list[Log]:
    return [replace(finger_log(seed, SECONDS), source=f"log {seed}") for seed in range(2)]


@pytest.fixture(scope="module")
def alone(others: list[Log]) -> Fit:
    return learn(others, finger_rig().bare(), OPTIONS)


def test_each_log_has_a_score_of_every_way(others: list[Log], alone: Fit) -> None:
    names = {WRITTEN, REGRESSION, AS_GIVEN, BY_EQUATIONS, *YARDSTICKS}
    assert [one.log for one in alone.compared] == [log.source for log in others]
    assert alone.candidates[0].error == min(each.error for each in alone.candidates)
    assert {*alone.maps} == {"filter", "readings"}
    for one in alone.compared:
        assert names <= set(one.scores)
        assert all(score is not None and score.rms > 0.0 for score in one.scores.values())


def test_a_score_is_of_parameters_that_have_not_seen_the_log(others: list[Log], alone: Fit) -> None:
    candidate = next(c for c in alone.candidates if c.name == BY_EQUATIONS)
    assert candidate.parameters is not None
    unseen = parameters_without(candidate.parameters, others, [0, 1])
    rigs = [own.put_into(candidate.rig) for own in unseen]
    assert all(rig != candidate.rig for rig in rigs)
    by_others, _ = filtered(others, rigs, None, False)
    for k, compared in enumerate(alone.compared):
        score = compared.scores[BY_EQUATIONS]
        assert score is not None
        assert score.rms == pytest.approx(np.sqrt(np.nanmean(by_others[k].targets ** 2)), rel=1e-6)


def test_workers_change_no_number(others: list[Log], alone: Fit) -> None:
    assert learn(others, finger_rig().bare(), replace(OPTIONS, workers=3)).rig == alone.rig


@pytest.fixture(scope="module")
def two(others: list[Log], alone: Fit) -> list[ParameterEstimates]:
    return parameters_without(alone.parameters, others, [0, 1])


def test_maps_learn_from_numbers_that_have_not_seen_the_log(
    two: list[ParameterEstimates], others: list[Log], alone: Fit
) -> None:
    """Each half of a cross-fit has moved from the numbers of all logs; what each log has anew is
    that of the other in the log left out.
    """
    whole = alone.parameters
    for own, left_out in zip(two, others):
        gone = [data.log.source for data in whole.problem.data].index(left_out.source)
        assert (own.optimum.z != whole.optimum.z).any()
        of_log = {(part.name, log): z for (part, log), z in zip(whole.problem.parts, own.optimum.z)}
        for part, log in whole.problem.parts:
            if log == gone:
                assert of_log[part.name, gone] == of_log[part.name, 1 - gone]
    assert parameters_without(whole, others, [0, 0]) == [whole]


def test_ctrl_c_is_not_taken_for_an_answer(
    monkeypatch: pytest.MonkeyPatch, others: list[Log], alone: Fit
) -> None:
    """A search that is stopped ends with the best so far: wherever it was, the fit ends there too,
    with its numbers.
    """
    module = import_module("distal.fitting.candidates")
    whole, calls = module.by_equations, list[int]()

    def stopped(*arguments: object) -> object:
        calls.append(1)
        found = whole(*arguments)
        return replace(found, optimum=replace(found.optimum, interrupted=True))

    monkeypatch.setattr(module, "by_equations", stopped)
    monkeypatch.setattr("distal.fitting.candidates.UNEXPLAINED", 0.0)
    found = learn(others, finger_rig().bare(), OPTIONS)
    assert found.interrupted
    assert calls == [1]
    assert found.kept
    whole_fit = next(one for one in alone.candidates if one.name == BY_EQUATIONS)
    assert whole_fit.parameters is not None
    np.testing.assert_array_equal(found.parameters.optimum.z, whole_fit.parameters.optimum.z)


def test_each_joint_is_homed_by_its_own_truth() -> None:
    """A log that knows one joint comes before one that knows both: the second is read as it would
    be alone.
    """
    rig = load_rig("finger-2n").bare()
    both = simulate(rig, load_scenario("finger", ['duration="2 s"']), 3)
    one = replace(both, source="one", truth={"theta_pip": both.truth["theta_pip"]})
    assert Training.of([one], rig, OPTIONS).unknown == ("mcp",)
    assert Training.of([one, both], rig, OPTIONS).judges
    alone, _ = filtered([both], [rig], 1.0, False)
    after, refused = filtered([one, both], [rig, rig], 1.0, False)
    assert not refused
    np.testing.assert_array_equal(after[1].angles, alone[0].angles)


def test_a_rig_as_it_came_keeps_its_numbers(others: list[Log]) -> None:
    """As it came it is a candidate like the others, and its numbers are not touched."""
    rig = finger_rig().bare()
    training = Training(tuple(others), ("0", "1"), rig, OPTIONS)
    came = filter_candidate(AS_GIVEN, training, None)
    assert came.rig.bare() == rig


def test_a_filter_that_leaves_all_bounds_is_no_candidate(
    others: list[Log], alone: Fit, monkeypatch: pytest.MonkeyPatch
) -> None:
    map_samples = import_module("distal.fitting.learned_maps")
    run = map_samples._filtered

    def wild(*arguments: object) -> Samples:
        samples = run(*arguments)
        return replace(samples, angles=samples.angles + 1e90)

    monkeypatch.setattr(map_samples, "_filtered", wild)
    rigs = [finger_rig().bare()] * len(others)
    data, refused = filtered(others, rigs, None, False)
    assert not data
    assert all("left all bounds" in line for line in refused)


def test_without_forces_no_touch_is_looked_for_and_none_need_be_closed() -> None:
    rig = finger_rig().bare()
    without = rig.model_copy(
        update={"sensors": tuple(s for s in rig.sensors if s.measures != "force")}
    )
    assert untouched(without) is without
    assert {joint.touch for joint in untouched(rig).joints} == {"never"}
