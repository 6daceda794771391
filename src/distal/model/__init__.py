"""The physics of a rig, written once in CasADi: forces by virtual work, exact friction, stops, and the time step."""

from distal.model.friction import SoftMoments, free_response, load_dependent_limit, soft, soft_moments
from distal.model.geometry import angle_at, elongation
from distal.model.intervals import interval_step
from distal.model.mechanism import GRAVITY, Body, Mechanism
from distal.model.parameters import Parameters
from distal.model.stepping import Kick, impulses, kick_and_drift, last_kick, responses, stiffest_frequency, substeps
from distal.model.stops import restitution, stop_force
from distal.model.tangents import tangent_step

__all__ = [
    "GRAVITY",
    "Body",
    "Kick",
    "Mechanism",
    "Parameters",
    "SoftMoments",
    "angle_at",
    "elongation",
    "free_response",
    "impulses",
    "interval_step",
    "kick_and_drift",
    "last_kick",
    "load_dependent_limit",
    "responses",
    "restitution",
    "soft",
    "soft_moments",
    "stiffest_frequency",
    "stop_force",
    "substeps",
    "tangent_step",
]
