"""A log that is left out teaches nothing: what a fold learns is, to the last bit, what the other
logs teach alone.
"""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest
from benchmarks.strangers.foreign_plants import finger_log, finger_rig

from distal import Log, Rig, load_rig, simulate
from distal.fitting.candidates import (
    AS_GIVEN,
    BY_EQUATIONS,
    Candidate,
    Training,
    best_of,
    filter_candidate,
)
from distal.fitting.fit_options import Options
from distal.fitting.jackknife import parameters_without
from distal.fitting.learn import Learned, learn
from distal.fitting.learn_free_motion import untouched
from distal.fitting.leave_out import leave_out
from distal.fitting.map_samples import filtered
from distal.fitting.parameter_estimates import ParameterEstimates
from distal.regression import Samples

SECONDS = 3.0
OPTIONS = Options(workers=1)


def planted(kind: str) -> Log:
    """Return a log that would change each choice of a fit that saw it."""
    log = replace(finger_log(7, SECONDS), source="planted")
    theta, channels = log.truth["theta"], dict(log.channels)
    rng = np.random.default_rng(3)
    if kind == "another rig":  # numbers, stds, doubts, logs that contradict each other
        theta = 0.6 * theta
    elif (
        kind == "an encoder that errs"
    ):  # whether the reference is one more sensor, the size of bands
        theta = theta + 0.2 * np.sin(3.0 * log.time)
    elif kind == "another range":  # scale, range and terms of the maps
        channels = {name: 3.0 * values for name, values in channels.items()}
        theta = 3.0 * theta
    elif kind == "loud sensors":  # the noise
        channels = {
            name: values + 0.2 * np.ptp(values) * rng.normal(size=len(log))
            for name, values in channels.items()
        }
    return replace(log, truth={"theta": theta}, channels=channels)


@pytest.fixture(scope="module")
def others() -> list[Log]:
    return [replace(finger_log(seed, SECONDS), source=f"log {seed}") for seed in range(2)]


@pytest.fixture(scope="module")
def alone(others: list[Log]) -> Learned:
    return learn(others, finger_rig().bare(), OPTIONS)


def cable_rig() -> Rig:
    """Return the finger's rig with friction along its cable, which a fit would add otherwise."""
    path = {"friction": {"value": 0.1, "std": 0.1}, "wrap": np.pi / 2, "nodes": 2}
    return finger_rig().bare().with_values({"tendons.flexor.path": path})


@pytest.fixture(scope="module")
def with_cable(others: list[Log]) -> Learned:
    return learn(others, cable_rig(), OPTIONS)


@pytest.mark.filterwarnings(
    "ignore::distal.errors.DistalWarning"
)  # readings outside of what was learned
@pytest.mark.parametrize(
    "kind", ["another rig", "an encoder that errs", "another range", "loud sensors"]
)
def test_a_log_that_is_left_out_teaches_nothing(
    kind: str, others: list[Log], alone: Learned
) -> None:
    rig = finger_rig().bare()
    logs = [planted(kind), *others]
    fold = leave_out(logs, rig, [0, 1, 1], lambda rest, _: learn(rest, rig, OPTIONS), None)[0]
    assert fold.left_out == ("planted",)
    assert fold.learned.rig == alone.rig
    assert repr(fold.learned.fitted) == repr(alone.fitted)  # what is not known is NaN
    assert (fold.learned.doubts, fold.learned.hold) == (alone.doubts, alone.hold)
    assert [(c.name, c.rig, c.error) for c in fold.learned.candidates] == [
        (c.name, c.rig, c.error) for c in alone.candidates
    ]
    assert len(fold.compared) == 1


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind", ["another rig", "an encoder that errs", "another range", "loud sensors"]
)
def test_each_planted_log_would_be_seen(kind: str, others: list[Log], alone: Learned) -> None:
    """With it among the logs, what is learned is another rig, so that the test above cannot pass by
    accident.
    """
    assert learn([planted(kind), *others], finger_rig().bare(), OPTIONS).rig != alone.rig


def test_workers_change_no_number(others: list[Log], alone: Learned) -> None:
    assert learn(others, finger_rig().bare(), replace(OPTIONS, workers=3)).rig == alone.rig


@pytest.fixture(scope="module")
def two(others: list[Log], alone: Learned) -> list[ParameterEstimates]:
    return parameters_without(alone.parameters, others, [0, 1])


