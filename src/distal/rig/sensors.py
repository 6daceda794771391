"""All kinds of sensors: what every one has; what a kind of measurement is (the parts that it is of,
its unit, what it reads of a motion, which estimators use it); and the conversion between a log's
numbers and SI. A further kind is a class, a line in `MEASURANDS`, and its class in `Sensor`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from math import pi
from typing import Annotated, Literal, Protocol, Self, TypeAlias

from pydantic import Field, ValidationInfo, model_validator
from pydantic_core import PydanticOmit

from distal.confidence import BAND
from distal.errors import UnitError, did_you_mean
from distal.expressions import Scalar, Vector
from distal.rig.components import REACH, Capstan, Joint, Slider, Tendon
from distal.rig.values_with_stds import (
    ONE,
    ZERO,
    AnyAngle,
    AnyTorque,
    Description,
    Factor,
    In,
    Metres,
    Name,
    NewtonMetres,
    Newtons,
    Parameter,
    Radians,
    Rate,
    Seconds,
    TorqueConstant,
)
from distal.units import to_si, unit_factor

COUNTS = frozenset({"count", "counts", "cnt", "inc", "pulses", "qc", "tick", "ticks"})
"""Names of the unit of an encoder that counts."""


NOISE = Field(0.0, description="standard deviation of the random error")
SMOOTH = Field(0.0, description="largest deviation of a smooth systematic error")
STEP = Field(0.0, description="quantisation step; of an encoder before its gear")
OFFSET = Field(ZERO, description="offset; it walks where it has a drift")
"""Fields of the errors that all kinds of sensors have, each in its own unit."""

GEAR = Field(
    1.0, description="turns of the motor's (or encoder's) shaft for one turn of what is measured"
)
"""Field of sensors that may be behind a gear."""

ERRORS = ("noise", "linearity", "resolution", "bias")
"""Keys of the errors of a sensor, which may be written in the unit of the log."""


def _in_si(error: object, unit: str, size: float) -> object:
    """Return an error of a sensor, or a table of it, with texts such as ``2 count`` or ``20 mA`` in
    SI; what is in another unit stays.

    Args:
        unit: of the log.
        size: of this unit in SI.
    """
    if isinstance(error, Mapping):
        spreads = ("value", "std", "drift")
        return {
            key: _in_si(part, unit, size) if key in spreads else part for key, part in error.items()
        }
    try:
        if not isinstance(error, str):
            return error
        number, _, suffix = error.strip().rpartition(" ")
        if unit != "count":
            return to_si(error, unit) * size
        return to_si(number.strip(), "") * size if suffix in COUNTS else error
    except UnitError:
        return error


class SensorBase(Description):
    """What every sensor has; the unit of its errors follows from what it measures (`si`, filled in
    by `Rig`).
    """

    name: Name
    measures: str = Field(
        description="`position` or `force` of a drive, `command` (a position that it was sent and "
        "follows with `lag`), `tension` of a tendon, `angle` or `torque` of a joint"
    )
    of: str = Field(description="the drive, tendon or joint")
    column: str | None = Field(
        None,
        min_length=1,
        description="of the log, or /topic.field of a recording; the sensor's name by default",
    )
    unit: str | None = Field(None, min_length=1, description="in the log; SI by default")
    sign: Literal[1, -1] = Field(1, description="−1 where the log counts the other way")
    rate: Rate = 100.0
    delay: Seconds = Field(0.0, description="age of a reading when it is stamped")

    lag: Seconds = Field(
        0.0,
        description="time constant with which a drive follows a command",
    )

    @model_validator(mode="before")
    @classmethod
    def _errors_as_logged(cls, raw: object) -> object:
        """Turn errors that are written as the log counts, in counts or amperes, into SI."""
        if not isinstance(raw, Mapping):
            return raw
        try:
            unit, size = cls._logged(raw)
            if raw.get("unit") is not None and raw["unit"] not in COUNTS:
                unit_factor(str(raw["unit"]), unit)
            gear = to_si(raw.get("gear", 1.0), "") if unit == "count" else 1.0
        except (UnitError, ZeroDivisionError):
            # the wrong field is refused later; until then the unit of the errors is not known
            return {key: value for key, value in raw.items() if key not in ERRORS}
        if unit == "count" and raw.get("unit") in COUNTS:
            raw = {"resolution": "1 count", **raw}  # one count is the smallest step
        sizes = {key: size * (gear if key == "resolution" else 1.0) for key in ERRORS}
        errors = {key: _in_si(raw[key], unit, sizes[key]) for key in ERRORS if key in raw}
        return {**raw, **errors}

    @classmethod
    def _logged(cls, raw: Mapping[str, object]) -> tuple[str, float]:
        """Return `logged` of a raw or a checked sensor."""
        return str(raw.get("si")), 1.0

    @property
    def logged(self) -> tuple[str, float]:
        """Unit of what the log holds, SI or counts, and what one such unit stands for in SI."""
        return self._logged(vars(self))

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.unit in COUNTS and getattr(self, "counts_per_turn", None) is None:
            raise ValueError(
                "unit: 'count' needs 'counts_per_turn' of an angle's encoder; for others give the "
                "unit of the number in the log"
            )
        if self.lag > 0.0 and self.measures != "position":
            raise ValueError(
                "lag: is of a drive that follows a command; a sensor that is late has a delay"
            )
        return self

    @property
    def log_column(self) -> str:
        """The column of the log that holds the sensor's readings."""
        return self.column or self.name


