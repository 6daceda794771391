"""What a fit varies: a parameter of the rig, or several by one factor, with prior and bounds; which
ones these are (`choose`), by the `Options` of the fit; and what is written of each afterwards.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import exp, inf, isnan, log, log1p

import numpy as np

from distal.errors import FitError, RigError
from distal.estimators import Robustness, channels_of
from distal.estimators.adaptive import FilterContext, uncertain_parameters
from distal.model import Mechanism
from distal.rig import REFERENCES, Number, Rig, Sensor, in_words, named, number, part_at
from distal.rig.values_with_stds import SMALLEST

DIGITS = 7
"""Number of significant digits of a value in a file: far more than any log tells. Source:
judgement.
"""

COMMON = {
    "rad": ("deg", float(np.rad2deg(1.0))),
    "rad/s": ("deg/s", float(np.rad2deg(1.0))),
    "m": ("mm", 1e3),
    "N/m": ("N/mm", 1e-3),
    "N m": ("mN m", 1e3),
    "N m s": ("mN m s", 1e3),
}
"""SI unit → the unit in which people give sizes of fingers and instruments, and the factor to it.
Source: definition (unit conversions).
"""

SMALLEST_RELATIVE_STD = 0.002
"""Least std in a fitted file, as a share of the value, since a rig differs that much from day to
day. Source: judgement.
"""


NOISE_RANGE = 25.0
"""Largest factor by which the size of a noise changes in a fit, either way: a model without noise
would have standard errors of zero. Source: judgement.
"""

NOISE_PRIOR = 1.0
"""Standard deviation of the prior of a noise's size, as a share of its start: a factor of two
either way. Source: judgement.
"""

SMALLEST_NUMBER = 1e-3
"""Lower bound of a positive parameter, as a share of its start. Source: judgement."""


@dataclass(frozen=True)
class FittedParameter:
    """One free parameter after a fit, with its value in the description.

    Args:
        name: name in words.
        paths: paths of all values in the description that vary together with it.
        si: SI unit.
        start: value where it started, which is the mean of its prior.
        prior_std: std of its prior, NaN where there was none.
        value: fitted value of the first path, or the mean over the logs.
        error: standard error, the other parameters not being known; NaN where the search did not
            converge.
        noise: whether it is the size of a noise.
        values: the values at all `paths`.
        per_log: value of each log, in their order, where each has its own; else none.
    """

    name: str
    paths: tuple[str, ...]
    si: str
    start: float
    prior_std: float
    value: float
    error: float
    noise: bool
    values: tuple[float, ...]
    per_log: tuple[float, ...] = ()

    @property
    def as_it_came(self) -> FittedParameter:
        """The same parameter with its original value."""
        starts = tuple(
            self.start * value / self.value if self.value else self.start for value in self.values
        )
        return replace(self, value=self.start, values=starts)

    @property
    def std(self) -> float:
        """The std that a fitted file has: its error, where that is less than the prior's."""
        return float(np.fmin(self.error, self.prior_std))

    @property
    def sizes(self) -> tuple[str, str, str]:
        """The original value, the fitted value, each with the std that its file has, and their
        unit, as text in a common unit.
        """
        unit, factor = COMMON.get(self.si, (self.si, 1.0))
        prior = "" if np.isnan(self.prior_std) else f" ± {factor * self.prior_std:.2g}"
        before = f"{factor * self.start:.4g}{prior}"
        std = f" ± {factor * self.std:.2g}" if np.isfinite(self.std) else ""
        return before, f"{factor * self.value:.4g}{std}", unit

    @property
    def variance_reduction(self) -> float:
        """Share of the prior's variance that the logs take away [1], 0 where nothing is known of
        it.
        """
        share = 1.0 - (self.std / self.prior_std) ** 2
        return share if np.isfinite(share) else 0.0


