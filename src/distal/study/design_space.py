"""The space of a study's designs, one axis for each thing that varies, and the designs that fill
it; and rigs as built: plants whose parameters are drawn from the stds of a rig's description.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import exp, log
from typing import Literal
from zlib import crc32

import numpy as np

from distal.arrays import Floats
from distal.control import COMMAND, ENCODER, RATIO
from distal.errors import DistalError, StudyError, did_you_mean
from distal.estimators import ESTIMATORS
from distal.logs.memory import MEMORY_VARIABLE, memory_limit
from distal.rig import ALL, Rig, known_to_a_factor, named, number, parameters_below
from distal.study.description import Plan
from distal.units import to_si


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
    common = dict[str, tuple[float, list[str]]]()
    for kind, components in rig.components.items():
        for i, part in enumerate(components):
            for path, parameter in parameters_below(part, f"{kind}.{i}"):
                if path.endswith(".nominal_force"):  # filters take it where no force is read
                    continue
                if parameter.std > 0.0:
                    draws.append(Draw(named(rig, path), parameter.std, (path,)))
                if parameter.shared is not None and parameter.shared.std > 0.0:
                    common.setdefault(parameter.shared.name, (parameter.shared.std, []))[1].append(
                        path
                    )
    return (*draws, *(Draw(name, std, tuple(paths), True) for name, (std, paths) in common.items()))


def scores(draws: Sequence[Draw], seed: Sequence[int]) -> dict[str, float]:
    """Return by how many standard deviations each draw is off: name → standard normal number. The
    number depends on the draw's name and the seed alone.
    """
    keys = ([*seed, crc32(draw.name.encode())] for draw in draws)
    return {draw.name: float(np.random.default_rng(key).normal()) for draw, key in zip(draws, keys)}


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
            nominal = number(rig, path).value
            bound = number(rig, path).quantity.bound
            rough = bound == "positive" and known_to_a_factor(
                path, 1.0 if draw.common else nominal, draw.std
            )
            if draw.common:
                values[path] = nominal * _drawn(1.0, draw.std, score[draw.name], True, rough)
            else:
                mean = values.get(path, nominal)
                values[path] = _drawn(mean, draw.std, score[draw.name], bound != "any", rough)
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
            return exp(log(self.low) + share * (log(self.high) - log(self.low)))
        return self.low + share * (self.high - self.low)


def _axis(rig: Rig, path: str, raw: object) -> Axis:
    sensors = rig.sensor_names
    if path in (ESTIMATOR, FEEDBACK):
        allowed = [*ESTIMATORS, *((ENCODER, RATIO, COMMAND) if path == FEEDBACK else ())]
        names = _list(path, raw)
        for name in names:
            if name not in allowed:
                raise StudyError(f"vary.{path}: unknown '{name}'{did_you_mean(str(name), allowed)}")
        return Axis(path, choices=tuple(map(str, names)))
    if sensor := sensor_of(path):
        if sensor not in sensors:
            raise StudyError(
                f"vary.{path}: the rig has no such sensor{did_you_mean(sensor, sensors)}"
            )
        flags = _list(path, raw)
        if not all(isinstance(flag, bool) for flag in flags):
            raise StudyError(
                f"vary.{path}: a sensor is there or not, [true, false]; {raw!r:.60} came"
            )
        return Axis(path, choices=tuple(map(bool, flags)))
    try:
        unit = _unit(rig, path)
        if isinstance(raw, Mapping):
            _check_smooth(rig, path)
            return _range(path, raw, unit)
        axis = Axis(path, unit, tuple(to_si(choice, unit) for choice in _list(path, raw)))
        for choice in axis.choices:
            rig.with_values({path: choice})
    except StudyError:
        raise
    except DistalError as problem:
        raise StudyError(f"vary.{path}: {problem}") from None
    return axis


def _unit(rig: Rig, path: str) -> str:
    """Return the SI unit of a number: ``*`` in its path stands for all parts of a kind, a std has
    the unit of its number, a shared std has none.
    """
    keys = path.replace(ALL, "0")
    if keys.endswith(".shared.std"):
        number(rig, keys.removesuffix(".shared.std"))
        return ""
    return number(rig, keys.removesuffix(".std")).quantity.si


def _check_smooth(rig: Rig, path: str) -> None:
    """Refuse a range of a number that is a constant of compiled kernels: each design would need its
    own.
    """
    keys = path.replace(ALL, "0").removesuffix(".std").removesuffix(".shared")
    fixed = (
        not number(rig, keys).is_parameter
        or path.startswith("sensors.")
        or path.endswith(".nominal_force")
    )
    if fixed and not path.endswith((".noise", ".linearity")):
        raise StudyError(
            f"vary.{path}: each value of it needs a kernel of its own; give a list of a few "
            "values, no range"
        )


def _list(path: str, raw: object) -> Sequence[object]:
    if not isinstance(raw, (list, tuple)) or not raw:
        raise StudyError(
            f"vary.{path}: must be a list of values or {{ from = …, to = … }}; {raw!r:.60} came"
        )
    return raw


def _range(path: str, raw: Mapping[str, object], unit: str) -> Axis:
    for key in raw:
        if key not in KEYS:
            raise StudyError(f"vary.{path}: unknown key '{key}'{did_you_mean(key, KEYS)}")
    if "from" not in raw or "to" not in raw:
        raise StudyError(f"vary.{path}: a range needs 'from' and 'to'")
    low = to_si(raw["from"], unit)
    high = to_si(raw["to"], unit)
    scale = raw.get("scale", "linear")
    if not low < high:
        raise StudyError(
            f"vary.{path}: the range is empty: from {low:g} {unit} must be below to {high:g} {unit}"
        )
    if scale not in ("linear", "log") or (scale == "log" and low <= 0.0):
        raise StudyError(
            f"vary.{path}: scale is 'linear', or 'log' from above zero; {scale!r:.40} from "
            f"{low:g} came"
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
        columns = [i for i, axis in enumerate(self.axes) if axis.choices]
        counts = np.array([len(self.axes[i].choices) for i in columns])
        choices = np.minimum(self.shares[:, columns] * counts, counts - 1).astype(int)
        order = np.lexsort(choices.T[::-1]) if columns else np.arange(len(self))
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
    axes = tuple(_axis(plan.rig, path, raw) for path, raw in plan.study.vary.items())
    if FEEDBACK in study.vary and all(scenario.control is None for scenario in plan.scenarios):
        raise StudyError(
            f"vary.{FEEDBACK}: no scenario of the study has a [control] table; estimator is what "
            "may vary"
        )
    for axis in axes:
        for share in (0.0, 1.0):
            try:
                rig_of(plan.rig, {axis.path: axis.at(share)})
            except DistalError as problem:
                raise StudyError(f"vary.{axis.path}: {problem}") from None
    if not axes:
        return Space(axes, np.zeros((study.designs, 0)))
    size = study.designs * len(axes) * np.dtype(np.float64).itemsize
    if size > memory_limit():
        raise StudyError(
            f"{study.designs:,} designs take {size / 1e9:.3g} GB, {memory_limit() / 1e9:.3g} GB "
            f"are allowed ({MEMORY_VARIABLE}); take fewer designs"
        )
    rng = np.random.default_rng([study.draw, 0])
    return Space(axes, qmc.LatinHypercube(len(axes), rng=rng).random(study.designs))


def rig_of(rig: Rig, design: Design) -> Rig:
    """Return the rig of a design, without the sensors that it leaves out."""
    off = {sensor_of(path) for path, setting in design.items() if setting is False}
    values = {
        path: setting for path, setting in design.items() if not isinstance(setting, (bool, str))
    }
    changed = rig.with_values(values) if values else rig
    if not off:
        return changed
    return changed.model_copy(
        update={"sensors": tuple(s for s in changed.sensors if s.name not in off)}
    )
