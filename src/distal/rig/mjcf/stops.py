"""How stiff the stops of a model's joints are: MuJoCo's limits give way, those of a light joint by degrees."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from distal.rig.mjcf.bodies import Units

if TYPE_CHECKING:
    import mujoco

RETURN_TIME = 1e-3
"""In this time a joint leaves a stop that a correction of a filter has put it into [s]; MuJoCo takes twice solref's."""


def described_stop(model: mujoco.MjModel, joint: int, units: Units) -> dict[str, float]:
    """Return the raw stiffness and damping of a joint's stops, those of MuJoCo's limits at rest deep in them.

    K = k d/((1 − d) A), k = 1/(T ζ)²/d (or −solref[0]/d): MuJoCo's documentation, "Computation", Constraint model, where
    r is far beyond solimp's width, so that d = d_max, and A is the inverse inertia that a joint's torque meets.
    """
    time, ratio = (float(part) for part in model.jnt_solref[joint])
    d = float(np.clip(model.jnt_solimp[joint][1], 1e-4, 0.9999))
    inverse = float(model.dof_invweight0[int(model.jnt_dofadr[joint])])
    # MuJoCo takes no time constant below two steps
    k = 1.0 / (max(time, 2.0 * model.opt.timestep) * ratio) ** 2 if time > 0.0 else -time
    stiffness = float(f"{k / ((1.0 - d) * max(inverse, 1e-12)) * units.torque:.6g}")
    return {"stop_stiffness": stiffness, "stop_damping": RETURN_TIME * stiffness}
