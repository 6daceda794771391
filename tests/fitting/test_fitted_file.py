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
    Training,
    filter_candidate,
    readings_map,
    with_parts,
)
from distal.fitting.fit import Fit, _without_guesses, plain_value
from distal.fitting.learned_maps import Score
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


@pytest.mark.parametrize("which", [1, 2])
def test_each_candidate_is_written(which: int, found: Found, text: str, tmp_path: Path) -> None:
    """As it was judged, with the std that the screen says; also into a file of its own."""
    candidate = found.candidates[which]
    result = found.learned(candidate)
    written = check(result, text, tmp_path / "fitted.toml")
    assert "# bought in March" in written
    assert load_rig(tmp_path / "fitted.toml").bare() == candidate.rig.bare()
    check(result, None, tmp_path / "anew.toml")
    moved = [part for part in result.fitted if not part.noise and part.value != part.start]
    assert bool(moved) == (candidate.parameters is not None)
    for part in moved:
        std = max(part.std, 0.002 * abs(part.value))
        assert number(result.rig, part.paths[0]).std == pytest.approx(std, rel=0.01)


@pytest.fixture(scope="module")
def first(found: Found) -> Fit:
    return found.learned(found.candidates[0])


@pytest.mark.parametrize(("share", "said"), [(0.4, False), (0.6, True)])
def test_an_encoders_zero_that_no_score_shows_is_said(share: float, said: bool, first: Fit) -> None:
    result = replace(first, reference_offset=share * first.scores()[0][1])
    assert any("whose own zero may be off by" in line for line in result.advice()) == said


@pytest.mark.parametrize(("ratio", "said"), [(0.94, True), (0.97, False)])
def test_another_way_that_errs_less_is_said_first(ratio: float, said: bool, first: Fit) -> None:
    """By more than 5 %."""
    name = "least squares with lags"
    scores = {WRITTEN: Score(0.01, 0.95, 0.02), name: Score(0.01 * ratio, np.nan, np.nan)}
    answer = replace(first, compared=(Compared(0, "log", scores),)).answer()
    assert answer.startswith(f"another way errs less than what is written, {name}") == said
    assert f"{name}: " in answer
    assert replace(first, compared=()).answer() == ""


def test_one_that_was_interrupted_is_written(
    found: Found, text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C while candidates are judged leaves the best so far with its map and its scores."""
    calls = list[str]()

    def judged_so_far(name: str, *arguments: object) -> Candidate:
        if calls:
            raise KeyboardInterrupt
        calls.append(name)
        return filter_candidate(name, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(judging, "filter_candidate", judged_so_far)
    judged = judging.judge(found.logs, found.rig, OPTIONS)
    assert [candidate.name for candidate in judged.candidates] == calls
    learned = Fit.of(judged, judged.chosen)
    assert learned.interrupted
    assert "filter" in learned.maps
    assert len(learned.compared) == 3
    written = check(learned, text, tmp_path / "fitted.toml")
    assert "interrupted" in written


def test_without_an_angle_parameters_alone_are_written(
    found: Found, text: str, tmp_path: Path
) -> None:
    unknown = replace(found.training, unknown=("finger",))
    judged = Judged(found.logs, unknown, None, found.solutions, [], False)
    result = Fit.of(judged, judged.chosen)
    assert any("the angle of finger is known in no log" in doubt for doubt in result.doubts)
    check(result, text, tmp_path / "fitted.toml")


def test_the_text_of_another_rig_is_refused(first: Fit, text: str, tmp_path: Path) -> None:
    other = text.replace('name = "finger"', 'name = "thumb"').replace('"finger"', '"thumb"')
    with pytest.raises(RigError, match="not that of the rig that was fitted"):
        first.save(tmp_path / "fitted.toml", other)
    assert not (tmp_path / "fitted.toml").exists()


def test_what_does_not_fit_into_the_text_is_written_anew(
    first: Fit, text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A result is not lost for the comments of a file."""
    monkeypatch.setattr(import_module("distal.fitting.fit"), "_put_into", lambda *_: text)
    with pytest.warns(DistalWarning, match="written anew"):
        first.save(tmp_path / "fitted.toml", text)
    assert load_rig(tmp_path / "fitted.toml") == first.rig


def test_a_guess_is_none_once_its_value_was_found() -> None:
    before = [
        "mass = 1 # not in the logs: masses",
        "kept = 2 # not in the logs: masses",
        "arms = [{ value = 3 }, { value = 4 }] # not in the logs: arms",
    ]
    found = "\n".join(before).replace("1", "5").replace("4", "6")
    assert _without_guesses(found, "\n".join(before)).split("\n") == [
        "mass = 5",
        before[1],
        "arms = [{ value = 3 }, { value = 6 }] # partly not in the logs: arms",
    ]