Part: TypeAlias = Slider | Capstan | Tendon | Joint


class Parts(Protocol):
    """The parts of a rig that sensors measure."""

    @property
    def joints(self) -> Sequence[Joint]:
        """The joints of the rig."""

    @property
    def drives(self) -> Sequence[Slider | Capstan]:
        """The drives of the rig."""

    @property
    def tendons(self) -> Sequence[Tendon]:
        """The tendons of the rig."""


@dataclass(frozen=True)
class Motion:
    """What a mechanism does at a moment, in SI.

    Args:
        angles: of the joints, (n_joints,) [rad].
        torques: from outside on the joints, (n_joints,) [N m].
        positions: of the drives, (n_drives,) [m, rad].
        rates: their speeds, (n_drives,).
        efforts: forces or torques that the drives exert, (n_drives,) [N, N m].
        tensions: of the tendons, (n_tendons,) [N].
    """

    angles: Vector
    torques: Vector
    positions: Vector
    rates: Vector
    efforts: Vector
    tensions: Vector


class Role(Enum):
    """What estimators do with a measurement."""

    POSITION = "position"
    """The position of a drive, by which the model is moved."""

    EFFORT = "effort"
    """The effort of a drive; displacement-driven filters compare it with what they predict."""

    TENSION = "tension"
    """The tension of a tendon; displacement-driven filters compare it, too."""

    REFERENCE = "reference"
    """A reading at a joint: estimates are compared with it or homed by it, and do not need it."""


@dataclass(frozen=True)
class Measurand:
    """A kind of measurement.

    Args:
        name: in a rig file.
        of: kind of the parts that it measures.
        role: what estimators do with its readings.
        unit: SI unit of a sensor's readings and errors.
        read: (sensor, motion, index of its part) → what it reads without errors [SI].
        travel: (rig, index of its part) → the lowest and the highest value that it measures [SI],
            between which its linearity error is defined.
        unit_of_capstan: the same of a capstan, where it is another one.
    """

    name: str
    of: Literal["drives", "tendons", "joints"]
    role: Role
    unit: str
    read: Callable[[SensorBase, Motion, int], Scalar]
    travel: Callable[[Parts, int], tuple[float, float]]
    unit_of_capstan: str = ""


class LengthSensor(SensorBase):
    """A sensor of a displacement [m]."""

    si: Literal["m"]
    noise: Metres = NOISE
    linearity: Metres = SMOOTH
    resolution: Metres = STEP
    bias: Annotated[Parameter, In("m", drifts=False)] = OFFSET


class AngleSensor(SensorBase):
    """A sensor of an angle [rad]."""

    si: Literal["rad"]
    counts_per_turn: Factor | None = Field(
        None,
        description='after quadrature, of the encoder\'s own shaft; with unit = "count"',
    )
    gear: Factor = GEAR
    noise: Radians = NOISE
    linearity: Radians = SMOOTH
    resolution: Radians = STEP
    bias: AnyAngle = OFFSET

    @classmethod
    def _logged(cls, raw: Mapping[str, object]) -> tuple[str, float]:
        if raw.get("counts_per_turn") is None:
            return super()._logged(raw)
        return "count", 2 * pi / (
            to_si(raw["counts_per_turn"], "") * to_si(raw.get("gear", 1.0), "")
        )

    @model_validator(mode="after")
    def _counted(self) -> Self:
        if self.counts_per_turn is not None and self.unit not in COUNTS:
            raise ValueError(
                'counts_per_turn: is for a log in counts; give unit = "count" too, or remove it'
            )
        return self


