"""What varies, and how designs fill the space of it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from distal.errors import DistalError, StudyError
from distal.study import load_study, plan_of, shipped_studies, space_of
from distal.study.design_space import rig_of
from tests.study.plans import RAW, small

STIFF = "tendons.*.stiffness"
THREE = (STIFF, "joints.link.damping", "joints.link.inertia")


def test_a_latin_hypercube_has_one_design_in_each_part() -> None:
    axes = {
        STIFF: {"from": "400 N/m", "to": "1.4 N/mm"},
        "sensors.u1.noise": {"from": 0.1, "to": 0.3},
    }
    space = space_of(small(designs=40, vary=axes))
    for axis, low, high in zip((STIFF, "sensors.u1.noise"), (400.0, 0.1), (1400.0, 0.3)):
        parts = [int(40 * (float(space.design(i)[axis]) - low) / (high - low)) for i in range(40)]
        assert sorted(parts) == list(range(40))


def test_a_logarithmic_range_has_its_mean_at_the_geometric_one() -> None:
    space = space_of(small(designs=64, vary={STIFF: {"from": 100.0, "to": 1e4, "scale": "log"}}))
    logs = np.log10([float(space.design(i)[STIFF]) for i in range(64)])
    assert logs.mean() == pytest.approx(3.0, abs=0.02)


def test_designs_depend_on_the_draw_alone() -> None:
    one, same, other = (space_of(small(draw=draw)).shares for draw in (1, 1, 2))
    assert np.array_equal(one, same)
    assert not np.allclose(one, other)


def test_a_design_without_a_sensor() -> None:
    plan = small()
    rig = rig_of(plan.rig, {"sensors.u1": False, "sensors.u2": True, STIFF: 700.0})
    assert [sensor.name for sensor in rig.sensors] == ["x1", "x2", "u2", "encoder"]
    assert [tendon.stiffness.value for tendon in rig.tendons] == [700.0, 700.0]


def test_chunks_hold_each_design_once_and_like_beside_like() -> None:
    space = space_of(
        small(designs=50, vary={"sensors.u1": [True, False], STIFF: {"from": 500.0, "to": 900.0}})
    )
    chunks = space.chunks(runs_per_design=2, size=10)
    assert sorted(i for chunk in chunks for i in chunk) == list(range(50))
    assert [len(chunk) for chunk in chunks] == [5] * 10
    identified = [space.design(i)["sensors.u1"] for chunk in chunks for i in chunk]
    assert identified == [True] * 25 + [False] * 25


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (
            {"vary": {"tendons.*.stifness": [1.0]}},
            "there is no 'stifness'; did you mean 'stiffness'",
        ),
        (
            {"vary": {STIFF: {"from": "900 N/m", "to": "0.7 N/mm"}}},
            "the range is empty: from 900 N/m must be below",
        ),
        ({"vary": {STIFF: {"from": "900 N/m"}}}, "a range needs 'from' and 'to'"),
        ({"vary": {STIFF: []}}, "must be a list of values or { from"),
        ({"vary": {STIFF: {"from": 0.0, "to": 1.0, "scale": "log"}}}, "'log' from above zero"),
        (
            {"vary": {"sensors.x1.resolution": {"from": 1e-5, "to": 1e-4}}},
            "give a list of a few values, no range",
        ),
        ({"vary": {"sensors.u3": [True]}}, "no such sensor; did you mean 'u"),
        ({"vary": {"sensors.u1": ["yes"]}}, "a sensor is there or not"),
        ({"vary": {"estimator": ["adaptiv"]}}, "did you mean 'adaptive'"),
        (
            {"requirement": {"joint": "lnk", "within": "1 deg"}},
            "no joint 'lnk'; did you mean 'link'",
        ),
        ({"scenarios": ["serie-2"]}, "did you mean 'series-2'"),
        ({"vary": {"feedback": ["encoder"]}}, "no scenario of the study has a [control] table"),
        ({"vary": {"feedback": ["encodr"]}}, "did you mean 'encoder'?"),
        (
            {
                "designs": 100_000_000,
                "vary": {path: {"from": 1.0, "to": 2.0} for path in THREE},
            },
            "2 GB are allowed",
        ),
    ],
)
def test_what_is_wrong_is_said_in_one_line(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(DistalError) as caught:
        space_of(plan_of({**RAW, **changes}))
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_shipped_studies_fit_their_rigs() -> None:
    assert {"paper", "lab-bench", "finger", "wrist"} <= set(shipped_studies())
    for name in shipped_studies():
        assert len(space_of(load_study(name))) >= 60
    with pytest.raises(StudyError, match="unknown study 'papr'; did you mean 'paper'"):
        load_study("papr")


def test_a_scenario_of_another_rig_is_refused_before_any_run() -> None:
    """Every run would fail for the same reason: one line says it, and nothing is answered."""
    with pytest.raises(StudyError, match="scenario 'wrist' does not fit the rig"):
        plan_of({**RAW, "scenarios": ["wrist"]})
