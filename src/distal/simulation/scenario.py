"""Scenarios: what is done to a rig, read from TOML; and their signals: a constant, a table of
points, or a sine.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import pi
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, GetCoreSchemaHandler
from pydantic_core import CoreSchema, core_schema

from distal.arrays import Floats
from distal.errors import RigError, ScenarioError, UnitError, did_you_mean
from distal.rig import (
    Description,
    In,
    Rig,
    description_path,
    description_text,
    load_rig,
    parse_assignment,
    parse_toml,
    set_value,
    shipped_in,
    validated,
)
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
            index = np.searchsorted(self.times, time + 1e-9, side="right") - 1
            base = np.array(self.values)[np.maximum(index, 0)]
        else:
            base = np.interp(time, self.times, self.values)
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
        if isinstance(raw, Signal):
            signal = raw
        elif isinstance(raw, Mapping):
            signal = self._table(raw)
        elif isinstance(raw, (list, tuple)):
            signal = self._points(raw, self.interpolation)
        else:
            signal = Signal((0.0,), (to_si(raw, self.si),))
        least = min(signal.values) - abs(signal.amplitude)
        if self.nonnegative and least < 0.0:
            raise UnitError(f"must not be negative, {least:g} {self.si} came")
        return signal

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


SCENARIOS = "distal.simulation"
"""Package with the library of scenarios."""


class SliderLoop(Description):
    """A position loop on a slider: F = stiffness · (position − x) − damping · ẋ + force."""

    position: Annotated[Signal, SignalIn("m", POSITIONS)] = Field(description="where it should be")
    stiffness: Annotated[float, In("N/m", "positive")] = 5e3
    damping: Annotated[float, In("kg/s", "nonnegative")] = 5.0


class CapstanServo(Description):
    """A position loop on a motor: torque = stiffness · (angle − φ) − damping · φ̇."""

    angle: Annotated[Signal, SignalIn("rad", POSITIONS)] = Field(description="where it should be")
    stiffness: Annotated[float, In("N m/rad", "positive")] = 5.0
    damping: Annotated[float, In("N m s/rad", "nonnegative")] = 0.05


class DriveInput(Description):
    """What pulls a drive; parts that are given add up."""

    weight: Annotated[Signal, SignalIn("N", nonnegative=True)] | None = Field(
        None, description="a hung weight W with its inertia, U = W − (W/g) ẍ"
    )
    force: Annotated[Signal, SignalIn("N")] | None = Field(None, description="on a slider")
    torque: Annotated[Signal, SignalIn("N m")] | None = Field(None, description="on a capstan")
    servo: SliderLoop | CapstanServo | None = None


class TurningHand(Description):
    """A hand that turns the joint: torque = stiffness · (angle − θ) − damping · θ̇."""

    angle: Annotated[Signal, SignalIn("rad", POSITIONS)] = Field(
        description="where the hand wants the joint"
    )
    stiffness: Annotated[float, In("N m/rad", "positive")] = 3.0
    damping: Annotated[float, In("N m s/rad", "nonnegative")] = 0.0


class JointInput(Description):
    """What acts on a joint that nobody measures."""

    hand: TurningHand | None = None
    torque: Annotated[Signal, SignalIn("N m")] | None = Field(None, description="external")


class JointControl(Description):
    """Reference and gains of a joint's PID controller: τ = k_p e + k_i ∫ e dt − k_d ω."""

    reference: Annotated[Signal, SignalIn("rad", POSITIONS)]
    proportional: Annotated[float, In("N m/rad", "positive")] = Field(description="k_p")
    integral: Annotated[float, In("N m/(rad s)", "nonnegative")] = Field(0.0, description="k_i")
    derivative: Annotated[float, In("N m s/rad", "nonnegative")] = Field(0.0, description="k_d")
    deadband: Annotated[float, In("rad", "nonnegative")] = Field(
        0.0, description="smaller errors count as none"
    )
    torque_limit: Annotated[float, In("N m", "positive")] | None = None


