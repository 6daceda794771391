"""The kinds of states of the adaptive filter, and the state vector, which joins all states of a rig
and sums up what they add.

A state is one unknown value: its prior, how it changes, and what it adds to the model or to a
reading. The kinds are: motion of the joints and torques that no sensor measures; of a drive, its
position where no sensor measures it, friction that the rig does not declare, and the effort that
its transmission passes on; internal states, which no sensor sees (the far side of a backlash,
points of a cable in its sheath, creep); parameters of the model with a std whose effect sensors
can show; and systematic errors of sensors (offset, gain, the curve of a position sensor).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from math import erf, exp, pi, sqrt
from typing import Literal, TypeAlias

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.estimators.adaptive.filter_context import FilterContext
from distal.estimators.estimator_protocol import StateKind
from distal.expressions import Scalar, Vector, symbols
from distal.model import Mechanism
from distal.rig import (
    Rig,
    Sensor,
    angle_names,
    drive_travel,
    in_words,
    known_to_a_factor,
    named,
    number,
    speed_names,
    torque_names,
)
from distal.sensor_models import LINEARITY_STD, systematic_variance, variance

Acts = Literal["value", "factor", "deviation"]
"""How a state enters the model's parameters: it is the value of one, it multiplies the values of
all, or it is added to the value of one.
"""

Target: TypeAlias = tuple[str, int | str]
"""What a state adds to: ``("torque", joint)`` [N m]; of a drive its ``"position"`` where nothing
measures it, its ``"friction"`` limit, and the ``"lacking force"`` by which its pull is less than
expected, by index; ``("reading", sensor)``, by name.
"""


@dataclass(frozen=True)
class Begin:
    """The readings of a log's first sample.

    Args:
        positions: of the drives [m, rad], 0 where nothing is read.
        efforts: of the drives [N, N m], None without a sensor.
        tensions: of the tendons [N], None without a sensor.
    """

    positions: Sequence[Scalar]
    efforts: Sequence[Scalar | None]
    tensions: Sequence[Scalar | None]


def unchanged(reading: Scalar) -> Scalar:
    """Return 1: what a state adds does not depend on a reading."""
    return 1


@dataclass(frozen=True, eq=False)
class State:
    """One unknown value, in SI. What the filter does with it follows from its `kind`.

    Args:
        name: of the state; that of a parameter is in words.
        kind: of the state.
        part: the component that it belongs to: the name of a joint, drive, tendon or sensor, or the
            path of a parameter, with ".factor" or ".deviation" after it where the state is that.
        mean: prior mean.
        std: prior standard deviation.
        to: what it adds to, if anything.
        times: function of the reading, by whose result the state is multiplied before it is added.
        indices: of the model's parameters that it enters.
        acts: how it enters them.
        walk: standard deviation that it gains as a random walk, per √s.
        lowest: lower limit at which it is kept.
        unidentified: whether forces and displacements do not tell it; then only a reference angle
            teaches it.
        mean_by: the prior mean as an expression of inputs of the filter, which a fit may vary.
        std_by: the same for the standard deviation.
        fades_in: time constant with which it fades towards zero, as such an expression [s]: x⁺ = f
            x + noise of variance σ² (1 − f²), f = e^{−dt/T}, with the prior's std σ.
        first: mean and standard deviation at the first sample, where its readings give them.
        inputs: name → value of the inputs of the filter's kernel that follow from it, see
            `FilterContext.number`.
    """

    name: str
    kind: StateKind
    part: str
    mean: float
    std: float
    to: Target | None = None
    times: Callable[[Scalar], Scalar] = unchanged
    indices: tuple[int, ...] = ()
    acts: Acts = "value"
    walk: float = 0.0
    lowest: float = -np.inf
    unidentified: bool = False
    mean_by: Callable[[], Scalar] | None = None
    std_by: Callable[[], Scalar] | None = None
    fades_in: Callable[[], Scalar] | None = None
    first: Callable[[Begin], tuple[Scalar, Scalar]] | None = None
    inputs: Mapping[str, float] = field(default_factory=dict)

    @property
    def structure(self) -> tuple[object, ...]:
        """What the structure of a kernel depends on in this state: all but its values."""
        bounded = bool(np.isfinite(self.lowest))
        acts = self.indices, self.acts, self.unidentified
        return self.name, self.kind.name, self.walk > 0.0, bounded, *acts


UNKNOWN_TENSION = 10.0
"""Tension that is assumed at the start where neither sensor nor pre-tension nor nominal force gives
one [N]. Source: judgement.
"""


def inside(context: FilterContext) -> Iterator[State]:
    """Yield the model's internal states: parameters of its equations that move (see
    `prediction.follow`) from the first reading on. They are the far sides of backlashes and
    the points in sheaths [m, rad], then the slow parts of tendons' stretches [m], which creep over
    minutes.

    A prior standard deviation is that where nothing is read at the first sample.
    """
    mechanism = context.mechanism
    p = mechanism.parameters
    nothing = Begin(
        [0.0] * context.n_drives, [None] * context.n_drives, [None] * mechanism.n_tendons
    )
    for path in (*mechanism.plays, *mechanism.strains):
        components, index, quantity, *_, key = path.split(".")
        part = mechanism.rig.components[components][int(index)].name
        kind, start = FIRST[quantity]
        name = f"sheath_{part}_{key}" if quantity == "path" else f"{quantity}_{part}"
        first = partial(start, context, path, int(index))
        std = float(ca.Function("std", [p.symbols], [first(nothing)[1]])(p.values))
        at = p.names.index(path)
        yield State(name, kind, part, 0.0, std, indices=(at,), first=first)


def _std(context: FilterContext, path: str) -> Scalar:
    """Return the std of a parameter, 0 where the filter has no such input."""
    return context.number(f"{path}.std") if path in context.mechanism.parameters.names else 0


def _far_side(context: FilterContext, path: str, drive: int, begin: Begin) -> tuple[Scalar, Scalar]:
    """Return mean and std of the far side of a backlash at the first sample: in the middle of
    where it can be.
    """
    width = f"drives.{drive}.backlash.width"
    most = context.mechanism.parameters[width] + 2 * _std(context, width)
    return begin.positions[drive], most / sqrt(12.0)


def _point(context: FilterContext, path: str, tendon: int, begin: Begin) -> tuple[Scalar, Scalar]:
    """Return mean and std of a point in a sheath at the first sample: as if nothing rubbed."""
    mechanism = context.mechanism
    still = Mechanism(mechanism.rig)
    p = still.parameters
    inputs = symbols(ca.SX, q=still.n_bodies, T=1, stds=mechanism.n_joints)
    q, tension, stds = inputs
    sheath = still.sheath(tendon)
    assert sheath is not None  # it has points
    position = still.internal_state(q).inside[mechanism.plays.index(path)]
    initial = [f"joints.{j}.initial" for j in range(mechanism.n_joints)]
    slopes = ca.jacobian(position, q)
    turned = sum(((slopes[0, j] * stds[j]) ** 2 for j in still.joints_of[tendon]), ca.SX(0))
    friction = (sheath.drawn**sheath.count - 1) * tension / sheath.stiffness
    share = (2 * int(path.rpartition(".")[2]) + 1) / (2 * sheath.count)
    spread = ca.sqrt(turned + (share * friction) ** 2)
    prior = ca.Function("first", [*inputs, p.symbols], [position, spread])
    mean, std = prior(
        ca.vertcat(*map(context.number, initial), *begin.positions),
        _tension(context, tendon, begin),
        ca.vertcat(*(context.number(f"{angle}.std") for angle in initial)),
        ca.vertcat(*(mechanism.parameters[name] for name in p.names)),
    )
    return mean, std


def _strain(context: FilterContext, path: str, tendon: int, begin: Begin) -> tuple[Scalar, Scalar]:
    """Return mean and std of the slow part of a stretch at the first sample: the share ``settled``
    of γ T/k_t has crept already.
    """
    p = context.mechanism.parameters
    creep = path.rpartition(".")[0]
    share = p[f"{creep}.share"]
    stretch = _tension(context, tendon, begin) / p[f"tendons.{tendon}.stiffness"]
    settled = context.number(f"{creep}.settled")
    spread = ca.sqrt(
        (share * context.number(f"{creep}.settled.std")) ** 2
        + (_std(context, f"{creep}.share") * settled) ** 2
    )
    return settled * share * stretch, spread * stretch


First = Callable[[FilterContext, str, int, Begin], tuple[Scalar, Scalar]]
"""Function that returns mean and std of an internal state at the first sample."""

FIRST: dict[str, tuple[StateKind, First]] = {
    "backlash": (StateKind.BACKLASH, _far_side),
    "path": (StateKind.SHEATH, _point),
    "creep": (StateKind.CREEP, _strain),
}
"""Part of the rig that an internal state belongs to → its kind, and its first mean and std."""


def _tension(context: FilterContext, tendon: int, begin: Begin) -> Scalar:
    """Return a tendon's tension at the first sample [N]: as read, from its drive's effort, or as
    likely.
    """
    mechanism = context.mechanism
    path = f"tendons.{tendon}"
    body = mechanism.drive_of[tendon]
    tension = begin.tensions[tendon]
    effort = begin.efforts[body - mechanism.n_joints]
    if tension is None and effort is not None:
        count = len(mechanism.pulled_by(body))
        share = effort / mechanism.lever(body) / count * mechanism.winds(tendon)
        tension = share + context.number(f"{path}.pretension") * (1 - 1 / count)
    if tension is None:
        return context.number(f"{path}.likely_tension")
    return ca.fmax(tension, 0)


def likely_tension(rig: Rig, tendon: int) -> float:
    """Return the likely tension of a tendon at the start where nothing reads it [N]: pre-tension,
    else nominal force, else `UNKNOWN_TENSION`.
    """
    part = rig.tendons[tendon]
    nominal = rig.drive(part.drive).nominal_force.value
    return part.home_tension or abs(nominal) or UNKNOWN_TENSION


START_SPEED = 0.3
"""Standard deviation of a joint's speed at the first sample [rad/s]: a log may begin within a
motion. Source: benchmark (benchmarks.ablation).
"""


def motions(context: FilterContext) -> Iterator[State]:
    """Yield the angles of all joints, then the speeds of all."""
    rig = context.rig
    joints = list(enumerate(rig.joints))
    for name, (j, joint) in zip(angle_names(rig.joint_names), joints):
        initial = joint.initial
        mean_by = partial(context.number, f"joints.{j}.initial")
        yield State(name, StateKind.ANGLE, joint.name, initial.value, initial.std, mean_by=mean_by)
    for name, (_, joint) in zip(speed_names(rig.joint_names), joints):
        yield State(name, StateKind.SPEED, joint.name, 0.0, START_SPEED)


def external_torques(context: FilterContext) -> Iterator[State]:
    """Yield the external torque τ_ext of each joint on which one can act: where the rig declares
    one, or where forces may show one. It is a first-order Gauss–Markov process.

    Where the rig declares none it is zero until a touch opens its variance, (13b).
    """
    rig = context.rig
    for j, (joint, name) in enumerate(zip(rig.joints, torque_names(rig.joint_names))):
        std = joint.external_torque.std
        if std > 0.0 or j in context.touchable:
            path = f"joints.{j}.external_torque"
            yield State(
                name,
                StateKind.EXTERNAL_TORQUE,
                joint.name,
                0.0,
                std,
                to=("torque", j),
                std_by=partial(context.number, f"{path}.std"),
                fades_in=partial(context.number, f"{path}.correlation_time"),
            )


POSITION_WALK = 1.0
"""Random walk of a drive's position that nothing measures, in its travel [1/√s]: the drive may
cross it within a second. Source: judgement.
"""


def unmeasured_positions(context: FilterContext) -> Iterator[State]:
    """Yield the position s of each drive without a position sensor: anywhere on its travel at
    first; then it walks.
    """
    for i, drive in enumerate(context.rig.drives):
        if context.position_sensor(i) is None:
            low, high = drive_travel(context.rig, i)
            yield State(
                f"position_{drive.name}",
                StateKind.POSITION,
                drive.name,
                (low + high) / 2,
                (high - low) / np.sqrt(12.0),
                to=("position", i),
                walk=(high - low) * POSITION_WALK,
            )


def unknown_frictions(context: FilterContext) -> Iterator[State]:
    """Yield an addition to the friction limit of each drive with a force sensor whose friction the
    rig does not declare.

    Its size follows the noise σ of the drive's force sensor. It is not smoothed: friction at one
    time tells little of another time (docs/explanation/adaptive-guards.md).
    """
    guards = context.robustness
    if guards.unknown_friction == 0.0:
        return
    for i, drive in enumerate(context.rig.drives):
        sensor = context.force_sensor(i)
        if sensor is None or drive.hysteresis is not None or context.declares_friction(i):
            continue
        noise = float(np.sqrt(variance(sensor)))
        yield State(
            f"friction_{drive.name}",
            StateKind.FRICTION,
            drive.name,
            0.0,
            guards.unknown_friction * noise,
            to=("friction", i),
            walk=guards.unknown_friction_walk * noise,
        )


def transmissions(context: FilterContext) -> Iterator[State]:
    """Yield for each drive with hysteresis and a force sensor the effort z that a play operator
    passes on, which `prediction.play` moves, and what one play operator leaves out: that is
    *considered*, since the model has no state for it.

    At first z is anywhere within the limits h of the play, h/√3, and the sensor's noise.
    """
    for i, drive in enumerate(context.rig.drives):
        sensor = context.force_sensor(i)
        hysteresis = drive.hysteresis
        if sensor is None or hysteresis is None:
            continue
        path = f"drives.{i}"
        limit = play_limit(context, i)
        noise = variance(sensor)
        yield State(
            f"transmitted_{drive.name}",
            StateKind.TRANSMITTED,
            drive.name,
            drive.nominal_force.value,  # the first reading replaces it
            float(np.hypot(limit / np.sqrt(3.0), np.sqrt(noise))),
            std_by=partial(_transmitted_std, context, i, sensor),
            inputs={
                f"{path}.play_limit": limit,
                f"{path}.reading_weight": reading_weight(limit, noise),
            },
        )
        if hysteresis.error > 0.0:
            error = f"{path}.hysteresis.error"
            yield State(
                f"transmission_error_{drive.name}",
                StateKind.TRANSMISSION_ERROR,
                drive.name,
                0.0,
                hysteresis.error,
                to=("lacking force", i),
                std_by=partial(context.number, error),
                fades_in=partial(context.number, f"{error}_time"),
                inputs={error: hysteresis.error, f"{error}_time": hysteresis.error_time},
            )


def _transmitted_std(context: FilterContext, drive: int, sensor: Sensor) -> Scalar:
    limit = context.number(f"drives.{drive}.play_limit")
    return ca.sqrt(limit**2 / 3.0 + context.noise(sensor))


def play_limit(context: FilterContext, drive: int) -> float:
    """Return the limit h of a drive's play [N, N m] at pre-tension, with the joints at their
    `initial` angles.
    """
    mechanism = context.mechanism
    tensions = ca.DM([tendon.home_tension for tendon in mechanism.rig.tendons])
    angles = [joint.initial.value for joint in mechanism.rig.joints]
    q = ca.vertcat(*angles, ca.DM.zeros(mechanism.n_drives))
    limit = mechanism.hysteresis_limit(drive, q, tensions)
    p = mechanism.parameters
    return float(ca.Function("limit", [p.symbols], [limit])(p.values))


CALM = 8.0
"""Limit of a play over the noise of its smoothed effort, at least, (14) [1]. Source: judgement."""


def reading_weight(limit: float, noise: float) -> float:
    """Return the weight of a new reading of a drive's effort in its smoothed value: (14).

    It is 1 where the reading's variance `noise` is small against the square of the play's `limit`.
    """
    ratio = min((limit / CALM) ** 2 / noise, 1.0)
    return 2.0 * ratio / (1.0 + ratio)


SMALLEST_VALUE = 0.01
"""Lower limit of a parameter that cannot be negative, as a share of its std [1]. Source:
judgement.
"""

SMALLEST_FACTOR = 0.05
"""Lower limit of a common factor [1]. Source: judgement."""

UNSEEN = 0.03
"""Std of a drive's friction, as a share of the noise of its force sensor, below which the friction
has no visible effect [1]. Source: judgement.
"""


def uncertain_parameters(context: FilterContext) -> list[State]:
    """Return the uncertain parameters, without those that have no effect on a
    displacement-driven joint.

    First come values, then factors that several parameters share, then deviations of single ones,
    which are added to what the factor has made. A parameter that cannot be negative has its prior
    cut at zero: mean and variance are those of the cut normal distribution. A parameter that is
    known to a factor only (a std up to its value) keeps its mean instead, or is multiplied by a
    state of mean 1, whose std is that of its logarithm.
    """
    p = context.mechanism.parameters
    values, factors, deviations = (list[State]() for _ in range(3))
    seen = [
        i
        for i, name in enumerate(p.names)
        if p.stds[i] > 0.0 and not _without_effect(context, name, p.stds[i])
    ]
    sharing = {i for _, indices in p.shared.values() for i in indices}
    for i in seen:
        name = p.names[i]
        value = float(p.values[i])
        std = float(p.independent_stds[i])
        of_tendon = name.startswith("tendons.") and name.endswith((".stiffness", ".damping"))
        if i in sharing:
            if std > 0.0:
                bounded = _bounded(context, name)
                lowest = -(1.0 - SMALLEST_FACTOR) * value if bounded else -np.inf
                walk = _walk(context, i, std)
                of = f"{name}.deviation"
                deviations.append(_state(context, of, 0.0, std, (i,), "deviation", walk, lowest))
        elif (of_tendon and value > 0.0) or number(context.rig, name).is_rough:
            walk = _walk(context, i, std / value, value)
            factors.append(_factor(context, name, (i,), std / value, walk))
        else:
            values.append(_value(context, i, value, std))
    for name, (std, indices) in p.shared.items():
        together = [i for i in indices if i in seen]
        if together:
            # where one has a std of its own, its drift is that one's
            alone = [i for i in together if p.independent_stds[i] == 0.0]
            walks = [_walk(context, i, std, p.values[i]) for i in alone]
            usual = context.robustness.parameter_walk * std
            factors.append(_factor(context, name, together, std, max(walks, default=usual)))
    return values + factors + deviations


def _walk(context: FilterContext, index: int, std: float, scale: float = 1.0) -> float:
    """Return the random walk of a parameter's state, of which `scale` is one."""
    drift = float(context.mechanism.parameters.drifts[index])
    return context.robustness.parameter_walk * std if np.isnan(drift) else drift / scale


