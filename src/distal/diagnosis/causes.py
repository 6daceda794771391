"""What may be wrong with a rig or a log: sensors' scales, zeros, delays and columns, moment arms,
stiffnesses, frictions and damping. Each is one number x, zero where all is as the rig says.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Literal

import numpy as np

from distal.arrays import Floats
from distal.estimators import AdaptiveFilter
from distal.rig import Rig, Sensor, log_factor, named, number

CauseKind = Literal["scale", "zero", "delay", "swap", "arm", "stiffness", "friction", "damping"]

UNITS: dict[str, dict[float, str]] = {
    "rad": {
        180 / np.pi: "like degrees",
        np.pi / 180: "57.3 times too small (converted from degrees twice?)",
    },
    "m": {1e3: "like millimetres", 1e-3: "1000 times too small"},
    "N": {
        1e3: "like millinewtons",
        1e-3: "1000 times too small",
        1 / 4.4482216: "like pounds",
        4.4482216: "like newtons that are read as pounds",
    },
    "N m": {1e3: "like N mm", 1e-3: "1000 times too small"},
}
"""SI unit → factor by which readings are too large in another unit → what they look like."""

SIGN = -1.0
"""Factor on readings whose sign is wrong. Source: definition."""

LEAST_STD = {"scale": 0.03, "arm": 0.03, "stiffness": 0.1, "friction": 0.1, "damping": 0.1}
"""Kind → least std of a factor, whatever the rig says [1]: friction and stretch are in a force.
Source: judgement.
"""

LEAST_ZERO = {"m": 1e-4, "rad": float(np.deg2rad(1.0)), "N": 0.1, "N m": 1e-3}
"""Least std of the zero of a sensor, whatever the rig says [SI]. Source: judgement."""

UNLIKELY = 3.0
"""Distance of a sign, a unit or exchanged columns from what the rig says [stds]. Source: judgement.
"""

STEP = 0.02
"""Step of a factor over which derivatives are taken [1]. Source: judgement."""

FRICTIONS = ("friction.coefficient", "friction.constant", "friction.load")
"""Parameters of a joint's or drive's friction."""


@dataclass(frozen=True)
class Cause:
    """Something that may be wrong.

    Args:
        kind: of the cause.
        subject: sensor, drive, tendon or joint, in words.
        channels: whose readings it changes: one, or two that are exchanged.
        paths: parameters of the rig that it changes.
        std: how well the rig itself knows it, in the unit of x.
        step: of x over which derivatives are taken.
        ratio: what the first of two exchanged channels has for a unit of the second.
        tried: values of x that are tried whatever the derivative: signs, units.
        unit: SI unit of the channel.
    """

    kind: CauseKind
    subject: str
    channels: tuple[str, ...] = ()
    paths: tuple[str, ...] = ()
    std: float = 0.0
    step: float = STEP
    ratio: float = 1.0
    tried: tuple[float, ...] = field(default=(), compare=False)
    unit: str = ""

    @property
    def is_factor(self) -> bool:
        """Whether 1 + x is a factor."""
        return self.kind in LEAST_STD

    def distance(self, x: float) -> float:
        """Return how far a change x is from what the rig says, in stds; of a factor in logarithms.
        A sign, a unit, or columns that are exchanged are `UNLIKELY`, whatever their size.
        """
        if x in self.tried:
            return UNLIKELY
        if self.is_factor:
            least = max(self.std, LEAST_STD[self.kind])
            if self.kind == "scale" and self.unit.startswith("N"):
                least = max(least, LEAST_STD["stiffness"])
            size = np.log(max(abs(1.0 + x), 1e-6)) / np.log1p(least)
            return float(np.hypot(size, UNLIKELY if x < -1.0 else 0.0))
        return abs(x) / self.std

    def jacobian(self, x: float) -> float:
        """Return ln |dy'/dy| of readings y' that x makes of y: a density of scaled readings has
        another unit.
        """
        return float(np.log(max(abs(1.0 + x), 1e-300))) if self.kind == "scale" else 0.0

    def apply(self, x: float, samples: Floats, columns: Sequence[int], time: Floats) -> None:
        """Change readings in place.

        Args:
            x: size of the change.
            samples: readings, (k, n).
            columns: index of each of the `channels`.
            time: stamps [s], (k,).
        """
        readings = samples[:, columns]
        if self.kind == "scale":
            samples[:, columns] = (1.0 + x) * readings
        elif self.kind == "zero":
            samples[:, columns] = readings + x
        elif self.kind == "delay":
            samples[:, columns[0]] = np.interp(time + x, time, readings[:, 0])
        elif self.kind == "swap":
            exchanged = readings[:, ::-1] * np.array([self.ratio, 1.0 / self.ratio])
            samples[:, columns] = (1.0 - x) * readings + x * exchanged


def causes_of(estimator: AdaptiveFilter, interval: float) -> list[Cause]:
    """Return what may be wrong with the rig of a filter, or with the readings of its channels.

    Args:
        estimator: the filter.
        interval: between samples [s].
    """
    return [*_of_sensors(estimator, interval), *_of_rig(estimator)]


def _of_sensors(estimator: AdaptiveFilter, interval: float) -> Iterator[Cause]:
    rig = estimator.rig
    read = [
        sensor
        for sensor in rig.sensors
        if sensor.name in estimator.channels and sensor.measures in ("position", "force", "tension")
    ]
    for sensor in read:
        factors = (SIGN, *UNITS.get(sensor.si, ()))
        channel = (sensor.name,)
        gain = getattr(sensor, "gain", None)
        gain_std = 0.0 if gain is None else gain.total_std / abs(gain.value)
        yield Cause(
            "scale",
            sensor.name,
            channel,
            std=gain_std,
            tried=tuple(factor - 1.0 for factor in factors),
            unit=sensor.si,
        )
        least = LEAST_ZERO.get(sensor.si, 0.0)
        zero = max(_zero_std(rig, sensor), least)
        yield Cause("zero", sensor.name, channel, std=zero, step=0.2 * least, unit=sensor.si)
        yield Cause("delay", sensor.name, channel, std=interval, step=0.5 * interval)
    for first, second in combinations(read, 2):
        if first.measures == second.measures or first.of == second.of:
            yield Cause(
                "swap",
                f"{first.name} and {second.name}",
                (first.name, second.name),
                ratio=_unit(first) / _unit(second),
                tried=(1.0,),
            )


def _unit(sensor: Sensor) -> float:
    """Return what a unit of a sensor's column in the log is in SI."""
    return sensor.sign * log_factor(sensor)


