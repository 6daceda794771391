"""The transition of an interval against differences, of fingers of three joints: of crossed
tendons, slipping and stuck, and of one whose last joint follows the one before it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from distal import load_rig
from distal.estimators import AdaptiveFilter, Robustness
from distal.estimators.adaptive.filter_function import adaptive_function
from distal.rig import build_rig
from tests.helpers import finite_difference

ANGLES, STRETCH = np.array([0.5, 0.6, 0.48]), 1e-3


@pytest.mark.parametrize("case", ["coupled", "crossed", "stuck"])
def test_the_transition_of_joints_is_that_of_differences(case: str) -> None:
    rig = load_rig("finger-n-plus-1")
    speeds = [0.0, 0.5, 0.4] if case == "stuck" else [1.0, 2.0, 1.6]
    if case == "coupled":
        raw = load_rig("finger-underactuated").model_dump()
        own = ("initial", "spring", "stops")  # those of a joint that follows are its leader's
        last = {key: value for key, value in raw["joints"][2].items() if key not in own}
        last["coupled"] = {"joint": "pip", "ratio": 0.8}
        rig = build_rig({**raw, "joints": [*raw["joints"][:2], last]}, case)
    # with a torque the slopes are those of an expectation, see tests of the soft friction
    guards = replace(Robustness.usual(3), opens_torques=False)
    estimator = AdaptiveFilter(rig, compiled=False, robustness=guards)
    n, whole = len(estimator.state_names), adaptive_function(estimator.states, None, True)
    arms = [[tendon.arms().get(name, 0.0) for name in rig.joint_names] for tendon in rig.tendons]
    positions = iter((arms @ ANGLES + STRETCH) / (0.006 if case == "coupled" else 1.0))
    sample = np.array([next(positions) if name[0] in "xp" else 0.05 for name in estimator.channels])
    kernel_state = np.array(estimator.initial(0.0, sample).kernel_state)
    kernel_state[:6] = [*ANGLES, *speeds]
    row = np.concatenate([[0.005], sample, np.ones(len(sample))])

    def predicted(mean: np.ndarray) -> np.ndarray:
        given = np.concatenate([mean, kernel_state[n:]])
        return np.array(whole(given, row, estimator.parameters)[1]).ravel()[-n - 2 * n * n :]

    transition = predicted(kernel_state[:n])[-n * n :].reshape(n, n, order="F")[:6]
    stds = np.array(estimator.states.stds)
    sizes = np.where(stds > 0.0, 1e-4 * stds, 1e-6)
    slopes = finite_difference(lambda mean: predicted(mean)[:6], kernel_state[:n], sizes)
    # Coriolis torques are taken in the middle of a kick, their slopes at its start; in units of
    # what is unsure
    unsure = np.concatenate([np.full(3, 1e-2), np.full(3, 0.3), stds[6:]])
    slopes, transition = slopes * unsure, transition * unsure
    least = 0.002 * np.abs(slopes).max(axis=1, keepdims=True)
    assert np.all(np.abs(transition - slopes) <= 0.02 * np.abs(slopes).max(axis=0) + least)