def drive_travel(rig: Parts, drive: int) -> tuple[float, float]:
    """Return the lowest and the highest position of a drive [m, rad]: its stops, or what its tendon
    lets it use.

    Without stops, the tendon's joints decide: of a tendon at one joint ±`REACH`, of a tendon over
    several joints the stops of each. The range of a slider lies about the displacement T/k at its
    nominal force T.
    """
    part = rig.drives[drive]
    if part.stops is not None:
        return part.stops
    tendon = next(t for t in rig.tendons if t.drive == part.name)
    centre = 0.0 if part.kind == "capstan" else part.nominal_force.value / tendon.stiffness.value
    if len(tendon.joints) == 1:
        reach = REACH * tendon.total_arm / part.lever
        return centre - reach, centre + reach
    return positions_over(rig, part, tendon, centre)


def positions_over(
    rig: Parts, drive: Slider | Capstan, tendon: Tendon, zero: float
) -> tuple[float, float]:
    """Return the lowest and the highest position of a drive [m, rad] as the joints of its `tendon`
    turn from stop to stop; at `zero` all their angles are zero.
    """
    low = zero
    high = zero
    travels = {joint.name: joint.travel for joint in rig.joints}
    turned = tendon.winding if drive.kind == "capstan" else 1
    for name, arm in tendon.arms().items():
        ends = sorted(turned * arm / drive.lever * angle for angle in travels[name])
        low = low + ends[0]
        high = high + ends[1]
    return low, high


POSITION = Measurand(
    "position",
    "drives",
    Role.POSITION,
    "m",
    lambda sensor, motion, part: motion.positions[part] + sensor.lag * motion.rates[part],
    drive_travel,
    "rad",
)
"""The position of a drive: s of a slider [m], φ of a capstan [rad]. A sensor with a `lag` is a
command, which is ahead of the drive: it reads s + lag ṡ.
"""

ANGLE = Measurand(
    "angle",
    "joints",
    Role.REFERENCE,
    "rad",
    lambda sensor, motion, part: motion.angles[part],
    lambda rig, part: rig.joints[part].travel,
)
"""The angle θ of a joint [rad], within the range that it turns in."""


Gain = Annotated[
    Parameter,
    In("", "positive", drifts=False),
    Field(description="reading per unit of what is measured"),
]


class ForceSensor(SensorBase):
    """A sensor of a force or tension [N]."""

    si: Literal["N"]
    noise: Newtons = NOISE
    linearity: Newtons = SMOOTH
    resolution: Newtons = STEP
    bias: Annotated[Parameter, In("N")] = OFFSET
    gain: Gain = ONE


class TorqueSensor(SensorBase):
    """A sensor of a torque [N m]; of a motor's current with a constant K_t, τ = K_t i; of a force
    with a lever, τ = R F.
    """

    si: Literal["N m"]
    torque_constant: TorqueConstant | None = Field(
        None,
        description="K_t at the capstan, where the log holds a current",
    )
    torque_constant_motor: TorqueConstant | None = Field(
        None, description="K_t of the motor; the capstan's is `gear` times it"
    )
    gear: Factor = GEAR
    lever: Annotated[float, In("m", "positive")] | None = Field(
        None,
        description="of a load cell, where the log holds a force",
    )
    noise: NewtonMetres = NOISE
    linearity: NewtonMetres = SMOOTH
    resolution: NewtonMetres = STEP
    bias: AnyTorque = OFFSET
    gain: Gain = ONE

    @classmethod
    def _logged(cls, raw: Mapping[str, object]) -> tuple[str, float]:
        if raw.get("torque_constant") is not None:
            return "A", to_si(raw["torque_constant"], "N m/A")
        if raw.get("torque_constant_motor") is not None:
            motor = to_si(raw["torque_constant_motor"], "N m/A")
            return "A", motor * to_si(raw.get("gear", 1.0), "")
        if raw.get("lever") is not None:
            return "N", to_si(raw["lever"], "m")
        return super()._logged(raw)

    @model_validator(mode="after")
    def _one_constant(self) -> Self:
        if self.torque_constant is not None and self.torque_constant_motor is not None:
            raise ValueError(
                "torque_constant: is at the capstan, torque_constant_motor at the motor; give one "
                "of them"
            )
        if self.lever is not None and self.logged != ("N", self.lever):
            raise ValueError(
                "lever: is of a load cell, a torque constant of a motor's current; give one of them"
            )
        if self.gear != 1.0 and self.torque_constant_motor is None:
            raise ValueError(
                "gear: applies to torque_constant_motor only; a torque in N m and torque_constant "
                "are at the capstan"
            )
        return self


