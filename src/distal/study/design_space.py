"""Studies: what is asked of a rig before it is built, read from TOML; the designs that fill the
space of a study, one axis for each thing that varies; and rigs as built, plants whose parameters
are drawn from the stds of a rig's description.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, Self
from zlib import crc32

import numpy as np
from pydantic import Field, model_validator

from distal.arrays import Floats
from distal.control import COMMAND, ENCODER, RATIO
from distal.errors import DistalError, StudyError, did_you_mean
from distal.estimators import DEFAULT, ESTIMATORS
from distal.machine_limits import MEMORY_VARIABLE, memory_limit
from distal.rig import (
    ALL,
    Description,
    In,
    Rig,
    description_path,
    description_text,
    known_to_a_factor,
    load_rig,
    named,
    number,
    parameters_below,
    parse_toml,
    shipped_in,
    validated,
)
from distal.simulation import Scenario, load_scenario
from distal.simulation.simulate import prepare
from distal.units import to_si

Share = Annotated[float, In("", "positive"), Field(le=1.0)]


class Requirement(Description):
    """What is asked of a rig as built."""

    joint: str = Field(min_length=1)
    within: Annotated[float, In("rad", "positive")] = Field(
        description="largest error of the estimate"
    )
    time: Share = Field(0.95, description="share of the time for which it holds")
    rigs: Share = Field(0.95, description="share of the rigs as built for which it holds")


class Study(Description):
    """A rig, what is done to it, what varies, and what is required."""

    rig: str = Field(min_length=1, description="a shipped rig, or a path from this file")
    name: str = Field("", description="title of the answer")
    scenarios: tuple[str, ...] = Field(min_length=1, description="shipped scenarios, or paths")
    duration: Annotated[float, In("s", "positive")] | None = Field(
        None, description="of each run; the scenario's by default"
    )
    estimator: str = Field(DEFAULT, description="as of `distal estimate -e`")
    designs: int = Field(256, ge=1, description="how many")
    seeds: int = Field(3, ge=1, le=100_000, description="rigs as built of each design")
    draw: int = Field(1, ge=0, description="seed of all random numbers")
    set: dict[str, object] = Field(
        default_factory=dict,
        description="numbers of the rig for all designs, over those of scenarios",
    )
    vary: dict[str, object] = Field(
        default_factory=dict,
        description="path of a number as for `--set`, `sensors.NAME` or `estimator` → a list, or "
        "a table with from and to",
    )
    requirement: Requirement

    @model_validator(mode="after")
    def _known(self) -> Self:
        if self.estimator not in ESTIMATORS:
            raise ValueError(
                f"estimator: unknown '{self.estimator}'{did_you_mean(self.estimator, ESTIMATORS)}"
            )
        if len(set(self.scenarios)) < len(self.scenarios):
            raise ValueError("scenarios: one stands more than once; seeds give several runs of one")
        return self


@dataclass(frozen=True)
class Plan:
    """A study with its rig and scenarios loaded, to be sent to other computers; the rig has the
    values of the study's ``set``.
    """

    study: Study
    rig: Rig
    scenarios: tuple[Scenario, ...]

    @property
    def digest(self) -> str:
        """Hash of the study, its rig and its scenarios, 32 hexadecimal digits."""
        parts = [
            self.study.model_dump(),
            self.rig.model_dump(),
            [repr(scenario) for scenario in self.scenarios],
        ]
        return hashlib.sha256(json.dumps(parts, sort_keys=True, default=repr).encode()).hexdigest()[
            :32
        ]


def shipped_studies() -> tuple[str, ...]:
    """Return the names of the studies that come with distal."""
    return shipped_in("distal.study")


def load_study(name: str | Path) -> Plan:
    """Load a study with its rig and scenarios, by a shipped study's name (see `shipped_studies`) or
    from a TOML file.

    Raises:
        StudyError: the study is unknown, cannot be read, or its description is wrong.
        RigError: its rig is unknown or wrong.
        ScenarioError: one of its scenarios is unknown or wrong.
    """
    text = description_text(name, "distal.study", "study", StudyError)
    beside = description_path(name, "distal.study").parent
    return plan_of(parse_toml(text, str(name), StudyError), str(name), beside)


def plan_of(raw: Mapping[str, object], source: str = "study", beside: Path = Path()) -> Plan:
    """Check a raw study and load the rig and the scenarios that it names.

    Args:
        source: name of the study in messages.
        beside: folder to which its paths are relative; default the current one.

    Raises:
        StudyError: something is wrong; one line that says where, what came and what is allowed.
        RigError: its rig is unknown or wrong.
        ScenarioError: one of its scenarios is unknown or wrong.
    """
    study = validated(Study, raw, source, StudyError)

    def position(name: str) -> str | Path:
        return beside / name if name.endswith(".toml") else name

    rig = load_rig(position(study.rig)).with_values(study.set)
    joints = rig.joint_names
    if study.requirement.joint not in joints:
        name = study.requirement.joint
        raise StudyError(
            f"{source}: requirement.joint: the rig has no joint "
            f"'{name}'{did_you_mean(name, joints)}"
        )
    scenarios = list[Scenario]()
    for name in study.scenarios:
        scenario = load_scenario(position(name))
        if study.duration is not None:
            scenario = scenario.model_copy(update={"duration": study.duration})
        scenarios.append(scenario)
        try:
            prepare(rig, scenario)
        except DistalError as problem:  # every run would fail for it
            raise StudyError(
                f"{source}: scenario '{name}' does not fit the rig '{study.rig}': {problem}"
            ) from None
    return Plan(study, rig, tuple(scenarios))


@dataclass(frozen=True)
class Draw:
    """One random number of a rig as built: the error of a parameter, or an error that several
    parameters share.

    Args:
        name: path of the parameter with names of parts, or name of the shared error.
        std: of a parameter in SI, of a shared error as a share of the values.
        paths: of the parameters that it changes.
        common: whether it is a shared error.
    """

    name: str
    std: float
    paths: tuple[str, ...]
    common: bool = False


def draws_of(rig: Rig) -> tuple[Draw, ...]:
    """Return what is drawn for a rig as built: the error of each parameter with a std, and each
    shared error. Nominal forces are not drawn.
    """
    draws = list[Draw]()
    common = dict[str, Draw]()
    for kind, components in rig.components.items():
        for i, part in enumerate(components):
            for path, parameter in parameters_below(part, f"{kind}.{i}"):
                if path.endswith(".nominal_force"):  # filters take it where no force is read
                    continue
                if parameter.std > 0.0:
                    draws.append(Draw(named(rig, path), parameter.std, (path,)))
                shared = parameter.shared
                if shared is not None and shared.std > 0.0:
                    before = common[shared.name].paths if shared.name in common else ()
                    common[shared.name] = Draw(shared.name, shared.std, (*before, path), True)
    return (*draws, *common.values())


def scores(draws: Sequence[Draw], seed: Sequence[int]) -> dict[str, float]:
    """Return by how many standard deviations each draw is off: name → standard normal number. The
    number depends on the draw's name and the seed alone.
    """
    return {
        draw.name: float(np.random.default_rng([*seed, crc32(draw.name.encode())]).normal())
        for draw in draws
    }


def built_values(rig: Rig, draws: Sequence[Draw], score: Mapping[str, float]) -> dict[str, float]:
    """Return path → value [SI] of a rig as built.

    p = value (1 + σ z) + σ_own ε. A parameter that cannot be negative is drawn from the normal
    distribution cut at zero; one that is known to a factor only (`known_to_a_factor`) is drawn from
    the log-normal distribution, as filters assume.

    Args:
        score: name of a draw → its standard normal number, z or ε.
    """
    values: dict[str, float] = {}
    for draw in sorted(draws, key=lambda draw: not draw.common):
        for path in draw.paths:
            of = number(rig, path)
            bound = of.quantity.bound
            # a shared error is a share of the value
            size, nominal = (of.value, 1.0) if draw.common else (1.0, of.value)
            mean = nominal if draw.common else values.get(path, nominal)
            bounded = draw.common or bound != "any"
            rough = bound == "positive" and known_to_a_factor(path, nominal, draw.std)
            values[path] = size * _drawn(mean, draw.std, score[draw.name], bounded, rough)
    return values


def _drawn(mean: float, std: float, score: float, bounded: bool, rough: bool) -> float:
    from scipy.special import ndtr, ndtri

    if rough:
        return float(mean * np.exp(np.log1p(std / mean) * score))
    if bounded and mean < 8.0 * std:
        below = ndtr(-mean / std)
        score = float(ndtri(below + (1.0 - below) * ndtr(score)))
    return mean + std * score


Value = float | str | bool
Design = Mapping[str, Value]

ESTIMATOR = "estimator"
"""Path in ``vary`` that stands for the estimator."""

FEEDBACK = "feedback"
"""Path in ``vary`` that stands for what feeds back a controller: `ENCODER`, `RATIO`, `COMMAND` or
an estimator.
"""

KEYS = ("from", "to", "scale")
"""Keys of the table of a range."""


def sensor_of(path: str) -> str:
    """Return the name of the sensor that a path in ``vary`` puts in or leaves out, or ""."""
    kind, _, name = path.partition(".")
    return name if kind == "sensors" and "." not in name else ""


@dataclass(frozen=True)
class Axis:
    """One thing that varies in a study: a choice or a range.

    Args:
        path: of a number of the rig, of a sensor (``sensors.u1``), ``estimator`` or ``feedback``.
        unit: SI unit of `choices` that are numbers, of `low` and of `high`.
        choices: values that it may have; empty for a range.
        low: lower end of a range.
        high: upper end of a range.
        scale: whether a range is filled evenly in its values or in their logarithms.
    """

    path: str
    unit: str = ""
    choices: tuple[Value, ...] = ()
    low: float = 0.0
    high: float = 0.0
    scale: Literal["linear", "log"] = "linear"

    def at(self, share: float) -> Value:
        """Return the value [SI] at a `share` of the way along the axis, from 0 (low end, first
        choice) to 1 (high end, last choice).
        """
        if self.choices:
            return self.choices[min(int(share * len(self.choices)), len(self.choices) - 1)]
        if self.scale == "log":
            return float(self.low * (self.high / self.low) ** share)
        return self.low + share * (self.high - self.low)


def _axis(rig: Rig, path: str, raw: object) -> Axis:
    if path in (ESTIMATOR, FEEDBACK):
        allowed = [*ESTIMATORS, *((ENCODER, RATIO, COMMAND) if path == FEEDBACK else ())]
        names = _list(raw)
        for name in names:
            if name not in allowed:
                raise StudyError(f"unknown '{name}'{did_you_mean(str(name), allowed)}")
        return Axis(path, choices=tuple(map(str, names)))
    if sensor := sensor_of(path):
        if sensor not in rig.sensor_names:
            raise StudyError(f"the rig has no such sensor{did_you_mean(sensor, rig.sensor_names)}")
        flags = _list(raw)
        if not all(isinstance(flag, bool) for flag in flags):
            raise StudyError(f"a sensor is there or not, [true, false]; {raw!r:.60} came")
        return Axis(path, choices=tuple(map(bool, flags)))
    # `*` stands for all parts of a kind; a std has the unit of its number, a shared std has none
    keys = path.replace(ALL, "0").removesuffix(".shared.std").removesuffix(".std")
    varied = number(rig, keys)
    unit = "" if path.endswith(".shared.std") else varied.quantity.si
    if not isinstance(raw, Mapping):
        return Axis(path, unit, tuple(to_si(choice, unit) for choice in _list(raw)))
    # a constant of compiled kernels
    fixed = (
        not varied.is_parameter or path.startswith("sensors.") or path.endswith(".nominal_force")
    )
    if fixed and not path.endswith((".noise", ".linearity")):
        raise StudyError(
            "each value of it needs a kernel of its own; give a list of a few values, no range"
        )
    return _range(path, raw, unit)


def _list(raw: object) -> Sequence[object]:
    if not isinstance(raw, (list, tuple)) or not raw:
        raise StudyError(f"must be a list of values or {{ from = …, to = … }}; {raw!r:.60} came")
    return raw


def _range(path: str, raw: Mapping[str, object], unit: str) -> Axis:
    for key in raw:
        if key not in KEYS:
            raise StudyError(f"unknown key '{key}'{did_you_mean(key, KEYS)}")
    if "from" not in raw or "to" not in raw:
        raise StudyError("a range needs 'from' and 'to'")
    low = to_si(raw["from"], unit)
    high = to_si(raw["to"], unit)
    scale = raw.get("scale", "linear")
    if not low < high:
        raise StudyError(
            f"the range is empty: from {low:g} {unit} must be below to {high:g} {unit}"
        )
    if scale not in ("linear", "log") or (scale == "log" and low <= 0.0):
        raise StudyError(
            f"scale is 'linear', or 'log' from above zero; {scale!r:.40} from {low:g} came"
        )
    return Axis(path, unit, (), low, high, "log" if scale == "log" else "linear")


@dataclass(frozen=True)
class Space:
    """All designs of a study.

    Args:
        axes: what varies.
        shares: how far along each axis each design is, from 0 to 1, (n, n_axes).
    """

    axes: tuple[Axis, ...]
    shares: Floats

    def __len__(self) -> int:
        return len(self.shares)

    def design(self, index: int) -> dict[str, Value]:
        """Return the design with this `index`: path → value [SI]."""
        return {
            axis.path: axis.at(float(share)) for axis, share in zip(self.axes, self.shares[index])
        }

    def chunks(self, runs_per_design: int, size: int = 48) -> list[tuple[int, ...]]:
        """Return the indices of the designs in chunks of about `size` runs; designs with the same
        choices are next to each other.
        """
        counts = np.array([len(axis.choices) or 1 for axis in self.axes])
        choices = np.minimum(self.shares * counts, counts - 1).astype(int)
        order = np.lexsort(choices.T[::-1]) if self.axes else np.arange(len(self))
        length = max(1, size // runs_per_design)
        return [
            tuple(order[start : start + length].tolist()) for start in range(0, len(self), length)
        ]


def space_of(plan: Plan) -> Space:
    """Return the space of a study's designs; the same study always has the same designs.

    Raises:
        StudyError: what varies is wrong, or there are too many designs.
    """
    from scipy.stats import qmc

    study = plan.study
    axes = list[Axis]()
    for path, raw in study.vary.items():
        try:
            axis = _axis(plan.rig, path, raw)
            for value in axis.choices or (axis.low, axis.high):
                rig_of(plan.rig, {path: value})
        except DistalError as problem:
            raise StudyError(f"vary.{path}: {problem}") from None
        axes.append(axis)
    if FEEDBACK in study.vary and all(scenario.control is None for scenario in plan.scenarios):
        raise StudyError(
            f"vary.{FEEDBACK}: no scenario of the study has a [control] table; estimator is what "
            "may vary"
        )
    if not axes:
        return Space((), np.zeros((study.designs, 0)))
    size = 8 * study.designs * len(axes)  # bytes
    if size > memory_limit():
        raise StudyError(
            f"{study.designs:,} designs take {size / 1e9:.3g} GB, {memory_limit() / 1e9:.3g} GB "
            f"are allowed ({MEMORY_VARIABLE}); take fewer designs"
        )
    rng = np.random.default_rng([study.draw, 0])
    return Space(tuple(axes), qmc.LatinHypercube(len(axes), rng=rng).random(study.designs))


def rig_of(rig: Rig, design: Design) -> Rig:
    """Return the rig of a design, without the sensors that it leaves out."""
    off = {sensor_of(path) for path, setting in design.items() if setting is False}
    values = {
        path: setting for path, setting in design.items() if not isinstance(setting, (bool, str))
    }
    changed = rig.with_values(values)
    sensors = tuple(sensor for sensor in changed.sensors if sensor.name not in off)
    return changed.model_copy(update={"sensors": sensors})
