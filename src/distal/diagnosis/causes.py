"""What may be wrong with a rig or a log, each as one number x that is zero where all is as the rig
says (scales, zeros, delays and columns of sensors, moment arms, stiffnesses, frictions,
damping); the size of each by known motion; and findings, one statement of the diagnosis each.

With the joints at known angles a drive is at  s = g(θ) + (U − U₀)/K + friction, with the position
g that the joints ask of it, its pull U, the pull U₀ of pre-tension, and the stiffness K of its
tendons. What remains of a reading, ρ = s − g − (U − U₀)/K, is linear in most causes however large
they are: its derivatives come from CasADi, and least squares give the size.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from math import hypot, log, log1p, radians
from typing import Literal, get_args

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.estimators import AdaptiveFilter
from distal.logs import Log
from distal.regression import played
from distal.rig import Rig, Sensor, Tendon, log_factor, named, number
from distal.units import rounded

Silent = Literal["hardly compared", "not tested", "cannot test", "would explain"]
"""Kinds of findings that speak neither against the rig nor for it: what the log does not test, and
what would explain an error that the band allows.
"""

Kind = Literal[
    "against the truth",
    "disagrees",
    "too large",
    "drifts",
    "friction",
    "left its prior",
    "cannot be there",
    "stuck",
    "looks like",
    "out of range",
    "not free",
    Silent,
]
"""Kinds of findings."""

SCALE = "gear, spool, moment arm, unit or sign"
"""Group of causes that scale the position of a drive alike; nothing proximal tells them apart."""

COMPLIANCE = "stiffness or the force's scale"
"""Group of causes that scale the stretch of tendons alike; nothing proximal tells them apart."""

ZERO = "zero or pre-tension"
"""Group of causes that shift the position of a drive alike; nothing proximal tells them apart."""


ALIKE = 0.15
"""Difference of the logarithms of a factor and that of a unit, below which the factor is that unit
[1]. Source: judgement.
"""


@dataclass(frozen=True)
class Finding:
    """One statement of the diagnosis: what a log contradicts, or leaves untested.

    Args:
        kind: of the finding.
        subject: sensor, state, drive or parameter that it is about.
        text: the statement in words.
    """

    kind: Kind
    subject: str
    text: str

    @property
    def contradicts(self) -> bool:
        """Whether the finding speaks against the rig, the sensors or the band."""
        return self.kind not in get_args(Silent)


def named_cause(kind: Kind, rig: Rig, cause: Cause, x: float) -> Finding:
    """Return the finding that a cause explains a disagreement, by the change `x` that takes it
    off.
    """
    verb = "look" if len(cause.channels) > 1 else "looks"
    subject = cause.subject
    if cause.kind in ("friction", "damping"):
        subject = f"{cause.kind} of {subject}"
    return Finding(kind, subject, f"{subject} {verb} {_like(rig, cause, x)}")


def sensor_of(rig: Rig, cause: Cause) -> Sensor:
    """Return the first sensor whose readings a cause changes."""
    return rig.sensors[rig.sensor_names.index(cause.channels[0])]


def tendon_of(rig: Rig, cause: Cause) -> Tendon:
    """Return the first tendon whose parameters a cause changes."""
    return rig.tendons[int(cause.paths[0].split(".")[1])]


def _like(rig: Rig, cause: Cause, x: float) -> str:
    factor = 1.0 + x
    if cause.kind == "swap":
        return "swapped"
    if cause.kind == "delay":
        return f"{abs(x):.2g} s {'late' if x > 0 else 'early'}"
    if cause.kind == "zero":
        size = {"rad": f"{rounded(np.rad2deg(-x))}°", "m": f"{-1e3 * x:.2g} mm"}
        return f"{size.get(cause.unit, f'{-x:.2g} {cause.unit}')} off: its zero, or the pre-tension"
    if cause.kind == "arm":
        return f"as if its moment arm were {factor:.3g} times the rig's"
    if cause.kind == "stiffness":
        return _like_a_stretch(tendon_of(rig, cause).drive, 1.0 / factor)
    if cause.kind in ("friction", "damping"):
        return f"about {factor:.2g} times the rig's"
    return _like_a_scale(rig, cause, 1.0 / factor)


def _like_a_scale(rig: Rig, cause: Cause, factor: float) -> str:
    """Return what readings look like that are `factor` times as large as the rig asks for."""
    for unit, look in UNITS.get(cause.unit, {}).items():
        if factor > 0.0 and abs(log(factor / unit)) < ALIKE:
            return look
    size = abs(factor)
    sensor = sensor_of(rig, cause)
    if factor < 0.0:
        by = "" if abs(log(size)) < ALIKE else f", and {size:.2g} times too large"
        side = ", or the side of its tendon," if sensor.measures == "position" else ""
        return f"as if its sign{side} were wrong{by}"
    if sensor.measures != "position":
        return _like_a_stretch(sensor.of, 1.0 / size)
    gear = float(getattr(sensor, "gear", 1.0))
    if gear != 1.0:
        return f"like a gear of about {gear * size:.3g}, where the rig file has {gear:g}"
    return f"{size:.3g} times too large: gear, spool, unit or moment arm"


def _like_a_stretch(part: str, factor: float) -> str:
    """Return what a force looks like that stretches tendons `factor` times as far as the rig
    says.
    """
    times = f"as if it stretched the tendons of {part} {factor:.2g} times as far"
    return f"{times}: their stiffness, its scale, or friction in it"


CauseKind = Literal["scale", "zero", "delay", "swap", "arm", "stiffness", "friction", "damping"]

UNITS: dict[str, dict[float, str]] = {
    "rad": {
        180 / np.pi: "like degrees",
        np.pi / 180: "57.3 times too small (radians that are read as degrees?)",
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

LEAST_ZERO = {"m": 1e-4, "rad": radians(1.0), "N": 0.1, "N m": 1e-3}
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
        channels: whose readings it changes: one, several of one unit, or those that are exchanged,
            the first with the last and so on.
        paths: parameters of the rig that it changes.
        std: how well the rig itself knows it, in the unit of x.
        step: of x over which derivatives are taken.
        ratios: what each exchanged channel has for a unit of the other one.
        tried: values of x that are tried whatever the derivative: signs, units.
        unit: SI unit of the channel.
    """

    kind: CauseKind
    subject: str
    channels: tuple[str, ...] = ()
    paths: tuple[str, ...] = ()
    std: float = 0.0
    step: float = STEP
    ratios: tuple[float, ...] = ()
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
            size = log(max(abs(1.0 + x), 1e-6)) / log1p(least)
            return hypot(size, UNLIKELY if x < -1.0 else 0.0)
        return abs(x) / self.std

    def jacobian(self, x: float) -> float:
        """Return ln |dy'/dy| of readings y' that x makes of y: a density of scaled readings has
        another unit.
        """
        return log(max(abs(1.0 + x), 1e-300)) if self.kind == "scale" else 0.0

    def apply(self, x: float, samples: Floats, names: Sequence[str], time: Floats) -> None:
        """Change readings in place.

        Args:
            x: size of the change.
            samples: readings, (k, n).
            names: of their channels, (n,).
            time: stamps [s], (k,).
        """
        columns = [names.index(name) for name in self.channels]
        readings = samples[:, columns]
        if self.kind == "scale":
            readings *= 1.0 + x
        elif self.kind == "zero":
            readings += x
        elif self.kind == "delay":
            readings[:, 0] = np.interp(time + x, time, readings[:, 0])
        elif self.kind == "swap":
            exchanged = readings[:, ::-1] * np.array(self.ratios or 1.0)
            readings = (1.0 - x) * readings + x * exchanged
        samples[:, columns] = readings


