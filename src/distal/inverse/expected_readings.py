"""Readings of the drives' position sensors at given positions, with the offsets and curves that the
filter assumes.
"""

from __future__ import annotations

import casadi as ca

from distal.arrays import Floats
from distal.errors import EstimationError
from distal.estimators.adaptive import StateVector, state_vector
from distal.inverse.setpoint_function import CommandModel


def read_function(model: CommandModel, states: StateVector) -> ca.Function:
    """Return the function (positions, state, p) → readings of the drives' position sensors,
    (n_drives,) [m, rad], with the filter's `state`.
    """
    state = ca.SX.sym("state", len(states))
    known = states.context.mechanism.parameters
    positions = ca.SX.sym("s", model.nd)
    read = ca.SX(positions)
    for d in range(model.nd):
        sensor = states.context.position_sensor(d)
        if sensor is not None:
            # the sensor's error at the true position is nearly its error at the reading
            offset = states.context.number(f"{states.context.path(sensor)}.bias")
            read[d] += positions[d] - states.position(d, positions[d], state) + offset
    return ca.Function("read", [positions, state, known.symbols], [read])


def readings(model: CommandModel, positions: Floats) -> Floats:
    """Return the readings of the drives' position sensors at `positions` by the rig file, both (k,
    n_drives) [m, rad].

    Where the filter cannot run on the rig, the positions themselves are returned.
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
