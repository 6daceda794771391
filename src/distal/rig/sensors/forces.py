"""Sensors of forces: the effort of a drive, the tension of a tendon, the external torque on a
joint.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from distal.confidence import BAND
from distal.rig.quantities import (
    ONE,
    AnyTorque,
    Factor,
    In,
    NewtonMetres,
    Parameter,
    TorqueConstant,
)
from distal.rig.sensors.base import (
    COUNTS,
    NOISE,
    OFFSET,
    STEP,
    Measurand,
    Parts,
    Role,
    SensorBase,
)
from distal.units import to_si, unit_factor

OVER_RANGE = Field(0.0, description="largest deviation of a smooth systematic error")
Newtons = Annotated[float, In("N", "nonnegative")]
Gain = Annotated[
    Parameter,
    In("", "positive", drifts=False),
    Field(description="reading per unit of what is measured"),
]


class ForceSensor(SensorBase):
    """A sensor of a force or tension [N]."""

    si: Literal["N"]
    noise: Newtons = NOISE
    linearity: Newtons = OVER_RANGE
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
    gear: Factor = Field(
        1.0,
        description="turns of the motor's (or encoder's) shaft for one turn of what is measured",
    )
    lever: Annotated[float, In("m", "positive")] | None = Field(
        None,
        description="of a load cell, where the log holds a force",
    )
    noise: NewtonMetres = NOISE
    linearity: NewtonMetres = OVER_RANGE
    resolution: NewtonMetres = STEP
    bias: AnyTorque = OFFSET
    gain: Gain = ONE

    @classmethod
    def _per_unit(cls, raw: Mapping[str, object]) -> tuple[str, float] | None:
        """Return `logged` of a raw or a checked sensor, None where the log holds a torque."""
        if raw.get("torque_constant") is not None:
            return "A", to_si(raw["torque_constant"], "N m/A")
        if raw.get("torque_constant_motor") is not None:
            motor = to_si(raw["torque_constant_motor"], "N m/A")
            return "A", motor * to_si(raw.get("gear", 1.0), "")
        return ("N", to_si(raw["lever"], "m")) if raw.get("lever") is not None else None

    @classmethod
    def _counting(cls, raw: Mapping[str, object]) -> tuple[str, float] | None:
        unit = raw.get("unit")
        per_unit = cls._per_unit(raw)
        if per_unit is None and isinstance(unit, str) and unit not in COUNTS:
            # a wrong unit is refused here, before the errors that are written in it
            unit_factor(unit, "N m")
        return per_unit

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

    @property
    def logged(self) -> tuple[str, float]:
        """SI unit of what the log holds (N m, A or N), and the torque at the capstan [N m] that one
        such unit stands for.
        """
        return self._per_unit(vars(self)) or (self.si, 1.0)


def largest_effort(rig: Parts, drive: int) -> float:
    """Return the largest effort that a drive is likely to exert [N, N m]: its limit; without one
    twice its nominal force or twice the pretensions of its tendons, whichever is larger.
    """
    part = rig.drives[drive]
    if part.limit is not None:
        return part.limit
    pretension = sum(tendon.home_tension for tendon in rig.tendons if tendon.drive == part.name)
    return 2.0 * max(abs(part.nominal_force.value), part.lever * pretension)


def _effort_travel(sensor: SensorBase, rig: Parts, part: int) -> tuple[float, float]:
    """Return the range of likely efforts: from 0 to `largest_effort` of a slider, the same to both
    sides of a capstan.
    """
    largest = largest_effort(rig, part)
    return (-largest, largest) if rig.drives[part].kind == "capstan" else (0.0, largest)


def _tension_travel(sensor: SensorBase, rig: Parts, part: int) -> tuple[float, float]:
    """Return the range from slack, 0, to the largest force with which the drive is likely to pull
    [N].
    """
    drive = [drive.name for drive in rig.drives].index(rig.tendons[part].drive)
    return 0.0, largest_effort(rig, drive) / rig.drives[drive].lever


def _torque_travel(sensor: SensorBase, rig: Parts, part: int) -> tuple[float, float]:
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
