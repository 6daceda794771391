"""What the first sample tells of the drives: readings less their known offsets, over their
gains.
"""

from __future__ import annotations

import numpy as np
import pytest

from distal import load_rig, make_estimator


@pytest.mark.parametrize("name", ["inextensible", "elastic", "ekf", "ekf-2008"])
def test_offsets_and_gains_are_taken_off(name: str) -> None:
    rig = load_rig("template").with_values({"joints.0.initial": {"value": -0.4, "std": 0.05}})
    wrong = {"sensors.0.bias": 1e-3, "sensors.2.bias": 0.5, "sensors.2.gain": 1.25}
    sample = {"x1": 4e-3, "x2": 2e-3, "u1": 3.0, "u2": 2.0}
    other = {**sample, "x1": sample["x1"] + 1e-3, "u1": 1.25 * sample["u1"] + 0.5}
    begun = []
    for described, read in ((rig, sample), (rig.with_values(wrong), other)):
        made = make_estimator(name, described, compiled=False)
        belief = made.initial(0.0, np.array([read[channel] for channel in made.channels]))
        assert belief.mean[0] == pytest.approx(-0.4)
        n = belief.size
        # without the covariance: a zero that is known has another
        begun.append(np.delete(belief.kernel_state, np.s_[n : n * (n + 1)]))
    np.testing.assert_allclose(begun[1], begun[0], rtol=1e-12, atol=1e-15)
    assert np.isin(4e-3, np.round(begun[0], 12))
