"""Against another simulator, where it is installed: the plant itself, and the estimate of its
angle.
"""

from __future__ import annotations

import numpy as np
import pytest

from distal import estimate, load_rig, simulate
from distal.simulation import build_scenario
from tests import mujoco_plant
from tests.helpers import rms_degrees

mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install '.[test]'")


def test_both_simulators_turn_the_link_alike() -> None:
    """Both sliders servoed, stick and slip: 0.2° RMS of 25° or more. MuJoCo's friction is stiff but
    soft, ours exact.
    """
    target = mujoco_plant.targets(3, 600)
    theirs = mujoco_plant.run(target)["theta"]
    time = 0.01 * np.arange(len(target))
    gains = {"stiffness": mujoco_plant.KP, "damping": mujoco_plant.KD}
    drives = {
        name: {
            "servo": {
                "position": [[float(t), float(x)] for t, x in zip(time, target[:, i])],
                **gains,
            }
        }
        for i, name in enumerate(("left", "right"))
    }
    rig = load_rig("pulley-antagonist")
    ours = simulate(
        rig, build_scenario({"rig": "pulley-antagonist", "duration": "6 s", "drives": drives})
    ).truth["theta"]
    assert np.rad2deg(np.ptp(theirs)) > 25.0
    assert rms_degrees(ours - theirs) < 0.2


@pytest.mark.more
@pytest.mark.slow
def test_adaptive_on_a_plant_that_nobody_here_wrote() -> None:
    """Friction as the rig's and ±20 %, a seed each: RMS at most 0.35°, 88 % inside the band or
    more.
    """
    rig = load_rig("pulley-antagonist")
    results = [
        estimate(
            mujoco_plant.log(seed, link_friction=share * mujoco_plant.LINK_FRICTION),
            rig,
            "adaptive",
        )
        for seed, share in enumerate((0.8, 1.0, 1.2))
    ]
    assert rms_degrees(np.concatenate([result.errors() for result in results])) <= 0.35
    assert np.mean([result.inside_band() for result in results]) >= 0.88
