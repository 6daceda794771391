"""Parameters of one independent subsystem of a hand, a finger or a joint, by the ordinary fit to
its sweeps: the ends of the joints' ranges, where the motors met them, are the reference angles.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np

from distal.arrays import Floats
from distal.errors import FitError
from distal.fitting import Options
from distal.fitting.free_parameter import assignments
from distal.fitting.likelihood_search import most_likely
from distal.fitting.objective import Problem
from distal.fitting.parameter_estimates import ParameterEstimates, from_start, problem_of
from distal.hands.sweeps import Sweep, contacts, is_pair, needed
from distal.hands.tendon_faults import excess
from distal.logs import Log
from distal.rig import Rig, Subsystem

SPRUNG = 4.0
"""Std of a motor's torque about the model's in usual motion, in multiples of that in the slow
routine, where joints share one tendon against springs [1]. Source: benchmark
(docs/results/hands.md).
"""

SPRINGS_APART = 0.35
"""Std of the springs of a finger, as a share [1]: one motor hardly tells which spring is stiffer.
Source: benchmark (docs/results/hands.md).
"""

TENSION = {"slack": {"value": 0.0, "std": 0.0}, "pretension": {"value": 2.0, "std": 2.0}}
"""Slack [m] and prior of the pre-tension [N] of a pair that is not slack. Source: judgement."""


def part_values(
    log: Log, part: Subsystem, sweeps: Mapping[str, Sequence[Sweep]]
) -> dict[str, object]:
    """Return path by names → value of the parameters of one independent subsystem, whose pairs of
    tendons are slack or under tension, whichever is likelier.

    Args:
        log: of the power-on routine.
        part: the subsystem.
        sweeps: motor → its sweeps.

    Raises:
        FitError: no rig with these motors moves as the log does.
    """
    rig = part.rig
    drives = rig.drive_names
    begin = min(sweeps[name][0].end for name in drives)
    rows = slice(begin, max(sweeps[name][-1].end for name in drives) + 1)
    names = [sensor.name for sensor in rig.sensors if sensor.name in log.channels]
    cut = Log(
        log.time[rows] - log.time[begin],
        {name: log.channels[name][rows] for name in names},
        {},
        log.source,
    )
    pairs = [tendon.name for tendon in rig.tendons if is_pair(rig, tendon.drive)]
    tense: dict[str, object] = {
        f"tendons.{name}.{key}": value for name in pairs for key, value in TENSION.items()
    }
    found = list[tuple[float, dict[str, object], ParameterEstimates]]()
    for form in ({}, tense) if pairs else ({},):
        prior = rig.with_values(_at_ends(rig, sweeps) | form)
        problem = problem_of([cut], prior, Options(noise=False, workers=1))
        parameters = from_start(problem, _likeliest(problem, prior))
        # searches weight their channels differently, so that only unweighted costs can be compared
        found.append((float(problem.costs([parameters.optimum.z])[0]), form, parameters))
    cost, form, parameters = min(found, key=lambda one: one[0])
    if not np.isfinite(cost):
        raise FitError(
            f"{log.source}: no rig with the motors {', '.join(drives)} moves as this log does"
        )
    fitted = parameters.problem.filter.rig
    values = _at_ends(rig, sweeps) | form | assignments(parameters.fitted, fitted)
    if not pairs:
        for sensor in fitted.sensors_of("force"):
            values[f"sensors.{sensor.name}.noise"] = SPRUNG * sensor.noise
    return _with_ranges(
        rig, {path: v for path, v in values.items() if not path.endswith((".initial", ".hold"))}
    )


def _at_ends(rig: Rig, sweeps: Mapping[str, Sequence[Sweep]]) -> dict[str, object]:
    """Return path by names → prior by the ends of the sweeps: zeros of motors, angles of joints at
    the end of the first sweep, noise of torques.
    """
    values = _zeros(rig, sweeps)
    friction = {drive.name: drive.friction.constant.total_std for drive in rig.drives}
    for sensor in rig.sensors_of("force"):
        # friction is not the same everywhere, and the rig says how well it is known
        values[f"sensors.{sensor.name}.noise"] = max(sensor.noise, friction[sensor.of])
    joints = {joint.name: joint for joint in rig.joints}
    for tendon in rig.tendons:
        if is_pair(rig, tendon.drive):
            # what the motor clearly turns too far may be slack of both tendons
            longer, std = excess(rig, tendon.drive, sweeps[tendon.drive])
            more = max(longer - std, 0.0) / 2
            values[f"tendons.{tendon.name}.slack"] = {
                "value": tendon.slack.value + more,
                "std": float(np.hypot(tendon.slack.std, more)),
            }
            # of a rig that was calibrated before; a tendon has either slack or tension
            values[f"tendons.{tendon.name}.pretension"] = TENSION["slack"]
        way = sweeps[tendon.drive][0].way * tendon.winding
        for name, arm in tendon.arms().items():
            if joints[name].coupled is None:
                values[f"joints.{name}.initial"] = {
                    "value": joints[name].travel[1 if way * arm > 0 else 0],
                    "std": joints[name].stops_std,
                }
    return values


def _zeros(rig: Rig, sweeps: Mapping[str, Sequence[Sweep]]) -> dict[str, object]:
    """Return path by names → prior of each motor's zero, with which its tendons take up at the ends
    of its travel what the joints' ranges need.

    An end is at (Σ arm · stop + slack)/radius from the zero, and is known as well as these. One
    tendon meets an end only where it winds.
    """
    joints = {joint.name: joint for joint in rig.joints}
    values = dict[str, object]()
    for sensor in rig.sensors_of("position"):
        tendons = rig.tendons_of(sensor.of)
        drive = rig.drive(sensor.of)
        zeros = []
        for tendon in tendons:
            arms = tendon.arms()
            stops = [arm * joints[name].travel[1 if arm > 0 else 0] for name, arm in arms.items()]
            away = tendon.winding * (sum(stops) + tendon.slack.value) / drive.lever
            met = contacts(sweeps[sensor.of], tendon.winding)
            zeros.append(float(np.mean(met)) - away)
        unsure = [arm * joints[name].stops_std for name, arm in arms.items()]
        std = np.hypot.reduce([*unsure, tendon.slack.std]) / drive.lever
        values[f"sensors.{sensor.name}.bias"] = {
            "value": float(np.mean(zeros)),
            "std": float(np.hypot(std, np.std(zeros))),
        }
    return values


def _likeliest(problem: Problem, prior: Rig) -> Floats:
    """Return where the search for the parameters begins, (n,): at the priors' means, or where
    joints have springs, at the likeliest end of several searches.

    A joint at its stop shows as a bend of the torque, and the same bends may be those of other
    joints. So each further search begins with the bends of two joints exchanged, until none ends
    likelier.
    """
    best = np.zeros(problem.size)
    exchanges = _exchanges(problem, prior)
    if not exchanges:
        return best
    best = most_likely(problem, best)[1].z
    likelier = True
    while likelier:
        ends = [best]
        for one, other, ratio in exchanges:
            z = best.copy()
            values = [problem.parts[at][0].value(best[at]) for at in (one, other)]
            z[one] = problem.parts[one][0].coordinate(ratio * values[1])
            z[other] = problem.parts[other][0].coordinate(values[0] / ratio)
            ends.append(most_likely(problem, z)[1].z)
        at = int(np.nanargmin(problem.costs(ends)))
        likelier = at > 0
        best = ends[at]
    return best


def _exchanges(problem: Problem, prior: Rig) -> list[tuple[int, int, float]]:
    """Return the coordinates of the stiffness of each two springs along a tendon, and the ratio of
    the first to the second with which both joints would come to their stops at one tension.

    A joint does so at the tension k |θ − rest|/arm.
    """
    reaches = dict[str, dict[int, float]]()
    for at, (free, _) in enumerate(problem.parts):
        kind, index, *of_part = free.paths[0].split(".")
        if kind != "joints" or of_part != ["spring", "stiffness"]:
            continue
        joint = prior.joints[int(index)]
        assert joint.spring is not None
        tendon = next(tendon for tendon in prior.tendons if joint.name in tendon.joints)
        arm = tendon.arms()[joint.name]
        stop = joint.travel[1 if arm > 0 else 0]
        reach = abs((stop - joint.spring.rest_angle.value) / arm)
        reaches.setdefault(tendon.name, {})[at] = reach
    return [
        (one, other, along[other] / along[one])
        for along in reaches.values()
        for one, other in combinations(along, 2)
    ]


def _with_ranges(rig: Rig, values: Mapping[str, object]) -> dict[str, object]:
    """Return the values with wider stds: radii and zeros are known no better than the joints'
    ranges by which they were found, and springs no better than `SPRINGS_APART`.
    """
    wider = dict(values)

    def widen(path: str, std: float) -> None:
        if isinstance(found := wider.get(path), dict) and "std" in found:
            wider[path] = found | {"std": float(f"{np.hypot(found['std'], std):.3g}")}

    for joint in rig.joints:
        path = f"joints.{joint.name}.spring.stiffness"
        if isinstance(found := wider.get(path), dict):
            std = float(f"{SPRINGS_APART * found['value']:.3g}")
            wider[path] = {"value": found["value"], "std": std}
    for sensor in rig.sensors_of("position"):
        drive = rig.drive(sensor.of)
        arms = rig.tendons_of(drive.name)[0].arms()
        stds = [arms[joint.name] * joint.stops_std for joint in rig.joints if joint.name in arms]
        off = float(np.hypot.reduce(stds)) / drive.lever
        radius = np.sqrt(2) * off * drive.lever**2 / needed(rig, drive.name)
        widen(f"drives.{drive.name}.radius", radius)
        widen(f"sensors.{sensor.name}.bias", off / np.sqrt(2))
    return wider