def _state(
    context: FilterContext,
    path: str,
    mean: float,
    std: float,
    indices: Sequence[int],
    acts: Acts,
    walk: float,
    lowest: float,
    unidentified: bool = False,
) -> State:
    """Return the state of a parameter at a `path`; of the rest, see `State`."""
    rig = context.rig
    name = path.removesuffix(".factor")
    common = name in context.mechanism.parameters.shared
    return State(
        f"common factor of {name}" if common else in_words(rig, path),
        StateKind.PARAMETER,
        named(rig, path),
        mean,
        std,
        indices=tuple(indices),
        acts=acts,
        walk=walk,
        lowest=lowest,
        unidentified=unidentified,
    )


def _factor(
    context: FilterContext, name: str, indices: Sequence[int], relative: float, walk: float
) -> State:
    """Return the state of a factor on some parameters, by its std."""
    first = context.mechanism.parameters.names[indices[0]]
    rough = known_to_a_factor(first, 1.0, relative)
    logarithmic = rough and number(context.rig, first).quantity.bound == "positive"
    mean, spread = (1.0, float(np.log1p(relative))) if logarithmic else cut_normal(1.0, relative)
    # physics that the rig lacks would teach it wrongly (docs/results/other-rigs.md, "Rigs that
    # are hardly known")
    of = f"{name}.factor"
    return _state(context, of, mean, spread, indices, "factor", walk, SMALLEST_FACTOR, rough)


