"""The driver over a whole log: what it accepts."""

from __future__ import annotations

import subprocess
import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from distal import Log, Rig, diagnose, estimate, load_rig
from distal.logs import write_log
from tests.support.cases import paper_log, paper_rig


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
    for part in ("means", "variances", "innovations", "innovation_variances"):
        np.testing.assert_array_equal(getattr(lean, part), getattr(whole, part))
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
    said, expected = (diagnose(result, log, rig) for result in (lean, whole))
    assert (said.findings, said.text) == (expected.findings, expected.text)


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
        write_log(long_log(rows)[0], load_rig("paper-2008-printed"), tmp_path / "log.csv")
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
