"""The transition of an interval against differences, of a finger whose last joint follows the one
before it.
"""

from __future__ import annotations

import numpy as np

from distal import load_rig
from distal.estimators import AdaptiveFilter
from distal.estimators.adaptive.filter_function import adaptive_function
from distal.rig import build_rig


def test_the_transition_of_coupled_joints_is_that_of_differences() -> None:
    raw = load_rig("finger-underactuated").model_dump()
    joints = list(raw["joints"])
    own = ("initial", "spring", "stops")  # those of a joint that follows are its leader's
    joints[2] = {key: value for key, value in joints[2].items() if key not in own}
    joints[2]["coupled"] = {"joint": "pip", "ratio": 0.8}
    raw["joints"] = joints
    estimator = AdaptiveFilter(build_rig(raw, "coupled"), compiled=False)
    n, whole = len(estimator.state_names), adaptive_function(estimator.states, None, True)
    turn = (np.array([0.009, 0.007, 0.005]) @ [0.5, 0.6, 0.48] + 1e-3) / 0.006
    sample = np.array([turn if name.startswith("phi") else 0.05 for name in estimator.channels])
    kernel_state = np.array(estimator.initial(0.0, sample).kernel_state)
    kernel_state[:6] = [0.5, 0.6, 0.48, 1.0, 2.0, 1.6]  # all of them slip
    row = np.concatenate([[0.005], sample, np.ones(len(sample))])
    outputs = 2 * len(estimator.measured)

    def predicted(mean: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        y = np.array(
            whole(np.concatenate([mean, kernel_state[n:]]), row, estimator.parameters)[1]
        ).ravel()[outputs:]
        return y[:n], y[n + n * n :].reshape(n, n, order="F")

    transition = predicted(kernel_state[:n])[1]
    for at in (0, 1, 3, 4):  # the last joint has no motion of its own
        step = np.zeros(n)
        step[at] = 1e-6
        difference = (
            predicted(kernel_state[:n] + step)[0] - predicted(kernel_state[:n] - step)[0]
        ) / 2e-6
        # Coriolis torques are taken in the middle of a kick, their slopes at its start
        np.testing.assert_allclose(
            transition[:6, at], difference[:6], rtol=0.02, atol=0.02 * np.abs(difference).max()
        )
    np.testing.assert_allclose(
        transition[2, [0, 1, 3, 4]], 0.8 * transition[1, [0, 1, 3, 4]], rtol=1e-9
    )
