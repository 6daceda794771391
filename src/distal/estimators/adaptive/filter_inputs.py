"""What the steps of the filter share: the inputs of its kernel beside the parameters of the
equations, an interval with its sample, and the rig's equations at given positions of its bodies.

Rigs that differ only in these inputs have the same kernel.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.estimators.adaptive.filter_context import DERIVED, FilterContext, has_gain
from distal.estimators.adaptive.guard_settings import Robustness
from distal.estimators.adaptive.states import KINDS, Kind, StateVector, likely_tension
from distal.estimators.estimator_protocol import DEAD_INTERVALS, UNKNOWN_POSITION, Channels
from distal.expressions import MatrixNode, VectorNode, symbols
from distal.kernels import Layout
from distal.model import Mechanism
from distal.model.parameters import Derived, number_at
from distal.rig import LearnedMaps, Rig, Sensor, drive_travel, gain_of, step_of
from distal.sensor_models import quantisation_variance, variance


def states_of_rig(
    rig: Rig,
    inputs: Sequence[str],
    channels: Channels,
    robustness: Robustness,
    kinds: Sequence[Kind] = KINDS,
    folded: bool = False,
) -> StateVector:
    """Return the states of a filter, with all values of the rig as inputs of its kernel.

    The states are made twice, since values that follow from the states themselves are inputs too.
    With `folded`, inputs that are no parameters of the equations become constants.
    """

    def context_with(parameters: Mapping[str, float]) -> FilterContext:
        derived = {
            f"{DERIVED}{name}": value for name, value in parameters.items() if name not in inputs
        }
        return FilterContext(
            Mechanism(rig, inputs, True, Derived(derived, folded)), channels, robustness
        )

    parameters = dict(parameters_of_rig(context_with({})))
    states = StateVector(context_with(parameters), kinds)
    return StateVector(context_with({**parameters, **dict(states.inputs())}), kinds)


def parameters_of_rig(context: FilterContext) -> Iterator[tuple[str, float]]:
    """Yield name and value of each quantity of a description that the filter reads beside the
    equations' parameters.
    """
    rig = context.rig
    channels = context.channels
    yield "interval", channels.interval
    for sensor in (*channels.proximal, *channels.angles):
        yield from _of_sensor(context, sensor)
    for kind, keys in PLAIN.items():
        for i in range(len(rig.components[kind])):
            yield from _inputs_at(rig, f"{kind}.{i}", keys)
    shape = context.contact_shape
    for i, joint in enumerate(rig.joints):
        for moving, (ratio, share) in context.ratios(i).items():
            yield f"drives.{moving}.ratio.{joint.name}", ratio
            yield f"drives.{moving}.share.{joint.name}", share
        for other in np.flatnonzero(shape[i]):
            correlation = shape[i, other] / np.sqrt(shape[i, i] * shape[other, other])
            yield context.loaded_with(i, int(other)), float(correlation)
        by_contact = context.by_contact(i) if i in context.touchable else {}
        for sensor in context.forces:
            path = context.path(sensor)
            yield f"{path}.by_torque.{joint.name}", context.by_torque(i, sensor)
            if sensor.name in by_contact:
                yield f"{path}.by_contact.{joint.name}", by_contact[sensor.name]
    for i in range(context.n_drives):
        path = f"drives.{i}"
        low, high = drive_travel(rig, i)
        yield f"{path}.travel.low", low
        yield f"{path}.travel.high", high
        held, shown = context.jumps[i]
        yield f"{path}.held_stiffness", held
        yield f"{path}.shown_share", shown
    for t, tendon in enumerate(rig.tendons):
        yield f"tendons.{t}.likely_tension", likely_tension(rig, t)
        if tendon.creep is not None:
            yield from _inputs_at(rig, f"tendons.{t}.creep", ("settled", "settled.std"))
    p = context.mechanism.parameters
    for i, name in enumerate(p.names):
        if name.endswith((".backlash.width", ".share")):
            yield f"{name}.std", float(p.stds[i])


PLAIN = {
    "joints": (
        "initial",
        "initial.std",
        "unmodelled",
        "external_torque.std",
        "external_torque.correlation_time",
    ),
    "drives": ("nominal_force", "nominal_force.std"),
    "tendons": ("pretension",),
}
"""Kind of component → keys of the numbers that are inputs as they stand in the description."""


def _inputs_at(rig: Rig, path: str, keys: Iterable[str]) -> Iterator[tuple[str, float]]:
    """Yield path and value of numbers of the component at a `path`."""
    for key in keys:
        yield f"{path}.{key}", number_at(rig, f"{path}.{key}")


def _of_sensor(context: FilterContext, sensor: Sensor) -> Iterator[tuple[str, float]]:
    path = context.path(sensor)
    yield from _inputs_at(context.rig, path, ("noise", "bias", "linearity", "rate", "lag"))
    yield f"{path}.rounding", quantisation_variance(step_of(sensor))
    yield f"{path}.unknown_bias", context.bias_std(sensor)
    if has_gain(sensor):
        yield f"{path}.gain", gain_of(sensor).value
    if sensor.measures == "position":
        centre, away = context.possible_positions(sensor)
        for name, value in zip(JUDGED.names[1:], judged_by(context.rig, sensor)[1:]):
            yield f"{path}.{name}", float(value)
        yield f"{path}.middle", centre
        yield f"{path}.farthest", away


WANDERING = 1.0
"""Time in which the std of a drive's position grows by `UNKNOWN_POSITION` where no reading comes
back [s]. Source: benchmark (benchmarks.ablation).
"""


JUDGED = Layout(noise=1, dead=1, wandering=1, usual=1, centre=1, scale=1, felt=1)
"""Layout of what a position is judged by where no force judges it: the variance of its noise, the
time without a value after which it may not come back [s], the growth of its std after that, and its
`usual_motion`. Source: definition (layout of a vector).
"""


def judged_by(rig: Rig, sensor: Sensor) -> Floats:
    """Return what a position is judged by where no force judges it, in the order of `JUDGED`."""
    wandering = UNKNOWN_POSITION[rig.drive(sensor.of).kind] / WANDERING
    dead = DEAD_INTERVALS / sensor.rate
    return np.array([variance(sensor), dead, wandering, *usual_motion(rig, sensor)])


def usual_motion(rig: Rig, sensor: Sensor) -> tuple[float, ...]:
    """Return the mean square speed of a position in the logs that taught a rig [m²/s², rad²/s²],
    its mean and its std there, and whether forces are compared with those at its positions; 0 where
    no logs taught it.
    """
    maps = LearnedMaps() if rig.map is None else rig.map
    for learned in (*maps.filter, *maps.readings):
        if sensor.name in learned.channels:
            at = learned.channels.index(sensor.name)
            rate, centre, scale = (
                float(learned.arrays[n][at]) for n in ("rate", "centre", "scale")
            )
            felt = any(sensor.name in forces.channels for forces in maps.efforts)
            return (rate * scale) ** 2, centre, scale, float(felt)
    return 0.0, 0.0, 0.0, 0.0


@dataclass(frozen=True)
class Interval:
    """An interval that ends with a sample, all symbolic.

    Args:
        tracks: of the drives at its end, a column of `TRACKED` values for each.
        memory: what was remembered of the drives at its start, a column for each.
        x: the sample (dt, values, mask).
        p: the model's parameters.
    """

    tracks: MatrixNode
    memory: MatrixNode
    x: VectorNode
    p: VectorNode


@dataclass(frozen=True)
class Prediction:
    """The prediction for the end of an interval, symbolic; the steps change it in place.

    Args:
        state: predicted mean, (n,).
        covariance: of its error, (n, n).
        transition: Φ from the start of the interval, (n, n).
    """

    state: VectorNode
    covariance: MatrixNode
    transition: MatrixNode


def mechanics_function(context: FilterContext) -> ca.Function:
    """Return the function (q, v, p) → tensions, pulls on the bodies, their dampings, friction
    limits and asymmetries, slopes of tensions and of pulls by q.
    """
    mechanism = context.mechanism
    q, v = symbols(ca.SX, q=mechanism.n_bodies, v=mechanism.n_bodies)
    tendons = mechanism.pulls(q, v, settled=True)
    nj = mechanism.n_joints
    tensions = tendons.drive
    # cogging is among the passive forces; those of the joints are compared with nothing
    cogging = ca.vertcat(ca.SX.zeros(nj), mechanism.passive_forces(q)[nj:])
    pulls = mechanism.dampings() * v - tendons.forces - cogging
    friction = mechanism.friction_limits(q, v, tendons.joint, tendons.drive)
    limits = ca.vertcat(*(limit.mean for limit in friction))
    asymmetries = ca.vertcat(*(limit.asymmetry for limit in friction))
    slopes = [ca.jacobian(tensions, q), ca.jacobian(pulls, q)]
    outputs = [tensions, pulls, mechanism.dampings(), limits, asymmetries, *slopes]
    return ca.Function("mechanics", [q, v, mechanism.parameters.symbols], outputs)
