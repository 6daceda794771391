"""The derivatives of an interval between samples."""

from __future__ import annotations

import numpy as np
import pytest

from distal import Rig, load_rig
from distal.estimators.paper_2008 import tangent_step
from distal.model import Mechanism, substeps
from tests.helpers import finite_difference, without_stops
from tests.model.test_stepping import DT, START, Stepper


@pytest.mark.parametrize("name", ["paper-2008-printed", "pulley-antagonist", "capstan-joint"])
def test_tangents_are_the_derivatives(name: str) -> None:
    """S = ∂(q⁺, v⁺)/∂(q, v, effort) against finite differences, slipping and pressed against a
    stop.
    """
    rig = load_rig(name)
    mechanism = Mechanism(rig)
    n = mechanism.n_bodies
    function = tangent_step(mechanism, substeps(mechanism, DT))
    p = mechanism.parameters.values
    effort = np.array([0.02, *np.full(n - 1, 5.0 if n > 2 else 0.1)])
    cases = [([0.1, *np.full(n - 1, 5e-3)], [2.0, *np.full(n - 1, 0.02)])]
    if name == "paper-2008-printed":
        cases.append(([0.1, 7.52e-3, 3e-3], [1.5, 0.0, 0.02]))
    steps = np.repeat([1e-9, 1e-7, 1e-6], n)
    for q, v in cases:

        def end(x: np.ndarray) -> np.ndarray:
            q, v, effort = np.split(x, 3)
            return np.concatenate(
                [part.full() for part in function(q, v, effort, effort, DT, p)[:2]]
            )

        slopes = function(q, v, effort, effort, DT, p)[2].full()
        expected = finite_difference(end, np.concatenate([q, v, effort]), steps)
        # no column for an effort on the joint
        expected = np.delete(expected, 2 * n, axis=1)
        scale = np.abs(expected).max(axis=1, keepdims=True)
        np.testing.assert_allclose(slopes / scale, expected / scale, rtol=2e-4, atol=2e-5)


def test_tangents_of_a_stuck_link_are_those_of_rest(paper_rig: Rig) -> None:
    mechanism = Mechanism(without_stops(paper_rig))
    slopes = tangent_step(mechanism, 15)(
        START, np.zeros(3), [0, 2, 2], [0, 2, 2], DT, mechanism.parameters.values
    )[2].full()
    assert slopes[0, 0] == 1.0  # the angle stays what it was
    assert np.all(slopes[3] == 0.0)  # and its speed is zero whatever happens nearby


def test_the_interval_and_its_tangent_step_agree(paper_rig: Rig) -> None:
    rig = without_stops(paper_rig)
    stepper = Stepper(rig, 15)
    tangent = tangent_step(stepper.mechanism, 15)
    q, v, effort = np.array([[0.2, 4e-3, 3e-3], [1.0, 0.1, -0.1], [0.0, 5.0, 2.0]])
    out = tangent(q, v, effort, effort, DT, stepper.mechanism.parameters.values)
    np.testing.assert_allclose(out[0].full().ravel(), stepper(q, v, effort)[0], rtol=1e-13)
