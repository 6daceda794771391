"""Rows: the same numbers as one simulation and one estimate, and what is known in closed form."""

from __future__ import annotations

from math import erf, sqrt
from pathlib import Path

import numpy as np
import pytest

from distal import estimate, load_rig, simulate
from distal.errors import StudyError
from distal.estimators import AdaptiveFilter
from distal.results import Estimate
from distal.study.design_space import rig_of, space_of
from distal.study.kernels import Kernels, _masked
from distal.study.plants import built_values, draws_of, scores
from distal.study.runs import NOMINAL, Task, run_chunk, run_tasks
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


def test_a_filter_takes_the_numbers_of_another_rig() -> None:
    """All but random walks and bounds, which are a hair's breadth in a short log."""
    base = load_rig("paper-2008-observed").with_values({"joints.link.initial": "-25 deg"})
    known = AdaptiveFilter(base, inputs=("sensors.1.noise", "sensors.3.noise"))
    changes = {
        "tendons.*.stiffness": 500.0,
        "sensors.u1.noise": 0.25,
        "tendons.left.insertion.radius": "10 mm",
    }
    other = base.with_values({**changes, "joints.link.friction.coefficient.std": 0.05})
    log = simulate(other, small(duration="0.3 s").scenarios[0], 2)
    taken = known.of_rig(other)
    assert taken is not None
    assert taken.kernel is known.kernel
    whole = estimate(log, other)
    np.testing.assert_allclose(estimate(log, other, taken).angles, whole.angles, atol=1e-6)
    assert np.abs(estimate(log, other, known).angles - whole.angles).max() > 1e-4
    # load cells so bad that they do not see the friction of the sliders: there are fewer states
    assert known.of_rig(base.with_values({"sensors.u1.noise": 3.0})) is None


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
    plan = small(vary={"sensors.x1": [True, False], "sensors.x2": [True, False]}, fill="grid")
    rows = run_chunk(plan, range(4))
    problems = [str(text) for text in rows["problem"]]
    assert [bool(text) for text in problems] == [False] * 6 + [True] * 2
    assert "needs" in problems[-1] or "sensor" in problems[-1]
    assert rows["met"][-1] is False
    assert np.isnan(float(rows["rms_deg"][-1] or 0.0))


def test_a_scenario_that_is_not_asked_is_neither_met_nor_not() -> None:
    asked = {"joint": "link", "within": "1 deg", "scenarios": ["series-2"]}
    plan = small(scenarios=["series-2", "series-2-high"], requirement=asked, designs=1)
    rows = run_chunk(plan, [0])
    assert [met is None for met in rows["met"]] == [name != "series-2" for name in rows["scenario"]]


def test_the_nominal_plant_is_the_rig() -> None:
    (found,) = run_tasks(small(), [Task(0, {}, NOMINAL, 0)])
    assert isinstance(found, Estimate)
    assert found.truths is not None
    assert found.truths[0, 0] == pytest.approx(np.deg2rad(-25.0), abs=1e-9)


@pytest.mark.slow
def test_a_row_does_not_depend_on_what_ran_before(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a kernel has as constants, such as random walks, is that of the first design of its
    structure.
    """
    vary = {
        "joints.link.friction.coefficient.std": {"from": 0.02, "to": 0.2},
        "sensors.u1.noise": [0.3, 0.05],
    }
    plan, found = small(vary=vary, designs=8, duration="2 s"), []
    for designs in ([5, 2, 7], [7], [0, 1, 2, 3, 7]):
        monkeypatch.setattr("distal.study.runs._KERNELS", Kernels())
        found.append(run_chunk(plan, designs)["rms_deg"][-1])
    assert found[0] == found[1] == found[2]


def test_a_closed_loop_is_asked_for_its_reference() -> None:
    """The joint that is fed back by displacements stays behind; what is told of it is judged
    apart.
    """
    asked = {"joint": "link", "within": "6 deg", "time": "50 %"}
    vary = {"feedback": ["encoder", "adaptive", "ratio", "command"]}
    plan = small(
        scenarios=["control-paper"],
        vary=vary,
        fill="grid",
        seeds=1,
        duration="5 s",
        requirement=asked,
    )
    rows = run_chunk(plan, [0, 1, 2, 3])
    assert rows["problem"] == ["", "", "", ""]
    assert rows["feedback"] == ["encoder", "adaptive", "ratio", "command"]
    encoder, adaptive, ratio, command = (float(value or 0.0) for value in rows["rms_deg"])
    assert encoder == pytest.approx(adaptive, rel=0.3)
    assert command < 1.2 * encoder
    assert ratio > 2.0 * encoder
    assert rows["met"] == [True, True, False, True]
    with pytest.raises(
        StudyError, match=r"vary\.feedback: no scenario of the study has a \[control\] table"
    ):
        space_of(small(vary={"feedback": ["encoder"]}))
    with pytest.raises(
        StudyError, match=r"vary\.feedback: unknown 'encodr'; did you mean 'encoder'\?"
    ):
        space_of(small(vary={"feedback": ["encodr"]}))


def test_numbers_have_one_structure_where_the_equations_ask_the_same_of_them() -> None:
    """Absent, one, known, and known to a half or to a fifth: across these a kernel is not shared,
    within them it is.
    """

    def of(value: float, std: float, **more: object) -> object:
        return _masked({"part": [{"value": value, "std": std, **more}]})

    alike = (
        [(3.0, 0.0), (-4.0, 0.0)],
        [(3.0, 0.3), (-4.0, 0.7)],
        [(3.0, 0.9), (-4.0, 1.9)],
        [(3.0, 1.6), (-4.0, 9.0)],
    )
    alike += [(0.0, 0.0)], [(1.0, 0.0)], [(1.0, 0.1)], [(0.0, 1.0), (0.0, 2.0)]
    kinds = [{repr(of(*pair)) for pair in group} for group in alike]
    assert all(len(kind) == 1 for kind in kinds)
    assert len(set.union(*kinds)) == len(kinds)
    shared = {"name": "all", "std": 0.1}
    more = [
        {},
        {"hold": True},
        {"drift": 0.1},
        {"shared": shared},
        {"shared": {"name": "some", "std": 0.1}},
    ]
    assert len({repr(of(3.0, 0.3, **each)) for each in more}) == len(more)
    assert of(3.0, 0.3, shared=shared) == of(3.0, 0.3, shared={"name": "all", "std": 0.2})
