"""What `benchmarks.mujoco_tendons` makes of fitted rigs: it counts errors as it says, and its rival
finds the numbers of a model.
"""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install '.[mujoco]'")

from tests.support.mujoco_replay import Motion, driven, replayed, rms

from benchmarks.mujoco_tendons import (
    CASES,
    identified,
    motion_of,
    numbers_of,
    off,
    sysid_module,
    varied,
)


def test_errors_count_after_homing() -> None:
    """A constant error is known then; what comes on top of it counts."""
    time = np.arange(6.0)
    truth = np.zeros((6, 1))
    angles = truth + 0.5
    angles[4:] += 0.1
    np.testing.assert_allclose(off(time, angles, truth, 2.0)[:, 0], [0, 0, 0.1, 0.1], atol=1e-12)
    np.testing.assert_allclose(off(time, angles, truth, 0.0), angles)


@pytest.mark.slow
def test_the_rival_finds_a_model() -> None:
    """From a motion of a model with other numbers; without variation a model stays what it is."""
    case = CASES["Bowden finger"](9000)
    whole = motion_of(case.judged[0], case.rig, loaded=False)
    motion = Motion(whole.time[:400], whole.angles[:400], whole.positions[:400])
    model = driven(case.rig).compile()
    places = numbers_of(model, case.rig)
    alone = replayed(case.rig, motion, tendons=False)
    same = varied(model, places, np.zeros(len(places)))
    np.testing.assert_allclose(replayed(case.rig, motion, False, same), alone, atol=0.02)
    x = np.array([0.02 if array == "wrap_prm" else 0.1 for array, _ in places])
    other = varied(model, places, x)
    motion = motion._replace(angles=replayed(case.rig, motion, False, other))
    if sysid_module() is None:
        pytest.skip("there is no mujoco.sysid: pip install 'mujoco[sysid]'")
    found = identified(case.rig, [motion], 0.0)
    before, after = (
        rms(replayed(case.rig, motion, False, each) - motion.angles) for each in (None, found)
    )
    assert after < 0.05 * before
