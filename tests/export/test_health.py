"""The health of a stream in C: the words that `distal stream` says."""

from __future__ import annotations

import ctypes
from pathlib import Path

import numpy as np
import pytest

from distal import Log, Rig, load_scenario, log_health, scenario_rig, simulate
from distal.export import c_filter
from distal.fitting.learned_maps import efforts_of
from distal.run import samples_of
from distal.run.health import HEALTH
from tests.export.helpers import shared_library, spoiled
from tests.export.test_export import needs_compiler
from tests.support.foreign_plants import finger_log, finger_rig

WATCHING = """#include "f.h"
static f_state state;
static f_watch watch;
int word(int first, double dt, const double* values) {
  f_output out;
  if (first) f_begin(&state, values), f_watch_begin(&watch);
  if (f_step(&state, dt, values, &out)) return -1;
  return f_health(&watch, &state, dt, values, &out);
}
"""


def words_in_c(rig: Rig, log: Log, folder: Path) -> list[str]:
    """Return the word of each sample."""
    made = c_filter(rig, name="f")
    texts = {"f.h": made.header, "f.c": made.source, "watching.c": WATCHING}
    word = shared_library(texts, folder).word
    samples, steps = (
        samples_of(log, made.estimator.channels),
        np.diff(log.time, prepend=log.time[0]),
    )
    codes = [
        word(
            k == 0,
            ctypes.c_double(steps[k]),
            np.ascontiguousarray(row).ctypes.data_as(ctypes.c_void_p),
        )
        for k, row in enumerate(samples)
    ]
    return [list(HEALTH)[code] for code in codes]


def changed(log: Log, name: str, values: np.ndarray) -> Log:
    return Log(log.time, {**log.channels, name: values}, log.truth, "changed", log.truth_source)


@pytest.fixture(scope="module")
def rig() -> Rig:
    return scenario_rig(load_scenario("series-2"))


@pytest.fixture(scope="module")
def log(rig: Rig) -> Log:
    return simulate(rig, load_scenario("series-2"), 5)


def stuck(log: Log) -> Log:
    values = log.channels["u1"].copy()
    values[300:420] = values[300]
    return changed(log, "u1", values)


def dead(log: Log) -> Log:
    values = log.channels["u2"].copy()
    values[200:330] = np.nan
    return changed(log, "u2", values)


def elsewhere(log: Log) -> Log:
    return changed(log, "x1", log.channels["x1"] * 1000.0)


def contradictory(log: Log) -> Log:
    return changed(log, "u1", log.channels["u1"] * 0.3)


@needs_compiler
@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (spoiled, "gap"),
        (stuck, "dead"),
        (dead, "dead"),
        (elsewhere, "disagrees"),
        (contradictory, "disagrees"),
    ],
    ids=lambda one: getattr(one, "__name__", one),
)
def test_the_words_are_those_of_a_stream(
    rig: Rig, log: Log, spoil: object, said: str, tmp_path: Path
) -> None:
    """One function says them: in C as in Python, at the same samples."""
    spoilt = spoil(log)  # type: ignore[operator]
    known, found = log_health(spoilt, rig), words_in_c(rig, spoilt, tmp_path)
    assert said in found
    assert tuple(found) == known


@needs_compiler
def test_forces_that_positions_predict(tmp_path: Path) -> None:
    bare = finger_rig().bare()
    logs = [finger_log(seed, 20.0) for seed in range(3)]
    rig = bare.with_map(efforts=efforts_of(logs, bare, range(3)))
    log = finger_log(11, 10.0)
    position = rig.sensors_of("position")[0].name
    spoilt = changed(log, position, 1.6 - log.channels[position])
    found = words_in_c(rig, spoilt, tmp_path)
    assert tuple(found) == log_health(spoilt, rig)
    assert "touched" in found


@needs_compiler
def test_of_a_chain(tmp_path: Path) -> None:
    scenario = load_scenario("wrist")
    rig = scenario_rig(scenario)
    log = simulate(rig, scenario, 1)
    found = words_in_c(rig, log, tmp_path)
    assert tuple(found) == log_health(log, rig)
    assert "untested" in found
