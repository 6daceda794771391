"""The physics of a rig, written once in CasADi: forces by virtual work, exact friction, stops, and the time step."""

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
from distal.model.geometry import Insertion, angle_at, elongation, excursion
from distal.model.intervals import interval_step
from distal.model.mechanism import GRAVITY, Mechanism
from distal.model.parameters import Parameters, number_at
from distal.model.stepping import (
    RESOLUTION,
    Kick,
    impulses,
    joint_frequency,
    kick_and_drift,
    last_kick,
    responses,
    stiffest_frequency,
    substeps,
)
from distal.model.stops import restitution
from distal.model.tangents import tangent_step
from distal.model.tendons import Body

__all__ = [
    "GRAVITY",
    "RESOLUTION",
    "Body",
    "ClipMoments",
    "Insertion",
    "Kick",
    "Limit",
    "Mechanism",
    "Parameters",
    "SoftMoments",
    "angle_at",
    "capstan_limit",
    "clip_moments",
    "elongation",
    "excursion",
    "free_response",
    "impulses",
    "interval_step",
    "joint_frequency",
    "kick_and_drift",
    "last_kick",
    "load_dependent_limit",
    "number_at",
    "responses",
    "restitution",
    "soft",
    "soft_moments",
    "stiffest_frequency",
    "stretched",
    "stribeck",
    "substeps",
    "tangent_step",
]