def _value(context: FilterContext, index: int, value: float, std: float) -> State:
    """Return the state of a parameter that stands alone."""
    name = context.mechanism.parameters.names[index]
    mean = value
    spread = std
    lowest = -np.inf
    rough = known_to_a_factor(name, value, std)
    if _bounded(context, name):
        cut, spread = cut_normal(value, std)
        # a number that is known to a factor is as likely above as below what is stated, unless it
        # may well be zero
        mean = value if rough and std <= value else cut
        lowest = SMALLEST_VALUE * spread
    # where no drive pulls against another, forces are those of friction and say little of all else
    unidentified = context.n_drives <= context.n_joints and lowest > 0.0 and rough
    walk = _walk(context, index, spread)
    return _state(context, name, mean, spread, (index,), "value", walk, lowest, unidentified)


def _bounded(context: FilterContext, name: str) -> bool:
    """Return whether a parameter cannot be negative."""
    return number(context.rig, name).quantity.bound != "any"


def _without_effect(context: FilterContext, name: str, std: float) -> bool:
    """Return whether a parameter's std has no visible effect: inertia and stops of a drive,
    friction far below the noise.
    """
    if not name.startswith("drives."):
        return False
    index = int(name.split(".")[1])
    drive = context.rig.drives[index]
    sensor = context.force_sensor(index)
    if name.endswith(("friction.load", "friction.constant")):
        noise = np.sqrt(variance(sensor)) if sensor is not None else drive.nominal_force.std
        force = std * max(abs(drive.nominal_force.value), 1.0) if name.endswith("load") else std
        return bool(force < UNSEEN * noise)
    return not (
        name.endswith((".damping", ".radius")) or ".backlash." in name or ".cogging." in name
    )