def test_maps_learn_from_numbers_that_have_not_seen_the_log(
    two: list[ParameterEstimates], others: list[Log], alone: Learned
) -> None:
    """Each half of a cross-fit is of the other logs alone, likelier on these, and leaves what stays
    at its prior.
    """
    whole = alone.parameters
    for own, left_out in zip(two, others):
        assert [data.log.source for data in own.problem.data] == [
            log.source for log in others if log is not left_out
        ]
        gone = [data.log.source for data in whole.problem.data].index(left_out.source)
        shared = np.array([log != gone for _, log in whole.problem.parts])
        before, after = own.problem.costs([whole.optimum.z[shared], own.optimum.z])
        assert after <= before
        moved = own.optimum.z != whole.optimum.z[shared]
        assert moved.any()
        assert not moved[whole.left[shared]].any()
    assert parameters_without(whole, others, [0, 0]) == [whole]


def test_ctrl_c_ends_all_folds(others: list[Log], alone: Learned) -> None:
    calls = list[int]()

    def interrupted(rest: object, fold: int) -> Learned:
        calls.append(fold)
        found = replace(alone.parameters.optimum, interrupted=True)
        return replace(alone, parameters=replace(alone.parameters, optimum=found))

    assert leave_out(others, finger_rig(), [0, 1], interrupted, None) == []
    assert calls == [1]


@pytest.mark.parametrize("where", ["doubts", "jackknife", "missing_terms"])
def test_ctrl_c_is_not_taken_for_an_answer(
    where: str, monkeypatch: pytest.MonkeyPatch, others: list[Log], with_cable: Learned
) -> None:
    """A search that is stopped ends with the best so far: wherever it was, the fit ends there too,
    with its numbers.
    """
    module = import_module(f"distal.fitting.{where}")
    name = "by_equations" if where == "missing_terms" else "search"
    whole, calls = getattr(module, name), list[int]()

    def stopped(*arguments: object, **named: object) -> object:
        calls.append(1)
        found = whole(*arguments, **named)
        if where == "missing_terms":
            return replace(found, optimum=replace(found.optimum, interrupted=True))
        return replace(found, interrupted=True)

    monkeypatch.setattr(module, name, stopped)
    monkeypatch.setattr("distal.fitting.missing_terms.UNEXPLAINED", 0.0)
    found = learn(others, cable_rig(), OPTIONS)
    assert found.interrupted
    assert len(calls) == 1
    assert found.kept
    assert [part.value for part in found.fitted] == [
        part.value for part in with_cable.parameters.fitted
    ]


def test_each_joint_is_homed_by_its_own_truth() -> None:
    """A log that knows one joint comes before one that knows both: the second is read as it would
    be alone.
    """
    rig = load_rig("finger-2n").bare()
    both = simulate(rig, "finger", 3)
    one = replace(both, source="one", truth={"theta_pip": both.truth["theta_pip"]})
    alone, _ = filtered([both], [rig], 1.0, False)
    after, refused = filtered([one, both], [rig, rig], 1.0, False)
    assert not refused
    np.testing.assert_array_equal(after[1].angles, alone[0].angles)


def test_logs_of_other_arms_make_no_rig_worse() -> None:
    """Two logs of other arms, one larger and one smaller than the rig's: what is written errs no
    more than what came.
    """
    logs = []
    for seed, share in ((0, 0.75), (1, 1.3)):
        one = finger_log(seed, SECONDS)
        logs.append(
            replace(one, source=f"arm {share}", truth={"theta": share * one.truth["theta"]})
        )
    found = learn(logs, finger_rig().bare(), OPTIONS)
    errors = {candidate.name: candidate.error for candidate in found.candidates}
    assert found.candidates[0].error <= 1.05 * errors[AS_GIVEN]
    assert any(line.startswith("contradictory logs: arm") for line in found.doubts)


def test_the_filter_that_errs_least_is_taken_and_equal_ones_in_their_order() -> None:
    def candidate(name: str, error: float) -> Candidate:
        return Candidate(name, finger_rig(), None, False, error, {})

    one, other = candidate(BY_EQUATIONS, 0.02), candidate(AS_GIVEN, 0.02)
    assert best_of([one, other]) is one
    assert best_of([one, candidate(AS_GIVEN, 0.0199)]).name == AS_GIVEN
    assert best_of([candidate(BY_EQUATIONS, np.inf), other]) is other


def test_a_rig_as_it_came_keeps_its_numbers(others: list[Log]) -> None:
    """As it came it is a candidate like the others, and its numbers are not touched."""
    rig = finger_rig().bare()
    training = Training(tuple(others), ("0", "1"), rig, OPTIONS)
    came = filter_candidate(AS_GIVEN, training, None)
    assert came.rig.bare() == rig


def test_a_filter_that_leaves_all_bounds_is_no_candidate(
    others: list[Log], alone: Learned, monkeypatch: pytest.MonkeyPatch
) -> None:
    map_samples = import_module("distal.fitting.map_samples")
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
    assert untouched(rig).free_motion is not None