def _zero_std(rig: Rig, sensor: Sensor) -> float:
    """Return the std of the zero of a sensor: its own, and for a position that of the stretch by
    pre-tension [SI].
    """
    bias = getattr(sensor, "bias", None)
    bias_std = 0.0 if bias is None else bias.total_std
    if sensor.measures != "position":
        return bias_std
    drive = next(drive for drive in rig.drives if drive.name == sensor.of)
    lever = drive.radius.value if drive.kind == "capstan" else 1.0
    stretches = [
        tendon.pretension.total_std / (tendon.stiffness.value * lever)
        for tendon in rig.tendons
        if tendon.drive == sensor.of and tendon.stiffness.value > 0.0
    ]
    return float(np.hypot(bias_std, max(stretches, default=0.0)))


def _of_rig(estimator: AdaptiveFilter) -> Iterator[Cause]:
    rig = estimator.rig
    for drive in rig.drives:
        pulled = [(i, tendon) for i, tendon in enumerate(rig.tendons) if tendon.drive == drive.name]
        forces = [sensor.name for sensor in rig.sensors_of("force") if sensor.of == drive.name]
        stiffnesses = [f"tendons.{i}.stiffness" for i, _ in pulled]
        subject = forces[0] if forces else f"the force of {drive.name}"
        yield from _of(estimator, "stiffness", subject, stiffnesses)
        joints = dict.fromkeys(name for _, tendon in pulled for name in tendon.joints)
        # at a single joint, arm, spool and gear are the scale of the drive's position
        for joint in joints if len(joints) > 1 else ():
            radii = [
                f"tendons.{i}.{meeting.path}.radius"
                for i, tendon in pulled
                for meeting in tendon.meetings
                if joint in meeting.joints and hasattr(meeting.shape, "radius")
            ]
            yield from _of(estimator, "arm", f"{drive.name} at {joint}", radii)
    for kind in ("joints", "drives"):
        for i, part in enumerate(rig.components[kind]):
            at = f"{kind}.{i}"
            yield from _of(estimator, "friction", part.name, [f"{at}.{key}" for key in FRICTIONS])
            yield from _of(estimator, "damping", part.name, [f"{at}.damping"])
    for i, tendon in enumerate(rig.tendons):
        path = [f"tendons.{i}.path.friction"]
        yield from _of(estimator, "friction", f"the path of {tendon.name}", path)


def _of(
    estimator: AdaptiveFilter, kind: CauseKind, subject: str, paths: Sequence[str]
) -> Iterator[Cause]:
    """Yield the cause that parameters err by one factor, if the filter has any that is not zero."""
    names = estimator.parameter_names
    present = [path for path in paths if path in names and estimator.parameters[names.index(path)]]
    if present:
        quantities = [number(estimator.rig, path) for path in present]
        std = max(quantity.std / abs(quantity.value) for quantity in quantities)
        yield Cause(kind, subject, paths=tuple(present), std=std)


def starts_of(estimator: AdaptiveFilter, path: str) -> list[str]:
    """Return the names of the kernel's parameters that hold the start of a state for a parameter of
    the rig.
    """
    part = named(estimator.rig, path)
    names = estimator.parameter_names
    states = (f"filter.state.{k}.mean" for k, of in enumerate(estimator.state_parts) if of == part)
    return [name for name in states if name in names]