class Control(Description):
    """A controller in the loop."""

    feedback: str = Field(
        "adaptive",
        description='an estimator\'s name, "encoder", "ratio" (displacements alone) or "command"',
    )
    period: Annotated[float, In("s", "positive")] = Field(0.01, description="between two commands")
    co_contraction: Annotated[float, In("N", "nonnegative")] = Field(
        0.0, description="tension of all tendons, as far as it makes no torque"
    )
    encoder_resolution: Annotated[float, In("rad", "nonnegative")] = Field(
        pi / 180.0, description='step of the encoder, with feedback = "encoder"'
    )
    joints: dict[str, JointControl] = Field(min_length=1)


class Scenario(Description):
    """What is done to a rig, for how long, and how the plant differs from the rig that filters
    know.
    """

    rig: str = Field(min_length=1, description="a shipped rig, or a path from this file")
    name: str = Field("", description="title of plots")
    duration: Annotated[float, In("s", "positive")]
    set: dict[str, object] = Field(
        default_factory=dict, description="numbers of the rig, for plant and filters"
    )
    plant: dict[str, object] = Field(
        default_factory=dict, description="numbers of the rig, for the plant alone"
    )
    initial: dict[str, object] = Field(
        default_factory=dict, description="angles of joints at the start"
    )
    drives: dict[str, DriveInput] = Field(default_factory=dict)
    joints: dict[str, JointInput] = Field(default_factory=dict)
    control: Control | None = None

    def plant_rig(self, rig: Rig) -> Rig:
        """Return the rig as the plant really is.

        Raises:
            ScenarioError: a value of the plant does not exist or is wrong.
        """
        try:
            return rig.with_values(self.plant) if self.plant else rig
        except RigError as problem:
            raise ScenarioError(f"plant: {problem}") from None


def shipped_scenarios() -> tuple[str, ...]:
    """Return the names of the scenarios that come with distal."""
    return shipped_in(SCENARIOS)


def scenario_text(name: str | Path) -> str:
    """Return the text of a scenario file.

    Raises:
        ScenarioError: neither a shipped scenario nor a readable file.
    """
    return description_text(name, SCENARIOS, "scenario", ScenarioError)


def load_scenario(name: str | Path, assignments: Sequence[str] = ()) -> Scenario:
    """Load a scenario by its name (`shipped_scenarios`) or TOML file, with ``path=value``
    assignments, values in TOML.

    Raises:
        ScenarioError: it is unknown, cannot be read, or its description is wrong.
    """
    raw = parse_toml(scenario_text(name), str(name), ScenarioError)
    for assignment in assignments:
        set_value(raw, *parse_assignment(assignment, ScenarioError), ScenarioError)
    if "joints" in raw and "rig" not in raw:
        raise ScenarioError(
            f"{name}: is a rig file; simulate takes what is done to it: a file with rig = "
            f'"{name}", duration and [drives], or a shipped scenario (distal scenarios)'
        )
    scenario = build_scenario(raw, str(name))
    if scenario.rig.endswith(".toml"):
        beside = description_path(name, SCENARIOS).parent
        return scenario.model_copy(update={"rig": str(beside / scenario.rig)})
    return scenario


def as_scenario(scenario: Scenario | str | Path) -> Scenario:
    """Return a `Scenario` as it is, or load one by its shipped name or path; for errors see
    `load_scenario`.
    """
    return scenario if isinstance(scenario, Scenario) else load_scenario(scenario)


def build_scenario(raw: Mapping[str, object], source: str = "scenario") -> Scenario:
    """Check a raw scenario; `source` names it in messages.

    Raises:
        ScenarioError: something is wrong; one line that says where, what came and what is allowed.
    """
    return validated(Scenario, raw, source, ScenarioError)


def scenario_rig(scenario: Scenario, assignments: Sequence[str] = ()) -> Rig:
    """Return the rig that a scenario names, with the scenario's ``[set]`` values: what filters
    know.

    Assignments are ``path=value`` each, as with `load_rig`; they win over ``[set]``.

    Raises:
        RigError: the rig is unknown or wrong.
    """
    rig = load_rig(scenario.rig)
    values = {**scenario.set, **dict(parse_assignment(text, RigError) for text in assignments)}
    return rig.with_values(values) if values else rig
