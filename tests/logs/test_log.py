from __future__ import annotations

import numpy as np
import pandas
import polars as pl
import pytest

from distal import Log
from distal.errors import LogError
from distal.logs import FROM_SENSOR, TruthKind, TruthSource


def test_a_log_is_frozen_and_checked() -> None:
    values = np.array([1.0, 2.0])
    log = Log(np.array([0.0, 1.0]), {"x": values})
    values[0] = 9.0
    assert log.channels["x"][0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        log.channels["x"][0] = 3.0
    with pytest.raises(TypeError):
        log.channels["y"] = values  # type: ignore[index]
    for times in ([0.0, 0.0], [1.0, 0.0], [0.0, np.nan], [[0.0], [1.0]]):
        with pytest.raises(LogError):
            Log(np.array(times), {})
    with pytest.raises(LogError, match="'x' has shape"):
        Log(np.array([0.0, 1.0]), {"x": np.zeros(3)})


def test_rate_gaps_select_and_frames() -> None:
    time = np.concatenate([0.01 * np.arange(50), 1.0 + 0.01 * np.arange(50)])
    log = Log(time, {"x": np.arange(100.0)}, {"theta": np.zeros(100)})
    assert log.rate == pytest.approx(100)
    assert log.gaps() == [(pytest.approx(0.49), pytest.approx(1.0))]
    assert len(log.select(slice(10, 20))) == 10
    for library in (pl, pandas):
        assert list(library.DataFrame(log.columns()).columns) == ["t", "x", "true_theta"]


def test_where_a_truth_comes_from_has_a_kind_and_words() -> None:
    """What is said of a truth is for people: a file of any name is no sensor."""
    time, theta = np.array([0.0, 1.0]), {"theta": np.zeros(2)}
    read = Log(time, {}, theta, "log", FROM_SENSOR)
    assert read.truth_kind is TruthKind.SENSOR
    assert str(read.truth_source) == "the reference sensor"
    assert read.select([0]).truth_kind is TruthKind.SENSOR
    source = TruthSource(position="at home, the reference sensor")
    identified = Log(time, {}, theta, "log", source)
    assert identified.truth_kind is TruthKind.OTHER
    assert not identified.truth_kind.by_sensor
    assert str(identified.truth_source) == "at home, the reference sensor"
    assert str(Log(time, {}).truth_source) == ""
