"""A plant of parts that move without one another: each part's own function, side by side."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from distal.expressions import VectorNode
from distal.kernels import Indices, placed, taken
from distal.model import Mechanism
from distal.rig import Part, independent_parts


def parts_of_plant(mechanism: Mechanism) -> tuple[Part, ...]:
    """Return the parts of a plant that do not touch each other; none where there is only one."""
    parts = independent_parts(mechanism.rig)
    return () if len(parts) == 1 or mechanism.parameters.inside else parts


def plants_apart(
    mechanism: Mechanism, parts: tuple[Part, ...], plant: Callable[[Mechanism], ca.Function], rubbing: list[int]
) -> ca.Function:
    """Return (carry, x, p) → (carry⁺, y) of a plant, see `plant_function`, by the functions of its parts.

    Args:
        plant: equations of a part → its function.
        rubbing: drives with friction inside their transmission.
    """
    n, nt, nj = mechanism.n_bodies, mechanism.n_tendons, mechanism.n_joints
    names = mechanism.parameters.names
    carry, x = ca.MX.sym("carry", 2 * n + len(rubbing)), ca.MX.sym("x", 5 * n + 1)
    p = ca.MX.sym("p", len(names))
    carries, outputs = list[VectorNode](), list[VectorNode]()
    to_carry, to_y = list[Indices](), list[Indices]()
    for part in parts:
        equations = Mechanism(part.rig, part.own_paths(mechanism.parameters.inputs), remembers=True)
        drives = np.array(part.indices["drives"], dtype=np.intp)
        bodies = np.concatenate([part.indices["joints"], nj + drives]).astype(np.intp)
        frictions = np.array([rubbing.index(d) for d in drives if d in rubbing], dtype=np.intp)
        numbers = np.array([names.index(part.whole_path(name)) for name in equations.parameters.names], dtype=np.intp)
        at = np.concatenate([bodies, n + bodies, 2 * n + frictions])
        inputs = np.concatenate([*(k * n + bodies for k in range(5)), [5 * n]])
        after, y = plant(equations)(taken(carry, at), taken(x, inputs), taken(p, numbers))
        carries.append(after)
        outputs.append(y)
        to_carry.append(at)
        tendons = np.array(part.indices["tendons"], dtype=np.intp)
        to_y.append(np.concatenate([bodies, n + bodies, 2 * n + tendons, 2 * n + nt + bodies]))
    following = placed(carries, to_carry, carry.numel())
    y = placed(outputs, to_y, 3 * n + nt)
    return ca.Function("plant", [carry, x, p], [following, y], ["carry", "x", "p"], ["next", "y"])
