"""The health of a stream in C: the words that `distal stream` says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from distal import Log, Rig, load_scenario, log_health, scenario_rig, simulate
from distal.export import c_filter
from distal.fitting.learned_maps import efforts_of
from tests.export.helpers import build, needs_compiler, run, spoiled
from tests.support.foreign_plants import finger_log, finger_rig


def changed(log: Log, name: str, values: np.ndarray) -> Log:
    return Log(log.time, {**log.channels, name: values}, log.truth, "changed", log.truth_source)


@pytest.fixture(scope="module")
def rig() -> Rig:
    return scenario_rig(load_scenario("series-2"))


@pytest.fixture(scope="module")
def log(rig: Rig) -> Log:
    return simulate(rig, load_scenario("series-2"), 5)


def during(values: np.ndarray, what: float) -> np.ndarray:
    """Return values that are another one for 1.2 s."""
    return np.where(np.arange(len(values)) // 120 == 2, what, values)


@needs_compiler
def test_the_words_are_those_of_a_stream(rig: Rig, log: Log, tmp_path: Path) -> None:
    """One function says them: in C as in Python, at the same samples."""
    program = build(c_filter(rig), tmp_path, "-O1")
    u1, u2, x1 = (log.channels[name] for name in ("u1", "u2", "x1"))
    for name, values, said in (
        ("u1", u1, "gap"),
        ("u1", during(u1, u1[240]), "dead"),
        ("u1", 0.3 * u1, "disagrees"),
        ("u2", during(u2, np.nan), "dead"),
        ("x1", 1000.0 * x1, "disagrees"),
    ):
        spoilt = spoiled(changed(log, name, values))
        found = run(program, spoilt).health
        assert said in found
        assert tuple(found) == log_health(spoilt, rig)


@needs_compiler
def test_forces_that_positions_predict(tmp_path: Path) -> None:
    bare = finger_rig().bare()
    logs = [finger_log(seed, 20.0) for seed in range(3)]
    rig = bare.with_map(efforts=efforts_of(logs, bare, range(3)))
    log = finger_log(11, 10.0)
    position = rig.sensors_of("position")[0].name
    spoilt = changed(log, position, 1.6 - log.channels[position])
    found = run(build(c_filter(rig), tmp_path, "-O1"), spoilt).health
    assert tuple(found) == log_health(spoilt, rig)
    assert "touched" in found


@needs_compiler
def test_of_a_chain(tmp_path: Path) -> None:
    scenario = load_scenario("wrist")
    rig = scenario_rig(scenario)
    log = simulate(rig, scenario, 1)
    found = run(build(c_filter(rig), tmp_path, "-O1"), log).health
    assert tuple(found) == log_health(log, rig)
    assert "untested" in found
