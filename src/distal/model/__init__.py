"""The physics of a rig as CasADi expressions: forces by virtual work, exact friction, stops, and
the time step. It is written once, for the simulation and the filters.

In: a `Rig`; out: functions of coordinates q (joints, then drives), speeds and parameters. A tendon
with length ℓ(q) and tension T pushes its coordinates by −T ∂ℓ/∂q; friction is set-valued and solved
with the speeds, not smoothed.

    from distal.model import Mechanism
    from distal.rig import load_rig

    mechanism = Mechanism(load_rig("capstan-joint"))
    print(mechanism.n_bodies, mechanism.parameters.names[:3])
"""

from distal.model.friction import (
    Limit,
    Slip,
    clip_moments,
    restitution,
    slipping,
    soft_moments,
    solver,
)
from distal.model.mechanism import GRAVITY, Mechanism, Moment
from distal.model.stepping import (
    RESOLUTION,
    Contacts,
    Kick,
    Kicked,
    damped_inertias,
    interval_step,
    joint_frequency,
    kick_and_drift,
    kicked,
    loads_of,
    residual,
    stiffest_frequency,
    substeps,
)
from distal.model.tendon_tensions import stretched

__all__ = [
    "GRAVITY",
    "RESOLUTION",
    "Contacts",
    "Kick",
    "Kicked",
    "Limit",
    "Mechanism",
    "Moment",
    "Slip",
    "clip_moments",
    "damped_inertias",
    "interval_step",
    "joint_frequency",
    "kick_and_drift",
    "kicked",
    "loads_of",
    "residual",
    "restitution",
    "slipping",
    "soft_moments",
    "solver",
    "stiffest_frequency",
    "stretched",
    "substeps",
]
