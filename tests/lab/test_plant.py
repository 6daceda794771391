"""The simulated plant in C: the motion of Python's kernel, and sensors whose errors are those that
the rig describes.
"""

from __future__ import annotations

import ctypes
from pathlib import Path

import numpy as np
import pytest
from tools.lab.plant_source import ExportedPlant, c_plant, resting_inputs

from distal import Rig, load_rig
from distal.errors import ExportError
from distal.kernels import Kernel
from distal.model import Mechanism
from distal.rig import Sensor, gain_of, step_of, travel_of
from distal.simulation.plant import at_rest, input_layout, plant_function
from tests.export.helpers import shared_library
from tests.export.test_export import needs_compiler

pytestmark = needs_compiler


def true_reading(plant: Mechanism, sensor: Sensor, y: np.ndarray) -> float:
    """Return what a sensor without errors reads of a plant's output (q, v, tensions, efforts), by
    hand.
    """
    n, nj, rig = plant.n_bodies, plant.n_joints, plant.rig
    if sensor.measures == "tension":
        return float(y[2 * n + [tendon.name for tendon in rig.tendons].index(sensor.of)])
    if sensor.measures == "angle":
        return float(y[[joint.name for joint in rig.joints].index(sensor.of)])
    body = nj + [drive.name for drive in rig.drives].index(sensor.of)
    if sensor.measures == "force":
        return float(y[2 * n + plant.n_tendons + body])
    return float(y[body] + sensor.lag * y[n + body])


