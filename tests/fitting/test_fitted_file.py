"""The file that a fit writes reads as the fitted rig, to the last number, whichever way it came."""

from __future__ import annotations

import warnings
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import tomlkit

from distal import Rig, load_rig
from distal.errors import DistalWarning, RigError
from distal.fitting import candidates as judging
from distal.fitting.candidates import (
    WRITTEN,
    Candidate,
    Compared,
    Judged,
    MissingTerm,
    Score,
    Training,
    filter_candidate,
    readings_map,
    with_parts,
)
from distal.fitting.fit import Fit, plain_value
from distal.fitting.parameter_search import parameters_of, problem_of
from distal.fitting.parameters_and_priors import Options
from distal.rig import build_rig, number, parse_toml
from tests.support.foreign_plants import finger_log, finger_rig

OPTIONS = Options(workers=1)
BACKLASH = {"drives.motor.backlash.width": {"value": 0.01, "std": 0.01}}


def text_of(rig: Rig) -> str:
    """Return the rig as somebody types it: with comments and percentages."""
    raw = plain_value(rig.model_dump(exclude_defaults=True))
    tendon = raw["tendons"][0]  # type: ignore[index]
    tendon["stiffness"] = {"value": "8 N/mm", "std": "100 %"}
    raw["joints"][0]["damping"] = {  # type: ignore[index]
        "value": "1e-3 N m s",
        "std": "30 %",
        "drift": "1 %",
    }
    return "# my finger\n" + tomlkit.dumps(raw).replace(
        "[[tendons]]", "# bought in March\n[[tendons]]"
    )


@pytest.fixture(scope="module")
def text() -> str:
    return text_of(finger_rig().bare())


@pytest.fixture(scope="module")
def rig(text: str) -> Rig:
    return build_rig(parse_toml(text, "mine", RigError), "mine")


class Found:
    """What one search of a fit finds: every candidate, and what each would be written from."""

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self.logs = [replace(finger_log(seed, 3.0), source=f"log {seed}") for seed in range(3)]
        self.training = Training.of(self.logs, rig, OPTIONS)
        self.line = readings_map(self.training)
        self.solutions = parameters_of(problem_of(self.logs, rig, OPTIONS), OPTIONS, None)
        play = [MissingTerm("play", BACKLASH)]
        named = with_parts(play, self.logs, rig, OPTIONS, self.solutions[0])
        ways = [
            *judging._ways(self.training, self.solutions),
            *(
                (
                    part.name,
                    replace(self.training, rig=rig.with_values(part.values), part=part),
                    way,
                )
                for part, way in named
            ),
        ]
        self.candidates = [filter_candidate(*way) for way in ways]

    def learned(self, candidate: Candidate) -> Fit:
        """Return what a candidate teaches."""
        judged = Judged(self.logs, self.training, self.line, self.solutions, self.candidates, False)
        return Fit.of(judged, candidate)


@pytest.fixture(scope="module")
def found(rig: Rig) -> Found:
    return Found(rig)


