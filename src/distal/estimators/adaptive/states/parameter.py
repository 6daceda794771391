"""Uncertain parameters of the model: every one with a std whose effect sensors can show."""

from __future__ import annotations

from collections.abc import Sequence
from math import erf, exp, pi, sqrt

import numpy as np

from distal.estimators.adaptive.filter_context import FilterContext
from distal.estimators.adaptive.states.state import State
from distal.estimators.state_kinds import StateKind
from distal.rig import in_words, known_to_a_factor, named, number
from distal.sensor_errors import variance

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
    rig = context.mechanism.rig
    values, factors, deviations = (list[State]() for _ in range(3))
    seen = [
        i
        for i, name in enumerate(p.names)
        if p.stds[i] > 0.0 and not _without_effect(context, name, p.stds[i])
    ]
    sharing = {i for _, indices in p.shared.values() for i in indices}

    def walk(i: int, std: float, scale: float = 1.0) -> float:
        return (
            context.robustness.parameter_walk * std
            if np.isnan(p.drifts[i])
            else float(p.drifts[i]) / scale
        )

    def factor(name: str, indices: Sequence[int], relative: float, walked: float) -> State:
        first = p.names[indices[0]]
        path = f"{name}.factor"
        words = f"common factor of {name}" if name in p.shared else in_words(rig, path)
        rough = known_to_a_factor(first, 1.0, relative)
        logarithmic = rough and number(rig, first).quantity.bound == "positive"
        mean, spread = (
            (1.0, float(np.log1p(relative))) if logarithmic else cut_normal(1.0, relative)
        )
        # physics that the rig lacks would teach it wrongly (docs/results/other-rigs.md, "Rigs that
        # are hardly known")
        return State(
            words,
            StateKind.PARAMETER,
            named(rig, path),
            mean,
            spread,
            indices=tuple(indices),
            acts="factor",
            walk=walked,
            lowest=SMALLEST_FACTOR,
            unidentified=rough,
        )

    for i in seen:
        name = p.names[i]
        value = float(p.values[i])
        std = float(p.independent_stds[i])
        kind = name.split(".", 2)[2]
        if i in sharing:
            if std > 0.0:
                lowest = -(1.0 - SMALLEST_FACTOR) * value if _bounded(context, name) else -np.inf
                path = f"{name}.deviation"
                deviations.append(
                    State(
                        in_words(rig, path),
                        StateKind.PARAMETER,
                        named(rig, path),
                        0.0,
                        std,
                        indices=(i,),
                        acts="deviation",
                        walk=walk(i, std),
                        lowest=lowest,
                    )
                )
            continue
        of_tendon = name.startswith("tendons.") and kind in ("stiffness", "damping") and value > 0.0
        if of_tendon or number(rig, name).is_rough:
            factors.append(factor(name, (i,), std / value, walk(i, std / value, value)))
            continue
        mean = value
        spread = std
        lowest = -np.inf
        rough = known_to_a_factor(name, value, std)
        if _bounded(context, name):
            cut, spread = cut_normal(value, std)
            # a number that is known to a factor is as likely above as below what is stated, unless
            # it may well be zero
            mean = value if rough and std <= value else cut
            lowest = SMALLEST_VALUE * spread
        # where no drive pulls against another, forces are those of friction and say little of all
        # else
        alone = context.n_drives <= context.n_joints
        values.append(
            State(
                in_words(rig, name),
                StateKind.PARAMETER,
                named(rig, name),
                mean,
                spread,
                indices=(i,),
                walk=walk(i, spread),
                lowest=lowest,
                unidentified=alone and lowest > 0.0 and rough,
                doubted=rough and name.startswith("joints.") and kind.startswith("friction."),
            )
        )
    for name, (std, indices) in p.shared.items():
        together = [i for i in indices if i in seen]
        if together:
            # where one has a std of its own, its drift is that one's
            walks = [walk(i, std, p.values[i]) for i in together if p.independent_stds[i] == 0.0]
            factors.append(
                factor(
                    name, together, std, max(walks, default=context.robustness.parameter_walk * std)
                )
            )
    return values + factors + deviations


def _bounded(context: FilterContext, name: str) -> bool:
    """Return whether a parameter cannot be negative."""
    return number(context.mechanism.rig, name).quantity.bound != "any"


def _without_effect(context: FilterContext, name: str, std: float) -> bool:
    """Return whether a parameter's std has no visible effect: inertia and stops of a drive,
    friction far below the noise.
    """
    if not name.startswith("drives."):
        return False
    index = int(name.split(".")[1])
    drive = context.mechanism.rig.drives[index]
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