def causes_of(estimator: AdaptiveFilter, interval: float) -> list[Cause]:
    """Return what may be wrong with the rig of a filter, or with the readings of its channels.

    Args:
        estimator: the filter.
        interval: between samples [s].
    """
    return [*of_sensors(estimator.rig, estimator.channels, interval), *_of_rig(estimator)]


def of_sensors(rig: Rig, channels: Sequence[str], interval: float) -> Iterator[Cause]:
    """Yield what may be wrong with the readings of some channels.

    Args:
        rig: of the sensors.
        channels: their names.
        interval: between samples [s].
    """
    read = [
        sensor
        for sensor in rig.sensors
        if sensor.name in channels and sensor.measures in ("position", "force", "tension")
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
            yield swap(f"{first.name} and {second.name}", [first], [second])


def swap(subject: str, these: Sequence[Sensor], others: Sequence[Sensor]) -> Cause:
    """Return the cause that the columns of some sensors and of others are exchanged."""
    sensors = [*these, *others[::-1]]
    return Cause(
        "swap",
        subject,
        tuple(sensor.name for sensor in sensors),
        ratios=tuple(_unit(a) / _unit(b) for a, b in zip(sensors, sensors[::-1])),
        tried=(1.0,),
    )


def _unit(sensor: Sensor) -> float:
    """Return what a unit of a sensor's column in the log is in SI."""
    return sensor.sign * log_factor(sensor)


def _zero_std(rig: Rig, sensor: Sensor) -> float:
    """Return the std of the zero of a sensor: its own, and for a position that of the stretch by
    pre-tension [SI].
    """
    if sensor.measures != "position":
        return sensor.bias.total_std
    drive = rig.drive(sensor.of)
    lever = drive.radius.value if drive.kind == "capstan" else 1.0
    stretches = [
        tendon.pretension.total_std / (tendon.stiffness.value * lever)
        for tendon in rig.tendons_of(sensor.of)
        if tendon.stiffness.value > 0.0
    ]
    return hypot(sensor.bias.total_std, max(stretches, default=0.0))


def _of_rig(estimator: AdaptiveFilter) -> Iterator[Cause]:
    rig = estimator.rig
    for drive in rig.drives:
        pulled = [(i, tendon) for i, tendon in enumerate(rig.tendons) if tendon.drive == drive.name]
        forces = (sensor.name for sensor in rig.sensors_of("force") if sensor.of == drive.name)
        stiffnesses = [f"tendons.{i}.stiffness" for i, _ in pulled]
        subject = next(forces, f"the force of {drive.name}")
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


TURNS_BACK = 0.02
"""Way back after which a drive has turned back, as a share of its range [1]. Source: judgement."""


@dataclass(frozen=True)
class _Drive:
    """What remains of a drive's position, (k,) each.

    Args:
        residual: ρ, NaN where it is not known.
        reading: of the position.
        softened: pull over stiffness, U/K.
        columns: path, or kind of cause and channels → derivative of −s by the logarithm of a
            parameter, or of ρ by a cause.
    """

    residual: Floats
    reading: Floats
    softened: Floats
    columns: dict[object, Floats]

    def column(self, cause: Cause) -> Floats | None:
        """Return the derivative of ρ by a cause, (k,); None where it has none."""
        keys = cause.paths or [(cause.kind, cause.channels)]
        columns = [self.columns[key] for key in keys if key in self.columns]
        column = np.sum(columns, axis=0)
        return column if np.nansum(np.abs(column)) > 0.0 else None


def sizes(
    estimator: AdaptiveFilter, log: Log, truths: Floats | None, causes: Sequence[Cause]
) -> dict[Cause, list[float]]:
    """Return the sizes of each cause that explain the positions of a drive best, as the only one
    beside friction: with a shift of the position beside it, and without; causes that do not act on
    a position are left out.

    Args:
        estimator: filter of the rig.
        log: with positions and forces.
        truths: known angles of the joints, (k, n_joints) [rad], without which no cause has a
            size.
        causes: to be sized.
    """
    sized = dict[Cause, list[float]]()
    for drive in () if truths is None else _drives(estimator, log, truths):
        for cause in causes:
            column = drive.column(cause)
            if column is not None and np.isfinite(column + drive.residual).any():
                sized[cause] = _fitted(cause, column, drive)
    return sized


def _drives(estimator: AdaptiveFilter, log: Log, truths: Floats) -> Iterator[_Drive]:
    rig = estimator.rig
    mechanism = estimator.states.context.mechanism
    parameters = mechanism.parameters
    symbols = parameters.symbols
    values = estimator.parameters[: symbols.numel()]
    q = ca.SX.sym("q", mechanism.n_bodies)
    pull = ca.SX.sym("pull")
    for sensor in rig.sensors_of("position"):
        if sensor.name not in log.channels:
            continue
        drive = rig.drive_names.index(sensor.of)
        levers = mechanism.length_jacobian(q)[:, mechanism.n_joints + drive]
        stiffness = ca.SX(0)
        standing = ca.SX(0)
        angles = np.zeros((q.numel(), len(log)))
        for i, tendon in enumerate(rig.tendons):
            if tendon.drive == sensor.of:
                stiffness += levers[i] ** 2 * parameters[f"tendons.{i}.stiffness"]
                standing += levers[i] * parameters[f"tendons.{i}.pretension"]
                for joint in map(rig.joint_names.index, tendon.joints):
                    angles[joint] = truths[:, joint]
        stretch = mechanism.stretch(drive, q)
        home = ca.substitute(stretch, q, ca.SX.zeros(q.numel()))
        softened = pull / stiffness
        expected = home - stretch + softened - standing / stiffness
        slopes = ca.jacobian(expected, symbols) * symbols.T
        function = ca.Function("position", [q, pull, symbols], [expected, softened, slopes])
        forces = (s.name for s in rig.sensors_of("force") if s.of == sensor.of)
        force = next((name for name in forces if name in log.channels), "")
        pulls = log.channels.get(force, np.zeros(len(log)))
        expect, soft, by = map(np.array, function(angles, pulls[None, :], values))
        reading = log.channels[sensor.name]
        soft = soft.ravel()
        columns: dict[object, Floats] = dict(zip(parameters.names, -by.reshape(len(log), -1).T))
        at = (sensor.name,)
        columns["scale", at] = reading
        columns["zero", at] = np.ones(len(log))
        columns["delay", at] = np.gradient(np.nan_to_num(reading), log.time)
        columns["scale", (force,)] = -soft
        yield _Drive(reading - expect.ravel(), reading, soft, columns)


def _fitted(cause: Cause, column: Floats, drive: _Drive) -> list[float]:
    usable = np.isfinite(drive.residual) & np.isfinite(column)
    residual = drive.residual[usable]
    # the direction in which the drive last moved, −1 to 1, by a play operator
    readings = drive.reading[usable]
    half = max(TURNS_BACK * np.ptp(readings), 1e-300)
    way = (readings - played(readings, half)) / half
    matrix = np.column_stack([column[usable], way, way * np.abs(drive.softened[usable])])
    shifted = np.column_stack([matrix, np.ones(len(way))])
    sizes_of = list[float]()
    for columns in [matrix] if cause.kind == "zero" else [shifted, matrix]:
        scales = np.linalg.norm(columns, axis=0)
        scales[scales == 0.0] = 1.0
        fitted = np.linalg.lstsq(columns / scales, residual, rcond=1e-9)[0] / scales
        x = -float(fitted[0])
        if cause.kind == "stiffness":
            x = x / (1.0 - x) if x < 1.0 else -1.0  # ρ is linear in 1/K: 1/(1 + x) = 1 − x'
        if x > -1.0 or not cause.paths:
            sizes_of.append(x)
    return sizes_of
