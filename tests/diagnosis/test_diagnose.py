"""A diagnosis with log and rig: ranges, the truth, and runs of the filter with changes."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
import pytest
from scipy.stats import binom

from distal import Log, Rig, estimate, load_rig, load_scenario, read_log, simulate
from distal.confidence import BAND, COVERED
from distal.diagnosis import why_diverged
from distal.diagnosis.cause_search import MOST_SAMPLES, Derivatives, PerturbedRuns, Search
from distal.diagnosis.causes import Cause, causes_of
from distal.diagnosis.diagnose import against_truth, elsewhere, out_of_range
from distal.diagnosis.innovation_tests import LEVEL, SPAN
from distal.estimators import AdaptiveFilter
from distal.results import Estimate
from distal.run.offline import estimator_for
from tests.support.given_plants import log_of


@pytest.fixture(scope="module")
def runs(rig: Rig, log: Log) -> PerturbedRuns:
    return PerturbedRuns(log, cast(AdaptiveFilter, estimator_for(log, rig, "adaptive")))


def scaled(log: Log, **factors: float) -> Log:
    channels = {name: values * factors.get(name, 1.0) for name, values in log.channels.items()}
    return replace(log, channels=channels)


class TestRuns:
    """A run with a change is the run of the log, or of the rig, that is changed so."""

    def test_unchanged_it_is_the_estimate(self, rig: Rig, log: Log, runs: PerturbedRuns) -> None:
        result = estimate(log, rig)
        (base,) = runs([{}])
        np.testing.assert_array_equal(base.angles, result.angles)
        np.testing.assert_array_equal(base.innovations, result.innovations)
        np.testing.assert_array_equal(runs.errors(base), result.angles - result.truths)

    @pytest.mark.parametrize("kind", ["scale", "zero", "delay", "swap"])
    def test_a_channel(self, rig: Rig, log: Log, runs: PerturbedRuns, kind: str) -> None:
        time, u1, u2 = log.time, log.channels["u1"], log.channels["u2"]
        x, changed = {
            "scale": (0.1, {"u1": 1.1 * u1}),
            "zero": (0.5, {"u1": u1 + 0.5}),
            "delay": (0.02, {"u1": np.interp(time + 0.02, time, u1)}),
            "swap": (1.0, {"u1": u2, "u2": u1}),
        }[kind]
        other = replace(log, channels={**log.channels, **changed})
        (found,) = runs([{Cause(kind, "u1", tuple(changed), std=1.0): x}])
        np.testing.assert_allclose(found.angles, estimate(other, rig).angles, atol=1e-12)

    @pytest.mark.parametrize(
        "path", ["tendons.0.insertion.radius", "joints.0.friction.coefficient"]
    )
    def test_a_parameter(self, rig: Rig, log: Log, runs: PerturbedRuns, path: str) -> None:
        """One is certain, the other a state, which then begins elsewhere too. The joint's own load
        is computed from the rig's values, and is not changed here.
        """
        at = runs.estimator.parameter_names.index(path)
        value = float(runs.estimator.parameters[at])
        (found,) = runs([{Cause("arm", "", paths=(path,)): 0.1}])
        other = estimate(log, rig.with_values({path: 1.1 * value}))
        np.testing.assert_allclose(found.angles, other.angles, atol=2e-4)

    def test_several_side_by_side_are_those_alone(self, runs: PerturbedRuns) -> None:
        cause = Cause("scale", "u1", ("u1",))
        changes = [{cause: x} for x in np.linspace(-0.2, 0.2, 9)]
        for change, found in zip(changes, runs(changes), strict=True):
            np.testing.assert_array_equal(found.angles, runs([change])[0].angles)

    def test_derivatives_lead_to_the_run_with_the_change(self, runs: PerturbedRuns) -> None:
        """With ten times the step, nearly: a kinked filter is no straight line."""
        for zero in (cause for cause in causes_of(runs.estimator, 0.01) if cause.kind == "zero"):
            slopes = Derivatives(runs, [zero])
            base, far = runs([{}, {zero: 10.0 * zero.step}])
            for slope, change in (
                (slopes.angles[0], far.angles - base.angles),
                (slopes.innovations[0], far.normalized - base.normalized),
            ):
                both = np.isfinite(slope) & np.isfinite(change)
                size = slope[both] @ change[both] / (slope[both] @ slope[both])
                assert size == pytest.approx(10.0 * zero.step, rel=0.35)

    def test_a_start_with_what_was_learned(self, rig: Rig, log: Log, runs: PerturbedRuns) -> None:
        result = estimate(log, rig)
        began = runs.begun_with(result.means[-1])
        assert np.any(began.angles != result.angles)
        prior = runs.estimator.states.means
        np.testing.assert_array_equal(runs.begun_with(prior).angles, result.angles)

    def test_the_likelihood_is_that_typed_out(self, runs: PerturbedRuns) -> None:
        """ln p of a value, an outlier beyond 9 S counting as in the filter."""
        (found,) = runs([{Cause("scale", "u1", ("u1",)): 2.0}])
        for k, said in enumerate(found.log_likelihoods()):
            values = [
                -0.5 * (v**2 / (s * c) + np.log(s * c))
                for v, s in zip(found.innovations[:, k], found.innovation_variances[:, k])
                if np.isfinite(v)
                for c in [max(1.0, v**2 / s / 9.0)]
            ]
            assert said == pytest.approx(np.mean(values))

    def test_a_long_log_is_cut(self, rig: Rig, log: Log) -> None:
        times = np.arange(MOST_SAMPLES + 10) / 100.0
        channels = {name: np.resize(values, len(times)) for name, values in log.channels.items()}
        estimator = cast(AdaptiveFilter, estimator_for(log, rig, "adaptive"))
        assert len(PerturbedRuns(Log(times, channels), estimator).log) == MOST_SAMPLES


def with_outside(result: Estimate, share: float) -> Estimate:
    """Return the result with a truth that is far off for a share of the log, in its begin."""
    truths = np.array(result.angles)
    within = slice(round(share * len(truths)))
    truths[within] += 10.0 * result.angle_stds[within]
    return replace(result, truths=truths)


def test_the_truth_contradicts_where_chance_does_not_explain_it(rig: Rig, log: Log) -> None:
    """95 % inside, less z √(0.95 · 0.05/n): of n spans of 2 s that count as independent. Fewer
    inside have a chance of at most ten times `LEVEL` (the binomial tail is longer than the normal).
    """
    result = estimate(log, rig)
    spans = np.ptp(result.time) / SPAN
    least = COVERED - 3.2905 * np.sqrt(COVERED * (1.0 - COVERED) / spans)
    assert against_truth(with_outside(result, 1.0 - least - 0.02)) == []
    (finding,) = against_truth(with_outside(result, 1.0 - least + 0.02))
    assert finding.text.endswith(f"{100 * (least - 0.02):.0f} % inside the band")
    assert binom.cdf(np.floor(least * spans), round(spans), COVERED) < 10.0 * LEVEL


def test_a_truth_inside_the_band_contradicts_nothing(rig: Rig, log: Log) -> None:
    result = estimate(log, rig)
    edge = replace(result, truths=result.angles + 0.99 * BAND * result.angle_stds)
    assert against_truth(edge) == []
    assert against_truth(replace(result, truths=None)) == []


def test_a_displacement_where_no_drive_can_be(rig: Rig, log: Log) -> None:
    assert elsewhere(log, rig) == []
    wrong = elsewhere(scaled(log, x1=57.3), rig)
    assert [(one.kind, one.subject) for one in wrong] == [("cannot be there", "x1")]


def test_outside_the_range_of_a_fit(rig: Rig, log: Log) -> None:
    low, high = np.min(log.channels["u1"]), np.max(log.channels["u1"])
    for most, subjects in ((high, []), ((low + high) / 2, ["u1"])):
        found = out_of_range(log, {"u1": (low, most), "not there": (0.0, 1.0)})
        assert [one.subject for one in found if one.kind == "out of range"] == subjects


def test_a_band_of_many_turns_is_no_noise(data: Path) -> None:
    """Of a force in millinewtons a filter makes a band in which any angle is: that does not excuse
    the error that its unit takes off.
    """
    rig = load_rig(data / "newcomer" / "finger.toml")
    with tempfile.TemporaryDirectory() as folder:
        log = read_log(log_of("finger", 4, Path(folder)), rig)
    runs = PerturbedRuns(log, AdaptiveFilter(rig, "lanes"))
    (base,) = runs([{}])
    wide = replace(base, variances=np.full_like(base.variances, 100.0), angles=base.angles + 0.5)
    search = Search(runs, wide, of_truth=True)
    zero = next(c for c in causes_of(runs.estimator, 0.01) if c.kind == "zero")
    assert search([{zero: 0.1 * zero.std}])


def test_why_a_run_left_all_bounds_is_said() -> None:
    """Millimetres for metres, by the truth; a sign, without one."""
    finger = load_rig("finger-2n")
    seen = simulate(finger, load_scenario("finger", ['duration="2 s"']), 5)
    found = why_diverged(scaled(seen, x_mcp_f=1000.0), finger)
    assert [each.text for each in found] == ["x_mcp_f looks like millimetres"]
    blind = replace(scaled(seen, F_mcp_f=1000.0), truth={})
    assert "F_mcp_f looks like millinewtons" in [e.text for e in why_diverged(blind, finger)]
