"""How surprising an angle's error is without its reference: ν²/S beyond the mean of each log, of the worst reference."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from distal.fitting.angle_errors import surprise_of
from distal.fitting.likelihood import Innovations


@dataclass(frozen=True)
class Reference:
    """What `surprise_of` asks of an angle sensor."""

    name: str
    bias: SimpleNamespace


def surprise(values: list[np.ndarray], variance: float, offset_std: float) -> float:
    """Return the surprise of logs whose second channel is the one reference."""
    runs = [Innovations(np.column_stack([0.0 * v, v]), np.full((len(v), 2), variance)) for v in values]
    reference = Reference("encoder", SimpleNamespace(filter_std=offset_std))
    problem = SimpleNamespace(
        measured=("u", "encoder"), filter=SimpleNamespace(references=(reference,)), at=lambda z: runs
    )
    return surprise_of(problem, np.zeros(1))  # type: ignore[arg-type]


def test_each_logs_own_offset_is_no_surprise() -> None:
    wave = 0.1 * np.array([1.0, -1.0, 1.0, -1.0])
    assert surprise([wave + 5.0, wave - 3.0], 0.04, 0.0) == pytest.approx(0.01 / 0.04)


def test_an_offset_that_is_not_known_hides_nothing() -> None:
    """S holds the offset's variance; what is left of S is what the angle is expected to err by, a tenth of S at least."""
    wave = 0.1 * np.array([1.0, -1.0, 1.0, -1.0])
    assert surprise([wave], 0.04, 0.1) == pytest.approx(0.01 / (0.04 - 0.01))
    assert surprise([wave], 0.04, 10.0) == pytest.approx(0.01 / 0.004)


def test_samples_without_a_reference_do_not_count() -> None:
    wave = np.array([0.1, np.nan, -0.1, np.nan])
    assert surprise([wave, np.full(3, np.nan)], 0.04, 0.0) == pytest.approx(0.01 / 0.04)
