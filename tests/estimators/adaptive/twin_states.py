"""The state vector of the naive twin: docs/explanation/adaptive-state.md, one plain list."""

from __future__ import annotations

from dataclasses import dataclass
from math import erf, exp, inf, log, pi, sqrt
from typing import Any

import numpy as np

from distal.estimators import Robustness
from distal.model import Mechanism
from distal.rig import Rig
from distal.sensor_models import variance

MAY_BE_NEGATIVE = ("rest_angle", "hanging_angle", "slope", "curvature", "centre")
LINEARITY_SHARE = 0.6  # std of a linearity curve, as a share of its largest magnitude


@dataclass
class State:
    """One number of x: what it is called, its prior, and how it changes."""

    name: str
    kind: str
    mean: float
    std: float
    of: int = 0  # index of its joint, drive, parameter or sensor (position or compared)
    order: int = 0  # j of a bend of a linearity
    walk: float = 0.0  # per √s
    fade_rate: float = 0.0  # 1/T_i
    lowest: float = -inf
    considered: bool = False
    unidentified: bool = False  # only a joint's own angle teaches it
    members: tuple[int, ...] = ()  # the parameters that a factor multiplies


def cut_at_zero(mean: float, std: float) -> tuple[float, float]:
    """Mean and std of a normal distribution that is cut at zero, (†)."""
    if mean > 4 * std:
        return mean, std
    alpha = -mean / std
    density = exp(-alpha * alpha / 2) / sqrt(2 * pi)
    hazard = density / (1 - (1 + erf(alpha / sqrt(2))) / 2)
    return mean + std * hazard, std * sqrt(1 + alpha * hazard - hazard**2)


def travel_of(rig: Rig, drive: int) -> tuple[float, float]:
    """Between the drive's stops; else ±1.2 rad of the joint about where the nominal force pulls a
    slider to.
    """
    part = rig.drives[drive]
    if part.stops is not None:
        return part.stops
    tendon = next(t for t in rig.tendons if t.drive == part.name)
    radius = part.radius.value if part.kind == "capstan" else 1.0
    middle = part.nominal_force.value / tendon.stiffness.value if part.kind == "slider" else 0.0
    half = 1.2 * tendon.insertion.radius.value / radius
    return middle - half, middle + half


def declares_friction(rig: Rig, drive: int, least: float) -> bool:
    """Whether friction at the drive's usual load comes to `least` newtons or more."""
    part = rig.drives[drive]
    own = [t for t in rig.tendons if t.drive == part.name]
    radius = part.radius.value if part.kind == "capstan" else 1.0
    load = max(abs(part.nominal_force.value) / radius, sum(t.pretension.value for t in own), 1.0)
    constant, share = part.friction.constant, part.friction.load
    total = (constant.value + constant.filter_std) / radius + (
        share.value + share.filter_std
    ) * load
    for tendon in own:
        if tendon.path is not None:
            mu, beta = tendon.path.friction, tendon.path.wrap.value
            total += load * (exp((mu.value + mu.filter_std) * beta) - 1)
    return total >= least


def sensor_at(sensors: tuple[Any, ...], part: Any) -> Any:
    """The sensor of a drive, or None."""
    return next((s for s in sensors if s.of == part.name), None)


def states_of(
    rig: Rig, mechanism: Mechanism, guards: Robustness, references: tuple[Any, ...]
) -> list[State]:
    """The whole list, in the order of the table."""
    names = [j.name for j in rig.joints]
    one = len(names) == 1
    positions, forces = rig.sensors_of("position"), rig.sensors_of("force")
    states = [
        State("theta" if one else f"theta_{j.name}", "angle", j.initial.value, j.initial.std, i)
        for i, j in enumerate(rig.joints)
    ]
    states += [
        State("theta_dot" if one else f"theta_{j.name}_dot", "speed", 0.0, 0.3, i)
        for i, j in enumerate(rig.joints)
    ]
    for i, joint in enumerate(rig.joints):
        torque = joint.external_torque
        if torque.std > 0:
            name, rate = f"external_torque_{joint.name}", 1 / torque.correlation_time
            name = "external_torque" if one else name
            states.append(State(name, "torque", 0.0, torque.std, i, fade_rate=rate))
    states += parameters_of(rig, mechanism, guards)
    for i, sensor in enumerate(positions):
        states += linearity_of(sensor, i)
    for i, drive in enumerate(rig.drives):
        if sensor_at(positions, drive) is None:
            low, high = travel_of(rig, i)
            middle, travel = (low + high) / 2, high - low
            name = f"position_{drive.name}"
            states.append(State(name, "position", middle, travel / sqrt(12), i, walk=travel))
    for i, drive in enumerate(rig.drives):
        sensor = sensor_at(forces, drive)
        if sensor is None or guards.unknown_friction == 0 or drive.hysteresis is not None:
            continue
        if not declares_friction(rig, i, guards.declared_friction):
            sigma = sqrt(variance(sensor))
            name, walk = f"friction_{drive.name}", guards.unknown_friction_walk * sigma
            states.append(
                State(name, "friction", 0.0, guards.unknown_friction * sigma, i, walk=walk)
            )
    plays = [
        (i, drive.name, drive.hysteresis)
        for i, drive in enumerate(rig.drives)
        if drive.hysteresis is not None and sensor_at(forces, drive) is not None
    ]
    # their prior is the first reading ± √(H₀²/3 + σ²): filled in by the twin, which has H₀
    states += [State(f"transmitted_{name}", "transmitted", 0.0, 0.0, i) for i, name, _ in plays]
    for i, name, play in plays:
        if play.error > 0:
            state = State(f"transmission_error_{name}", "error", 0.0, play.error, i)
            state.fade_rate, state.considered = 1 / play.error_time, True
            states.append(state)
    for i, sensor in enumerate((*forces, *rig.sensors_of("tension"), *references)):
        spread = sqrt(sensor.bias.filter_std**2 + (LINEARITY_SHARE * sensor.linearity) ** 2)
        if spread > 0:
            state = State(f"bias_{sensor.name}", "bias", 0.0, spread, i)
            drift = sensor.bias.drift or 0.0
            if sensor.measures == "angle":
                state.fade_rate = drift**2 / (2 * spread**2)
            else:
                state.walk = drift
            states.append(state)
    return states


