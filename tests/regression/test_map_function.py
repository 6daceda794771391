"""The kernel of a map against a naive twin: values, variances, and what it costs not to read."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from distal.regression import (
    INDEPENDENT,
    MOST,
    JudgedJumps,
    Shape,
    forces_parameters,
    map_function,
    map_parameters,
    whitening,
)
from distal.regression.features import features_function
from distal.rig import HALF_WIDTHS, TIME_CONSTANTS, LearnedMap
from tests.learned_maps import drawn_map
from tests.regression.test_features import frame_of

DT = 0.02


def run(learned: LearnedMap, rows: np.ndarray, mask: np.ndarray) -> list[tuple[np.ndarray, ...]]:
    shape = Shape.of(learned)
    function = map_function(shape, len(learned.joints))
    memory = np.zeros(shape.memory.size)
    found = []
    for row, there in zip(rows, mask):
        values, gains, variances, memory = (
            np.array(part).ravel()
            for part in function(
                memory, DT, row, there, map_parameters(learned), 0.0, row[: shape.channels], 0.0
            )
        )
        found.append((values, gains, variances, memory))
    return found


@pytest.mark.parametrize("beside", [True, False])
def test_values_and_variances(beside: bool) -> None:
    """φᵀ m, and φᵀ C φ + σ² + s_r² far + the plays' doubt by numerical slopes."""
    learned = drawn_map(("a", "b"), ("x", "f"), beside)
    arrays, shape = learned.arrays, Shape.of(learned)
    rng = np.random.default_rng(1)
    rows = np.cumsum(0.1 * rng.normal(size=(30, shape.count)), axis=0)
    mask = np.ones((30, shape.channels))
    found = run(learned, rows, mask)
    memory = np.zeros(shape.memory.size)
    frame = frame_of(learned, shape)
    features = features_function(shape)
    for row, (values, gains, variances, after) in zip(rows, found):
        outputs, following = features(memory, DT, row, np.ones(shape.channels), frame)
        parts = {name: np.array(v).ravel() for name, v in shape.outputs.parts(outputs).items()}
        phi = parts["features"]
        np.testing.assert_allclose(np.array(following).ravel(), after)
        np.testing.assert_allclose(values, arrays["mean"] @ phi, atol=1e-14)
        np.testing.assert_allclose(gains, arrays["filter"])
        for j in range(2):
            plain = phi @ arrays["covariance"][j] @ phi + arrays["noise"][j]
            plain += arrays["radial"][j] * parts["far"][0]
            turns = slopes_of_slips(learned, phi, parts, j)
            doubt = turns @ parts["doubt"]
            assert variances[j] == pytest.approx(plain + doubt**2 / 3, rel=1e-6)
        memory = after


def slopes_of_slips(
    learned: LearnedMap, phi: np.ndarray, parts: dict[str, np.ndarray], joint: int
) -> np.ndarray:
    """Return |∂y/∂slip|, the radial part's by differences."""
    shape, arrays = Shape.of(learned), learned.arrays
    mean = arrays["mean"][joint]
    turns = np.abs(mean[shape.features["slips"]])
    weights = mean[shape.features["radial"]]

    def radial(inputs: np.ndarray) -> float:
        kernel = np.exp(-((arrays["points"] - inputs) ** 2).sum(axis=1) / 2)
        return float(weights @ arrays["root"] @ kernel * parts["amplitude"][0])

    for k, i in enumerate(learned.moving):
        step = np.zeros(len(parts["inputs"]))
        step[shape.count + k] = 1e-5 / arrays["lengths"][shape.count + k]
        slope = (radial(parts["inputs"] + step) - radial(parts["inputs"] - step)) / 2e-5
        turns[shape.count + i] += abs(slope)
    return turns


def test_what_is_missing_widens_the_band_with_its_age() -> None:
    """By (∂y/∂z)² 2 (1 − exp(−(rate a)²/2)), and by nothing else: the last reading stands."""
    learned = drawn_map(("a",), ("x", "f"), False)
    arrays, shape = learned.arrays, Shape.of(learned)
    rows = np.tile([0.05, 0.02], (60, 1))
    mask = np.ones((60, 2))
    mask[20:, 1] = 0.0
    rows[20:, 1] = 99.0
    found = run(learned, rows, mask)
    settled, later = found[19], found[59]
    ages = DT * 40
    unknown = 2 * (1 - np.exp(-((arrays["rate"][1] * ages) ** 2) / 2))
    mean = arrays["mean"][0]
    lags = mean[shape.features["lags"]].reshape(len(TIME_CONSTANTS), 2)[:, 1].sum()
    slope = mean[shape.features["readings"]][1] + lags + _radial_slope(learned, rows[0], later)
    gained = later[2][0] - _without_age(learned, later, rows[0])
    assert gained == pytest.approx(slope**2 * unknown, rel=1e-5)
    assert later[2][0] > settled[2][0]


def _without_age(learned: LearnedMap, at: tuple[np.ndarray, ...], row: np.ndarray) -> float:
    """Return the variance at the same memory if all is read."""
    function = map_function(Shape.of(learned), 1)
    _, _, variances, _ = function(
        at[3], 0.0, row, np.ones(2), map_parameters(learned), 0.0, row[:2], 0.0
    )
    return float(variances)


