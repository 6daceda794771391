"""The physics of a rig as CasADi expressions: forces by virtual work, exact friction, stops, and
the time step. It is written once, for the simulation and the filters.
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
