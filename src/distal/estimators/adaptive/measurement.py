"""The comparison of measured forces, tensions and angles with those that follow from the state.
Equation (17).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from distal.estimators.adaptive.drive_tracking import Tracks
from distal.estimators.adaptive.filter_context import FilterContext
from distal.estimators.adaptive.filter_inputs import mechanics_function
from distal.estimators.adaptive.states import StateVector
from distal.expressions import Scalar, Vector, VectorNode
from distal.kernels.layout import Layout
from distal.model import Moment
from distal.rig import Sensor

TIE = 0.3
"""Standard deviation of the transmitted effort around the tendons' pull, in those of the effort's
sensor [1]. Source: benchmark (benchmarks/guards).
"""

NOMINAL_TIME = 1.0
"""Time for which an unmeasured pull keeps its departure from its nominal value [s]. Source:
judgement.
"""

ROW = Layout(residual=1, limit=1, asymmetry=1, variance=1, mask=1)
"""Layout of the values of a row, as in `MeasurementRow`. Source: definition (layout of a
vector).
"""

SLOPED = ("residual", "limit", "asymmetry")
"""Names of the values of a row that change with the state."""


@dataclass(frozen=True)
class MeasurementRow:
    """One force, tension, angle or other reading to compare, as expressions of a symbolic state.

    Args:
        name: of its sensor, or of the drive where the pull is only nominal.
        residual: measured minus expected, without friction.
        variance: of the sensor and of the drive's position.
        mask: 0 where the row does not count, else see `distal.kernels.layout`.
        limit: friction limit of the drive, the mean of both directions.
        asymmetry: by how much the limit is larger against motion to +, and smaller against motion
            to −.
        drive: index of the drive whose friction is in it, or None.
        measured: whether a sensor measures it; else the pull is nominal.
        trusted: whether it is a reference, which is never taken as wild.
    """

    name: str
    residual: Scalar
    variance: Scalar
    mask: Scalar
    limit: Scalar = 0
    asymmetry: Scalar = 0
    drive: int | None = None
    measured: bool = True
    trusted: bool = False


def measurement_rows_of(
    states: StateVector, state: Vector, tracks: Tracks[ca.SX], rates: Vector, x: Vector
) -> list[MeasurementRow]:
    """Return the rows to compare: U = Σ T ∂ℓ/∂s + B_d ṡ + friction of each drive, measured
    tensions, a reference's angle, other sensors.

    Args:
        state: symbolic, (n,).
        tracks: of the drives.
        rates: mean speed of each drive over the interval, (n_drives,).
        x: the sample.
    """
    context = states.context
    mechanism = states.context.mechanism
    nj = states.context.n_joints
    q = states.coordinates(state, tracks.positions)
    v = ca.vertcat(state[nj : 2 * nj], rates)
    mechanics = mechanics_function(context)(q, v, states.parameters(state))
    tensions, pulls, dampings, limits, asymmetries, tension_slopes, pull_slopes = mechanics

    def read(sensor: Sensor) -> Scalar:
        value = context.value(x, sensor)
        return value - states.added(("reading", sensor.name), state, value)

    rows = []
    for i, drive in enumerate(mechanism.rig.drives):
        sensor = context.force_sensor(i)
        body = nj + i
        track = tracks[i]
        spread = track.variance * pull_slopes[body, body] ** 2
        free = away_from_stops(context, i, track.position)
        expected = pulls[body] - states.added(("lacking force", i), state)
        friction = (limits[body] + states.added(("friction", i), state), asymmetries[body], i)
        if sensor is None:
            path = f"drives.{i}.nominal_force"
            nominal_std = context.number(f"{path}.std")
            is_known = nominal_std > 0.0
            lasting = nominal_std**2 * 2 * NOMINAL_TIME / ca.fmax(x[0], 1e-6)
            residual = context.number(path) - expected
            rows.append(
                MeasurementRow(
                    drive.name,
                    residual,
                    spread + lasting,
                    is_known * free,
                    *friction,
                    measured=False,
                )
            )
            continue
        noise = context.noise(sensor)
        mask = context.mask(x, sensor) * free
        transmitted = states.transmitted(i)
        if transmitted is not None:
            damped = dampings[body] * rates[i]
            rows.append(
                MeasurementRow(
                    sensor.name,
                    state[transmitted] - (expected - damped),
                    TIE**2 * noise + spread,
                    mask,
                )
            )
            continue
        residual = read(sensor) - expected
        rows.append(MeasurementRow(sensor.name, residual, noise + spread, mask, *friction))
    tendons = mechanism.rig.tendon_names
    for sensor in context.channels.tensions:
        t = tendons.index(sensor.of)
        body = mechanism.drive_of[t]
        spread = context.noise(sensor) + tension_slopes[t, body] ** 2 * tracks[body - nj].variance
        residual = read(sensor) - tensions[t]
        rows.append(MeasurementRow(sensor.name, residual, spread, context.mask(x, sensor)))
    moment = Moment(mechanism, q, v, tensions, pulls)
    for sensor in context.channels.angles:
        residual = read(sensor) - moment.read(sensor)
        noise = context.noise(sensor)
        rows.append(
            MeasurementRow(sensor.name, residual, noise, context.mask(x, sensor), trusted=True)
        )
    # as the filter names its innovations: by the rig's order of sensors; nominal pulls come last
    names = [sensor.name for sensor in context.channels.compared]
    return sorted(rows, key=lambda row: names.index(row.name) if row.measured else len(names))


def away_from_stops(context: FilterContext, drive: int, position: Scalar) -> Scalar:
    """Return 1 where the `position` of a drive is certainly not at a stop, since the contact force
    there is unknown, else 0: (17).
    """
    part = context.mechanism.rig.drives[drive]
    sensor = context.position_sensor(drive)
    if part.stops is None or sensor is None:
        return ca.SX(1)
    p = context.mechanism.parameters
    path = context.path(sensor)
    low, high = (p[f"drives.{drive}.stops.{end}"] for end in ("low", "high"))
    # one that is held by its stop may read a position before it
    unknown = context.noise(sensor) + context.number(f"{path}.unknown_bias") ** 2
    wrong = context.number(f"{path}.linearity") + 2 * ca.sqrt(unknown)
    return ca.if_else(ca.logic_and(position > low + wrong, position < high - wrong), 1, 0)


@dataclass(frozen=True)
class RowAt:
    """A row at a state.

    Args:
        values: its values, in the layout `ROW`.
        slopes: those of its `SLOPED` values by the state, (n, 1) each, by name.
    """

    row: MeasurementRow
    values: VectorNode
    slopes: dict[str, VectorNode]


@dataclass(frozen=True)
class Rows:
    """All rows to compare, as one function of the state.

    Args:
        function: (state, tracks, rates, x, p) → values (`ROW`) and slopes of each row.
    """

    rows: Sequence[MeasurementRow]
    function: ca.Function

    @classmethod
    def of(cls, states: StateVector) -> Rows:
        """Return the rows of a state vector."""
        context = states.context
        state = ca.SX.sym("state", len(states))
        vector = ca.SX.sym("tracks", Tracks.size(context.n_drives))
        rates = ca.SX.sym("rates", context.n_drives)
        x = ca.SX.sym("x", context.width)
        rows = measurement_rows_of(states, state, Tracks(vector), rates, x)
        outputs = dict[str, ca.SX]()
        for k, row in enumerate(rows):
            values = {part: ca.SX(vars(row)[part]) for part in ROW.names}
            outputs[f"values_{k}"] = ROW.joined(**values)
            for part in SLOPED:
                outputs[f"{part}_{k}"] = ca.sparsify(ca.jacobian(values[part], state)).T
        arguments = [state, vector, rates, x, context.mechanism.parameters.symbols]
        inputs = ["state", "tracks", "rates", "x", "p"]
        return cls(
            rows,
            ca.Function("rows", arguments, ca.cse(list(outputs.values())), inputs, list(outputs)),
        )

    def at(
        self, state: VectorNode, tracks: VectorNode, rates: VectorNode, x: VectorNode, p: VectorNode
    ) -> list[RowAt]:
        """Return each row with its values and slopes at a `state`; `tracks` are as in `Interval`,
        `rates` as in `Moved`.
        """
        outputs = self.function(state=state, tracks=tracks, rates=rates, x=x, p=p)
        return [
            RowAt(row, outputs[f"values_{k}"], {part: outputs[f"{part}_{k}"] for part in SLOPED})
            for k, row in enumerate(self.rows)
        ]
