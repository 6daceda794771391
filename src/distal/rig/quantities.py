"""The kinds of number in a description: a certain scalar, a parameter with a standard deviation, an interval."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, GetCoreSchemaHandler
from pydantic_core import CoreSchema, core_schema

from distal.errors import UnitError, did_you_mean
from distal.units import to_si

SMALLEST, LARGEST = 1e-20, 1e12
"""Sizes beyond which a number in a description is a mistake, and squares of it would leave what a computer can hold."""

Bound = Literal["any", "nonnegative", "positive"]


class Description(BaseModel):
    """Base of every part of a description: frozen, and an unknown key is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True)


class Parameter(Description):
    """A physical parameter: value and the standard deviation of what is not known about it, both SI.

    A parameter that is exactly zero with ``std = 0`` does not exist for the model: its terms are left out.
    """

    value: float
    std: float = 0.0

    @property
    def absent(self) -> bool:
        """Whether the parameter is zero for certain."""
        return self.value == 0.0 and self.std == 0.0


@dataclass(frozen=True)
class In:
    """Annotation of a field: its SI unit and its bound; it reads bare numbers as SI and text with a unit.

    On a `Parameter` it also reads ``{ value = …, std = … }`` (std may be a percentage of the value), on a pair
    of floats an interval [low, high].
    """

    si: str
    bound: Bound = "any"

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Put the reader in front of pydantic's own check of the field."""
        readers = {Parameter: self._parameter, float: self._scalar}
        return core_schema.no_info_before_validator_function(readers.get(source, self._interval), handler(source))

    def _scalar(self, raw: object) -> float:
        number = to_si(raw, self.si)
        if number != 0.0 and not SMALLEST <= abs(number) <= LARGEST:
            raise UnitError(f"must be between {SMALLEST:g} and {LARGEST:g} in size, {number:g} came")
        if self.bound == "positive" and number <= 0.0:
            raise UnitError(f"must be positive, {number:g} came")
        if self.bound == "nonnegative" and number < 0.0:
            raise UnitError(f"must not be negative, {number:g} came")
        return number

    def _parameter(self, raw: object) -> object:
        if isinstance(raw, Parameter):
            raw = {"value": raw.value, "std": raw.std}
        if not isinstance(raw, Mapping):
            return {"value": self._scalar(raw), "std": 0.0}
        for key in raw:
            if key not in ("value", "std"):
                raise UnitError(f"unknown key '{key}'{did_you_mean(str(key), ['value', 'std'])}")
        if "value" not in raw:
            raise UnitError("has no 'value'; write { value = …, std = … }")
        value, std = self._scalar(raw["value"]), raw.get("std", 0.0)
        if isinstance(std, str) and std.strip().endswith("%"):
            spread = to_si(std, "") * abs(value)
        else:
            spread = to_si(std, self.si)
        if spread > LARGEST:
            raise UnitError(f"std must be at most {LARGEST:g}, {spread:g} came")
        if spread < 0.0:
            raise UnitError(f"std must not be negative, {spread:g} came")
        return {"value": value, "std": spread}

    def _interval(self, raw: object) -> object:
        if not isinstance(raw, (list, tuple)) or len(raw) != 2:
            raise UnitError(f"must be two numbers [low, high], {raw!r} came")
        low, high = to_si(raw[0], self.si), to_si(raw[1], self.si)
        if not low < high:
            raise UnitError(f"is the wrong way round: low ({low:g} {self.si}) must be below high ({high:g} {self.si})")
        return low, high


Name = Annotated[str, Field(pattern=r"^[A-Za-z_][A-Za-z0-9_-]*$", max_length=64)]
"""A name that can stand in a column header and in a path of ``--set``."""
