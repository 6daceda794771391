"""What is written is a rig whose filter follows the logs that it was learned from."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from distal import Log, Rig, load_rig
from distal.confidence import BAND
from distal.errors import DivergedError
from distal.fitting.candidates import WRITTEN, Candidate, Compared, Training
from distal.fitting.learned_maps import Score, untouched
from distal.fitting.parameters_and_priors import Options
from distal.rig.validation import angle_names

FIT = sys.modules["distal.fitting.fit"]
LOG = Log(np.arange(3.0), {"x": np.zeros(3)}, source="one.csv")


@dataclass(frozen=True)
class Learned:
    rig: Rig
    doubts: tuple[str, ...] = ()
    compared: tuple[Compared, ...] = ()


@pytest.fixture
def candidates(pulley_rig: Rig) -> list[Candidate]:
    return [
        Candidate(name, rig, None, False, error, {})
        for name, rig, error in (
            ("first", pulley_rig, 0.01),
            ("third", load_rig("capstan-joint"), 0.03),
            ("second", load_rig("template"), 0.02),
        )
    ]


Written = Callable[..., Learned]


@pytest.fixture
def written(candidates: list[Candidate], monkeypatch: pytest.MonkeyPatch) -> Written:
    """Return what is written where the filters of some rigs leave all bounds, and the first errs by
    `error` with a band of ±`half`; logs left out had an error of 0.01 and a band of ±0.02, and a
    straight line errs by `line`.
    """

    compared = (Compared(0, "one.csv", {WRITTEN: Score(0.01, 0.95, 0.02)}),)
    made = SimpleNamespace(of=lambda _, one: Learned(one.rig, (), compared))
    monkeypatch.setattr(FIT, "reference_offset", lambda *_: 0.0)
    monkeypatch.setattr(FIT, "Fit", made)
    monkeypatch.setattr(
        FIT, "_with_free_motion", lambda learned, *_: replace(learned, doubts=("whole",))
    )

    def of(
        fails: Sequence[Rig] = (), error: float = 0.0, half: float = 0.02, line: float = 1.0
    ) -> Learned:
        def estimate(log: Log, rig: Rig, **_: object) -> SimpleNamespace:
            if rig in fails:
                raise DivergedError(log.source)
            first = rig == candidates[0].rig
            errors = np.full(3, error if first else 0)
            stds = np.full((3, 1), (half if first else 0.02) / BAND)
            return SimpleNamespace(errors=lambda: errors, angle_stds=stds)

        monkeypatch.setattr(FIT, "estimate", estimate)
        options = SimpleNamespace(compiled=False, homing=None)
        training = SimpleNamespace(options=options, line_error=line, logs=[LOG])
        judged = SimpleNamespace(candidates=candidates, training=training, chosen=candidates[0])
        return FIT._followed(judged, [LOG])

    return of


def test_a_rig_whose_filter_leaves_all_bounds_is_not_written(
    candidates: list[Candidate], written: Written
) -> None:
    first, _, second = candidates
    whole = written()
    assert (whole.rig, whole.doubts) == (first.rig, ("whole",))
    without_touches = written([first.rig])
    assert (without_touches.rig, without_touches.doubts) == (untouched(first.rig), ("whole",))
    next_best = written([first.rig, untouched(first.rig)])
    assert (next_best.rig, next_best.doubts) == (second.rig, ("whole",))
    last = written([rig for each in candidates for rig in (each.rig, untouched(each.rig))])
    assert last.rig == first.rig
    assert last.doubts[:2] == (
        "the filter of first leaves all bounds on one.csv",
        "the filter of first, which looks for no touches, leaves all bounds on one.csv",
    )
    assert last.doubts[6:] == (
        "no filter is written: the angles are those of the map on readings alone",
        "whole",
    )


def test_ctrl_c_at_the_last_step_leaves_what_was_learned(
    candidates: list[Candidate], written: Written, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Rig, "__hash__", stopped)  # the first thing that is done with a rig
    assert written().rig == candidates[0].rig


@pytest.mark.parametrize(
    ("found", "said"),
    [
        ({"error": 0.0195}, False),
        ({"error": 0.0205}, True),
        ({"half": 0.039}, False),
        ({"half": 0.041}, True),
    ],
)
def test_a_rig_whose_error_or_band_is_twice_what_was_promised_is_not_written(
    found: dict[str, float], said: bool, candidates: list[Candidate], written: Written
) -> None:
    """On the very logs that it was learned from."""
    first = candidates[0].rig
    assert written(**found).rig == (untouched(first) if said else first)


def test_a_filter_that_errs_twice_as_much_as_a_straight_line_is_not_written(
    written: Written,
) -> None:
    """The next ones do too, so that readings alone are left."""
    assert written(line=0.0051).doubts == ("whole",)
    doubts = written(line=0.0049).doubts
    assert doubts[0] == (
        "the filter of first errs by 0.57° on logs left out, a straight line of the readings by "
        "0.28°"
    )
    assert len(doubts) == 5


def test_the_straight_line_is_judged_on_logs_left_out(pulley_rig: Rig) -> None:
    """Angles that are a line of the readings are known by it, others are not."""
    rig = pulley_rig
    time = np.linspace(0, 2, 201)
    names = [sensor.name for sensor in rig.sensors]
    options = Options()

    def line_error(bend: float) -> float:
        logs = []
        for k in range(3):
            reading = np.sin((k + 1) * time)
            channels = {name: (i + 1) * 0.01 * reading for i, name in enumerate(names)}
            angles = 0.3 * reading + bend * reading**2
            truth = dict.fromkeys(angle_names(rig.joint_names), angles)
            logs.append(Log(time, channels, truth, source=f"{k}.csv"))
        return Training.of(logs, rig, options).line_error

    assert line_error(0.0) < 1e-9
    # 0.1 s² less its mean over each sine has an RMS near 0.1 / √8
    assert 0.03 < line_error(0.1) < 0.06
