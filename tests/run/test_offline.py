"""The driver over a whole log: what it accepts."""

from __future__ import annotations

import subprocess
import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from distal import (
    Belief,
    Estimator,
    Innovation,
    Log,
    Rig,
    diagnose,
    estimate,
    estimate_batch,
    load_rig,
)
from distal.errors import EstimationError
from distal.logs import write_log
from tests.support.cases import paper_log, paper_rig


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


def long_log(rows: int) -> tuple[Log, Rig]:
    """Return a log of the paper's rig that goes back and forth until it is long enough."""
    log, rig = paper_log("servo", "as the rig", 0), paper_rig("as the rig")
    there = np.arange(rows) % (2 * len(log) - 2)
    at = np.where(there < len(log), there, 2 * len(log) - 2 - there)
    channels = {name: values[at] for name, values in log.channels.items()}
    return Log(0.01 * np.arange(rows), channels, {"theta": log.truth["theta"][at]}), rig


def test_without_covariances_an_estimate_is_the_same_and_takes_little_memory() -> None:
    """A million samples within a gigabyte; the kernel states of 100,000 take 140 MB at once."""
    log, rig = long_log(100_000)
    whole = estimate(log, rig)
    tracemalloc.start()
    lean = estimate(log, rig, covariances=False)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert lean.covariances is None
    np.testing.assert_array_equal(lean.means, whole.means)
    np.testing.assert_array_equal(lean.variances, whole.variances)
    np.testing.assert_array_equal(lean.innovations, whole.innovations)
    np.testing.assert_array_equal(lean.innovation_variances, whole.innovation_variances)
    assert peak < 100e6


@pytest.mark.more
def test_of_all_states_the_ends_are_enough_for_words_and_diagnosis() -> None:
    """What is written and said is the same, and takes a tenth of the memory."""
    log, rig = long_log(30_000)
    whole = estimate(log, rig, covariances=False)
    tracemalloc.start()
    lean = estimate(log, rig, covariances=False, every=False)
    held, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(lean.state_names) < len(whole.state_names)
    assert held < 30_000 * 8 * 2 * len(whole.state_names)
    for name, column in lean.columns(every=True).items():
        np.testing.assert_array_equal(column, whole.columns(every=True)[name])
    assert lean.columns().keys() == whole.columns().keys()
    ends = lean.with_all_states
    assert ends.state_names == whole.state_names
    np.testing.assert_array_equal(ends.means, whole.means[[0, -1]])
    np.testing.assert_array_equal(ends.variances, whole.variances[[0, -1]])
    assert lean.in_words() == whole.in_words()
    assert diagnose(lean, log, rig).findings == diagnose(whole, log, rig).findings
    assert diagnose(lean, log, rig).text == diagnose(whole, log, rig).text


OF_A_COMMAND = """
import resource, sys
from distal.cli.app import main
try:
    main()
finally:
    print("peak", resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


@pytest.mark.more  # memory of an estimate alone: the tests above
@pytest.mark.skipif(sys.platform != "linux", reason="ru_maxrss has other units elsewhere")
def test_a_row_more_costs_the_command_little(tmp_path: Path) -> None:
    """Ten million rows within two gigabytes, with a truth and all estimators beside it."""
    peaks = []
    for rows in (20_000, 100_000):
        log, _ = long_log(rows)
        rig = load_rig("paper-2008-printed")
        write_log(log, rig, tmp_path / "log.csv")
        words = ["estimate", "log.csv", "--rig", "paper-2008-printed", "--out", "out.csv"]
        done = subprocess.run(
            [sys.executable, "-c", OF_A_COMMAND, *words],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=True,
        )
        assert "error against truth" in done.stdout
        peaks.append(1024 * int(done.stdout.split("peak ")[1]))
    assert (peaks[1] - peaks[0]) / 80_000 < 250