def parameters_of(rig: Rig, mechanism: Mechanism, guards: Robustness) -> list[State]:
    """Parameters with a std that can be seen, and the factors of tendons that err together, as they
    come.
    """
    p, states, factors, deviations = mechanism.parameters, [], [], []
    sharing = rig.sharing()

    def walk(std: float, drift: float) -> float:
        return guards.parameter_walk * std if np.isnan(drift) else drift

    def factor(name: str, mean: float, std: float, drift: float, *members: int) -> State:
        state = State(f"{name}.factor", "factor", mean, std, lowest=0.05, members=members)
        state.walk = walk(std, drift)
        factors.append(state)
        return state

    of_factors = {path for together in sharing.values() for path in together}
    for i, (name, value, std, drift) in enumerate(zip(p.names, p.values, p.stds, p.drifts)):
        if name in of_factors:
            alone = p.independent_stds[i]
            if alone > 0:
                state = State(f"{name}.deviation", "deviation", 0.0, alone, i, lowest=-0.95 * value)
                state.walk = walk(alone, drift)
                deviations.append(state)
            continue
        if std <= 0 or not is_seen(rig, name, std):
            continue
        kind, _, what = name.split(".", 2)
        arm = (
            ".insertion." in name
            or ".crossings." in name
            or (kind == "drives" and what == "radius")
        )
        rough = (
            not name.endswith(MAY_BE_NEGATIVE) and value > 0 and std / value > (0.2 if arm else 0.5)
        )
        unidentified = rough and len(rig.drives) <= len(rig.joints)
        if rough and what.endswith(
            ("stiffness", "radius", "mass", "inertia", "length")
        ):  # what cannot be zero
            state = factor(name, 1.0, log(1 + std / value), drift / value, i)
            state.walk = walk(std, drift) / value
            state.unidentified = True
            continue
        if kind == "tendons" and what in ("stiffness", "damping"):
            state = factor(name, *cut_at_zero(1.0, std / value), drift / value, i)
            state.unidentified = rough
            continue
        state = State(name, "parameter", value, std, i, unidentified=unidentified)
        if not name.endswith(MAY_BE_NEGATIVE):
            state.mean, state.std = cut_at_zero(value, std)
            if rough and std <= value:
                state.mean = value  # (†)
            state.lowest = 0.01 * state.std
        state.walk = walk(state.std, drift)
        states.append(state)
    for title, together in sharing.items():
        members = [p.names.index(path) for path in together]
        alone = [k for k in members if p.independent_stds[k] == 0 and not np.isnan(p.drifts[k])]
        drift = max((p.drifts[k] / p.values[k] for k in alone), default=np.nan)
        factor(title, *cut_at_zero(1.0, next(iter(together.values()))), drift, *members)
    return states + factors + deviations


def is_seen(rig: Rig, name: str, std: float) -> bool:
    """Whether a parameter can be seen by the filter: of a drive, only its damping, its radius and
    larger friction.
    """
    if not name.startswith("drives."):
        return True
    _, index, what = name.split(".", 2)
    if what in ("damping", "radius"):
        return True
    drive = rig.drives[int(index)]
    sensor = sensor_at(rig.sensors_of("force"), drive)
    noise = sqrt(variance(sensor)) if sensor is not None else drive.nominal_force.filter_std
    if what not in ("friction.constant", "friction.load"):
        return False
    load = max(abs(drive.nominal_force.value), 1.0) if what == "friction.load" else 1.0
    return std * load >= 0.03 * noise


def linearity_of(sensor: Any, index: int) -> list[State]:
    """Bends of a position sensor's error over the travel, (‡)."""
    if sensor.linearity == 0 and sensor.bias.filter_std == 0:
        return []
    weights = [exp(-((j / 3) ** 2) / 2) for j in range(6)]
    # c_L² (1 + ½ Σ e^{−(j/3)²}) = (0.6 L)²
    c = LINEARITY_SHARE * sensor.linearity / sqrt(1 + 0.5 * sum(w * w for w in weights[1:]))
    states = []
    for j in range(6):
        std = sqrt((c * weights[j]) ** 2 + (sensor.bias.filter_std**2 if j == 0 else 0.0))
        if std > 0:
            states.append(
                State(f"linearity_{sensor.name}_{j}", "linearity", 0.0, std, index, order=j)
            )
    return states
