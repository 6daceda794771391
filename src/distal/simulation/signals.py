"""Signals of a scenario: a constant, a table of points, or a sine."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from pydantic import GetCoreSchemaHandler
from pydantic_core import CoreSchema, core_schema

from distal.arrays import Floats
from distal.errors import UnitError, did_you_mean
from distal.units import to_si

Interpolation = Literal["hold", "linear"]
POSITIONS: Interpolation = "linear"
"""How the points of positions and angles are joined where a scenario does not say it; those of
efforts and loads are held.
"""


@dataclass(frozen=True)
class Signal:
    """A value over time: points that are held or joined by straight lines, plus a sine.

    The points are `values` [SI], (n,), at rising `times` [s], (n,); equal times make a jump. The
    first value holds before its time, the last one after it. The sine starts at t = 0 and has an
    amplitude [SI], a frequency [Hz] and a phase [rad].
    """

    times: tuple[float, ...]
    values: tuple[float, ...]
    interpolation: Interpolation = "hold"
    amplitude: float = 0.0
    frequency: float = 0.0
    phase: float = 0.0

    def at(self, time: Floats) -> Floats:
        """Return the values at `time` [s], (n,)."""
        if self.interpolation == "hold":
            # a point counts from its own time on; the grid's rounding must not delay it by a step
            index = np.searchsorted(np.array(self.times), time + 1e-9, side="right") - 1
            base = np.array(self.values)[np.maximum(index, 0)]
        else:
            base = np.interp(time, np.array(self.times), np.array(self.values))
        return base + self.amplitude * np.sin(2 * np.pi * self.frequency * time + self.phase)


@dataclass(frozen=True)
class SignalIn:
    """Annotation of a signal's field: its SI unit and how a plain list of points is read.

    A constant (``"2 N"``), a list of points (``[["0 s", "2 N"], ["1 s", "6 N"]]``), or a table with
    ``points`` and ``interpolation`` or with ``mean``, ``amplitude``, ``frequency`` and ``phase``.
    """

    si: str
    interpolation: Interpolation = "hold"
    nonnegative: bool = False

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Let pydantic read the field with this annotation."""
        return core_schema.no_info_plain_validator_function(self._read)

    def _read(self, raw: object) -> Signal:
        signal = self._parse(raw)
        if self.nonnegative and min(signal.values) - abs(signal.amplitude) < 0.0:
            raise UnitError(
                f"must not be negative, {min(signal.values) - abs(signal.amplitude):g} {self.si} "
                "came"
            )
        return signal

    def _parse(self, raw: object) -> Signal:
        if isinstance(raw, Signal):
            return raw
        if isinstance(raw, Mapping):
            return self._table(raw)
        if isinstance(raw, (list, tuple)):
            return self._points(raw, self.interpolation)
        return Signal((0.0,), (to_si(raw, self.si),))

    def _points(self, raw: object, interpolation: Interpolation) -> Signal:
        if not isinstance(raw, (list, tuple)) or not raw:
            raise UnitError(f'must be a list of points [["0 s", …], …], {raw!r} came')
        for point in raw:
            if not isinstance(point, (list, tuple)) or len(point) != 2:
                raise UnitError(f"a point is [time, value], {point!r} came")
        times = tuple(to_si(point[0], "s") for point in raw)
        values = tuple(to_si(point[1], self.si) for point in raw)
        if any(later < earlier for earlier, later in pairwise(times)):
            raise UnitError("the times of the points must rise")
        return Signal(times, values, interpolation)

    def _table(self, raw: Mapping[object, object]) -> Signal:
        points = {"points", "interpolation"}
        sine = {"mean", "amplitude", "frequency", "phase"}
        allowed = points if "points" in raw else sine
        for key in raw:
            if key not in allowed:
                raise UnitError(f"unknown key '{key}'{did_you_mean(str(key), points | sine)}")
        if "points" in raw:
            interpolation = raw.get("interpolation", self.interpolation)
            if interpolation not in ("hold", "linear"):
                raise UnitError(f"interpolation must be 'hold' or 'linear', {interpolation!r} came")
            return self._points(raw["points"], interpolation)
        for key in ("amplitude", "frequency"):
            if key not in raw:
                raise UnitError(f"a sine needs '{key}'")
        return Signal(
            (0.0,),
            (to_si(raw.get("mean", 0.0), self.si),),
            amplitude=to_si(raw["amplitude"], self.si),
            frequency=to_si(raw["frequency"], "Hz"),
            phase=to_si(raw.get("phase", 0.0), "rad"),
        )