def cut_normal(mean: float, std: float) -> tuple[float, float]:
    """Return mean and std of the normal distribution with `mean` and `std` after it is cut at zero;
    the same where zero is more than 4 stds away.
    """
    lower = -mean / std
    if lower < -4.0:
        return mean, std
    density = exp(-lower * lower / 2) / sqrt(2 * pi)
    above = 0.5 * (1 - erf(lower / sqrt(2)))
    ratio = density / above
    return mean + std * ratio, std * sqrt(max(1 + lower * ratio - ratio * ratio, 1e-6))


def sensor_biases(context: FilterContext) -> Iterator[State]:
    """Yield the offset b of each compared sensor in which it is uncertain, then the gain error γ of
    each, as a share of its reading; forces tell little of that.
    """
    sensors = context.channels.compared
    yield from (bias for bias in (_bias(context, sensor) for sensor in sensors) if bias.std > 0.0)
    for sensor in sensors:
        std = context.gain_std(sensor)
        if std > 0.0:
            to = ("reading", sensor.name)
            name = f"gain_{sensor.name}"
            kind = StateKind.SENSOR_GAIN
            yield State(name, kind, sensor.name, 0.0, std, to=to, times=_proportional)


def _proportional(reading: Scalar) -> Scalar:
    return reading


def _bias(context: FilterContext, sensor: Sensor) -> State:
    """Return the offset of a sensor, which stays, or walks by the bias's `drift`.

    The offset of a reference of a joint's angle stays within its std instead: with a `drift` it is
    a first-order Gauss–Markov process, of which e^{−dt/T} is left after dt, T = 2 σ²/drift². It is
    the difference between the model's angle and the joint's, so that a short reference tells less
    than a long one.
    """
    std = float(np.hypot(context.bias_std(sensor), np.sqrt(systematic_variance(sensor))))
    of = f"bias_{sensor.name}", StateKind.SENSOR_BIAS, sensor.name, 0.0, std
    to = ("reading", sensor.name)
    drift = float(sensor.bias.drift or 0.0)
    if sensor.measures != "angle" or drift == 0.0:
        return State(*of, to=to, walk=drift)
    path = f"{context.path(sensor)}.bias"
    std_by = partial(context.number, f"{path}.std")
    inputs = {f"{path}.std": std, f"{path}.drift": drift}
    return State(*of, to=to, std_by=std_by, fades_in=partial(_lasts, context, path), inputs=inputs)


