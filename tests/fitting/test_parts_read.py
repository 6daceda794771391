"""What the maps of a rig's independent parts read."""

from __future__ import annotations

import numpy as np
import pytest

from distal.estimators import channels_of
from distal.fitting.learned_maps import map_of, parts_read
from distal.regression import Samples
from distal.rig import Rig
from tests.hand_rigs import hand

FOLDS = [0, 1, 2, 3]


@pytest.fixture(scope="module")
def rig() -> Rig:
    return hand(["capstan-joint", "capstan-joint"])


def logs(rig: Rig, shared: float) -> list[Samples]:
    """Return logs in which a motor turns its joint, and the other joint by a share of that."""
    names = [sensor.name for sensor in channels_of(rig, "regression").proximal]
    turned = [names.index(f"f{i}_motor_angle") for i in range(2)]
    made = []
    for seed in FOLDS:
        rng = np.random.default_rng(seed)
        time = 0.01 * np.arange(1500)
        waves = np.sin(2 * np.pi * rng.uniform(0.1, 0.5, (2, 1)) * time + 6 * rng.random((2, 1)))
        readings = 1e-3 * rng.normal(size=(len(time), len(names)))
        readings[:, turned] += waves.T
        angles = 0.5 * waves.T @ np.array([[1.0, shared], [shared, 1.0]])
        angles += 2e-3 * rng.normal(size=angles.shape)
        nothing = np.zeros((len(time), 0))
        made.append(Samples(f"log {seed}", time, readings, nothing, angles, np.zeros(angles.shape)))
    return made


def test_each_part_reads_its_sensors(rig: Rig) -> None:
    parts = parts_read(logs(rig, 0.0), rig, FOLDS, True)
    for i, part in enumerate(parts):
        assert len(part["joints"]) == 1
        assert all(name.startswith(f"f{i}_") for name in part["channels"])


def test_parts_that_move_each_other_read_all(rig: Rig) -> None:
    """A description that lacks what joins them does not keep the map from the readings."""
    data = logs(rig, 0.2)
    parts = parts_read(data, rig, FOLDS, True)
    names = tuple(sensor.name for sensor in channels_of(rig, "regression").proximal)
    assert [part["channels"] for part in parts] == [names, names]
    assert parts_read(data, rig, FOLDS) == parts_read(logs(rig, 0.0), rig, FOLDS, True)
    wide = map_of(data, rig, "readings", parts, FOLDS, None)
    assert wide.parts == parts
    rms = np.mean([rms for learned in wide.maps for rms in learned.rms])
    assert rms < 3e-3  # the reference's noise is 2e-3; of the other motor's share 0.07 is left
