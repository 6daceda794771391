"""Pulls of rigs whose arms are small numbers in SI: a determinant is small without being zero."""

import casadi as ca
import numpy as np
import pytest

from distal.inverse.feedforward import least_pulls, solved


@pytest.mark.parametrize("size", [1.0, 5e-3, 1e-4])
def test_pulls_make_the_torques_whatever_the_size_of_the_arms(size: float) -> None:
    arms = size * np.array([[1.0, 1.0, -1.0, -1.0], [1.0, -1.0, 1.0, -1.0], [0.6, -0.8, -0.9, 1.1]])
    torques = arms @ np.array([3.0, 2.0, 4.0, 1.0])
    pulls = least_pulls(ca.SX(arms), ca.SX(torques), ca.SX.zeros(4), [True] * 4)
    found = np.array(ca.evalf(pulls)).ravel()
    assert arms @ found == pytest.approx(torques, rel=1e-9)
    assert (found > -1e-9).all()


def test_soft_joints_are_solved_and_a_singular_matrix_gives_zero() -> None:
    soft = ca.SX(-1e-9 * np.eye(2))
    assert np.array(ca.evalf(solved(soft, ca.SX([1.0, 2.0])))).ravel() == pytest.approx(
        [-1e9, -2e9]
    )
    singular = ca.SX(np.array([[1.0, 2.0], [2.0, 4.0]]))
    assert np.array(ca.evalf(solved(singular, ca.SX([1.0, 2.0])))).ravel() == pytest.approx([0, 0])