def _lasts(context: FilterContext, path: str) -> Scalar:
    return 2 * context.number(f"{path}.std") ** 2 / context.number(f"{path}.drift") ** 2


BASIS = 6
"""Number of basis functions of a sensor's linearity over its travel [1]: more changed no error on
the logs of `make accuracy`. Source: benchmark (benchmarks/accuracy).
"""

SMOOTHNESS = 3.0
"""Order j₀ at which the prior of the weights decreases, in half waves over the travel [1];
`distal.sensor_models` draws curves so. Source: judgement.
"""


def linearities(context: FilterContext) -> Iterator[State]:
    """Yield the weights w_j of each position sensor's error Σ w_j cos(π j ξ), ξ = 0 … 1 over the
    travel; none where the sensor has no systematic error. Their prior means are zeros.

    A posture that lasts shows only one point of the curve, so that references teach it slowly.
    """
    for i in range(context.n_drives):
        sensor = context.position_sensor(i)
        if sensor is None:
            continue
        for j, std in enumerate(_weight_stds(context, sensor)):
            yield State(
                f"linearity_{sensor.name}_{j}",
                StateKind.LINEARITY,
                sensor.name,
                0.0,
                float(std),
                to=("reading", sensor.name),
                times=partial(_cosine, context, i, j),
            )


