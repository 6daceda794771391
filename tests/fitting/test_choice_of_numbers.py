"""What a fit varies, and how uncertain the model leaves it."""

from __future__ import annotations

import pytest

from distal import load_rig
from distal.fitting.free_parameters import NOISY, POINTS, Free, _coarse


@pytest.mark.parametrize(
    ("path", "coarse"),
    [
        (
            "tendons.0.path.friction",
            POINTS / 4,
        ),  # a sheath of four points keeps so much of its friction's value
        ("drives.0.damping", NOISY),
        ("drives.0.backlash.width", NOISY),
        ("tendons.0.stiffness", 0.0),
    ],
)
def test_what_the_model_leaves_uncertain(path: str, coarse: float) -> None:
    rig = load_rig("capstan-joint").with_values(
        {
            "tendons.0.path": {"friction": 0.1, "wrap": "90 deg", "nodes": 4},
            "tendons.0.damping": 0.0,
        }
    )
    part = Free(path, (path,), (1.0,), 0.1, 1.0, 0.0, 10.0, coarse=0.0)
    assert _coarse(rig, part).coarse == pytest.approx(coarse)
