"""Stiffness of the limits and couplings of a model's joints; in MuJoCo they give way, those of
light joints by degrees.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from distal.arrays import Floats
from distal.rig.mjcf.bodies import Units

if TYPE_CHECKING:
    import mujoco

RETURN_TIME = 1e-3
"""Time constant with which a joint leaves a stop into which a correction of a filter has put it
[s]; in MuJoCo it is twice that of `solref`. Source: judgement.
"""


def stiffness_at_rest(
    model: mujoco.MjModel, solref: Floats, solimp: Floats, inverse_inertia: float
) -> float:
    """Return the stiffness of a constraint at rest, beyond the width of `solimp`, in the model's
    units.

    It is K = k/((1 − d) A), with k = 1/(T ζ)² or −solref[0], d = d_max and A the `inverse_inertia`.
    This follows from MuJoCo's documentation, "Computation": the force is f = (a_ref − a)/R with R =
    A (1 − d)/d and a_ref = −(d/d_max²) k r at rest.
    """
    time = float(solref[0])
    ratio = float(solref[1])
    d = float(np.clip(solimp[1], 1e-4, 0.9999))
    # MuJoCo takes no time constant below two steps
    k = 1.0 / (max(time, 2.0 * float(model.opt.timestep)) * ratio) ** 2 if time > 0.0 else -time
    return k / ((1.0 - d) * max(inverse_inertia, 1e-12))


def described_stop(model: mujoco.MjModel, joint: int, units: Units) -> dict[str, float]:
    """Return stiffness and damping of a joint's stops, raw, by the joint's limits in MuJoCo."""
    inverse = float(model.dof_invweight0[int(model.jnt_dofadr[joint])])
    stiffness = (
        stiffness_at_rest(model, model.jnt_solref[joint], model.jnt_solimp[joint], inverse)
        * units.torque
    )
    return {
        "stop_stiffness": float(f"{stiffness:.6g}"),
        "stop_damping": float(f"{RETURN_TIME * stiffness:.6g}"),
    }