class Plant:
    """An exported plant as a shared library."""

    def __init__(self, made: ExportedPlant, folder: Path) -> None:
        size = (
            f'#include "{made.name}.h"\nunsigned long size(void) {{ return '
            f"sizeof({made.name}_state); }}\n"
        )
        texts = {f"{made.name}.h": made.header, f"{made.name}.c": made.source, "size.c": size}
        self.code, self.made = shared_library(texts, folder), made
        self.state = np.zeros(int(self.code.size()) // 8 + 1)
        self.values = np.zeros(len(made.plant.rig.sensors))

    def begin(self, seed: int) -> np.ndarray:
        self.code.p_begin(self._at(self.state), ctypes.c_uint64(seed), self._at(self.values))
        return self.values.copy()

    def step(self, pull: np.ndarray) -> np.ndarray:
        assert (
            self.code.p_step(
                self._at(self.state), self._at(np.ascontiguousarray(pull)), self._at(self.values)
            )
            == 1
        )
        return self.values.copy()

    @staticmethod
    def _at(array: np.ndarray) -> ctypes.c_void_p:
        return ctypes.c_void_p(array.ctypes.data)


def by_kernel(
    made: ExportedPlant, pulls: np.ndarray, truth: Rig | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the state of Python's kernel and what it puts out after each sample, by what acts in
    it, (k, n), with the numbers that are true from the first step on; default the rig's.
    """
    kernel = Kernel(plant_function(made.plant, made.count))
    begun, _ = at_rest(made.plant, resting_inputs(made.plant), made.start, kernel)
    lengths = np.full(made.parts * len(pulls), made.interval / made.parts)
    rows = np.column_stack([np.repeat(pulls, made.parts, axis=0), lengths])
    known = made.plant if truth is None else Mechanism(truth, remembers=True)
    states, ys = kernel.scan(begun, rows, known.parameters.values)
    return states[made.parts - 1 :: made.parts], ys[made.parts - 1 :: made.parts]


@pytest.mark.parametrize("name", ["template", "da-vinci-grasper", "finger-underactuated"])
def test_the_motion_is_that_of_the_kernel(name: str, tmp_path: Path) -> None:
    made = c_plant(load_rig(name), "p")
    nj, plant = made.plant.n_joints, Plant(made, tmp_path)
    plant.begin(1)
    pulls = np.zeros((200, 5, made.plant.n_bodies))
    pulls[:, 0] = input_layout(made.plant).views(resting_inputs(made.plant))["effort"][0]
    pulls[:, 0, nj:] += 0.02 * np.sin(0.1 * np.arange(200))[:, None]
    pulls[100:, 2:, 0] = 0.05, 0.3, 1e-3  # a hand takes the first joint
    for pull in pulls:
        plant.step(pull.ravel())
    states, _ = by_kernel(made, pulls.reshape(200, -1))
    np.testing.assert_allclose(plant.state[: states.shape[1]], states[-1], rtol=0, atol=1e-12)
    assert np.abs(states[-1] - states[0])[:nj].max() > 1e-3


class Drawn:
    """The random numbers of the C: splitmix64 (Steele, Lea and Flood, 2014), normal by Box and
    Muller.
    """

    def __init__(self, seed: int) -> None:
        self.state = seed

    def uniform(self) -> float:
        whole = 2**64 - 1
        self.state = z = (self.state + 0x9E3779B97F4A7C15) & whole
        z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & whole
        z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & whole
        return float(((z ^ (z >> 31)) >> 11) + 1) / 2**53

    def normal(self) -> float:
        length = np.sqrt(-2 * np.log(self.uniform()))
        return float(length * np.cos(2 * np.pi * self.uniform()))


def test_readings_are_those_of_a_naive_twin(tmp_path: Path) -> None:
    """Gain, bias, curve, noise and lag of each sensor, number by number, from the same random
    numbers.
    """
    changed = {
        "sensors.0.linearity": 1e-4,
        "sensors.0.bias": 3e-4,
        "sensors.0.lag": 0.02,
        "sensors.0.resolution": 0.0,
    }
    changed |= {"sensors.2.noise": 0.1, "sensors.2.gain": 1.1, "sensors.2.resolution": 0.0}
    rig = load_rig("template").with_values(changed)
    made = c_plant(rig, "p")
    plant, pull, drawn = Plant(made, tmp_path), np.zeros((5, made.plant.n_bodies)), Drawn(7)
    pull[0] = input_layout(made.plant).views(resting_inputs(made.plant))["effort"][0]
    pull[0, made.plant.n_joints] += 1.0
    curves = []
    for sensor in rig.sensors:
        weights, phases = [], []
        for j in (1, 2, 3):
            weights.append(drawn.normal() / j)
            phases.append(2 * np.pi * drawn.uniform())
        low, high = travel_of(sensor, rig)

        def at(
            share: np.ndarray, own: tuple[list[float], list[float]] = (weights, phases)
        ) -> np.ndarray:
            return sum(w * np.sin(np.pi * j * share + f) for j, w, f in zip((1, 2, 3), *own))  # type: ignore[return-value]

        scale = sensor.linearity / np.abs(at(np.linspace(0, 1, 501))).max()
        curves.append((at, scale, low, high))
    read = [plant.begin(7), *(plant.step(pull.ravel()) for _ in range(30))]
    _, ys = by_kernel(made, np.tile(pull.ravel(), (30, 1)))
    for values, y in zip(read, [made.first, *ys]):
        for i, (sensor, (curve, scale, low, high)) in enumerate(zip(rig.sensors, curves)):
            true = true_reading(made.plant, sensor, y)
            share = np.clip((true - low) / (high - low), 0, 1)
            expected = (
                gain_of(sensor).value * true
                + sensor.bias.value
                + scale * curve(share)
                + sensor.noise * drawn.normal()
            )
            step = step_of(sensor)
            expected = np.floor(expected / step + 0.5) * step if step > 0 else expected
            assert values[i] == pytest.approx(expected, rel=1e-12, abs=1e-12)
    assert (
        np.abs(ys[:, made.plant.n_bodies + made.plant.n_joints]).max() > 1e-6
    )  # a lag shows where the drive moves


def test_sensors_of_other_rates(tmp_path: Path) -> None:
    made = c_plant(load_rig("template").with_values({"sensors.2.rate": 25.0}), "p")
    plant, pull = Plant(made, tmp_path), np.zeros((5, made.plant.n_bodies))
    pull[0] = input_layout(made.plant).views(resting_inputs(made.plant))["effort"][0]
    read = np.array([plant.begin(1), *(plant.step(pull.ravel()) for _ in range(11))])
    np.testing.assert_array_equal(np.isfinite(read[:, 2]), np.arange(12) % 4 == 0)
    assert np.isfinite(read[:, 0]).all()


def test_what_it_does_not_have_is_refused() -> None:
    with pytest.raises(ExportError, match="a delay is set for x1"):
        c_plant(load_rig("template").with_values({"sensors.0.delay": 0.01}), "p")
    with pytest.raises(ExportError, match="cannot begin"):
        c_plant(load_rig("template"), "P")