def assignments(
    parameters: Sequence[FittedParameter], start: Rig, hold: bool = False
) -> dict[str, object]:
    """Return path by names → value, with its std where it had one, of all that does not stay as it
    was.

    Args:
        parameters: the parameters after the fit.
        start: the original rig.
        hold: whether estimators are to take the values as exactly known.
    """
    positions = [f"sensors.{i}" for i, s in enumerate(start.sensors) if s.measures == "position"]
    only_grow = (".unmodelled", *(f"{position}.noise" for position in positions))
    changed: dict[str, object] = {}
    for part in parameters:
        if part.value == part.start:
            continue
        for path, value in zip(part.paths, part.values):
            before = number(start, path)
            rounded = 0.0 if abs(value) < SMALLEST else float(f"{value:.{DIGITS}g}")
            if path.endswith(only_grow):
                # these logs did not need so much noise, others may: without it the filter's band
                # would be too narrow
                rounded = max(rounded, before.value)
            if not before.is_parameter or before.std == 0.0:
                changed[path] = rounded
                continue
            share = abs(value / part.value) if part.value else 1.0
            std = max(part.std * share, SMALLEST_RELATIVE_STD * abs(value))
            # a file may have it as a share of the value
            other = {} if before.parameter.drift is None else {"drift": before.parameter.drift}
            other |= {"hold": True} if hold else {}
            changed[path] = {"value": rounded, **_spread(part, before, std, value, start), **other}
    return {named(start, path): value for path, value in changed.items()}


def _spread(
    part: FittedParameter, before: Number, std: float, value: float, start: Rig
) -> dict[str, object]:
    """Return the std of a value as a file holds it: shared with others where all of them were
    varied by one factor.
    """
    shared = before.parameter.shared
    varied = set(part.paths)
    alone = before.parameter.std > 0.0
    if shared is not None and not alone and set(start.sharing()[shared.name]) <= varied:
        return {"shared": {"name": shared.name, "std": min(1.0, float(f"{std / abs(value):.3g}"))}}
    return {"std": float(f"{std:.3g}")}


@dataclass(frozen=True)
class Free:
    """A parameter that is varied, or several that are varied by a common factor; scale, bounds and
    unit are those of the first.

    Its coordinate z is ln(value/start) where it is `logarithmic`, else (value − start)/scale.

    Args:
        name: name in words, for tables.
        paths: paths of the parameters in the description.
        starts: their values where the fit starts; the first is the mean of the prior.
        std: std of the prior; NaN where there is none.
        scale: change of the value for one unit of the coordinate.
        low: lower bound of the value.
        high: upper bound of the value.
        si: SI unit.
        logarithmic: whether the coordinate is a logarithm; the prior is then on it, with std ln(1 +
            std/start).
        per_log: whether each log has a value of its own.
        noise: whether it is the size of a noise.
    """

    name: str
    paths: tuple[str, ...]
    starts: tuple[float, ...]
    std: float
    scale: float
    low: float
    high: float
    si: str = ""
    logarithmic: bool = False
    per_log: bool = False
    noise: bool = False

    @property
    def start(self) -> float:
        """The value of the first parameter where the fit starts."""
        return self.starts[0]

    @property
    def has_prior(self) -> bool:
        """Whether the parameter has a prior."""
        return not isnan(self.std)

    @property
    def spread(self) -> float:
        """Standard deviation of the prior in the coordinate; NaN where there is none."""
        if not self.has_prior:
            return float("nan")
        return log1p(self.std / self.start) if self.logarithmic else self.std / self.scale

    def coordinate(self, value: float) -> float:
        """Return the coordinate of a value of the first parameter, 0 for a value that has no
        logarithm.
        """
        if not self.logarithmic:
            return (value - self.start) / self.scale
        return log(value / self.start) if value > 0.0 else 0.0

    def value(self, z: float) -> float:
        """Return the value of the first parameter at a coordinate, within its bounds."""
        low, high = self.bounds
        z = min(max(z, low), high)
        number = self.start * exp(z) if self.logarithmic else self.start + self.scale * z
        return min(max(number, self.low), self.high)  # rounding may lead beyond a bound

    def values(self, first: float) -> tuple[float, ...]:
        """Return the values of all parameters by that of the first."""
        if len(set(self.starts)) == 1:
            return (first,) * len(self.starts)
        return tuple(first * start / self.start for start in self.starts)

    def fitted(
        self, value: float, error: float = float("nan"), per_log: tuple[float, ...] = ()
    ) -> FittedParameter:
        """Return the parameter after a fit, with the value of the first and its standard error, or
        with the mean of those of each log, `per_log`.
        """
        prior = self.name, self.paths, self.si, self.start, self.std
        return FittedParameter(*prior, value, error, self.noise, self.values(value), per_log)

    @cached_property
    def bounds(self) -> tuple[float, float]:
        """Lower and upper bound of the coordinate."""
        if self.logarithmic:
            return _log(self.low / self.start), _log(self.high / self.start)
        return (self.low - self.start) / self.scale, (self.high - self.start) / self.scale

    def unit(self, z: float) -> float:
        """Return the change of the coordinate that stands for the whole value at z, or for `scale`
        where the value may be zero or negative.
        """
        if self.logarithmic or self.low < 0.0 or self.start <= 0.0:
            return 1.0
        # slopes go over the same share of each value: two parameters that show only as a product
        # then meet the same kinks
        return max(self.value(z) / self.scale, 0.1)

    def slope(self, z: float) -> float:
        """Return the derivative of the first parameter's value by the coordinate, d value/dz."""
        return self.value(z) if self.logarithmic else self.scale