def largest_effort(rig: Parts, drive: int) -> float:
    """Return the largest effort that a drive is likely to exert [N, N m]: its limit; without one
    twice its nominal force or twice the pretensions of its tendons, whichever is larger.
    """
    part = rig.drives[drive]
    if part.limit is not None:
        return part.limit
    pretension = sum(tendon.home_tension for tendon in rig.tendons if tendon.drive == part.name)
    return 2.0 * max(abs(part.nominal_force.value), part.lever * pretension)


def _effort_travel(rig: Parts, part: int) -> tuple[float, float]:
    """Return the range of likely efforts: from 0 to `largest_effort` of a slider, the same to both
    sides of a capstan.
    """
    largest = largest_effort(rig, part)
    return (-largest, largest) if rig.drives[part].kind == "capstan" else (0.0, largest)


def _tension_travel(rig: Parts, part: int) -> tuple[float, float]:
    """Return the range from slack, 0, to the largest force with which the drive is likely to pull
    [N].
    """
    drive = [drive.name for drive in rig.drives].index(rig.tendons[part].drive)
    return 0.0, largest_effort(rig, drive) / rig.drives[drive].lever


def _torque_travel(rig: Parts, part: int) -> tuple[float, float]:
    """Return the band of the external torque by the rig."""
    largest = BAND * rig.joints[part].external_torque.std
    return -largest, largest


FORCE = Measurand(
    "force",
    "drives",
    Role.EFFORT,
    "N",
    lambda sensor, motion, part: motion.efforts[part],
    _effort_travel,
    "N m",
)
"""The effort of a drive: force U of a slider [N], torque τ of a capstan's motor [N m]."""

TENSION = Measurand(
    "tension",
    "tendons",
    Role.TENSION,
    "N",
    lambda sensor, motion, part: motion.tensions[part],
    _tension_travel,
)
"""The tension T of a tendon at the joint's end of its path [N]."""

TORQUE = Measurand(
    "torque",
    "joints",
    Role.REFERENCE,
    "N m",
    lambda sensor, motion, part: motion.torques[part],
    _torque_travel,
)
"""The external torque τ_ext on a joint [N m]."""


MEASURANDS: dict[str, Measurand] = {
    kind.name: kind for kind in (POSITION, FORCE, TENSION, ANGLE, TORQUE)
}
"""Name in a rig file → what can be measured."""

Sensor = Annotated[
    LengthSensor | AngleSensor | ForceSensor | TorqueSensor,
    Field(discriminator="si"),
]
"""A sensor."""

UNITS = ("m", "rad", "N", "N m")
"""SI units, by which pydantic tells the classes of sensors apart."""

REFERENCES = frozenset(name for name, kind in MEASURANDS.items() if kind.role is Role.REFERENCE)
"""Names of what is measured at a joint: estimators compare with these references or home by them,
and do not need them.
"""

MEASURED = {
    of: tuple(n for n, kind in MEASURANDS.items() if kind.of == of)
    for of in ("drives", "tendons", "joints")
}
"""Kind of part → names of what can be measured of it."""


