"""The kinds of number in a description: a certain scalar, a parameter with a standard deviation, an
interval.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import hypot, inf
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, GetCoreSchemaHandler, StrictBool, model_validator
from pydantic_core import CoreSchema, core_schema

from distal.errors import UnitError, did_you_mean
from distal.units import to_si

SMALLEST = 1e-20
"""Smallest magnitude of a number in a description that is not zero [SI]. Source: rounding
(underflow of squares).
"""

LARGEST = 1e12
"""Largest magnitude of a number in a description [SI]. Source: rounding (overflow of squares)."""

KEYS = ("value", "std", "drift", "hold", "shared")
"""Keys of a parameter that is written as a table."""

Raw = dict[str, object]
"""A part of a description as a file has it, not yet checked."""


class Description(BaseModel):
    """Base of every part of a description: frozen, and an unknown key is an error."""

    model_config = ConfigDict(frozen=True, validate_default=True, defer_build=True)

    @model_validator(mode="before")
    @classmethod
    def _check_keys(cls, raw: object) -> object:
        for key in raw if isinstance(raw, Mapping) else ():
            if key not in cls.model_fields:
                hint = did_you_mean(str(key), cls.model_fields.keys() - {"si"})
                raise ValueError(f"unknown key '{key}'{hint}")
        return raw


@dataclass(frozen=True)
class In:
    """Annotation of a field with its SI unit and its bound; it makes the field read bare numbers as
    SI, and text with a unit.

    On a `Parameter` it also reads ``{ value = …, std = …, drift = …, hold = …, shared = { name = …,
    std = … } }``. There std and drift may be percentages of the value, and the shared std is a
    share of it. On a pair of floats it reads an interval [low, high], on three a vector [x, y, z].
    Where `drifts` is False the parameter cannot walk and shares nothing. A number is `within` two
    others.
    """

    si: str
    bound: Literal["any", "nonnegative", "positive"] = "any"
    drifts: bool = True
    within: tuple[float, float] = (-inf, inf)

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Put the reader in front of pydantic's own check of the field."""
        readers: dict[object, Callable[[object], object]] = {
            Parameter: self._parameter,
            float: self._scalar,
            tuple[float, float, float]: self._vector,
        }
        return core_schema.no_info_before_validator_function(
            readers.get(source, self._interval), handler(source)
        )

    def _scalar(self, raw: object) -> float:
        number = to_si(raw, self.si)
        if number != 0.0 and not SMALLEST <= abs(number) <= LARGEST:
            raise UnitError(
                f"must be between {SMALLEST:g} and {LARGEST:g} in size, {number:g} came"
            )
        low, high = self.within
        if not low <= number <= high:
            raise UnitError(
                f"must be from {low:g} to {high:g} {self.si}".rstrip() + f", {number:g} came"
            )
        if self.bound == "positive" and number <= 0.0:
            raise UnitError(f"must be positive, {number:g} came")
        if self.bound == "nonnegative" and number < 0.0:
            raise UnitError(f"must not be negative, {number:g} came")
        return number

    def _parameter(self, raw: object) -> object:
        if isinstance(raw, Parameter):
            raw = raw.model_dump()
        if not isinstance(raw, Mapping):
            return {"value": self._scalar(raw)}
        if "value" not in raw:
            if set(raw) <= set(KEYS):
                raise UnitError("has no 'value'; write { value = …, std = … }")
            return raw  # a key that is not known is refused next
        value = self._scalar(raw["value"])
        drift = raw.get("drift")
        shared = raw.get("shared")
        std = self._spread("std", raw.get("std", 0.0), value)
        if drift is not None:
            drift = self._spread("drift", drift, value)
            if std == 0.0 and drift > 0.0 and shared is None:
                raise UnitError(
                    f"drift needs a std: what is certain does not walk, drift = {drift:g} came "
                    "without one"
                )
        for key, given in (("drift", drift), ("shared", shared)):
            if given is not None and not self.drifts:
                raise UnitError(
                    f"has no {key}: it is a start, or read only where nothing else is; remove "
                    f"'{key}'"
                )
        if shared is not None and value == 0.0:
            raise UnitError(
                "is zero, so there is no share of it that others err by too; remove 'shared'"
            )
        return {**raw, "value": value, "std": std, "drift": drift}

    def _spread(self, key: str, raw: object, value: float) -> float:
        if isinstance(raw, str) and raw.strip().endswith("%"):
            spread = to_si(raw, "") * abs(value)
        else:
            spread = to_si(raw, self.si)
        if spread > LARGEST:
            raise UnitError(f"{key} must be at most {LARGEST:g}, {spread:g} came")
        if spread < 0.0:
            raise UnitError(f"{key} must not be negative, {spread:g} came")
        return spread

    def _vector(self, raw: object) -> object:
        return tuple(self._scalar(part) for part in _listed(raw, 3, "three numbers [x, y, z]"))

    def _interval(self, raw: object) -> object:
        low, high = (to_si(end, self.si) for end in _listed(raw, 2, "two numbers [low, high]"))
        if not low < high:
            raise UnitError(
                f"is the wrong way round: low ({low:g} {self.si}) must be below high ({high:g} "
                f"{self.si})"
            )
        return low, high


