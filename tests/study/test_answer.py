"""What rows say: shares with their intervals, indices, sentences; and the page that shows them."""

from __future__ import annotations

import json
import re
from math import sqrt
from pathlib import Path

import numpy as np
import pytest

from distal.errors import StudyError
from distal.reports import study_report
from distal.study import Plan, Space, space_of
from distal.study.answer import Answer, Verdict, answer_of, proportion
from distal.study.runs import MEASURES, Columns
from tests.study.plans import small

STIFF, NOISE = "tendons.*.stiffness", "sensors.u1.noise"


def test_the_interval_of_a_share_is_wilsons() -> None:
    found = proportion(np.array([True] * 97 + [False] * 3))
    n, p, z = 100, 0.97, 1.959964
    centre, half = (
        (p + z * z / (2 * n)) / (1 + z * z / n),
        z / (1 + z * z / n) * sqrt(p * (1 - p) / n + (z / n / 2) ** 2),
    )
    assert (found.share, found.met) == (0.97, 97)
    assert found.low == pytest.approx(centre - half, abs=1e-6)
    assert found.high == pytest.approx(centre + half, abs=1e-6)
    assert str(found) == "97 % (95 % interval 92 to 99 %)"


def made(plan: Plan, space: Space, rms: np.ndarray) -> Columns:
    """Return rows with given RMS errors; a rig meets the requirement below 1 degree."""
    n, names = len(rms), sorted(plan.study.scenarios)
    each = plan.study.seeds * len(names)
    designs = [space.design(i // each) for i in range(n)]
    columns: Columns = {
        axis.path: np.array([one[axis.path] for one in designs]) for axis in space.axes
    }
    columns |= {
        "design": np.arange(n) // each,
        "seed": np.arange(n) // len(names) % plan.study.seeds,
    }
    columns["scenario"] = np.array([names[k % len(names)] for k in range(n)])
    columns |= dict.fromkeys(MEASURES, rms)
    columns |= {
        "met": rms < 1.0,
        "problem": np.array([""] * n),
        "seconds": np.ones(n),
    }
    return columns


@pytest.fixture(scope="module")
def linear() -> tuple[Plan, Space]:
    vary = {STIFF: {"from": "500 N/m", "to": "1500 N/m"}, NOISE: {"from": 0.1, "to": 0.3}}
    plan = small(designs=600, vary=vary)
    return plan, space_of(plan)


def test_the_sentence_says_what_the_rows_say(linear: tuple[Plan, Space]) -> None:
    plan, space = linear
    half = answer_of(plan, space, made(plan, space, np.repeat(2.0 * space.shares[:, 0], 2)))
    assert half.overall.share == pytest.approx(0.5, abs=0.01)
    assert half.sentence.startswith(
        "Without an encoder: no. 50 % (95 % interval 47 to 53 %) of 1,200 rigs as built stay"
    )
    assert "within ±1° for 95 % of the time in series-2. Best" in half.sentence
    assert "Best: stiffness of all tendons 500 N/m to 750 N/m" in half.sentence
    well = answer_of(plan, space, made(plan, space, np.full(1200, 0.5)))
    assert well.sentence.startswith("Without an encoder: yes. 100 %")
    some = np.where(np.arange(1200) % 20 == 0, 2.0, 0.5)
    assert "encoder: not certain. 95 %" in answer_of(plan, space, made(plan, space, some)).sentence


NEEDS = {
    "no": (lambda u1, stiff: 0.5 * np.ones(len(u1)), Verdict.NOT_NEEDED, Verdict.NOT_NEEDED),
    "the sensor": (lambda u1, stiff: np.where(u1, 0.5, 2.0), Verdict.NEEDED, Verdict.NOT_NEEDED),
    "stiffness": (
        lambda u1, stiff: np.where(stiff < 0.5, 2.0, 0.5),
        Verdict.NOT_NEEDED,
        Verdict.SOME,
    ),
    "one of both": (
        lambda u1, stiff: np.where(u1 | (stiff > 0.5), 0.5, 2.0),
        Verdict.NOT_NEEDED,
        Verdict.NOT_NEEDED,
    ),
    "both": (
        lambda u1, stiff: np.where(u1 & (stiff > 0.5), 0.5, 2.0),
        Verdict.NEEDED,
        Verdict.SOME,
    ),
    "who knows": (
        lambda u1, stiff: np.where(u1 | (np.arange(len(u1)) % 20 > 0), 0.5, 2.0),
        Verdict.NOT_CERTAIN,
        Verdict.NOT_NEEDED,
    ),
    "more": (lambda u1, stiff: 2.0 * np.ones(len(u1)), Verdict.NOT_ENOUGH, Verdict.NOT_ENOUGH),
}


@pytest.mark.parametrize("needed", NEEDS)
def test_it_says_of_a_sensor_and_of_a_number_whether_it_is_needed(needed: str) -> None:
    """A rig without the sensor may be right with stiffer tendons: it is judged where what else
    varies is as it is best.
    """
    vary = {STIFF: {"from": "500 N/m", "to": "5 kN/m"}, "sensors.u1": [True, False]}
    plan = small(designs=2000, seeds=1, vary=vary)
    space = space_of(plan)
    u1 = np.array([bool(space.design(k)["sensors.u1"]) for k in range(len(space))])
    stiff = np.array([(float(space.design(k)[STIFF]) - 500.0) / 4500.0 for k in range(len(space))])
    rule, of_sensor, of_stiffness = NEEDS[needed]
    found = answer_of(plan, space, made(plan, space, rule(u1, stiff)))
    verdicts = {need.name: need.verdict for need in found.needs}
    assert verdicts == {STIFF: of_stiffness, "sensors.u1": of_sensor}
    assert ("; needed: sensor u1" in found.sentence) == (of_sensor is Verdict.NEEDED)


def test_a_rig_has_to_meet_the_requirement_in_all_scenarios() -> None:
    plan = small(scenarios=["series-2", "series-2-high"], designs=100, seeds=1)
    space = space_of(plan)
    rms = np.where(np.arange(200) % 4 == 1, 2.0, 0.5)
    found = answer_of(plan, space, made(plan, space, rms))
    assert found.overall.share == 0.5
    assert {name: one.share for name, one in found.scenarios.items()} == {
        "series-2": 1.0,
        "series-2-high": 0.5,
    }
    assert "worst: series-2-high" in found.sentence


def test_a_study_that_is_not_done_has_no_answer(linear: tuple[Plan, Space]) -> None:
    plan, space = linear
    with pytest.raises(StudyError, match="3 rows came of 1200; run the study to its end"):
        answer_of(plan, space, made(plan, space, np.ones(3)))


@pytest.mark.parametrize("texts", [["no room"], ["no room", "no room", "left all bounds"]])
def test_where_every_run_failed_there_is_no_answer(
    linear: tuple[Plan, Space], texts: list[str]
) -> None:
    """However many of them say the same."""
    plan, space = linear
    columns = made(plan, space, np.full(1200, np.nan))
    columns["problem"] = np.array([texts[k % len(texts)] for k in range(1200)])
    with pytest.raises(StudyError, match="every run failed, so there is no answer: no room"):
        answer_of(plan, space, columns)


def test_a_study_of_which_some_runs_failed_has_an_answer(linear: tuple[Plan, Space]) -> None:
    """Two of them with one message, as many as there are texts; or all but one."""
    plan, space = linear
    for failed in (2, 1199):
        rms = np.full(1200, 0.5)
        rms[:failed] = np.nan
        columns = made(plan, space, rms)
        columns["problem"] = np.where(np.arange(1200) < failed, "no room", "")
        answer = answer_of(plan, space, columns)
        assert answer.problems == {"no room": failed}
        assert answer.overall.met == 1200 - failed


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Answer]:
    vary = {STIFF: {"from": "500 N/m", "to": "5 kN/m", "scale": "log"}, "sensors.u1": [True, False]}
    plan = small(designs=120, seeds=1, vary=vary, name="Stiff & <good>?")
    space, folder = space_of(plan), tmp_path_factory.mktemp("page")
    columns = made(plan, space, 2.0 * space.shares[:, 0])
    answer = answer_of(plan, space, columns)
    study_report(plan, space, answer, folder)
    return folder / "index.html", answer


def test_the_page_is_one_file_that_fetches_nothing_and_the_answer_is_json_too(
    shown: tuple[Path, Answer],
) -> None:
    text = shown[0].read_text(encoding="utf-8")
    assert not re.findall(r"(?:src|href)\s*=\s*['\"]?(?:https?:)?//", text)
    assert "Stiff &amp; &lt;good&gt;?" in text
    assert shown[1].sentence.replace("'", "&#x27;") in text
    assert text.count("<figure>") == 1  # the rig
    said = json.loads((shown[0].parent / "answer.json").read_text(encoding="utf-8"))
    assert said["sentence"] == shown[1].sentence
    assert said["overall"]["rigs"] == 120
