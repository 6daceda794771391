"""The driver over a whole log: what it accepts."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.cases import paper_log, paper_rig

from distal import Belief, Estimator, Innovation, Rig, estimate, estimate_batch
from distal.errors import EstimationError


def test_passes_are_for_the_papers_filters() -> None:
    with pytest.raises(EstimationError, match="one pass"):
        estimate(paper_log("servo", "as the rig", 0), paper_rig("as the rig"), "adaptive", passes=2)


class Ratio:
    """What hand builders use: the angle is a displacement over a radius. No base class, only the
    contract.
    """

    def __init__(self, rig: Rig) -> None:
        self.name, self.rig = "ratio", rig
        self.channels, self.measured, self.state_names = ("x1", "x2"), (), ("theta",)

    def initial(self, time: float, sample: np.ndarray) -> Belief:
        return Belief(time, np.array([0.0, 0.01]), 1)

    def step(self, belief: Belief, time: float, sample: np.ndarray) -> tuple[Belief, Innovation]:
        angle = (sample[0] - sample[1]) / 2 / 9.53e-3
        kernel_state = np.array([belief.mean[0] if np.isnan(angle) else angle, 0.01])
        return Belief(time, kernel_state, 1, belief.samples + 1), Innovation(
            np.zeros(0), np.zeros(0), 0.0
        )

    def scan(
        self, belief: Belief, times: np.ndarray, samples: np.ndarray
    ) -> tuple[np.ndarray, ...]:
        means = []
        for time, sample in zip(times, samples):
            belief, _ = self.step(belief, time, sample)
            means.append(belief.mean)
        nothing = np.zeros((len(times), 0))
        return np.array(means), np.full((len(times), 1, 1), 0.01), nothing, nothing


def test_anything_that_is_an_estimator_is_accepted() -> None:
    log, rig = paper_log("servo", "as the rig", 0), paper_rig("as the rig")
    own = Ratio(rig)
    assert isinstance(own, Estimator)
    result = estimate(log, rig, own)
    expected = (log.channels["x1"] - log.channels["x2"]) / 2 / 9.53e-3
    np.testing.assert_allclose(result.theta, expected, rtol=1e-15)
    assert result.estimator == "ratio"
    assert result.rms_error() > 0.0
    homed = estimate(log, rig, own, homing=1.0)
    early = log.time < 1.0
    assert abs(np.mean(homed.theta[early] - log.truth["theta"][early])) < 1e-12
    for one in estimate_batch([log, log], rig, own):
        np.testing.assert_array_equal(one.theta, result.theta)
    with pytest.raises(EstimationError, match="an estimator is a name or one from make_estimator"):
        estimate(log, rig, object())  # type: ignore[arg-type]