def _weight_stds(context: FilterContext, sensor: Sensor) -> Floats:
    """Return the prior standard deviations of the weights [m, rad].

    The error is a Gaussian process over the travel with a squared-exponential spectrum: the stds of
    w_j decrease as exp(−(j/j₀)²/2), scaled so that the mean variance over the travel is that of the
    linearity. The variance of a bias adds to that of the constant weight.
    """
    bias = context.bias_std(sensor)
    if sensor.linearity == 0.0:
        return np.array([bias] if bias > 0.0 else [])
    shape = np.exp(-0.5 * (np.arange(BASIS) / SMOOTHNESS) ** 2)
    shape /= np.sqrt(shape[0] ** 2 + 0.5 * np.sum(shape[1:] ** 2))
    stds: Floats = LINEARITY_STD * sensor.linearity * shape
    stds[0] = np.hypot(stds[0], bias)
    return stds


def _cosine(context: FilterContext, drive: int, order: int, reading: Scalar) -> Scalar:
    """Return cos(π j ξ) of the `order` j at a `reading`.

    By cos(π (j + 1) ξ) = 2 cos(π ξ) cos(π j ξ) − cos(π (j − 1) ξ) one cosine suffices for all
    (Chebyshev).
    """
    low, high = (context.number(f"drives.{drive}.travel.{end}") for end in ("low", "high"))
    terms = [ca.SX(1), ca.cos(ca.pi * ((reading - low) / (high - low)))]
    for _ in range(order - 1):
        terms.append(2 * terms[1] * terms[-1] - terms[-2])
    return terms[order]


