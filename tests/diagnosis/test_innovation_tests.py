"""Self-diagnosis: what disagrees and from when on, what was tested, and what could not be."""

from __future__ import annotations

from statistics import NormalDist

import numpy as np
import pytest
from scipy.signal import lfilter

from distal import Estimate, Log, Rig, diagnose, estimate
from distal.confidence import SMALL
from distal.diagnosis import Finding
from distal.diagnosis import diagnose_estimate as of_estimate
from distal.diagnosis.innovation_tests import (
    LARGE_RATIO,
    LONGEST_LINE,
    SPAN,
    _neighbours,
    _since,
    statistics_of,
)
from distal.errors import EstimationError
from distal.estimators import StateKind


def made(
    innovations: np.ndarray | None = None,
    end: float = 1.0,
    std: float = 0.01,
    friction: float = 0.0,
    turn: float = 0.0,
    priors: bool = True,
) -> Estimate:
    """Return a constructed estimate: an angle, a factor with prior 1 ± 0.1 that is `end` ± `std`, a
    friction; white innovations of variance 1 are the reference. The angle turns by `turn` [°].
    """
    k = 1000
    variances = np.tile([1e-4, std**2, 1e-4], (k, 1))
    variances[0, 1:] = 0.01, 1.0
    means = np.tile([0.0, end, friction], (k, 1))
    means[0] = 0.0, 1.0, 0.0
    means[:, 0] = np.deg2rad(turn) * np.linspace(-0.5, 0.5, k)
    return Estimate(
        "adaptive",
        "made",
        np.arange(k) / 100.0,
        ("theta", "factor", "friction_left"),
        means,
        variances,
        ("u1", "u2"),
        np.random.default_rng(3).normal(size=(k, 2)) if innovations is None else innovations,
        np.ones((k, 2)),
        prior_means=np.array([np.nan, 1.0 if priors else np.nan, np.nan]),
        prior_stds=np.array([np.nan, 0.1 if priors else np.nan, np.nan]),
        state_kinds=(StateKind.ANGLE, StateKind.PARAMETER, StateKind.FRICTION),
        state_parts=("joint", "factor", "left"),
        state_units=("rad", "1", "N"),
    )


@pytest.mark.parametrize(
    ("change", "kinds", "said"),
    [
        ({}, [], "consistent: u1, u2 agree with the rig, 100 % compared"),
        # a stiffness of 0.065 of itself was called consistent
        (
            {"end": 0.065, "std": 0.0006},
            ["left its prior"],
            "factor is 0.065 ± 0.0006, its prior 1 ± 0.1",
        ),
        ({"end": 1.29}, [], "consistent"),
        ({"end": 1.32}, ["left its prior"], "factor is 1.32"),
        # its own doubt is taken off: it may well be inside three standard deviations
        ({"end": 1.32, "std": 0.05}, [], "consistent"),
        ({"end": 0.065, "priors": False}, [], "consistent"),
        ({"friction": 0.6}, ["friction"], "friction that the rig does not have: 0.6 at 'left'"),
        ({"turn": 250.0}, [], "consistent"),
        ({"turn": 290.0}, ["cannot be there"], "covers 290°, which no joint does"),
    ],
)
def test_states_contradict(change: dict[str, float], kinds: list[str], said: str) -> None:
    """What left its prior, friction, and a gear that was forgotten, which turns the joint round and
    round.
    """
    found = diagnose(made(**change))
    assert [one.kind for one in found.findings] == kinds
    assert found.consistent is (kinds == [])
    assert found.tested == ("u1", "u2")
    assert said in found.text


@pytest.mark.parametrize(
    ("missing", "said"),
    [
        (1.0, "not tested"),
        (0.6, "only 40 % of u2 could be compared"),
        (0.4, "consistent: u1, u2 agree with the rig, 60 % compared"),
    ],
)
def test_what_is_not_compared_is_said(missing: float, said: str) -> None:
    """By the channel that is compared least."""
    values = np.random.default_rng(3).normal(size=(1000, 2))
    values[: round(1000 * missing), int(missing < 1.0) :] = np.nan
    found = diagnose(made(values))
    assert said in found.text
    assert found.untested is (missing == 1.0)
    assert found.consistent is (missing < 1.0)


def test_innovations_too_small_test_nothing() -> None:
    """ν²/S of 0.02 is no agreement: S is then what the filter does not believe of the
    sensor.
    """
    values = np.random.default_rng(4).normal(size=(1000, 2))
    both = diagnose(made(np.sqrt(0.02) * values))
    assert not both.consistent
    assert both.tested == ()
    assert both.untested
    assert both.text.startswith("not tested by u1")
    assert both.headline == "not tested by u1"
    one = diagnose(made(values * [1.0, np.sqrt(0.02)]))
    assert one.consistent
    assert one.tested == ("u1",)
    assert "not tested by u2" in one.text
    # the mean of 900 squares errs by 5 %, not by half
    assert diagnose(made(np.sqrt(2 * SMALL) * values)).consistent


@pytest.mark.parametrize(("weight", "white"), [(0.2, True), (0.5, False)])
def test_one_channel_that_is_not_white(weight: float, white: bool) -> None:
    """ν_k = (w_k + a w_{k−1})/√(1 + a²) has the correlation a/(1 + a²): 0.19 and 0.4, ± 0.03
    over 1000 samples.
    """
    noise = np.random.default_rng(5).normal(size=(1001, 2))
    values = noise[1:].copy()
    values[:, 1] = (noise[1:, 1] + weight * noise[:-1, 1]) / np.sqrt(1 + weight**2)
    found = diagnose(made(values))
    assert [(one.kind, one.subject) for one in found.findings] == (
        [] if white else [("drifts", "u2")]
    )


