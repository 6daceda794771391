"""The kernel of a map against a naive twin: values, variances, and what it costs not to read."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

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
from distal.rig import TIME_CONSTANTS, LearnedMap
from tests.helpers import finite_difference
from tests.learned_maps import drawn_map, frame_of

Floats = NDArray[np.float64]
DT = 0.02


def mapped(
    learned: LearnedMap,
    memory: Floats | None,
    dt: float,
    row: Floats,
    there: ArrayLike = 1.0,
    other: Floats | None = None,
    chance: float = 0.0,
) -> list[Floats]:
    """Return values, gains, variances and the memory after a sample."""
    shape = Shape.of(learned)
    memory = np.zeros(shape.memory.size) if memory is None else memory
    mask = np.broadcast_to(there, shape.channels)
    other = row[: shape.channels] if other is None else other
    arguments = memory, dt, row, mask, map_parameters(learned), 0.0, other, chance
    return [part.full().ravel() for part in map_function(shape, len(learned.joints))(*arguments)]


def seen(
    learned: LearnedMap, memory: Floats, dt: float, row: ArrayLike
) -> tuple[dict[str, Floats], Floats]:
    """Return what the map sees in a sample, and the memory after it."""
    shape = Shape.of(learned)
    there = np.ones(shape.channels)
    outputs, after = features_function(shape)(memory, dt, row, there, frame_of(learned))
    parts = shape.outputs.parts(outputs)
    return {name: np.array(v).ravel() for name, v in parts.items()}, np.array(after).ravel()


def radial_slopes(learned: LearnedMap, parts: dict[str, Floats], joint: int) -> Floats:
    """Return ∂y/∂inputs of the radial part, by differences, over the inputs' lengths."""
    arrays = learned.arrays
    weights = arrays["mean"][joint][Shape.of(learned).features["radial"]]

    def radial(inputs: Floats) -> Floats:
        kernel = np.exp(-((arrays["points"] - inputs) ** 2).sum(axis=1) / 2)
        return weights @ arrays["root"] @ kernel * parts["amplitude"][0]

    return finite_difference(radial, parts["inputs"])[0] / arrays["lengths"]


def variance_of_slips(learned: LearnedMap, parts: dict[str, Floats], joint: int) -> float:
    """Return a third of the square of what the slips' intervals make of an angle."""
    shape = Shape.of(learned)
    turns = np.abs(learned.arrays["mean"][joint][shape.features["slips"]])
    enters = shape.count + np.array(learned.moving)
    turns[enters] += np.abs(radial_slopes(learned, parts, joint)[shape.count :])
    return float(turns @ parts["doubt"]) ** 2 / 3


@pytest.mark.parametrize("beside", [True, False])
def test_values_and_variances(beside: bool) -> None:
    """φᵀ m, and φᵀ C φ + σ² + s_r² far + the plays' doubt by numerical slopes."""
    learned = drawn_map(("a", "b"), ("x", "f"), beside)
    arrays, shape = learned.arrays, Shape.of(learned)
    rng = np.random.default_rng(1)
    memory = np.zeros(shape.memory.size)
    for row in np.cumsum(0.1 * rng.normal(size=(30, shape.count)), axis=0):
        values, gains, variances, after = mapped(learned, memory, DT, row)
        parts, memory = seen(learned, memory, DT, row)
        phi = parts["features"]
        np.testing.assert_allclose(memory, after)
        np.testing.assert_allclose(values, arrays["mean"] @ phi, atol=1e-14)
        np.testing.assert_allclose(gains, arrays["filter"])
        for j in range(2):
            plain = phi @ arrays["covariance"][j] @ phi + arrays["noise"][j]
            plain += arrays["radial"][j] * parts["far"][0]
            expected = plain + variance_of_slips(learned, parts, j)
            assert variances[j] == pytest.approx(expected, rel=1e-6)


def test_the_first_angle_of_a_filter_is_that_after_the_first_sample() -> None:
    """Its lags begin there, whatever the memory before says."""
    learned = drawn_map(("a",), ("x",))
    shape = Shape.of(learned)
    parts, _ = seen(learned, np.full(shape.memory.size, 9.0), 0.0, [0.3, 0.7])
    lags = parts["features"][shape.features["lags"]]
    np.testing.assert_allclose(lags[1::2], 0.0, atol=1e-12)