def free_parameter(rig: Rig, parameters: Sequence[Number], per_log: bool) -> Free:
    """Return what a fit varies of some parameters by one factor: its prior is the rig's std, and
    its bounds are those of its kind; `per_log` says whether each log has a value of its own.

    Raises:
        FitError: a parameter is zero and its size unknown.
    """
    first = parameters[0]
    position = named(rig, first.path)
    if not first.is_parameter:
        return free_noise(rig, parameters)
    if first.value == 0.0 and first.std == 0.0:
        raise FitError(
            f"'{position}' is zero without a std, so its size is unknown; give it one "
            f"(--set {position}.std=…) to say how large it may be"
        )
    if per_log and first.std == 0.0:
        raise FitError(
            f"'{position}' has no std; what differs from log to log needs one "
            f"(--set {position}.std=…)"
        )
    shared = _of_all(rig, parameters)
    name, _, starts = shared
    if 0.0 in starts and len(set(starts)) > 1:
        raise FitError(
            f"'{name}' varies its numbers by one factor, but some are zero; name them one by one"
        )
    rough = first.is_rough
    least = SMALLEST_NUMBER * first.value
    bounds = {"any": -np.inf, "nonnegative": 0.0, "positive": least}
    low = least if rough else bounds[first.quantity.bound]
    scale = first.std or 0.1 * abs(first.value)
    std = first.std or float("nan")
    si = first.quantity.si
    return Free(*shared, std, scale, low, np.inf, si, logarithmic=rough, per_log=per_log)


def _of_all(
    rig: Rig, parameters: Sequence[Number]
) -> tuple[str, tuple[str, ...], tuple[float, ...]]:
    """Return the name of some parameters in words, their paths and their values."""
    paths = tuple(parameter.path for parameter in parameters)
    return in_words(rig, *paths), paths, tuple(parameter.value for parameter in parameters)


def free_noise(rig: Rig, parameters: Sequence[Number], prior: bool = True) -> Free:
    """Return what a fit varies of some noises by one factor, with a `prior` or without.

    Raises:
        FitError: a noise is zero.
    """
    first = parameters[0]
    if first.value <= 0.0:
        raise FitError(
            f"'{named(rig, first.path)}' is zero; a noise that is fitted needs a size to start from"
        )
    start = first.value
    std = NOISE_PRIOR * start if prior else float("nan")
    low = start / NOISE_RANGE
    high = start * NOISE_RANGE
    si = first.quantity.si
    shared = _of_all(rig, parameters)
    return Free(*shared, std, start, low, high, si, logarithmic=True, noise=True)


