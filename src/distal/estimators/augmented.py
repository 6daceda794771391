"""The augmented state: joint motion, external torque, uncertain parameters, sensor linearity, unknown drive friction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from distal.estimators.channels import Channels, sensor_for
from distal.model import Mechanism
from distal.rig import Sensor
from distal.sensors import systematic_variance, variance

Floats = NDArray[np.float64]

BASIS = 6
"""Basis functions of a sensor's linearity over its travel."""

SMOOTHNESS = 3.0
"""Order at which the prior of the basis falls off: half waves over the travel."""

LINEARITY_PRIOR = 0.6
"""Standard deviation of a linearity curve in the prior, as a share of its largest magnitude."""

UNKNOWN_FRICTION = 0.7
"""Prior of friction at a drive that the rig does not know of, in standard deviations of its force sensor."""

FRICTION_DRIFT = 0.6
"""Its random walk, in standard deviations of the force sensor per √s."""

DRIFT = 0.02
"""Random walk of an uncertain parameter whose `drift` is not given, in its standard deviations per √s."""

DIRTY = 0.1
"""A drive whose declared friction is below this at its nominal load [N, or N at the capstan's radius] is taken as clean."""


@dataclass(frozen=True)
class ParameterState:
    """A state that stands for one parameter (its value) or for several alike (a common factor).

    Tendons whose stiffness (or damping) has the same relative std are from one spool: they err together.

    Args:
        name: of the state.
        indices: of the parameters in the model's vector.
        factor: whether the state multiplies the parameters' values.
        mean: prior mean.
        std: prior standard deviation.
        drift: random walk per √s.
        lowest: the state is kept at or above this.
    """

    name: str
    indices: tuple[int, ...]
    factor: bool
    mean: float
    std: float
    drift: float
    lowest: float


def parameter_states(mechanism: Mechanism, channels: Channels) -> tuple[ParameterState, ...]:
    """Return the uncertain parameters as states, those without effect on a displacement-driven joint left out.

    A parameter that cannot be negative has its prior cut at zero: mean and variance are those of the cut normal.

    Args:
        mechanism: the rig's equations.
        channels: the sensors that are read.
    """
    p, states = mechanism.parameters, []
    shared: dict[tuple[str, float, float], list[int]] = {}
    for i, name in enumerate(p.names):
        value, std, drift = float(p.values[i]), float(p.stds[i]), float(p.drifts[i])
        if std == 0.0 or _without_effect(mechanism, channels, name, std):
            continue
        kind = name.split(".", 2)[2]
        if name.startswith("tendons.") and kind in ("stiffness", "damping") and value > 0.0:
            walk = DRIFT * std if np.isnan(drift) else drift
            shared.setdefault((kind, round(std / value, 9), round(walk / value, 9)), []).append(i)
            continue
        mean, spread, lowest = value, std, -np.inf
        if not name.endswith("angle"):
            mean, spread = cut_normal(value, std)
            lowest = 0.01 * spread
        walk = DRIFT * spread if np.isnan(drift) else drift
        states.append(ParameterState(name, (i,), False, mean, spread, walk, lowest))
    for (kind, relative, walk), indices in shared.items():
        mean, spread = cut_normal(1.0, relative)
        name = p.names[indices[0]] if len(indices) == 1 else f"tendons.{kind}"
        states.append(ParameterState(f"{name}.factor", tuple(indices), True, mean, spread, walk, 0.05))
    return tuple(states)


def _without_effect(mechanism: Mechanism, channels: Channels, name: str, std: float) -> bool:
    """Return whether a parameter's std cannot be seen: a drive's inertia and stops, friction below a tenth of the noise."""
    if not name.startswith("drives."):
        return False
    drive = mechanism.rig.drives[int(name.split(".")[1])]
    if name.endswith(("friction.load", "friction.constant")):
        sensor = sensor_for(channels.forces, drive.name)
        noise = np.sqrt(variance(sensor)) if sensor is not None else drive.nominal_force.std
        force = std * max(abs(drive.nominal_force.value), 1.0) if name.endswith("load") else std
        return bool(force < 0.1 * noise)
    return not name.endswith((".damping", ".radius"))