def test_what_else_was_found_counts_too() -> None:
    other = Finding("cannot be there", "x1", "x1 is elsewhere")
    assert not of_estimate(made(), [other]).consistent
    beyond = Finding("cannot test", "insertion radius of tendon left", "…")
    found = of_estimate(made(), [beyond])
    assert found.consistent
    assert found.text.endswith("cannot be felt: insertion radius of tendon left")
    assert not found.text.startswith("consistent")


def test_the_line_stays_one_line() -> None:
    many = [Finding("cannot test", f"insertion radius of tendon t{i}", "…") for i in range(20)]
    text = of_estimate(made(), many).text
    assert len(text) <= LONGEST_LINE
    assert text.endswith("; …")
    loud = [Finding("looks like", f"u{i}", 9 * f"u{i} looks like pounds, ") for i in range(20)]
    text = of_estimate(made(), loud).text
    assert len(text) <= LONGEST_LINE + len("; and 20 more (--findings)")
    assert "more" in text


def test_priors_are_those_of_the_rig(rig: Rig, log: Log) -> None:
    result = estimate(log, rig)
    priors = dict(zip(result.state_names, zip(result.prior_means, result.prior_stds)))
    assert priors["common factor of tendons.stiffness"] == pytest.approx((1.0, 0.1))
    assert np.isnan([priors[name][1] for name in ("theta", "friction_left")]).all()
    with pytest.raises(EstimationError, match="both the log and the rig"):
        diagnose(result, log)
    without = estimate(log, rig, "elastic")
    assert np.isnan(without.prior_means).all()
    assert "not checked" in diagnose(without).text


QUANTILES = np.array([NormalDist().inv_cdf((k + 0.5) / 100) for k in range(100)])[
    np.random.default_rng(0).permutation(100)
]
"""A second of values at 100 Hz that are normally distributed, exactly."""


@pytest.mark.parametrize("after", [1.01, 0.99])
def test_since_when_a_channel_is_too_large(after: float) -> None:
    """Six seconds of 1 σ, then four whose ν²/S is a hundredth above, or below, the limit."""
    time = np.arange(1000) / 100.0
    large = np.tile(QUANTILES, 4) / np.std(QUANTILES) * np.sqrt(after * LARGE_RATIO)
    since = _since(time, np.concatenate([np.tile(QUANTILES, 6), large]), LARGE_RATIO)
    assert np.isnan(since) if after < 1.0 else since == 6.0


def test_a_channel_that_agrees_again_disagrees_since_no_time() -> None:
    """Large for a while, or from the start on, is no day on which a sensor broke."""
    time, normal = np.arange(1000) / 100.0, np.tile(QUANTILES, 10)
    large = 3.0 * normal
    for values in (
        large,
        np.where(time < 6, large, normal),
        np.where(time < 4, normal, np.nan),
    ):
        assert np.isnan(_since(time, values, LARGE_RATIO))
    assert _since(time, np.where(time < 5, normal, large), LARGE_RATIO) == 2 * SPAN


def test_a_ratio_is_judged_by_how_many_values_it_is_a_mean_of() -> None:
    """ν²/S of 1.8 in the mean is too large over 100 s, where 1.7 (1 + 3.5 √(2/9950)) = 1.78 are
    normal, and not over a second.
    """
    rng = np.random.default_rng(7)
    values = rng.normal(size=(10000, 2))
    values *= np.sqrt(1.82 / np.mean(values[50:] ** 2, axis=0))
    time = np.arange(10000) / 100.0
    for count, texts in (
        (10000, ["u1, u2 disagree with the rig: innovations 1.3× larger than normal"]),
        (100, []),
    ):
        found = statistics_of(("u1", "u2"), values[:count], time[:count], is_taught=False)
        assert [one.text for one in found.disagreeing()] == texts


def test_innovations_of_a_rig_that_logs_taught_say_nothing() -> None:
    """ν²/S is 4, and neighbours correlate by 0.5."""
    rng = np.random.default_rng(8)
    noise = rng.normal(size=(2001, 1))
    values = 2.0 * (noise[1:] + noise[:-1]) / np.sqrt(2.0)
    time = np.arange(2000) / 100.0
    assert statistics_of(("u1",), values, time, is_taught=False).disagreeing()
    taught = statistics_of(("u1",), values, time, is_taught=True)
    assert taught.disagreeing() == taught.untested() == []
    assert taught.tested == ("u1",)


def test_the_correlation_of_neighbours() -> None:
    """Of x⁺ = ρ x + noise it is ρ; of values that say nothing, fewer than 20 or all the same, 0."""
    rng = np.random.default_rng(1)
    for rho in (-0.6, 0.0, 0.8):
        values = lfilter([1.0], [1.0, -rho], rng.normal(size=20000))
        # its standard error is (1 − ρ²)/√20000, at most 0.007
        assert _neighbours(values) == pytest.approx(rho, abs=0.03)
    assert _neighbours(np.full(100, 2.0)) == 0.0
    assert _neighbours(np.tile([1.0, -1.0], 50)) == pytest.approx(-0.99, abs=0.011)
    for count, expected in ((19, 0.0), (20, 1.0)):
        gaps = np.full(60, np.nan)
        gaps[3 : 3 + count] = np.linspace(5.0, 5.001, count)
        assert _neighbours(gaps) == pytest.approx(expected, abs=1e-3)
