"""What is written is a rig whose filter follows the logs that it was learned from."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from distal import Log, Rig, load_rig
from distal.errors import DivergedError
from distal.fitting.learn_free_motion import untouched

FIT = sys.modules["distal.fitting.fit"]
LOG = Log(np.arange(3.0), {"x": np.zeros(3)}, source="one.csv")


@dataclass(frozen=True)
class Candidate:
    name: str
    rig: Rig
    error: float


@dataclass(frozen=True)
class Learned:
    rig: Rig
    doubts: tuple[str, ...] = ()


@pytest.fixture
def candidates(pulley_rig: Rig) -> list[Candidate]:
    return [
        Candidate("first", pulley_rig, 0.01),
        Candidate("third", load_rig("capstan-joint"), 0.03),
        Candidate("second", load_rig("template"), 0.02),
    ]


def written(
    candidates: list[Candidate], fails: list[Rig], monkeypatch: pytest.MonkeyPatch
) -> Learned:
    """Return what is written where the filters of some rigs leave all bounds."""

    def estimate(log: Log, rig: Rig, **_: object) -> None:
        if rig in fails:
            raise DivergedError(log.source)

    monkeypatch.setattr(FIT, "estimate", estimate)
    monkeypatch.setattr(FIT, "learned_by", lambda _, candidate: Learned(candidate.rig))
    options = SimpleNamespace(compiled=False, homing=None)
    judged = SimpleNamespace(candidates=candidates, training=SimpleNamespace(options=options))
    return FIT._followed(judged, candidates[0], [LOG], lambda it: replace(it, doubts=("whole",)))


def test_a_rig_whose_filter_leaves_all_bounds_is_not_written(
    candidates: list[Candidate], monkeypatch: pytest.MonkeyPatch
) -> None:
    first, _, second = candidates
    assert written(candidates, [], monkeypatch) == Learned(first.rig, ("whole",))
    without_touches = written(candidates, [first.rig], monkeypatch)
    assert without_touches.rig == untouched(first.rig)
    assert without_touches.doubts == (
        "the filter of first leaves all bounds on one.csv",
        "whole",
    )
    next_best = written(candidates, [first.rig, untouched(first.rig)], monkeypatch)
    assert next_best.rig == second.rig
    assert next_best.doubts[1] == (
        "the filter of first, which looks for no touches, leaves all bounds on one.csv"
    )
    every = [rig for each in candidates for rig in (each.rig, untouched(each.rig))]
    last = written(candidates, every, monkeypatch)
    assert last.rig == first.rig
    assert len(last.doubts) == 6


def test_ctrl_c_at_the_last_step_leaves_what_was_learned(
    candidates: list[Candidate], monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Rig, "__hash__", stopped)  # the first thing that is done with a rig
    assert written(candidates, [], monkeypatch) == Learned(candidates[0].rig)