def test_what_is_missing_widens_the_band_with_its_age() -> None:
    """By (∂y/∂z)² 2 (1 − exp(−(rate a)²/2)), and by nothing else: the last reading stands."""
    learned = drawn_map(("a",), ("x", "f"), False)
    arrays, shape = learned.arrays, Shape.of(learned)
    row, memory = np.array([0.05, 0.02]), None
    for _ in range(20):
        *_, settled, memory = mapped(learned, memory, DT, row)
    for _ in range(40):
        *_, later, memory = mapped(learned, memory, DT, np.array([0.05, 99.0]), (1.0, 0.0))
    unknown = 2 * (1 - np.exp(-((arrays["rate"][1] * DT * 40) ** 2) / 2))
    parts, _ = seen(learned, memory, 0.0, row)
    mean = arrays["mean"][0]
    lags = mean[shape.features["lags"]].reshape(len(TIME_CONSTANTS), 2)[:, 1].sum()
    slope = mean[shape.features["readings"]][1] + lags + radial_slopes(learned, parts, 0)[1]
    *_, read, _ = mapped(learned, memory, 0.0, row)
    assert later[0] - read[0] == pytest.approx(slope**2 * unknown, rel=1e-5)
    assert later[0] > settled[0]


def test_a_map_is_in_both_places_of_its_readings() -> None:
    """The mean and the variance of two values with chances 0.7 and 0.3."""
    learned = drawn_map(("a", "b"), ("x", "f"), False)
    one, other = np.array([0.3, -0.2]), np.array([1.1, -0.2])
    alone, elsewhere = (mapped(learned, None, DT, row) for row in (one, other))
    both = mapped(learned, None, DT, one, other=other, chance=0.3)
    apart = elsewhere[0] - alone[0]
    np.testing.assert_allclose(both[0], alone[0] + 0.3 * apart)
    np.testing.assert_allclose(both[2], alone[2] + 0.21 * apart**2)
    np.testing.assert_allclose(both[3], alone[3])


def test_forces_say_which_reading_is_right() -> None:
    """T² and its spread by hand at both readings, each with plays of its own from the jump on."""
    learned = drawn_map(("f", "g"), ("x",), False).model_copy(update={"rms": (0.2, 0.3)})
    judge = JudgedJumps.among([learned], ["x", "f", "g"])[0]
    assert JudgedJumps.among([learned], ["x", "f"]) == []
    forces = np.array([0.3, -0.1])
    rms = np.array(learned.rms)

    def square(memory: Floats, x: float, dt: float) -> tuple[float, Floats]:
        parts, after = seen(learned, memory, dt, x)
        beside = np.array([variance_of_slips(learned, parts, j) for j in range(2)])
        errors = forces - learned.arrays["mean"] @ parts["features"]
        whitened = whitening(learned.arrays["correlation"]) @ (errors / np.sqrt(rms**2 + beside))
        spread = np.sum(np.log(1 + beside / rms**2)) / 2
        return min(float(whitened @ whitened / 2), MOST) + spread, after

    def evidence(memory: ca.DM, x: float, jumped: float, there: ArrayLike) -> tuple[float, ca.DM]:
        read = (ca.DM([value, *forces]) for value in (x, jumped))
        parameters = ca.DM(forces_parameters(learned))
        ratio, memory = judge.evidence(memory, ca.DM(DT), *read, ca.DM(there), parameters)
        return float(ratio), memory

    memory = judge.begun(ca.DM([0.1]), ca.DM([1]))
    off = real = np.array(judge.memory.part(memory, "off")).ravel()
    squares, total = [0.0, 0.0], 0.0
    for k, (x, jumped) in enumerate(((0.12, 0.12), (0.13, 0.9), (0.14, 0.91), (0.15, 0.92))):
        ratio, memory = evidence(memory, x, jumped, [1, 1, 1])
        total += ratio
        if k == 2:  # the jumped one is asked at the second sample after the jump
            squares[1], real = square(real, jumped, 2 * DT)
        else:
            squares[0], off = square(off, x, DT if k < 2 else 2 * DT)
        real = off if k == 0 else real
        parts = judge.memory.parts(memory)
        np.testing.assert_allclose(np.array(parts["off"]).ravel(), off)
        np.testing.assert_allclose(np.array(parts["real"]).ravel(), real)
        if k == 2:
            expected = 2 * (2 * DT / INDEPENDENT) / 2 * (squares[0] - squares[1])
            assert total == pytest.approx(expected, rel=1e-6)
    assert total == pytest.approx(expected)
    assert evidence(memory, 0.2, 0.9, [1, 1, 0])[0] == 0.0  # a force is missing
