"""The options of a fit as one frozen object, and which parameters of a rig it varies: those with a
std or those asked for, and the noise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from distal.errors import FitError, RigError
from distal.estimators import Robustness, channels_of
from distal.estimators.adaptive import FilterContext, uncertain_parameters
from distal.fitting.free_parameter import NOISY, POINTS, Free, free_noise, free_parameter
from distal.model import Mechanism
from distal.rig import REFERENCES, Number, Rig, Sensor, named, number, part_at

Progress = Callable[[str], None]
"""A function that is called with what the fit is doing, in words."""


def searching(progress: Progress | None, stage: str) -> Callable[[int, float], None] | None:
    """Return the function that a search calls after each iteration, with the iteration and −ln p;
    None without progress.
    """
    if progress is None:
        return None
    return lambda iteration, _: progress(f"{stage}, step {iteration}")


@dataclass(frozen=True, kw_only=True)
class Options:
    """The options of a fit, the arguments of the same names of `fit`."""

    free: tuple[str, ...] = ()
    per_log: tuple[str, ...] = ()
    homing: float | None = None
    noise: bool = True
    units: str | None = None
    workers: int = 2
    compiled: bool = True


EXACT = np.deg2rad(0.02)
"""Least std of the random error of a reference angle [rad], since the model's own time steps err as
much. Source: judgement.
"""


def choose(
    rig: Rig,
    references: Sequence[Sensor],
    asked: Sequence[str],
    per_log: Sequence[str],
    *,
    noise: bool,
    homing: bool,
    several: bool = False,
) -> tuple[Free, ...]:
    """Return what a fit varies.

    By default these are the parameters with a std that have an effect on the joint, and the noise
    of the sensors that are compared, of the unmodelled torque and of the hysteresis. Tendons that
    err together are varied by one factor, as in the filter.

    Args:
        rig: the rig with its `references`.
        references: sensors of joints' angles that give the reference.
        asked: paths of the parameters to vary, ``*`` for all components of a kind; empty for every
            parameter with a std.
        per_log: paths of parameters of which each log has its own.
        noise: whether noise is varied.
        homing: whether the errors after homing are fitted; the sensors' noise then stays as it is.
        several: whether there are several logs; each then has its own offsets of the sensors, whose
            std is their scatter.

    Raises:
        FitError: nothing is free, or a path cannot be varied.
    """
    own_of_each = [_asked(rig, path, True) for path in per_log]
    free = [_asked(rig, path, False) for path in asked] or _uncertain(
        rig, references, own_of_each, several
    )
    free += own_of_each
    if noise:
        paths = {path for part in free for path in part.paths}
        free += [
            part for part in _noises(rig, references, homing) if not paths.intersection(part.paths)
        ]
    seen: dict[str, str] = {}
    for part in free:
        for path in part.paths:
            if path in seen:
                names = f"'{seen[path]}' and '{part.name}'"
                raise FitError(f"'{named(rig, path)}' is asked for twice, by {names}; name it once")
            seen[path] = part.name
    if not asked and all(part.noise for part in free):
        raise FitError(
            f"{rig.name}: no parameter that shows in these sensors has a std, so there is nothing "
            "to fit; give the "
            f"unknown ones one (--set 'joints.{rig.joints[0].name}.damping.std=…') or name them "
            "with --free"
        )
    return tuple(_coarse(rig, part) for part in free)


def _coarse(rig: Rig, part: Free) -> Free:
    """Return what is varied, with a larger `coarse` where the model leaves more of it uncertain
    than elsewhere.
    """
    for path in part.paths:
        kind, index, *fields = path.split(".")
        if kind == "drives" and fields in (["damping"], ["backlash", "width"]):
            return replace(part, coarse=NOISY)
        if kind == "tendons" and fields[0] == "path":
            along = rig.tendons[int(index)].path
            if along is not None and along.nodes > 0:
                return replace(part, coarse=POINTS / along.nodes)
    return part


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
            parameters = [parameter for parameter in parameters if parameter.independent_std == 0.0]
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
    read = [
        (i, sensor) for i, sensor in enumerate(rig.sensors) if sensor.measures not in REFERENCES
    ]
    parameters = [(number(rig, f"sensors.{i}.bias"), several) for i, _ in read]
    parameters += [
        (number(rig, f"sensors.{i}.gain"), False) for i, sensor in read if hasattr(sensor, "gain")
    ]
    uncertain = [
        (bias, per_log) for bias, per_log in parameters if bias.std > 0.0 and not bias.hold
    ]
    return [free_parameter(rig, [bias], per_log) for bias, per_log in uncertain]


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
        if parameter.std > 0.0 and (parameter.hold or ".hysteresis." in path):
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


def _noises(rig: Rig, references: Sequence[Sensor], homing: bool) -> list[Free]:
    """Return the noises that are varied: of alike sensors by one factor, of the reference, of
    hysteresis and of the unmodelled torques.

    The noise of position sensors is left out. Their readings are inputs, so that their noise shows
    only in the forces that it shakes, and would come out too small. The noise of a force that moves
    a play operator is left out too, because that force is smoothed and not compared.
    """
    if homing:
        return []  # the errors after homing tell nothing of a sensor's own noise
    angles = {reference.name for reference in references}
    playing = {drive.name for drive in rig.drives if drive.hysteresis is not None}
    groups: dict[tuple[str, str, float], list[int]] = {}
    for i, sensor in enumerate(rig.sensors):
        smooth = sensor.measures == "force" and sensor.of in playing
        if sensor.measures not in ("position", *REFERENCES) and sensor.noise > 0.0 and not smooth:
            groups.setdefault((sensor.measures, sensor.si, sensor.noise), []).append(i)
    free = []
    for indices in groups.values():
        paths = [f"sensors.{i}.noise" for i in indices]
        free.append(free_noise(rig, [number(rig, path) for path in paths]))
    for at, sensor in enumerate(rig.sensors):
        if sensor.name in angles and sensor.noise > 0.0:
            reference_noise = free_noise(rig, [number(rig, f"sensors.{at}.noise")], prior=False)
            free.append(
                replace(
                    reference_noise, low=min(max(reference_noise.low, EXACT), reference_noise.start)
                )
            )
    paths = [
        f"drives.{i}.hysteresis.error" for i, d in enumerate(rig.drives) if d.hysteresis is not None
    ]
    paths = [path for path in paths if number(rig, path).value > 0.0]
    paths += [
        f"joints.{j}.unmodelled" for j, joint in enumerate(rig.joints) if joint.unmodelled > 0.0
    ]
    free += [
        replace(free_noise(rig, [number(rig, path)]), kept_by_file=path.endswith(".unmodelled"))
        for path in paths
    ]
    return free