def in_its_unit(raw: object, info: ValidationInfo) -> object:
    """Return the raw table of a sensor with its SI unit; `info` has the parts of the rig.

    Raises:
        ValueError: the table names no part, or one of which this cannot be measured.
    """
    parts: Mapping[str, Sequence[Part]] = info.data
    if not MEASURED.keys() <= parts.keys():
        # a part is refused already; a check of its sensors would only repeat that
        raise PydanticOmit
    if not isinstance(raw, Mapping):
        return raw
    if raw.get("measures") == "command":
        if "lag" not in raw:
            raise ValueError(
                "measures = 'command' needs lag, the time constant of the drive's servo (\"50 ms\")"
            )
        raw = {**raw, "measures": "position"}
    if not {"measures", "of"} <= raw.keys():
        return {**raw, "si": "m"}  # pydantic says what is missing
    measures = raw["measures"]
    of = str(raw["of"])
    kind = MEASURANDS.get(str(measures))
    if kind is None:
        *names, last = (f"'{name}'" for name in MEASURANDS)
        raise ValueError(f"measures: must be {', '.join(names)} or {last}, {measures!r} came")
    by_name = {part.name: part for part in parts[kind.of]}
    if of not in by_name:
        raise ValueError(
            f"of: no {kind.of[:-1]} is called '{of}'{_elsewhere(of, kind, parts, by_name)}"
        )
    is_capstan = isinstance(by_name[of], Capstan)
    return {**raw, "si": kind.unit_of_capstan if is_capstan else kind.unit}


def _elsewhere(
    of: str, kind: Measurand, parts: Mapping[str, Sequence[Part]], names: Iterable[str]
) -> str:
    """Return a hint for a message: a sensor's part is of another kind, or names that may
    be meant.
    """
    for kind_of_part, measurands in MEASURED.items():
        if of in [part.name for part in parts[kind_of_part]]:
            allowed = " or ".join(f"'{name}'" for name in measurands)
            is_motor = (kind_of_part, kind.name) == ("drives", "torque")
            hint = "; the torque of a capstan's motor is its force" if is_motor else ""
            return f", it is one of the {kind_of_part}: measures must be {allowed}{hint}"
    return did_you_mean(of, names)


def measurand_of(sensor: Sensor) -> Measurand:
    """Return the kind of measurement of a sensor."""
    return MEASURANDS[sensor.measures]


def part_of(sensor: Sensor, rig: Parts) -> int:
    """Return the index of the part that a sensor is of."""
    return [part.name for part in getattr(rig, measurand_of(sensor).of)].index(sensor.of)


def travel_of(sensor: Sensor, rig: Parts) -> tuple[float, float]:
    """Return the lowest and the highest value that a sensor measures [SI], between which its
    linearity error is defined.
    """
    return measurand_of(sensor).travel(rig, part_of(sensor, rig))


def gain_of(sensor: Sensor) -> Parameter:
    """Return the gain of a sensor, its reading per unit of what it measures; exactly 1 but for
    forces and torques.
    """
    return sensor.gain if isinstance(sensor, (ForceSensor, TorqueSensor)) else ONE


def step_of(sensor: Sensor) -> float:
    """Return the quantisation step of what a sensor measures [SI], behind its gear: `resolution` is
    that before the gear.
    """
    return sensor.resolution / (sensor.gear if isinstance(sensor, AngleSensor) else 1.0)


def log_factor(sensor: Sensor) -> float:
    """Return the factor from a log's numbers to SI, without the sensor's `sign`.

    Raises:
        UnitError: the unit is unknown or has the wrong dimension.
    """
    unit, size = sensor.logged
    if unit == "count":
        return size
    try:
        factor = size * unit_factor(sensor.unit or unit, unit)
    except UnitError as problem:
        needs = "; a load cell in N needs its lever, a current a torque_constant"
        raise UnitError(f"{problem}{needs if unit == 'N m' else ''}") from None
    return factor / sensor.gear if isinstance(sensor, AngleSensor) else factor


def angle_unit(sensors: Sequence[Sensor]) -> str:
    """Return the unit in which a log of these sensors has angles, "deg" or "rad": that of its known
    angles, else of its positions.
    """
    for role in (Role.REFERENCE, Role.POSITION):
        among = [s for s in sensors if s.si == "rad" and measurand_of(s).role == role]
        factors = [unit_factor(s.unit or "rad", "rad") for s in among if s.unit not in COUNTS]
        if factors:
            return "deg" if unit_factor("deg", "rad") in factors else "rad"
    return "rad"


def log_unit(sensor: Sensor) -> str:
    """Return the unit of a sensor's numbers in the log."""
    return sensor.unit or sensor.logged[0]
