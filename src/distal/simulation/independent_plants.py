"""A plant whose components move in independent groups: the function of each group, side by side in
one.
"""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from distal.kernels import PlacedKernel, side_by_side
from distal.model import Mechanism
from distal.rig import Subsystem, independent_parts


def parts_of_plant(mechanism: Mechanism) -> tuple[Subsystem, ...]:
    """Return the independent parts of a plant; none if there is only one, or if the plant has an
    internal state.
    """
    parts = independent_parts(mechanism.rig)
    return () if len(parts) == 1 or mechanism.parameters.inside else parts


def plants_apart(
    mechanism: Mechanism,
    parts: tuple[Subsystem, ...],
    plant: Callable[[Mechanism], ca.Function],
    rubbing: list[int],
) -> ca.Function:
    """Return the function of a plant, see `plant_function`, put together from those of its
    independent parts.

    Args:
        plant: returns the function of a part by its equations.
        rubbing: indices of the drives with friction inside their transmission.
    """
    n = mechanism.n_bodies
    nt = mechanism.n_tendons
    nj = mechanism.n_joints
    names = mechanism.parameters.names
    kernels = []
    for part in parts:
        equations = Mechanism(part.rig, part.own_paths(mechanism.parameters.inputs), remembers=True)
        drives, tendons = (
            np.array(part.indices[kind], dtype=np.intp) for kind in ("drives", "tendons")
        )
        bodies = np.concatenate([part.indices["joints"], nj + drives]).astype(np.intp)
        frictions = np.array([rubbing.index(d) for d in drives if d in rubbing], dtype=np.intp)
        kernel_state = np.concatenate([bodies, n + bodies, 2 * n + frictions])
        x = np.concatenate([*(k * n + bodies for k in range(5)), [5 * n]])
        p = np.array(
            [names.index(part.whole_path(name)) for name in equations.parameters.names],
            dtype=np.intp,
        )
        y = np.concatenate([bodies, n + bodies, 2 * n + tendons, 2 * n + nt + bodies])
        kernels.append(PlacedKernel(plant(equations), kernel_state, x, p, y))
    return side_by_side("plant", kernels, (2 * n + len(rubbing), 5 * n + 1, len(names), 3 * n + nt))
