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

from distal.model.chain import Slip, slipping, solver
from distal.model.friction import (
    Limit,
    clip_moments,
    free_response,
    restitution,
    soft,
    soft_moments,
)
from distal.model.mechanism import GRAVITY, Mechanism, Moment
from distal.model.stepping import (
    RESOLUTION,
    Contacts,
    Kick,
    damped_inertias,
    impulses,
    interval_step,
    joint_frequency,
    kick_and_drift,
    kicked_chain,
    loads_of,
    residual,
    responses,
    stiffest_frequency,
    substeps,
)
from distal.model.tendon_tensions import stretched

__all__ = [
    "GRAVITY",
    "RESOLUTION",
    "Contacts",
    "Kick",
    "Limit",
    "Mechanism",
    "Moment",
    "Slip",
    "clip_moments",
    "damped_inertias",
    "free_response",
    "impulses",
    "interval_step",
    "joint_frequency",
    "kick_and_drift",
    "kicked_chain",
    "loads_of",
    "residual",
    "responses",
    "restitution",
    "slipping",
    "soft",
    "soft_moments",
    "solver",
    "stiffest_frequency",
    "stretched",
    "substeps",
]
