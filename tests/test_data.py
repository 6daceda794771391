"""Logs that another simulator made: the main job on input that nobody here simulated."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from distal import ESTIMATORS, estimate, load_rig, read_log

# bounds: what is measured (see docs/estimators.md) rounded up by a quarter; worse is a regression
SERVO = {"inextensible": 11.5, "elastic": 1.1, "ekf-2008": 0.85, "ekf": 0.38}
HAND = {"inextensible": 6.0, "elastic": 6.5, "ekf-2008": 5.5, "ekf": 5.5}


@pytest.mark.parametrize("name", tuple(ESTIMATORS))
@pytest.mark.parametrize(("log", "bounds"), [("servo", SERVO), ("hand", HAND)])
def test_every_estimator_runs_on_the_mujoco_logs(data: Path, name: str, log: str, bounds: dict[str, float]) -> None:
    folder = data / "mujoco_rig"
    rig = load_rig("pulley-antagonist")
    read = read_log(folder / f"mujoco_tension_{log}.csv", rig, folder / f"mujoco_tension_{log}.truth.csv")
    result = estimate(read, rig, name)
    assert len(result) == 1200
    assert np.rad2deg(result.rms_error()) < bounds[name]