Kind = Callable[[FilterContext], Iterable[State]]
"""Function that returns the states of one kind that a rig has."""

KINDS: tuple[Kind, ...] = (
    motions,
    external_torques,
    uncertain_parameters,
    linearities,
    unmeasured_positions,
    unknown_frictions,
    transmissions,
    inside,
    sensor_biases,
)
"""All kinds; their order is that of the state vector."""

LEARNED_SLOWLY: tuple[StateKind, ...] = (StateKind.PARAMETER, StateKind.SENSOR_GAIN)
"""Kinds of states that learn slowly from forces, tensions and references. Source: definition."""

LASTING = (*LEARNED_SLOWLY, StateKind.LINEARITY, StateKind.SENSOR_BIAS)
"""Kinds of states that are constants of the rig or of a sensor; others are meant to move. Source:
definition.
"""


class StateVector:
    """All states of a rig in their order, (n,).

    Args:
        context: the rig as the filter reads it.
        kinds: kinds of states; default all.
    """

    def __init__(self, context: FilterContext, kinds: Sequence[Kind] = KINDS) -> None:
        self.context = context
        self.kinds = tuple(kinds)
        self.states = tuple(state for kind in kinds for state in kind(context))
        self.names = tuple(state.name for state in self.states)
        self.state_kinds = tuple(state.kind for state in self.states)
        self.state_parts = tuple(state.part for state in self.states)
        self.means, self.stds, self.walks, self.lowest = (
            np.array(values, dtype=np.float64)
            for values in zip(*((s.mean, s.std, s.walk, s.lowest) for s in self.states))
        )
        # friction at one time tells little of another time
        self.unsmoothed = self.of_kind(StateKind.FRICTION)
        self.lasting = np.array([kind in LASTING for kind in self.state_kinds])
        joints = context.rig.joint_names
        torques = self.of_kind(StateKind.EXTERNAL_TORQUE)
        self.torque_states = {i: joints.index(self.state_parts[i]) for i in torques}

    @property
    def structure(self) -> tuple[object, ...]:
        """What the structure of a kernel depends on in the states: all but their values."""
        return *(state.structure for state in self.states), self.context.contact_structure

    def __len__(self) -> int:
        return len(self.states)

    def of_kind(self, *kinds: StateKind) -> tuple[int, ...]:
        """Return the indices of the states of some kinds."""
        return tuple(i for i, state in enumerate(self.states) if state.kind in kinds)

    def inputs(self) -> Iterator[tuple[str, float]]:
        """Yield name and value of the inputs of the filter's kernel that follow from the states."""
        for i, state in enumerate(self.states):
            yield f"state.{i}.mean", state.mean
            yield f"state.{i}.std", state.std
            yield f"state.{i}.walk", state.walk
            yield f"state.{i}.lowest", state.lowest
            yield from state.inputs.items()

    def prior(self) -> tuple[Vector, Vector]:
        """Return prior means and standard deviations, (n,) each, as expressions of the filter's
        inputs.
        """
        number = self.context.number
        moments = [
            (
                number(f"state.{i}.mean") if state.mean_by is None else state.mean_by(),
                number(f"state.{i}.std") if state.std_by is None else state.std_by(),
            )
            for i, state in enumerate(self.states)
        ]
        means, stds = (ca.vertcat(*moment) for moment in zip(*moments))
        return means, stds

    def gain_shares(
        self, drive: int | None, reference: bool, interval: Scalar
    ) -> dict[int, Scalar]:
        """Return index → share of the gain, for the states that do not take all of it (24).

        Args:
            drive: index of the drive whose force is compared, None for any other reading.
            reference: whether a joint's own angle is compared, which tells of parameters what
                forces do not.
            interval: nominal interval of the filter [s].
        """
        guards = self.context.robustness
        declared = drive is None or self.context.declares_friction(drive)
        time = guards.learning_time if declared else guards.learning_time_guarded
        times = [(time, LEARNED_SLOWLY), (guards.creep_learning_time, (StateKind.CREEP,))]
        if reference:
            # the many samples of a joint at rest show only one posture
            times = [(guards.reference_time, (*LEARNED_SLOWLY, StateKind.LINEARITY))]
        slow = dict[int, Scalar]()
        for of_all, kinds in times:
            if of_all > 0.0:
                slow |= dict.fromkeys(self.of_kind(*kinds), ca.fmin(1.0, interval / of_all))
        # of an error for which the model has no state only the uncertainty counts (Schmidt, 1966)
        kept = list(self.of_kind(StateKind.TRANSMISSION_ERROR))
        if not reference:
            kept += [i for i, state in enumerate(self.states) if state.unidentified]
        return slow | dict.fromkeys(kept, 0.0)

    @property
    def slow(self) -> tuple[int, ...]:
        """Indices of the states that take a share of the gain of some forces."""
        guards = self.context.robustness
        interval = self.context.channels.interval
        kinds = list[StateKind]()
        if max(guards.learning_time, guards.learning_time_guarded) > interval:
            kinds += LEARNED_SLOWLY
        if guards.creep_learning_time > interval:
            kinds.append(StateKind.CREEP)
        return self.of_kind(*kinds)

    def fadings(self) -> list[tuple[int, Scalar, Scalar]]:
        """Return index, time constant [s] and lasting std of each state that fades."""
        _, stds = self.prior()
        return [
            (i, state.fades_in(), stds[i])
            for i, state in enumerate(self.states)
            if state.fades_in is not None
        ]

    def parameters(self, state: Vector) -> Vector:
        """Return the model's parameters at a state, (n_p,)."""
        p = ca.SX(self.context.mechanism.parameters.symbols)
        for i, unknown in enumerate(self.states):
            z = state[i]
            for at in unknown.indices:
                p[at] = {"value": z, "factor": p[at] * z, "deviation": p[at] + z}[unknown.acts]
        return p

    def added(self, to: Target, state: Vector, reading: Scalar = 0) -> Scalar:
        """Return what a `state` adds to something, of which the `reading` is that of a sensor."""
        every = enumerate(self.states)
        return sum((of.times(reading) * state[i] for i, of in every if of.to == to), ca.SX(0))

    def adding(self, to: Target) -> list[int]:
        """Return the indices of the states that add to something."""
        return [i for i, state in enumerate(self.states) if state.to == to]

    def placing(self, drive: int) -> list[int]:
        """Return the indices of the states that change the `position` of a drive."""
        sensor = self.context.position_sensor(drive)
        of_sensor = [] if sensor is None else self.adding(("reading", sensor.name))
        return of_sensor or self.adding(("position", drive))

    def torques(self, state: Vector) -> Vector:
        """Return the external torque on each joint, (n_joints,) [N m]."""
        joints = range(self.context.n_joints)
        return ca.vertcat(*(self.added(("torque", j), state) for j in joints))

    def position(self, drive: int, reading: Scalar, state: Vector) -> Scalar:
        """Return the position of a drive [m, rad]: its `reading` less the error of its sensor, or
        the state that holds the position.
        """
        sensor = self.context.position_sensor(drive)
        if sensor is None:
            return self.added(("position", drive), state)
        return reading - self.added(("reading", sensor.name), state, reading)

    def coordinates(self, state: Vector, readings: Sequence[Scalar]) -> Vector:
        """Return the coordinates q of joints and drives at a `state`, from the `readings` of all
        drives' positions.
        """
        positions = (self.position(i, reading, state) for i, reading in enumerate(readings))
        return ca.vertcat(state[: self.context.n_joints], *positions)

    def transmitted(self, drive: int) -> int | None:
        """Return the index of the effort that a drive's play passes on, None where it has no
        play.
        """
        name = self.context.rig.drive_names[drive]
        of = (i for i in self.of_kind(StateKind.TRANSMITTED) if self.state_parts[i] == name)
        return next(of, None)
