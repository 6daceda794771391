"""In a loop: the numbers of the whole log, no memory, and nothing silent about what is wrong."""

from __future__ import annotations

import gc
import pickle
import tracemalloc
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from copy import copy, deepcopy

import casadi as ca
import numpy as np
import pytest

from distal import (
    LiveEstimator,
    Log,
    Rig,
    load_rig,
    make_estimator,
)
from distal.errors import EstimationError
from distal.run import samples_of


def test_no_memory_is_taken(rig: Rig, log: Log) -> None:
    """Two thousand steps leave nothing behind, and hold no array on the way."""
    live = LiveEstimator(rig)
    samples, times = samples_of(log, live.channels), [float(t) for t in log.time]
    for k in range(700):
        if k == 100:
            gc.collect()
            tracemalloc.start()
            before = tracemalloc.get_traced_memory()[0]
        live.step(times[k], samples[k])
    now, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert now - before < 1000
    assert peak - before < 8 * live._kernel_state.size  # less than one belief


def test_the_first_step_builds_nothing(rig: Rig, log: Log, monkeypatch: pytest.MonkeyPatch) -> None:
    """All functions are there after the constructor, which leaves no trace: a first step that
    builds them misses 10 ms.
    """
    live, other = LiveEstimator(rig, compiled=False), LiveEstimator(rig, compiled=False)

    def build(*_: object) -> None:
        raise AssertionError("built within a step")

    for name in ("Function", "SX", "MX"):
        monkeypatch.setattr(ca, name, build)
    samples = samples_of(log, live.channels)
    assert live.samples == 0
    assert np.isnan(live.time)
    assert np.isnan(live.innovations).all()
    other.reset()
    assert live.step(log.time[0], samples[0]) == other.step(log.time[0], samples[0])
    live.step(log.time[1], samples[1])


def test_what_a_step_refuses(rig: Rig, log: Log) -> None:
    live = LiveEstimator(rig)
    samples = samples_of(log, live.channels)
    with pytest.raises(EstimationError, match="is no time"):
        live.step(np.nan, samples[0])
    live.step(0.0, samples[0])
    kept = live._kernel_state.copy()
    for time, sample, said in (
        (0.0, samples[1], "repeats"),
        (-0.01, samples[1], "is late"),
        (np.nan, samples[1], "is no time"),
        (1e9, samples[1], "too long to bridge"),
        (0.01, samples[1][:3], r"must have shape \(4,\)"),
        (0.01, [0.0, 0.0, 1.0, 1.0], "array of 4 numbers"),
        (0.01, np.full(4, np.inf), "is wild"),
    ):
        with pytest.raises(EstimationError, match=said):
            live.step(time, sample)
        np.testing.assert_array_equal(live._kernel_state, kept)
    for view in (live.mean, live.covariance, live.innovations):
        with pytest.raises(ValueError, match="read-only"):
            view[...] = 0.0


def step(live: LiveEstimator, samples: np.ndarray, begin: int, end: int) -> list[np.ndarray]:
    """Return the angles of samples, taken 100 times a second."""
    return [np.array(live.step(0.01 * k, samples[k])) for k in range(begin, end)]


@pytest.mark.parametrize(
    "again", [LiveEstimator.clone, copy, deepcopy, lambda live: pickle.loads(pickle.dumps(live))]
)
@pytest.mark.parametrize("name", ["pulley-antagonist", "finger-2n"])
def test_a_copy_goes_on_alone(name: str, again: Callable[[LiveEstimator], LiveEstimator]) -> None:
    """From the same belief both give the same numbers, and what one takes in does not reach the
    other.
    """
    live = LiveEstimator(load_rig(name), compiled=False)
    samples = np.random.default_rng(4).normal(0.0, 1e-4, (30, len(live.channels)))
    step(live, samples, 0, 10)
    other = again(live)
    np.testing.assert_array_equal(other.covariance, live.covariance)
    stood = np.array(other.mean)
    expected = step(live, samples, 10, 20)
    np.testing.assert_array_equal(other.mean, stood)
    np.testing.assert_array_equal(step(other, samples, 10, 20), expected)
    np.testing.assert_array_equal(other.innovations, live.innovations)


def test_threads_with_a_clone_each_give_the_numbers_of_one() -> None:
    first = LiveEstimator(load_rig("pulley-antagonist"), compiled=False)
    samples = np.random.default_rng(4).normal(0.0, 1e-4, (50, len(first.channels)))
    clones = [first.clone() for _ in range(4)]
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(step, clones, [samples] * 4, [0] * 4, [50] * 4))
    np.testing.assert_array_equal(found, [step(first, samples, 0, 50)] * 4)


def test_a_reset_widens_the_angles_alone() -> None:
    """Of the prior's covariance only the diagonal at the joints' angles is raised, to the std that
    was given.
    """
    rig = load_rig("finger-2n")
    live = LiveEstimator(rig, compiled=False)
    sample, n = np.zeros(len(live.channels)), len(live.state_names)
    live.reset([0.1, 0.2], 0.7)
    live._start(0.0, sample)  # what the first step begins with
    prior = make_estimator("adaptive", rig, compiled=False).initial(0.0, sample)
    expected = np.array(prior.covariance)
    expected[[0, 1], [0, 1]] = 0.7**2
    np.testing.assert_array_equal(live.covariance, expected)
    np.testing.assert_array_equal(live.mean[:2], [0.1, 0.2])
    np.testing.assert_array_equal(live.mean[2:n], np.array(prior.mean)[2:])
