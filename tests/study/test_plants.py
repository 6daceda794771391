"""Rigs as built: distributions that are known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import kstest, truncnorm

from distal import load_rig
from distal.study.design_space import built_values, draws_of, scores

FRICTION = "joints.0.friction.coefficient"


def drawn(values: dict[str, object], path: str, count: int = 1500) -> np.ndarray:
    rig = load_rig("paper-2008-observed").with_values(values)
    draws = draws_of(rig)
    return np.array([built_values(rig, draws, scores(draws, (3, i)))[path] for i in range(count)])


def test_a_number_is_normal_with_its_std() -> None:
    assert kstest(drawn({}, "joints.0.initial"), "norm", (0.0, np.deg2rad(3.0))).pvalue > 0.01


def test_what_cannot_be_negative_is_drawn_from_the_cut_normal() -> None:
    found = drawn({FRICTION: 0.1, f"{FRICTION}.std": 0.2}, FRICTION)
    assert found.min() >= 0.0
    assert kstest(found, truncnorm(-0.5, np.inf, 0.1, 0.2).cdf).pvalue > 0.01


def test_what_is_known_to_a_factor_is_log_normal() -> None:
    found = drawn({"joints.0.inertia": {"value": 1e-4, "std": 2e-4}}, "joints.0.inertia")
    assert kstest(np.log(found), "norm", (np.log(1e-4), np.log(3.0))).pvalue > 0.01


def test_what_several_share_is_the_same_for_all() -> None:
    one, other = (drawn({}, f"tendons.{i}.stiffness", 200) for i in (0, 1))
    assert np.array_equal(one, other)
    assert np.std(one) == pytest.approx(80.6, rel=0.15)
    both = drawn({"tendons.0.stiffness.std": 40.0}, "tendons.0.stiffness", 1000)
    assert np.std(both) == pytest.approx(np.hypot(80.6, 40.0), rel=0.1)


def test_a_draw_does_not_depend_on_what_else_is_drawn() -> None:
    rig = load_rig("paper-2008-observed")
    fewer = rig.with_values({f"{FRICTION}.std": 0.0})
    one, other = (scores(draws_of(each), (1, 2, 3)) for each in (rig, fewer))
    assert set(one) - set(other) == {"joints.link.friction.coefficient"}
    assert all(one[name] == other[name] for name in other)