def _listed(raw: object, count: int, form: str) -> Sequence[object]:
    if not isinstance(raw, (list, tuple)) or len(raw) != count:
        raise UnitError(f"must be {form}, {raw!r} came")
    return raw


class Shared(Description):
    """An error that several parameters share, as those of one make do: all parameters that name it
    are off by the same share of their values.

    p_i = value_i (1 + std z) + std_i ε_i, with one z for all of a name, and an ε_i for each.
    """

    name: str = Field(min_length=1, max_length=60, pattern=r"^[A-Za-z_][A-Za-z0-9_.-]*$")
    std: Annotated[float, In("")] = Field(ge=0.0, le=1.0)


class Parameter(Description):
    """A physical parameter: its value, the standard deviation of its error, and its random walk,
    all SI.

    The walk is `drift` per √s; None leaves its size to the estimator. With `hold` the std is a
    prior for fitting only: estimators take the value as it is. A parameter that is exactly zero
    with ``std = 0`` does not exist for the model: its terms are left out.
    """

    value: float
    std: float = 0.0
    drift: float | None = None
    hold: StrictBool = False
    shared: Shared | None = None

    @property
    def absent(self) -> bool:
        """Whether the parameter is zero for certain."""
        return self.value == 0.0 and self.filter_std == 0.0

    @property
    def filter_std(self) -> float:
        """The std of the value that estimators use: `total_std`, or 0 where the value is held."""
        return 0.0 if self.hold else self.total_std

    @property
    def total_std(self) -> float:
        """The std of the value from its own error and the shared one together."""
        return self.std if self.shared is None else hypot(self.std, self.value * self.shared.std)


ZERO = Parameter(value=0.0)
"""Default of a parameter that a rig need not have: zero for certain. Source: definition
(absent).
"""

ONE = Parameter(value=1.0)
"""Default of a factor that changes nothing: one for certain. Source: definition (unity)."""

Name = Annotated[str, Field(pattern=r"^[A-Za-z_][A-Za-z0-9_-]*$", max_length=64)]
"""A name that can stand in a column header and in a path of ``--set``."""

Coefficient = Annotated[Parameter, In("", "nonnegative")]
Length = Annotated[Parameter, In("m", "positive")]
Displacement = Annotated[Parameter, In("m", "nonnegative")]
Load = Annotated[Parameter, In("N", "nonnegative")]
Turn = Annotated[Parameter, In("rad", "nonnegative")]
AnyAngle = Annotated[Parameter, In("rad")]
FixedAngle = Annotated[Parameter, In("rad", drifts=False)]
AngularDamping = Annotated[Parameter, In("N m s/rad", "nonnegative")]
LinearDamping = Annotated[Parameter, In("kg/s", "nonnegative")]
Stiffness = Annotated[Parameter, In("N/m", "positive")]
TorqueSize = Annotated[Parameter, In("N m", "nonnegative")]
AnyTorque = Annotated[Parameter, In("N m")]
Rate = Annotated[float, In("Hz", within=(1e-3, 1e6))]
AngularRange = Annotated[tuple[float, float], In("rad")]
Seconds = Annotated[float, In("s", "nonnegative")]
Duration = Annotated[float, In("s", "positive")]
Radians = Annotated[float, In("rad", "nonnegative")]
RadiansPerSecond = Annotated[float, In("rad/s", "nonnegative")]
AnyRadians = Annotated[float, In("rad")]
Metres = Annotated[float, In("m", "nonnegative")]
Newtons = Annotated[float, In("N", "nonnegative")]
PositiveNewtonMetres = Annotated[float, In("N m", "positive")]
PositiveNewtons = Annotated[float, In("N", "positive")]
TorqueConstant = Annotated[float, In("N m/A", "positive")]
NewtonMetres = Annotated[float, In("N m", "nonnegative")]
Factor = Annotated[float, In("", "positive")]
"""Certain numbers and parameters by their unit and bound, as several parts of a rig have them."""