def cut_normal(mean: float, std: float) -> tuple[float, float]:
    """Return mean and standard deviation of a normal distribution cut at zero.

    Args:
        mean: of the whole normal distribution.
        std: of it.
    """
    from math import erf, exp, pi, sqrt

    lower = -mean / std
    if lower < -4.0:
        return mean, std
    density, above = exp(-lower * lower / 2) / sqrt(2 * pi), 0.5 * (1 - erf(lower / sqrt(2)))
    ratio = density / above
    return mean + std * ratio, std * sqrt(max(1 + lower * ratio - ratio * ratio, 1e-6))


def travel(mechanism: Mechanism, drive: int) -> tuple[float, float]:
    """Return the ends of a drive's travel, where its sensor's linearity is defined: its stops, or what it can use.

    Without stops: ±1.2 rad of the joint about the place that the nominal force stretches the tendon to.

    Args:
        mechanism: the rig's equations.
        drive: its index.
    """
    part = mechanism.rig.drives[drive]
    if part.stops is not None:
        return part.stops
    tendon = next(t for t in mechanism.rig.tendons if t.drive == part.name)
    lever = part.radius.value if part.kind == "capstan" else 1.0
    reach = 1.2 * tendon.insertion.radius.value / lever
    centre = 0.0 if part.kind == "capstan" else part.nominal_force.value / tendon.stiffness.value
    return centre - reach, centre + reach


def basis_stds(sensor: Sensor) -> Floats:
    """Return the prior standard deviations of the basis weights of a sensor's systematic error, (n,).

    A Gaussian process over the travel with a squared-exponential spectrum: weights of cos(π j ξ), j = 0.., fall off as
    exp(−(j/j₀)²/2), scaled so that the mean variance over the travel is that of the linearity. A bias with a std adds
    to the constant.

    Args:
        sensor: a position sensor.
    """
    if sensor.linearity == 0.0:
        return np.array([sensor.bias.std]) if sensor.bias.std > 0.0 else np.zeros(0)
    shape = np.exp(-0.5 * (np.arange(BASIS) / SMOOTHNESS) ** 2)
    shape /= np.sqrt(shape[0] ** 2 + 0.5 * np.sum(shape[1:] ** 2))
    stds = LINEARITY_PRIOR * sensor.linearity * shape
    stds[0] = np.hypot(stds[0], sensor.bias.std)
    return stds


