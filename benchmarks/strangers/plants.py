"""Plants of the paper's rig that lie within what its file leaves open."""

from __future__ import annotations

from typing import Any

import numpy as np
from tests.support.cases import WINDOW

from distal import Rig, load_rig


def wide_rig() -> Rig:
    """Return the paper's rig as printed, in a travel of 20 mm: what the filters know."""
    return load_rig("paper-2008-printed").with_values(WINDOW)


def drawn_plant(rng: np.random.Generator) -> dict[str, Any]:
    """Return the values of a plant: axle friction within ±20 %, stiffness of both tendons within
    ±10 %.
    """
    stiffness = 806.0 * (1 + 0.1 * float(rng.uniform(-1, 1)))
    return {
        "joints.0.friction.coefficient": 0.5 * (1 + 0.2 * float(rng.uniform(-1, 1))),
        "tendons.0.stiffness": stiffness,
        "tendons.1.stiffness": stiffness,
    }
