"""The kinds of states beside the joints' motion: a new kind is a file in this folder and an entry
here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from distal.estimators.adaptive.filter_context import FilterContext
from distal.estimators.adaptive.states.bias import sensor_biases
from distal.estimators.adaptive.states.drive_friction_state import unknown_frictions
from distal.estimators.adaptive.states.drive_position import unmeasured_positions
from distal.estimators.adaptive.states.external_torque import external_torques
from distal.estimators.adaptive.states.internal import inside
from distal.estimators.adaptive.states.linearity import linearities
from distal.estimators.adaptive.states.parameter import uncertain_parameters
from distal.estimators.adaptive.states.reading import unknowns_of_readings
from distal.estimators.adaptive.states.state import State
from distal.estimators.adaptive.states.transmission import transmissions

Kind = Callable[[FilterContext], Sequence[State]]
"""Function that returns the blocks of one kind that a rig has."""

KINDS: tuple[Kind, ...] = (
    external_torques,
    uncertain_parameters,
    linearities,
    unmeasured_positions,
    unknown_frictions,
    transmissions,
    inside,
    sensor_biases,
    unknowns_of_readings,
)
"""All kinds; their order is that of the state vector, after the joints' motion."""