class AugmentedState:
    """The layout of the displacement-driven filter's state, its prior, and what a state does to the model.

    θ, ω, then, where the rig has them: external torque, uncertain parameters, basis weights of each position sensor,
    places of drives without a position sensor, unknown friction of clean drives.

    Args:
        mechanism: the rig's equations.
        channels: the sensors that are read.
        suspicious: whether friction that the rig does not know of is looked for at clean drives.
    """

    def __init__(self, mechanism: Mechanism, channels: Channels, suspicious: bool = True) -> None:
        self.mechanism, self.channels, self.suspicious = mechanism, channels, suspicious
        rig = mechanism.rig
        self.torque = rig.joints[0].external_torque if rig.joints[0].external_torque.std > 0.0 else None
        self.parameters = parameter_states(mechanism, channels)
        names, means, stds, self.drifts = ["theta", "theta_dot"], [rig.joints[0].initial.value, 0.0], [], {}
        stds += [rig.joints[0].initial.std, START_SPEED]
        self.torque_at = len(names)
        if self.torque is not None:
            names, means, stds = [*names, "external_torque"], [*means, 0.0], [*stds, self.torque.std]
        self.parameters_at = len(names)
        for state in self.parameters:
            self.drifts[len(names)] = state.drift
            names, means, stds = [*names, state.name], [*means, state.mean], [*stds, state.std]
        self.weights_at: dict[int, tuple[int, Floats]] = {}
        self.places_at: dict[int, int] = {}
        self.friction_at: dict[int, int] = {}
        for i, drive in enumerate(rig.drives):
            sensor = sensor_for(channels.positions, drive.name)
            if sensor is None:
                low, high = travel(mechanism, i)
                self.places_at[i] = len(names)
                self.drifts[len(names)] = (high - low) * PLACE_DRIFT
                names, means = [*names, f"position_{drive.name}"], [*means, (low + high) / 2]
                stds = [*stds, (high - low) / np.sqrt(12.0)]
                continue
            spread = basis_stds(sensor)
            self.weights_at[i] = (len(names), spread)
            names += [f"linearity_{sensor.name}_{j}" for j in range(len(spread))]
            known = np.zeros(len(spread))
            curve = getattr(sensor, "curve", ())[: len(spread)]
            known[: len(curve)] = curve
            means, stds = [*means, *known], [*stds, *spread]
        for i, drive in enumerate(rig.drives):
            sensor = sensor_for(channels.forces, drive.name)
            if sensor is not None and suspicious and drive.hysteresis is None and self.is_clean(i):
                self.friction_at[i] = len(names)
                self.drifts[len(names)] = FRICTION_DRIFT * float(np.sqrt(variance(sensor)))
                names, means = [*names, f"friction_{drive.name}"], [*means, 0.0]
                stds = [*stds, UNKNOWN_FRICTION * float(np.sqrt(variance(sensor)))]
        self.transmitted_at: dict[int, int] = {}
        self.considered: dict[int, int] = {}
        for i, drive in enumerate(rig.drives):
            sensor = sensor_for(channels.forces, drive.name)
            if sensor is not None and drive.hysteresis is not None:
                self.transmitted_at[i] = len(names)
                # the friction is anywhere within its limits: see `AdaptiveFilter`, which puts the first reading here
                names, means = [*names, f"transmitted_{drive.name}"], [*means, drive.nominal_force.value]
                stds = [*stds, float(np.hypot(self.hysteresis(i) / np.sqrt(3.0), np.sqrt(variance(sensor))))]
                if drive.hysteresis.error > 0.0:
                    self.considered[i] = len(names)
                    names, means = [*names, f"transmission_error_{drive.name}"], [*means, 0.0]
                    stds = [*stds, drive.hysteresis.error]
        self.bias_at: dict[str, int] = {}
        self.wandering: dict[int, Sensor] = {}
        for sensor in channels.compared:
            width = float(np.hypot(sensor.bias.std, np.sqrt(systematic_variance(sensor))))
            if width > 0.0:
                if sensor.measures == "angle" and sensor.bias.drift:
                    self.wandering[len(names)] = sensor
                elif sensor.bias.drift is not None:
                    self.drifts[len(names)] = sensor.bias.drift
                self.bias_at[sensor.name] = len(names)
                names, means, stds = [*names, f"bias_{sensor.name}"], [*means, 0.0], [*stds, width]
        self.names = tuple(names)
        self.means, self.stds = np.array(means), np.array(stds)

    def hysteresis(self, drive: int) -> float:
        """Return the limit of a drive's hysteresis [N or N m] at pre-tension, with the joint where it starts.

        Args:
            drive: its index.
        """
        mechanism = self.mechanism
        tensions = ca.DM([tendon.pretension.value for tendon in mechanism.rig.tendons])
        q = ca.vertcat(mechanism.rig.joints[0].initial.value, ca.DM.zeros(mechanism.n_drives))
        limit = mechanism.hysteresis_limit(drive, q, tensions)
        p = mechanism.parameters
        return float(ca.Function("limit", [p.symbols], [limit])(p.values))

    def __len__(self) -> int:
        return len(self.names)

    def number(self, path: str, otherwise: float) -> Any:
        """Return a number of the description: an input of the filter where it is given, else a constant.

        Args:
            path: of the number.
            otherwise: its value.
        """
        p = self.mechanism.parameters
        return p[path] if path in p.given else otherwise

    def noise(self, sensor: Sensor) -> Any:
        """Return the variance of a sensor's random error, σ² + Δ²/12.

        Args:
            sensor: one of the rig's.
        """
        sigma = self.number(f"{self._path(sensor)}.noise", sensor.noise)
        return sigma * sigma + sensor.resolution**2 / 12.0

    def offset(self, sensor: Sensor) -> Any:
        """Return a sensor's constant offset as far as it is known.

        Args:
            sensor: one of the rig's.
        """
        return self.number(f"{self._path(sensor)}.bias", sensor.bias.value)

    def _path(self, sensor: Sensor) -> str:
        names = [each.name for each in self.mechanism.rig.sensors]
        return f"sensors.{names.index(sensor.name)}"

    def wander(self, sensor: Sensor) -> tuple[Any, Any]:
        """Return std and drift of a reference's bias that wanders: a walk of `drift` per √s that stays within its std.

        A first-order Gauss–Markov process: e^{−dt/τ} of it is left after dt, with τ = 2 σ²/drift². It is what the model's
        angle and the joint's differ by, so that a moment's reference tells less than a long one.

        Args:
            sensor: one whose bias has a drift.
        """
        path = f"{self._path(sensor)}.bias"
        std = self.number(f"{path}.std", float(np.hypot(sensor.bias.std, np.sqrt(systematic_variance(sensor)))))
        return std, self.number(f"{path}.drift", sensor.bias.drift or 0.0)

    def hysteresis_error(self, drive: int) -> tuple[Any, Any]:
        """Return std and correlation time of what the play of a drive leaves out.

        Args:
            drive: its index.
        """
        path, hysteresis = f"drives.{drive}.hysteresis", self.mechanism.rig.drives[drive].hysteresis
        assert hysteresis is not None  # else nothing is considered
        error = self.number(f"{path}.error", hysteresis.error)
        return error, self.number(f"{path}.error_time", hysteresis.error_time)

    @property
    def unmodelled(self) -> Any:
        """Random torque that the model does not know, as the standard deviation of ω that it makes in 1 s [rad/s]."""
        return self.number("joints.0.unmodelled", self.mechanism.rig.joints[0].unmodelled)

    @property
    def torque_std(self) -> Any:
        """Standard deviation of the external torque [N m]."""
        return self.number("joints.0.external_torque.std", self.mechanism.rig.joints[0].external_torque.std)

    def is_clean(self, drive: int) -> bool:
        """Return whether the rig declares so little friction at a drive that unknown friction must be looked for."""
        part = self.mechanism.rig.drives[drive]
        lever = part.radius.value if part.kind == "capstan" else 1.0
        tendons = [t for t in self.mechanism.rig.tendons if t.drive == part.name]
        load = max(abs(part.nominal_force.value) / lever, sum(t.pretension.value for t in tendons), 1.0)
        constant, growing = part.friction.constant, part.friction.load
        known = (constant.value + constant.std) / lever + (growing.value + growing.std) * load
        for tendon in tendons:
            if tendon.path is not None:
                rubs = tendon.path.friction
                known += load * float(np.expm1((rubs.value + rubs.std) * tendon.path.wrap.value))
        return bool(known < DIRTY)

    def bias(self, sensor: str, state: Any) -> Any:
        """Return the systematic error of a force or tension sensor, 0 where it has none.

        Args:
            sensor: its name.
            state: (n,).
        """
        return state[self.bias_at[sensor]] if sensor in self.bias_at else ca.SX(0)

    def model_parameters(self, state: Any) -> Any:
        """Return the model's parameter vector at a state, (n_p,).

        Args:
            state: (n,).
        """
        p = ca.SX(self.mechanism.parameters.symbols)
        for k, part in enumerate(self.parameters):
            for i in part.indices:
                value = state[self.parameters_at + k]
                p[i] = p[i] * value if part.factor else value
        return p

    def basis(self, drive: int, place: Any) -> Any:
        """Return the basis functions cos(π j ξ) of a drive's sensor at a place, (n,).

        By cos(π (j + 1) ξ) = 2 cos(π ξ) cos(π j ξ) − cos(π (j − 1) ξ): one cosine for all (Chebyshev).

        Args:
            drive: index of the drive.
            place: what the sensor reads.
        """
        low, high = travel(self.mechanism, drive)
        fraction = (place - low) / (high - low)
        count = len(self.weights_at[drive][1])
        terms = [ca.SX(1), ca.cos(ca.pi * fraction)]
        while len(terms) < count:
            terms.append(2 * terms[1] * terms[-1] - terms[-2])
        return ca.vertcat(*terms[:count]) if count else ca.SX(0, 1)

    def systematic_error(self, drive: int, place: Any, state: Any) -> Any:
        """Return a position sensor's systematic error Σ w_j cos(π j ξ) at a place.

        Args:
            drive: index of the drive.
            place: what the sensor reads.
            state: (n,).
        """
        start, spread = self.weights_at[drive]
        if len(spread) == 0:
            return ca.SX(0)
        return ca.dot(self.basis(drive, place), state[start : start + len(spread)])


START_SPEED = 0.3
"""Standard deviation of the joint's speed at the first sample [rad/s]."""

PLACE_DRIFT = 1.0
"""Random walk of a drive's place that nothing measures, in its travel per √s."""