def _log(value: float) -> float:
    return log(value) if value > 0.0 else -inf


Progress = Callable[[str], None]
"""A function that is called with what the fit is doing, in words."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """The options of a fit, the arguments of the same names of `fit`."""

    free: tuple[str, ...] = ()
    per_log: tuple[str, ...] = ()
    homing: float | None = None
    noise: bool = True
    groups: str | None = None
    workers: int = 2
    compiled: bool = True


EXACT = np.deg2rad(0.02)
"""Least std of the random error of a reference angle [rad], since the model's own time steps err as
much. Source: judgement.
"""


def choose(
    rig: Rig,
    references: Sequence[Sensor],
    options: Options,
    several: bool = False,
) -> tuple[Free, ...]:
    """Return what a fit varies.

    By default these are the parameters with a std that have an effect on the joint, and the noise
    of the sensors that are compared, of the unmodelled torque and of the hysteresis. Tendons that
    err together are varied by one factor, as in the filter.

    Args:
        rig: the rig with its `references`.
        references: sensors of joints' angles that give the reference.
        options: of the fit. With a homing move the sensors' noise stays as it is.
        several: whether there are several logs; each then has its own offsets of the sensors, whose
            std is their scatter.

    Raises:
        FitError: nothing is free, or a path cannot be varied.
    """
    own_of_each = [_asked(rig, path, True) for path in options.per_log]
    free = [_asked(rig, path, False) for path in options.free] or _uncertain(
        rig, references, own_of_each, several
    )
    free += own_of_each
    if options.noise and options.homing is None:  # else errors tell nothing of a noise
        paths = {path for part in free for path in part.paths}
        free += [part for part in _noises(rig, references) if not paths.intersection(part.paths)]
    seen: dict[str, str] = {}
    for part in free:
        for path in part.paths:
            if path in seen:
                names = f"'{seen[path]}' and '{part.name}'"
                raise FitError(f"'{named(rig, path)}' is asked for twice, by {names}; name it once")
            seen[path] = part.name
    if not options.free and all(part.noise for part in free):
        raise FitError(
            f"{rig.name}: no parameter that shows in these sensors has a std, so there is nothing "
            "to fit; give the "
            f"unknown ones one (--set 'joints.{rig.joints[0].name}.damping.std=…') or name them "
            "with --free"
        )
    return tuple(free)


def _uncertain(
    rig: Rig, references: Sequence[Sensor], own_of_each: Sequence[Free], several: bool
) -> list[Free]:
    mechanism = Mechanism(rig)
    per_log_paths = {path for part in own_of_each for path in part.paths}
    free = [part for part in _biases(rig, several) if not per_log_paths.intersection(part.paths)]
    context = FilterContext(mechanism, channels_of(rig, "fit", references), Robustness.fitting())
    for state in uncertain_parameters(context):
        paths = [mechanism.parameters.names[i] for i in state.indices]
        if per_log_paths.intersection(paths) or (
            len(paths) == 1 and any(paths[0] in part.paths for part in free)
        ):
            continue  # a parameter that shares no error with others is varied once
        parameters = [number(rig, path) for path in paths]
        if state.acts == "factor" and len(paths) > 1:
            # a parameter that also errs alone is varied alone, with the std of both errors
            parameters = [parameter for parameter in parameters if parameter.parameter.std == 0.0]
        if parameters:
            free.append(free_parameter(rig, parameters, False))
    taken = {path for part in free for path in part.paths} | per_log_paths
    alike: dict[tuple[str, float, float], list[Number]] = {}
    for path in _held(rig):
        if path not in taken:
            held = number(rig, path)
            # one pulley serves all its tendons: insertions with the same number are varied together
            shared = path.split(".", 2)[2] if ".insertion." in path else path
            alike.setdefault((shared, held.value, held.std), []).append(held)
    return free + [free_parameter(rig, parameters, False) for parameters in alike.values()]


def _biases(rig: Rig, several: bool) -> list[Free]:
    """Return the offsets and gains of the sensors that estimators read, where they have a std; with
    `several` logs each has its own offsets.
    """
    read = [i for i, sensor in enumerate(rig.sensors) if sensor.measures not in REFERENCES]
    errors = [(number(rig, f"sensors.{i}.bias"), several) for i in read]
    errors += [
        (number(rig, f"sensors.{i}.gain"), False) for i in read if hasattr(rig.sensors[i], "gain")
    ]
    return [
        free_parameter(rig, [error], per_log)
        for error, per_log in errors
        if error.std > 0.0 and not error.parameter.hold
    ]


def _held(rig: Rig) -> list[str]:
    """Return the paths of what estimators take as exactly known but a fit may vary: held parameters
    and hysteresis.
    """
    held = []
    for path in Mechanism(rig, ()).parameters.all_names:
        try:
            parameter = number(rig, path)
        except RigError:
            continue  # stops, and parameters that follow from others
        if parameter.std > 0.0 and (parameter.parameter.hold or ".hysteresis." in path):
            held.append(path)
    return held


def paths_of(rig: Rig, desired: str) -> list[str]:
    """Return the paths, by indices, that a path by names or indices stands for; ``*`` stands for
    all components of a kind.

    Raises:
        FitError: ``*`` stands for nothing.
        RigError: the path is not that of a number.
    """
    before, star, after = desired.partition(".*.")
    if not star:
        return [number(rig, desired).path]
    items = part_at(rig, before)
    if not isinstance(items, tuple):
        raise FitError(
            f"'{desired}': '{before}' is no list that '*' could stand for; write e.g. "
            "tendons.*.stiffness"
        )
    return [path for i in range(len(items)) for path in paths_of(rig, f"{before}.{i}.{after}")]


def _asked(rig: Rig, desired: str, per_log: bool) -> Free:
    try:
        parameters = [number(rig, path) for path in paths_of(rig, desired)]
    except RigError as problem:
        raise FitError(f"{'--per-log' if per_log else '--free'} {problem}") from None
    return free_parameter(rig, parameters, per_log)


def _noises(rig: Rig, references: Sequence[Sensor]) -> list[Free]:
    """Return the noises that are varied: of alike sensors by one factor, of the reference, of
    hysteresis and of the unmodelled torques.

    The noise of position sensors is left out. Their readings are inputs, so that their noise shows
    only in the forces that it shakes, and would come out too small. The noise of a force that moves
    a play operator is left out too, because that force is smoothed and not compared.
    """
    angles = {reference.name for reference in references}
    playing = {drive.name for drive in rig.drives if drive.hysteresis is not None}
    alike: dict[tuple[str, str, float], list[Number]] = {}
    of_references = []
    for i, sensor in enumerate(rig.sensors):
        noise = number(rig, f"sensors.{i}.noise")
        smooth = sensor.measures == "force" and sensor.of in playing
        if noise.value == 0.0:
            continue
        if sensor.name in angles:
            part = free_noise(rig, [noise], prior=False)
            of_references.append(replace(part, low=min(max(part.low, EXACT), part.start)))
        elif sensor.measures not in ("position", *REFERENCES) and not smooth:
            alike.setdefault((sensor.measures, sensor.si, sensor.noise), []).append(noise)
    paths = [
        f"drives.{i}.hysteresis.error" for i, d in enumerate(rig.drives) if d.hysteresis is not None
    ]
    paths += [f"joints.{j}.unmodelled" for j in range(len(rig.joints))]
    alone = [[noise] for path in paths if (noise := number(rig, path)).value > 0.0]
    of_sensors = [free_noise(rig, noises) for noises in alike.values()]
    return [*of_sensors, *of_references, *(free_noise(rig, noises) for noises in alone)]
