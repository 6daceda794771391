"""The belief before the first sample, from the rig and from that sample's readings."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import casadi as ca

from distal.estimators.adaptive.drive_tracking import MEMORY, remembered_position
from distal.estimators.adaptive.filter_context import FilterContext
from distal.estimators.adaptive.states import Begin, StateVector
from distal.estimators.adaptive.touch import touch_layout
from distal.estimators.read_channels import UNKNOWN_POSITION
from distal.expressions import Scalar, Vector
from distal.kernels.layout import is_read
from distal.regression import (
    ReportedMap,
    Shape,
    begun_by,
    homed_memory,
    map_function,
    map_parameters,
)
from distal.rig import LearnedMap, Sensor

Read = Callable[[Sensor, Scalar], Scalar]
"""Function that returns a sensor's first value, or its second argument where that value
is missing.
"""


def prior_function(
    states: StateVector,
    maps: Sequence[ReportedMap],
    readings: Sequence[tuple[LearnedMap, Sequence[int]]],
    positions: Sequence[int | None],
    inputs: int,
    home_std: float | None = None,
) -> ca.Function:
    """Return the function (values, mask, p) → (mean, covariance's diagonal, memory) before the
    first sample.

    Drives are at rest at the positions of the first sample; the effort that a play transmits is the
    first reading of its drive's effort.

    The angles are those of the maps on readings alone, where these are more certain than the rig.

    Args:
        maps: each map that is reported.
        readings: each map on readings alone, with the joints that it speaks of.
        positions: for each channel the index in the kernel state of its drive's position, None for
            readings used as they are.
        inputs: length of p.
        home_std: std of the angles at which joints are known to stand [rad], if they ever are.
    """
    context = states.context
    names = context.channels.names
    values = ca.SX.sym("values", len(names))
    is_present = ca.SX.sym("mask", len(names))
    sensors = {sensor.name: sensor for sensor in context.mechanism.rig.sensors}
    credible = (context.credible(sensors[name], values[k]) for k, name in enumerate(names))
    mask = ca.vertcat(*(is_present[k] * is_credible for k, is_credible in enumerate(credible)))

    def is_there(sensor: Sensor) -> Scalar:
        return is_read(mask[names.index(sensor.name)])

    def read(sensor: Sensor, otherwise: Scalar) -> Scalar:
        value = context.corrected(sensor, values[names.index(sensor.name)])
        return ca.if_else(is_there(sensor), value, otherwise)

    means, stds = states.prior()
    mean = ca.SX(means)
    variances = ca.SX(stds**2)
    memory = _memory(context, read, is_there)
    for i in range(context.n_drives):
        effort = context.force_sensor(i)
        at = states.transmitted(i)
        if at is not None and effort is not None:
            mean[at] = read(effort, mean[at])
    begin = _begin(context, read)
    for at, state in enumerate(states.states):
        if state.first is not None:
            mean[at], std = state.first(begin)
            variances[at] = std**2
    # maps beside the filter read the positions of drives as it has them, without a known offset
    placed = (
        values[k] if at is None else context.corrected(sensors[names[k]], values[k])
        for k, at in enumerate(positions)
    )
    symbols = context.mechanism.parameters.symbols
    p = ca.SX.sym("p", inputs)
    outputs = [mean, variances, memory, ca.vertcat(*placed, values[len(positions) :])]
    outputs = ca.substitute(outputs, [symbols], [p[: symbols.numel()]])
    plain = ca.Function("plain", [values, is_present, p], outputs)
    return _with_maps(plain, maps, readings, names, home_std)


def _with_maps(
    plain: ca.Function,
    maps: Sequence[ReportedMap],
    readings: Sequence[tuple[LearnedMap, Sequence[int]]],
    names: Sequence[str],
    home_std: float | None,
) -> ca.Function:
    """Return the function `plain` with the start by maps, and with the memories of maps."""
    values, is_present, p = (ca.MX.sym(n, plain.numel_in(i)) for i, n in enumerate("vmp"))
    mean, variances, memory, tracked = plain(values, is_present, p)
    for learned, joints in readings:
        columns = [list(names).index(name) for name in learned.channels]
        read = values[columns], is_present[columns]
        function = map_function(Shape.of(learned), len(learned.joints))
        begun = begun_by(learned, *read)
        angles, _, spreads, _ = function(begun, 0, *read, map_parameters(learned))
        for k, joint in enumerate(joints):
            better = spreads[k] < variances[joint]
            mean[joint] = ca.if_else(better, angles[k], mean[joint])
            variances[joint] = ca.if_else(better, spreads[k], variances[joint])
    number = p.numel() - sum(placed.parameters for placed in maps)
    for placed in maps:
        columns = list(placed.channels)
        of = (tracked if placed.learned.beside_filter else values)[columns]
        if placed.learned.beside_filter:
            of = ca.vertcat(of, mean[list(placed.states)])
        begun = begun_by(placed.learned, of, is_present[columns])
        if placed.homes:
            parameters = p[number : number + placed.parameters]
            begun = homed_memory(placed.shape, placed.joints)(begun, parameters, home_std)
        memory = ca.vertcat(memory, begun)
        number += placed.parameters
    return ca.Function("prior", [values, is_present, p], [mean, variances, memory])


def _memory(context: FilterContext, read: Read, is_there: Callable[[Sensor], Scalar]) -> Vector:
    """Return what is remembered of the drives and their forces at the first sample; the position of
    a drive is unknown where `is_there` is 0.
    """
    lengths = touch_layout(context)
    memory = ca.SX.zeros(MEMORY * context.n_drives)
    for i, drive in enumerate(context.mechanism.rig.drives):
        position = context.position_sensor(i)
        effort = context.force_sensor(i)
        if position is not None:
            unknown = UNKNOWN_POSITION[drive.kind] ** 2
            memory[remembered_position(i, "position")] = read(position, 0.0)
            memory[remembered_position(i, "unknown")] = ca.if_else(is_there(position), 0.0, unknown)
        if effort is not None:
            memory[remembered_position(i, "effort")] = read(effort, 0.0)
    forces, evidence, torques = (
        ca.SX.zeros(lengths[name]) for name in ("forces", "evidence", "torques")
    )
    return ca.vertcat(memory, forces, evidence, torques)


def _begin(context: FilterContext, read: Read) -> Begin:
    """Return the readings of the first sample; `read` gives a sensor's value, or its second
    argument where that is missing.
    """
    cells = {sensor.of: sensor for sensor in context.channels.tensions}
    positions = [context.position_sensor(i) for i in range(context.n_drives)]
    forces = [context.force_sensor(i) for i in range(context.n_drives)]
    tensions = [cells.get(name) for name in context.mechanism.rig.tendon_names]
    starts, efforts, pulls = (
        [None if sensor is None else read(sensor, 0.0) for sensor in sensors]
        for sensors in (positions, forces, tensions)
    )
    return Begin([0.0 if start is None else start for start in starts], efforts, pulls)
