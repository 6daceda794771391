"""The physics of a rig, written once in CasADi: forces by virtual work, exact friction, stops, and the time step."""

from distal.model.chain_kick import residual
from distal.model.elasticity import stretched
from distal.model.friction import (
    ClipMoments,
    Limit,
    SoftMoments,
    capstan_limit,
    clip_moments,
    free_response,
    load_dependent_limit,
    soft,
    soft_moments,
    stribeck,
)
from distal.model.intervals import interval_step
from distal.model.mechanism import GRAVITY, Mechanism
from distal.model.motion import Moment
from distal.model.parameters import Parameters, number_at
from distal.model.stepping import (
    RESOLUTION,
    Kick,
    impulses,
    joint_frequency,
    kick_and_drift,
    kicked_chain,
    last_kick,
    loads_of,
    responses,
    stiffest_frequency,
    substeps,
)
from distal.model.stick_slip import Slip, slipping, solver
from distal.model.stops import restitution
from distal.model.tangents import tangent_step
from distal.model.tendons import Body

__all__ = [
    "GRAVITY",
    "RESOLUTION",
    "Body",
    "ClipMoments",
    "Kick",
    "Limit",
    "Mechanism",
    "Moment",
    "Parameters",
    "Slip",
    "SoftMoments",
    "capstan_limit",
    "clip_moments",
    "free_response",
    "impulses",
    "interval_step",
    "joint_frequency",
    "kick_and_drift",
    "kicked_chain",
    "last_kick",
    "load_dependent_limit",
    "loads_of",
    "number_at",
    "residual",
    "responses",
    "restitution",
    "slipping",
    "soft",
    "soft_moments",
    "solver",
    "stiffest_frequency",
    "stretched",
    "stribeck",
    "substeps",
    "tangent_step",
]
