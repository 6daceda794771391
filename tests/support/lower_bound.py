"""A lower bound on the error of the joint angle: what no filter with the same knowledge can beat by
much.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from distal.errors import EstimationError
from distal.estimators import AdaptiveFilter, Robustness, first_values
from distal.logs import Log, true_angles
from distal.rig import Rig
from distal.run import samples_of


def lower_bound(rig: Rig, log: Log) -> float:
    """Return the RMS over a log and its joints of the posterior Cramér–Rao bound on an angle's std
    [rad].

    The covariance recursion of the state of `adaptive`, with the same priors, linearised along the
    true trajectory and without what guards against a wrong model (Tichavský, Muravchik and Nehorai,
    1998). The true trajectory is had by feeding the filter with noise-free sensors from the true
    initial angle; the plant must be as the rig.

    Args:
        rig: the description, equal to the plant.
        log: with the truth of a simulation.

    Raises:
        EstimationError: the log has no truth, or the rig's sensors do not suffice.
    """
    usual = Robustness()
    guards = replace(
        Robustness.none(),
        wild_displacement=usual.wild_displacement,
        unknown_friction=usual.unknown_friction,
    )
    bound = AdaptiveFilter(rig, robustness=guards, name="bound")
    positions = {sensor.of: sensor.name for sensor in rig.sensors_of("position")}
    forces = {sensor.of: sensor.name for sensor in rig.sensors_of("force")}
    channels = {name: log.truth[f"position_{of}"] for of, name in positions.items()}
    channels |= {name: log.truth[f"force_{of}"] for of, name in forces.items()}
    channels |= {
        sensor.name: log.truth[f"tension_{sensor.of}"] for sensor in rig.sensors_of("tension")
    }
    true = Log(log.time, channels, dict(log.truth), log.source)
    samples = samples_of(true, bound.channels, bound.name)
    belief = bound.initial(true.time[0], first_values(samples))
    kernel_state = np.array(belief.kernel_state)
    known = true_angles(log, [joint.name for joint in rig.joints])
    if known is None:
        raise EstimationError(f"{log.source}: has no truth; the bound is for simulated logs")
    kernel_state[bound.angles] = known[0]
    started = type(belief)(belief.time, kernel_state, belief.size)
    _, covariances, _, _ = bound.scan(started, true.time, samples)
    variances = np.diagonal(covariances, axis1=1, axis2=2)[:, bound.angles]
    return float(np.sqrt(np.mean(variances)))
