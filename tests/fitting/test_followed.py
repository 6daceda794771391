"""What is written is a rig whose filter follows the logs that it was learned from."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest

from distal import Log, Rig, load_rig
from distal.confidence import BAND
from distal.errors import DivergedError
from distal.fitting.learn_free_motion import untouched
from distal.fitting.scores import WRITTEN, Compared, Score

FIT = sys.modules["distal.fitting.fit"]
LOG = Log(np.arange(3.0), {"x": np.zeros(3)}, source="one.csv")


@dataclass(frozen=True)
class Candidate:
    name: str
    rig: Rig
    error: float
    data: Mapping[int, object] = field(default_factory=dict)


@dataclass(frozen=True)
class Learned:
    rig: Rig
    doubts: tuple[str, ...] = ()
    compared: tuple[Compared, ...] = ()


@pytest.fixture
def candidates(pulley_rig: Rig) -> list[Candidate]:
    return [
        Candidate("first", pulley_rig, 0.01),
        Candidate("third", load_rig("capstan-joint"), 0.03),
        Candidate("second", load_rig("template"), 0.02),
    ]


def written(
    candidates: list[Candidate],
    fails: list[Rig],
    monkeypatch: pytest.MonkeyPatch,
    error: float = 0.0,
    half: float = 0.02,
    spread: float = 1.0,
) -> Learned:
    """Return what is written where the filters of some rigs leave all bounds, and the first errs by
    `error` with a band of ±`half`; logs left out had an error of 0.01 and a band of ±0.02, and the
    angles vary by `spread`.
    """

    def estimate(log: Log, rig: Rig, **_: object) -> SimpleNamespace:
        if rig in fails:
            raise DivergedError(log.source)
        first = rig == candidates[0].rig
        errors = np.full(3, error if first else 0)
        stds = np.full((3, 1), (half if first else 0.02) / BAND)
        return SimpleNamespace(errors=lambda: errors, angle_stds=stds)

    compared = (Compared("one.csv", {WRITTEN: Score(0.01, 0.95, 0.02)}),)
    monkeypatch.setattr(FIT, "estimate", estimate)
    monkeypatch.setattr(FIT, "reference_offset", lambda *_: 0.0)
    monkeypatch.setattr(FIT, "learned_by", lambda _, one: Learned(one.rig, (), compared))
    monkeypatch.setattr(
        FIT, "_with_free_motion", lambda learned, *_: replace(learned, doubts=("whole",))
    )
    options = SimpleNamespace(compiled=False, homing=None)
    training = SimpleNamespace(options=options, spread=spread)
    judged = SimpleNamespace(candidates=candidates, training=training, chosen=candidates[0])
    return FIT._followed(judged, [LOG])


def test_a_rig_whose_filter_leaves_all_bounds_is_not_written(
    candidates: list[Candidate], monkeypatch: pytest.MonkeyPatch
) -> None:
    first, _, second = candidates
    whole = written(candidates, [], monkeypatch)
    assert (whole.rig, whole.doubts) == (first.rig, ("whole",))
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
    assert last.doubts[6:] == (
        "no filter is written: the angles are those of the map on readings alone",
        "whole",
    )


def test_ctrl_c_at_the_last_step_leaves_what_was_learned(
    candidates: list[Candidate], monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Rig, "__hash__", stopped)  # the first thing that is done with a rig
    assert written(candidates, [], monkeypatch).rig == candidates[0].rig


@pytest.mark.parametrize(("error", "said"), [(0.0195, False), (0.0205, True)])
def test_a_rig_that_errs_twice_what_was_promised_is_not_written(
    error: float, said: bool, candidates: list[Candidate], monkeypatch: pytest.MonkeyPatch
) -> None:
    """On the very logs that it was learned from."""
    result = written(candidates, [], monkeypatch, error)
    assert result.rig == (untouched(candidates[0].rig) if said else candidates[0].rig)
    line = "the filter of first errs by 1.2° on one.csv, where left out it had 0.57°"
    assert (line in result.doubts) == said


@pytest.mark.parametrize(("half", "said"), [(0.039, False), (0.041, True)])
def test_a_rig_whose_band_is_twice_what_was_promised_is_not_written(
    half: float, said: bool, candidates: list[Candidate], monkeypatch: pytest.MonkeyPatch
) -> None:
    result = written(candidates, [], monkeypatch, half=half)
    line = "the filter of first knows the angle to ±2.3° on one.csv, where left out it had 1.1°"
    assert (line in result.doubts) == said


def test_a_filter_that_errs_by_more_than_the_angles_vary_is_not_written(
    candidates: list[Candidate], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The mean of the angles errs less; the next ones do too, so that readings alone are left."""
    result = written(candidates, [], monkeypatch, spread=0.015)
    assert result.rig == candidates[0].rig
    result = written(candidates, [], monkeypatch, spread=0.005)
    assert result.doubts[0] == (
        "the filter of first errs by 0.57° on logs left out, where the angles vary by 0.29°"
    )
    assert len(result.doubts) == 5
