"""Numbers of a mechanism's expressions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np

from distal import Rig
from distal.model import Mechanism

At = Callable[..., list[np.ndarray]]


def look(rig: Rig | Mechanism, expressions: Callable[[Mechanism, ca.SX, ca.SX], list[Any]]) -> At:
    """Return what gives the numbers, (n,) each, of expressions of positions and speeds, which are
    zero where nothing is said; joints come first.
    """
    mechanism = rig if isinstance(rig, Mechanism) else Mechanism(rig)
    n, parameters = mechanism.n_bodies, mechanism.parameters
    q, v = ca.SX.sym("q", n), ca.SX.sym("v", n)
    function = ca.Function("look", [q, v, parameters.symbols], expressions(mechanism, q, v))

    def at(positions: Sequence[float], speeds: Sequence[float] = ()) -> list[np.ndarray]:
        state = (np.append(part, np.zeros(n - len(part))) for part in (positions, speeds))
        made = function.call([*map(ca.DM, state), ca.DM(parameters.values)])
        return [np.array(part).ravel() for part in made]

    return at
