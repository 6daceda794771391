"""Rows: the same numbers as one simulation and one estimate, and what is known in closed form."""

from __future__ import annotations

from dataclasses import replace
from math import erf, sqrt
from pathlib import Path

import numpy as np
import pytest

from distal import estimate, simulate
from distal.results import Estimate
from distal.study.design_space import built_values, draws_of, rig_of, scores, space_of
from distal.study.runs import _SPACES, Task, run_chunk, run_tasks
from tests.study.plans import small, still


def test_a_run_is_a_simulation_of_the_plant_and_an_estimate_with_the_rig() -> None:
    plan = small(duration="0.3 s")
    design = {"tendons.*.stiffness": 760.0}
    (found,) = run_tasks(plan, [Task(4, design, 1, 0)])
    assert isinstance(found, Estimate)
    (scenario,) = plan.scenarios
    rig = rig_of(plan.rig.with_values(scenario.set), design)
    draws = draws_of(rig)
    plant = built_values(rig, draws, scores(draws, (1, 4, 1)))
    seed = int(np.random.SeedSequence([1, 4, 1, 0, 1]).generate_state(1)[0])
    alone = estimate(simulate(rig, scenario.model_copy(update={"plant": plant}), seed), rig)
    assert found.truths is not None
    assert alone.truths is not None
    np.testing.assert_allclose(found.truths, alone.truths, atol=1e-12)
    np.testing.assert_allclose(found.angles, alone.angles, atol=1e-7)


def test_the_share_of_a_requirement_is_that_of_a_known_normal_distribution(tmp_path: Path) -> None:
    """Nothing moves and nothing but the angle at the start is unknown: the error is that angle's,
    N(0, 3°).
    """
    plan = still(tmp_path, designs=50, seeds=2, requirement={"joint": "link", "within": "3 deg"})
    rows = run_chunk(plan, range(50))
    assert all(0.0 < float(str(seconds)) < 10.0 for seconds in rows["seconds"])  # for each run
    score = np.array(rows["built: joints.link.initial"], dtype=float)
    np.testing.assert_allclose(
        np.array(rows["rms_deg"], dtype=float), np.abs(3.0 * score), atol=0.1
    )
    share, expected = np.mean(np.array(rows["met"], dtype=bool)), erf(1 / sqrt(2))
    assert share == pytest.approx(expected, abs=3 * sqrt(expected * (1 - expected) / 100))


def test_an_error_is_a_row() -> None:
    plan = small(
        vary={"sensors.x1": [True, False], "sensors.x2": [True, False]}, designs=8, seeds=1
    )
    rows = run_chunk(plan, range(8))
    problems = [str(text) for text in rows["problem"]]
    blind = [not (x1 or x2) for x1, x2 in zip(rows["sensors.x1"], rows["sensors.x2"])]
    assert [bool(text) for text in problems] == blind
    last = blind.index(True)
    assert "needs" in problems[last] or "sensor" in problems[last]
    assert rows["met"][last] is False
    assert np.isnan(float(rows["rms_deg"][last] or 0.0))


@pytest.mark.slow
def test_a_row_does_not_depend_on_what_ran_before() -> None:
    """Designs that share a kernel have their own random walks and noises."""
    vary = {
        "joints.link.friction.coefficient.std": {"from": 0.02, "to": 0.2},
        "sensors.u1.noise": [0.3, 0.05],
    }
    plan, found = small(vary=vary, designs=8, duration="2 s"), []
    for designs in ([5, 2, 7], [7], [0, 1, 2, 3, 7]):
        found.append(run_chunk(plan, designs)["rms_deg"][-1])
    assert found[0] == found[1] == found[2]


def test_a_closed_loop_is_asked_for_its_reference(monkeypatch: pytest.MonkeyPatch) -> None:
    """The joint that is fed back by displacements stays behind; what is told of it is judged
    apart.
    """
    asked = {"joint": "link", "within": "6 deg", "time": "50 %"}
    vary = {"feedback": ["encoder", "adaptive", "ratio", "command"]}
    plan = small(
        scenarios=["control-paper"],
        vary=vary,
        seeds=1,
        duration="5 s",
        requirement=asked,
    )
    shares = np.array([[0.1], [0.4], [0.6], [0.9]])
    monkeypatch.setitem(_SPACES, plan.digest, replace(space_of(plan), shares=shares))
    rows = run_chunk(plan, [0, 1, 2, 3])
    assert rows["problem"] == ["", "", "", ""]
    assert rows["feedback"] == ["encoder", "adaptive", "ratio", "command"]
    encoder, adaptive, ratio, command = (float(value or 0.0) for value in rows["rms_deg"])
    assert encoder == pytest.approx(adaptive, rel=0.3)
    assert command < 1.2 * encoder
    assert ratio > 2.0 * encoder
    assert rows["met"] == [True, True, False, True]
