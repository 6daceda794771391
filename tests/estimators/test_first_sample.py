"""What the first sample tells of the drives: readings less their known offsets, over their
gains.
"""

from __future__ import annotations

import numpy as np
import pytest

from distal import load_rig, make_estimator


@pytest.mark.parametrize("name", ["inextensible", "elastic", "ekf", "ekf-2008"])
def test_offsets_and_gains_are_taken_off(name: str) -> None:
    rig = load_rig("template")
    plain = make_estimator(name, rig, compiled=False)
    changed = make_estimator(
        name,
        rig.with_values({"sensors.0.bias": 1e-3, "sensors.2.bias": 0.5, "sensors.2.gain": 1.25}),
        compiled=False,
    )
    sample = np.array([4e-3, 2e-3, 3.0, 2.0])
    values = dict(zip(("x1", "x2", "u1", "u2"), sample))
    other = values | {"x1": values["x1"] + 1e-3, "u1": 1.25 * values["u1"] + 0.5}
    known = plain.initial(0.0, np.array([values[name] for name in plain.channels])).kernel_state
    found = changed.initial(0.0, np.array([other[name] for name in changed.channels])).kernel_state
    n = len(plain.state_names)
    np.testing.assert_allclose(found[:n], known[:n], rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(found[n * (n + 1) :], known[n * (n + 1) :], rtol=1e-12, atol=1e-15)
    assert np.isin(4e-3, np.round(known, 12))