def _radial_slope(learned: LearnedMap, row: np.ndarray, at: tuple[np.ndarray, ...]) -> float:
    shape, arrays = Shape.of(learned), learned.arrays
    outputs, _ = features_function(shape)(at[3], 0.0, row, np.ones(2), frame_of(learned, shape))
    parts = {name: np.array(v).ravel() for name, v in shape.outputs.parts(outputs).items()}
    weights = arrays["mean"][0][shape.features["radial"]]

    def radial(inputs: np.ndarray) -> float:
        kernel = np.exp(-((arrays["points"] - inputs) ** 2).sum(axis=1) / 2)
        return float(weights @ arrays["root"] @ kernel * parts["amplitude"][0])

    step = np.zeros(len(parts["inputs"]))
    step[1] = 1e-5 / arrays["lengths"][1]
    return (radial(parts["inputs"] + step) - radial(parts["inputs"] - step)) / 2e-5


def test_a_map_is_in_both_places_of_its_readings() -> None:
    """The mean and the variance of two values with chances 0.7 and 0.3."""
    learned = drawn_map(("a", "b"), ("x", "f"), False)
    shape = Shape.of(learned)
    function = map_function(shape, 2)
    one, other = np.array([0.3, -0.2]), np.array([1.1, -0.2])
    arguments = (np.ones(2), map_parameters(learned), 0.0)
    memory = np.zeros(shape.memory.size)

    def at(first: np.ndarray, second: np.ndarray, chance: float) -> list[np.ndarray]:
        told = function(memory, DT, first, *arguments, second, chance)
        return [np.array(part).ravel() for part in told]

    alone, elsewhere, both = at(one, one, 0.0), at(other, other, 0.0), at(one, other, 0.3)
    apart = elsewhere[0] - alone[0]
    np.testing.assert_allclose(both[0], alone[0] + 0.3 * apart)
    np.testing.assert_allclose(both[2], alone[2] + 0.21 * apart**2)
    np.testing.assert_allclose(both[3], alone[3])


def test_forces_say_which_reading_is_right() -> None:
    """T² and its spread by hand at both readings, each with plays of its own from the jump on."""
    learned = drawn_map(("f", "g"), ("x",), False)
    learned = learned.model_copy(update={"rms": (0.2, 0.3)})
    judge = JudgedJumps.among([learned], ["x", "f", "g"])[0]
    shape = judge.shape
    parameters = forces_parameters(learned)
    assert JudgedJumps.among([learned], ["x", "f"]) == []

    def square(
        memory: np.ndarray, x: float, forces: list[float], dt: float
    ) -> tuple[float, np.ndarray]:
        outputs, after = features_function(shape)(memory, dt, x, 1.0, frame_of(learned, shape))
        parts = {name: np.array(v).ravel() for name, v in shape.outputs.parts(outputs).items()}
        errors = np.array(forces) - learned.arrays["mean"] @ parts["features"]
        spread = 0.0
        for j in range(2):
            turns = slopes_of_slips(learned, parts["features"], parts, j)
            beside = (turns @ parts["doubt"]) ** 2 / 3
            errors[j] /= np.sqrt(learned.rms[j] ** 2 + beside)
            spread += np.log(1 + beside / learned.rms[j] ** 2) / 2
        whitened = whitening(learned.arrays["correlation"]) @ errors
        return min(float(whitened @ whitened / 2), MOST) + spread, np.array(after).ravel()

    memory = judge.begun(ca.DM([0.1]), ca.DM([1]))
    off = real = np.array(judge.memory.part(memory, "off")).ravel()
    squares, total = [0.0, 0.0], 0.0
    forces = [0.3, -0.1]
    for k, (x, jumped) in enumerate(((0.12, 0.12), (0.13, 0.9), (0.14, 0.91), (0.15, 0.92))):
        ratio, memory = judge.evidence(
            memory,
            ca.DM(DT),
            ca.DM([x, *forces]),
            ca.DM([jumped, *forces]),
            ca.DM.ones(3),
            ca.DM(parameters),
        )
        total += float(ratio)
        if k == 2:  # the jumped one is asked at the second sample after the jump
            squares[1], real = square(real, jumped, forces, 2 * DT)
        else:
            squares[0], off = square(off, x, forces, DT if k < 2 else 2 * DT)
        real = off if k == 0 else real
        parts = judge.memory.parts(memory)
        np.testing.assert_allclose(np.array(parts["off"]).ravel(), off)
        np.testing.assert_allclose(np.array(parts["real"]).ravel(), real)
        if k == 2:
            expected = 2 * (2 * DT / INDEPENDENT) / 2 * (squares[0] - squares[1])
            assert total == pytest.approx(expected, rel=1e-6)
    assert total == pytest.approx(expected)
    missing, _ = judge.evidence(
        memory,
        ca.DM(DT),
        ca.DM([0.2, 0.3, 0.0]),
        ca.DM([0.9, 0.3, 0.0]),
        ca.DM([1, 1, 0]),
        ca.DM(parameters),
    )
    assert float(missing) == 0.0


def test_there_is_a_width_that_enters_the_radial_functions() -> None:
    assert tuple(sorted(HALF_WIDTHS)) == HALF_WIDTHS