def check(result: Fit, text: str | None, path: Path) -> str:
    """Write what was learned and read it again."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        result.save(path, text)
    assert load_rig(path) == result.rig
    return path.read_text(encoding="utf-8")


@pytest.mark.parametrize("which", [0, 1, pytest.param(2, marks=pytest.mark.more)])
def test_each_candidate_is_written(which: int, found: Found, text: str, tmp_path: Path) -> None:
    """As it was judged."""
    candidate = found.candidates[which]
    written = check(found.learned(candidate), text, tmp_path / "fitted.toml")
    assert "# bought in March" in written
    assert load_rig(tmp_path / "fitted.toml").bare() == candidate.rig.bare()


@pytest.mark.parametrize(("share", "said"), [(0.0, False), (0.4, False), (0.6, True)])
def test_an_encoders_zero_that_no_score_shows_is_said(
    share: float, said: bool, found: Found
) -> None:
    result = found.learned(found.candidates[0])
    result = replace(result, reference_offset=share * result.scores()[0][1])
    assert any("whose own zero may be off by" in line for line in result.advice()) == said


@pytest.mark.parametrize(("ratio", "said"), [(0.94, True), (0.97, False)])
def test_another_way_that_errs_less_is_said_first(ratio: float, said: bool, found: Found) -> None:
    """By more than 5 %."""
    result = found.learned(found.candidates[0])
    name = "least squares with lags"
    scores = {WRITTEN: Score(0.01, 0.95, 0.02), name: Score(0.01 * ratio, np.nan, np.nan)}
    answer = replace(result, compared=(Compared(0, "log", scores),)).answer()
    assert answer.startswith(f"another way errs less than what is written, {name}") == said
    assert f"{name}: " in answer
    assert "readings" not in replace(result, compared=()).answer()


def test_the_screen_and_the_file_say_the_same_std(found: Found) -> None:
    parameters = found.solutions[0]
    result = found.learned(next(c for c in found.candidates if c.parameters is parameters))
    for part in result.fitted:
        if not part.noise and part.value != part.start:
            written = number(result.rig, part.paths[0])
            assert written.std == pytest.approx(max(part.std, 0.002 * abs(part.value)), rel=0.01)


def test_the_candidates_are_of_each_kind(found: Found) -> None:
    names = [candidate.name for candidate in found.candidates]
    assert len(set(names)) == len(names) == 3
    assert sum("play" in name for name in names) == 1


def test_a_file_of_its_own_is_written_anew(found: Found, tmp_path: Path) -> None:
    candidate = found.candidates[0]
    check(found.learned(candidate), None, tmp_path / "fitted.toml")


@pytest.mark.parametrize("after", [pytest.param(0, marks=pytest.mark.more), 1])
def test_one_that_was_interrupted_is_written(
    after: int, found: Found, text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C while candidates are judged leaves the best so far with its map and its scores, before
    the first the parameters.
    """
    calls = list[str]()

    def judged_so_far(name: str, *arguments: object) -> Candidate:
        if len(calls) == after:
            raise KeyboardInterrupt
        calls.append(name)
        return filter_candidate(name, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(judging, "filter_candidate", judged_so_far)
    judged = judging.judge(found.logs, found.rig, OPTIONS)
    assert [candidate.name for candidate in judged.candidates] == calls
    learned = Fit.of(judged, judged.chosen)
    assert learned.interrupted
    assert ("filter" in learned.maps, len(learned.compared)) == (after == 1, 3 * after)
    written = check(learned, text, tmp_path / "fitted.toml")
    assert "interrupted" in written


def test_without_an_angle_parameters_alone_are_written(
    found: Found, text: str, tmp_path: Path
) -> None:
    judged = Judged(found.logs, found.training, None, found.solutions, [], False)
    check(Fit.of(judged, judged.chosen), text, tmp_path / "fitted.toml")


def test_the_text_of_another_rig_is_refused(found: Found, text: str, tmp_path: Path) -> None:
    result = found.learned(found.candidates[0])
    other = text.replace('name = "finger"', 'name = "thumb"').replace('"finger"', '"thumb"')
    with pytest.raises(RigError, match="not that of the rig that was fitted"):
        result.save(tmp_path / "fitted.toml", other)
    assert not (tmp_path / "fitted.toml").exists()


def test_what_does_not_fit_into_the_text_is_written_anew(
    found: Found, text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A result is not lost for the comments of a file."""
    monkeypatch.setattr(import_module("distal.fitting.fit"), "_put_into", lambda *_: text)
    candidate = next(c for c in found.candidates if c.parameters is not None)
    assert candidate.parameters is not None
    result = found.learned(candidate)
    with pytest.warns(DistalWarning, match="written anew"):
        result.save(tmp_path / "fitted.toml", text)
    assert load_rig(tmp_path / "fitted.toml") == result.rig
