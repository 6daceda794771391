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
from distal.fitting.free_parameters import assignments
from distal.fitting.objective import Problem
from distal.fitting.parameter_estimates import most_likely, problem_of, search, searched
from distal.hands.power_on_routine import Sweep, crossed, is_pair, needed, winds_to
from distal.logs import Log
from distal.rig import Capstan, Rig, Sensor, Subsystem

SPRUNG = 4.0
"""Std of a motor's torque about the model's in usual motion, in multiples of that in the slow
routine, where joints share one tendon against springs [1]. Source: benchmark
(docs/results/hands.md).
"""

SPRINGS_APART = 0.35
"""Std of the springs of a finger, as a share [1]: one motor hardly tells which spring is stiffer.
Source: benchmark (docs/results/hands.md).
"""

UNKNOWN = 2 * np.pi
"""Std of a zero before the ends of the travel were met [rad]. Source: definition (a turn)."""

ITERATIONS = 3
"""How often the ends are linearized anew. Source: rounding (5e-6 rad, travel 20 % off)."""


def part_values(
    log: Log, part: Subsystem, sweeps: Mapping[str, Sequence[Sweep]]
) -> dict[str, object]:
    """Return path by names → value of the parameters of one independent subsystem; tendons of a
    pair under tension have a negative slack.

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
    pairs = all(is_pair(rig, name) for name in drives)
    at_ends = _at_ends(rig, sweeps)
    prior = rig.with_values(at_ends)
    problem = problem_of([cut], prior, Options(noise=pairs, workers=1))
    parameters = searched(problem, _likeliest(problem, prior), may_stay=False)
    if not np.isfinite(parameters.optimum.cost):
        raise FitError(
            f"{log.source}: no rig with the motors {', '.join(drives)} moves as this log does"
        )
    fitted = parameters.problem.filter.rig
    values = at_ends | assignments(parameters.fitted, fitted)
    for sensor in fitted.sensors_of("force"):
        # friction is not the same everywhere, and the rig says how well it is known
        friction = rig.drive(sensor.of).friction.constant.total_std
        noise = max(sensor.noise, friction) if pairs else SPRUNG * sensor.noise
        values[f"sensors.{sensor.name}.noise"] = noise
    return _with_ranges(
        rig, {path: v for path, v in values.items() if not path.endswith((".initial", ".hold"))}
    )


def _at_ends(rig: Rig, sweeps: Mapping[str, Sequence[Sweep]]) -> dict[str, object]:
    """Return path by names → prior by the ends of the sweeps: zeros and radii of motors, slack,
    angles of joints at the end of the first sweep, noise of torques.
    """
    values = dict[str, object]()
    for sensor in rig.sensors_of("force"):
        # friction is not the same everywhere, and the rig says how well it is known
        noise = rig.drive(sensor.of).friction.constant.total_std
        if is_pair(rig, sensor.of):  # it is fitted, from what the free motion shows
            noise = max(sweep.noise for sweep in sweeps[sensor.of])
        values[f"sensors.{sensor.name}.noise"] = max(sensor.noise, noise)
    for sensor in rig.sensors_of("position"):
        values |= _by_contacts(rig, sensor, sweeps[sensor.of])
    for tendon in rig.tendons:
        way = sweeps[tendon.drive][0].way * tendon.winding
        for joint, arm in crossed(rig, tendon):
            if joint.coupled is None:
                end = joint.travel[way * arm > 0]
                values[f"joints.{joint.name}.initial"] = {"value": end, "std": joint.stops_std}
    return values


def _by_contacts(rig: Rig, sensor: Sensor, sweeps: Sequence[Sweep]) -> dict[str, object]:
    """Return path by names → a motor's zero and radius and its tendons' slack, as the ends of the
    travel and the rig tell them together (Kalman, J. Basic Engineering 82, 1960, iterated).

    A tendon meets its end at zero ± (Σ arm · stop + slack)/radius, as well as the stops are known.
    A pre-tension T is the slack −T/k.
    """
    drive = rig.drive(sensor.of)
    assert isinstance(drive, Capstan)
    tendons = rig.tendons_of(drive.name)
    ways = np.array([tendon.winding for tendon in tendons])
    met, lengths, unsure = np.array([winds_to(rig, tendon, sweeps) for tendon in tendons]).T
    stds = [
        np.hypot(t.slack.total_std, t.pretension.total_std / t.stiffness.value) for t in tendons
    ]
    slacks = [tendon.loose for tendon in tendons]
    zero = np.mean(met - ways * (lengths + slacks) / drive.lever)
    prior = np.array([zero, drive.lever, *slacks])
    covariance = np.diag(np.square([UNKNOWN, drive.radius.total_std, *stds]))
    x = prior
    for _ in range(ITERATIONS):
        away = ways * (lengths + x[2:]) / x[1]
        slopes = np.column_stack([np.ones(len(ways)), -away / x[1], np.diag(ways / x[1])])
        cross = slopes @ covariance
        seen = cross @ slopes.T + np.diag(np.square(unsure) / x[1] ** 2)
        gain = np.linalg.solve(seen, cross).T
        x = prior + gain @ (met - x[0] - away - slopes @ (prior - x))
    names = [f"sensors.{sensor.name}.bias", f"drives.{drive.name}.radius"]
    values = dict[str, object]()
    for tendon in tendons if len(tendons) == 2 else ():
        names.append(f"tendons.{tendon.name}.slack")
        values[f"tendons.{tendon.name}.pretension"] = {"value": 0.0, "std": 0.0}
    for name, value, variance in zip(names, x, np.diag(covariance - gain @ cross)):
        values[name] = {"value": float(value), "std": float(np.sqrt(variance))}
    return values


def _likeliest(problem: Problem, prior: Rig) -> Floats:
    """Return where the search for the parameters begins, (n,): at the end of one for some of them,
    or where joints have springs, at the likeliest end of several searches.

    A joint at its stop shows as a bend of the torque, and the same bends may be those of other
    joints. So each further search begins with the bends of two joints exchanged, until none ends
    likelier.
    """
    best = np.zeros(problem.size)
    exchanges = _exchanges(problem, prior)
    if not exchanges:
        # friction first, since a wrong torque draws all else away; noise last
        frictions = [part.paths[0].endswith("friction.constant") for part, _ in problem.parts]
        noises = [part.noise for part, _ in problem.parts]
        for fixed in (~np.array(frictions), np.array(noises)):
            best = search(problem, best, fixed=fixed).z
        return best
    best = most_likely(problem, best)[1].z
    while True:
        ends = [best]
        for one, other, ratio in exchanges:
            z = best.copy()
            first = problem.parts[one][0]
            second = problem.parts[other][0]
            z[one] = first.coordinate(ratio * second.value(best[other]))
            z[other] = second.coordinate(first.value(best[one]) / ratio)
            ends.append(most_likely(problem, z)[1].z)
        likeliest = int(np.nanargmin(problem.costs(ends)))
        if likeliest == 0:
            return best
        best = ends[likeliest]


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
        stop = joint.travel[arm > 0]
        reach = abs((stop - joint.spring.rest_angle.value) / arm)
        reaches.setdefault(tendon.name, {})[at] = reach
    return [
        (one, other, along[other] / along[one])
        for along in reaches.values()
        for one, other in combinations(along, 2)
    ]


def _with_ranges(rig: Rig, values: Mapping[str, object]) -> dict[str, object]:
    """Return the values with wider stds: radii, zeros and slack are known no better than the ranges
    of joints by which they were found, and springs no better than `SPRINGS_APART`.
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
        meets = crossed(rig, rig.tendons_of(drive.name)[0])
        off = np.hypot.reduce([arm * joint.stops_std for joint, arm in meets]) / drive.lever
        radius = np.sqrt(2) * off * drive.lever**2 / needed(rig, drive.name)
        widen(f"drives.{drive.name}.radius", radius)
        widen(f"sensors.{sensor.name}.bias", off / np.sqrt(2))
        for tendon in rig.tendons_of(drive.name) if is_pair(rig, drive.name) else ():
            widen(f"tendons.{tendon.name}.slack", off * drive.lever)
    return wider
