"""What the sensors of the drives read at their positions: offsets and curves, as the filter has
them.
"""

from __future__ import annotations

import casadi as ca

from distal.arrays import Floats
from distal.errors import EstimationError
from distal.estimators.adaptive import StateVector, state_vector
from distal.inverse.setpoint_function import CommandModel


def read_function(model: CommandModel, states: StateVector) -> ca.Function:
    """Return (positions, state, p) → what the sensors of the drives' positions read there."""
    state = ca.SX.sym("state", len(states))
    known = states.context.mechanism.parameters
    positions = ca.SX.sym("s", model.nd)
    read = ca.SX(positions)
    for d in range(model.nd):
        sensor = states.context.position_sensor(d)
        if sensor is not None:
            # what a reading errs by changes little over that error itself
            offset = states.context.number(f"{states.context.path(sensor)}.bias")
            read[d] += positions[d] - states.position(d, positions[d], state) + offset
    return ca.Function("read", [positions, state, known.symbols], [read])


def readings(model: CommandModel, positions: Floats) -> Floats:
    """Return the same over time by what the rig file says, (k, n_drives); positions themselves
    where no filter reads it.
    """
    try:
        states = state_vector(model.rig)
    except EstimationError:
        return positions
    read = read_function(model, states).map(len(positions))
    found: Floats = (
        read(positions.T, states.means, states.context.mechanism.parameters.values).full().T
    )
    return found
