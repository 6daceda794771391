"""Parameters of one independent subsystem of a hand, a finger or a joint, from the sweeps of its
motors: each form that its tendons may have is fitted, and the likeliest is taken.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np

from distal.errors import FitError
from distal.fitting import Options
from distal.fitting.free_parameter import assignments
from distal.fitting.parameter_estimates import ParameterEstimates, from_starts, problem_of
from distal.hands.findings import LOOSE, longer
from distal.hands.springs_from_stops import Springs, springs_of
from distal.hands.starts import Start, is_pair, pair_starts, single_starts
from distal.hands.sweeps import Sweep, sweep_channels_of
from distal.logs import Log
from distal.rig import Capstan, Number, Rig, Subsystem, named, number

SCATTER = 0.25
"""Std of a motor's torque about the model's, as a share of the torque that moves it [1]: friction
is not the same everywhere. Source: judgement.
"""

FASTER = 1.5
"""Std of a motor's torque about the model's in usual motion, in multiples of that in the slow
routine, where motors have pairs of tendons [1]. Source: benchmark (docs/results/hands.md).
"""

SPRUNG = 4.0
"""Std of a motor's torque about the model's in usual motion, in multiples of that in the slow
routine, where joints share one tendon against springs [1]. Source: benchmark
(docs/results/hands.md).
"""

ZERO_SPREAD = 0.05
"""Prior std of a motor's zero about the one by its contacts, as a share of its travel [1]. Source:
judgement.
"""

STIFFNESS_SPREAD = 0.3
"""Prior std of a tendon's stiffness about the one by the torque's slope at the end of the travel,
as a share [1]. Source: judgement.
"""

PRETENSION = {"value": 2.0, "std": 2.0}
"""Prior of the pre-tension of a pair that is not slack [N]. Source: judgement."""

SPRINGS_SPREAD = 0.6
"""Prior std of the common factor of the springs of a finger, as a share [1]. Source: benchmark
(docs/results/hands.md).
"""

SPRINGS_APART = 0.35
"""Std of each spring of a finger beside the springs' common factor, as a share [1]: one motor
hardly tells which spring is stiffer. Source: benchmark (docs/results/hands.md).
"""

QUASI_STATIC = 300.0
"""Natural frequency that the joints' inertia is chosen for [rad/s]: a slow routine says nothing of
inertia, and with this one few steps in time are enough. Source: judgement.
"""

NOT_SLACK = {"value": 0.0, "std": 0.0}
"""Slack of a pair under tension [m]."""

RADIUS_SPREAD = 0.25
"""Prior std of a spool's radius where the travel does not fit the rig's, as a share [1]; the slack
is then the rig's. Source: judgement.
"""

Form = Literal["slack", "stretched", "radius"]

SLACK = (0.3e-3, 1.5e-3)
"""Mean and std of the prior of the slack of each tendon of a pair [m]: wider than in the rig, since
tendons may be loose. Source: judgement.
"""

AT_STOP = float(np.deg2rad(1.0))
"""Prior std of a joint's angle at the end of the first sweep [rad]. Source: judgement."""


def part_values(
    log: Log, part: Subsystem, sweeps: Mapping[str, Sequence[Sweep]]
) -> dict[str, object]:
    """Return path by names → value of the parameters of one independent subsystem, in the likeliest
    of its forms.

    The forms are: pairs of tendons are slack, are under tension, or are on spools whose radius is
    not the rig's.

    Args:
        log: of the power-on routine.
        part: the subsystem.
        sweeps: motor → its sweeps.

    Raises:
        FitError: no rig with these motors moves as the log does.
    """
    rig = part.rig
    drives = part.rig.drive_names
    first = min(sweeps[name][0].end for name in drives)
    last = max(sweeps[name][-1].end for name in drives)
    cut = Log(
        log.time[first : last + 1] - log.time[first],
        {
            name: log.channels[name][first : last + 1]
            for name in (sensor.name for sensor in rig.sensors)
            if name in log.channels
        },
        {},
        log.source,
    )
    pairs = [name for name in drives if is_pair(rig, name)]
    forms: list[Form] = ["slack", "stretched"] if pairs else ["slack"]
    if any(abs(longer(rig, name, sweeps[name])) > LOOSE for name in pairs):
        forms.append("radius")
    springs = None if pairs else springs_of(log, rig, drives[0], sweeps[drives[0]])
    found = list[tuple[float, Rig, ParameterEstimates]]()
    for form in forms:
        formed = _formed(rig, form, pairs)
        starts = _starts(formed, drives, sweeps, pairs if form == "stretched" else ())
        if springs is not None:
            starts = [{**starts[0], **springs.values}]
        prior = _prior(formed, drives, sweeps, starts, springs, form)
        problem = problem_of([cut], prior, Options(noise=False, workers=1))
        parameters = from_starts(problem, [prior.with_values(start) for start in starts])
        # searches weight their channels differently, so that only unweighted costs can be compared
        found.append((float(problem.costs([parameters.optimum.z])[0]), formed, parameters))
    cost, formed, parameters = min(found, key=lambda one: one[0])
    if not np.isfinite(cost):
        raise FitError(
            f"{log.source}: no rig with the motors {', '.join(drives)} moves as this log does"
        )
    fitted = parameters.problem.filter.rig
    # a parameter that the fit did not find keeps its value by contacts and slopes
    begun = {
        named(fitted, path): _spread(number(fitted, path))
        for path in _starts(formed, drives, sweeps, ())[0]
    }
    values = {
        path: value
        for path, value in assignments(parameters.fitted, fitted).items()
        if not path.endswith(".hold")
    }
    # the model's error of a motor's torque is larger than the sensor's, and larger yet in faster
    # motion
    noise: dict[str, object] = {
        f"sensors.{sensor.name}.noise": float(f"{(FASTER if pairs else SPRUNG) * sensor.noise:.2g}")
        for sensor in fitted.sensors_of("force")
    }
    return _form_values(rig, formed) | _with_ranges(formed, begun | values, springs) | noise


def _spread(found: Number) -> dict[str, object]:
    """Return a number's value and std as a rig file has them."""
    if found.shared is not None:
        name, std = found.shared
        return {"value": found.value, "shared": {"name": name, "std": std}}
    return {"value": found.value, "std": found.std}


def _formed(rig: Rig, form: Form, pairs: Sequence[str]) -> Rig:
    """Return the rig in one form: with pairs of tendons under tension instead of slack, or with
    unknown radii of their spools.
    """
    changed: dict[str, object] = {}
    if form == "stretched":
        for k, tendon in enumerate(rig.tendons):
            if tendon.drive in pairs:
                changed |= {f"tendons.{k}.slack": NOT_SLACK, f"tendons.{k}.pretension": PRETENSION}
    if form == "radius":
        for k, drive in enumerate(rig.drives):
            if drive.name in pairs and isinstance(drive, Capstan):
                radius = drive.radius.value
                spread = {"value": radius, "std": RADIUS_SPREAD * radius}
                changed[f"drives.{k}.radius"] = spread
    return rig.with_values(changed) if changed else rig


def _form_values(rig: Rig, formed: Rig) -> dict[str, object]:
    """Return path by names → value of slack and pre-tension where a form differs from the rig."""
    return {
        f"tendons.{one.name}.{key}": {
            "value": getattr(other, key).value,
            "std": getattr(other, key).std,
        }
        for one, other in zip(rig.tendons, formed.tendons)
        for key in ("slack", "pretension")
        if getattr(one, key) != getattr(other, key)
    }


def _starts(
    rig: Rig, drives: Sequence[str], sweeps: Mapping[str, Sequence[Sweep]], stretched: Sequence[str]
) -> list[Start]:
    """Return the starts of the search for a subsystem: for each motor its own starts, with the
    middle start of all other motors.
    """
    families = [
        pair_starts(rig, name, sweeps[name], name in stretched)
        if is_pair(rig, name)
        else single_starts(rig, name, sweeps[name])
        for name in drives
    ]
    common: Start = {}
    for family in families:
        common = {**common, **family[len(family) // 2]}
    return [{**common, **start} for family in families for start in family]


def _prior(
    rig: Rig,
    drives: Sequence[str],
    sweeps: Mapping[str, Sequence[Sweep]],
    starts: Sequence[Start],
    springs: Springs | None,
    form: Form,
) -> Rig:
    """Return the rig with the priors of the fit: zeros and stiffness by contacts and slopes, noise
    by friction, initial angles by the end that the first sweep goes to.
    """
    values = dict[str, object]()
    middle = starts[len(starts) // 2]
    # one noise for all motors of a hand: it is a constant of the kernel, so that subsystems of one
    # kind share a kernel
    levels = [abs(sweep.level) for of_drive in sweeps.values() for sweep in of_drive]
    scatter = float(f"{SCATTER * np.median(levels):.2g}")
    for path, value in middle.items():
        if path.endswith(".bias"):
            sensor = rig.sensors[int(path.split(".")[1])]
            contacts = [sweep.contact for sweep in sweeps[sensor.of]]
            values[path] = {"value": value, "std": ZERO_SPREAD * (max(contacts) - min(contacts))}
        elif path.endswith(".slack") and form != "radius":
            values[path] = {"value": SLACK[0], "std": SLACK[1]}
        elif path.endswith(".stiffness") and path.startswith("tendons."):
            shared = rig.tendons[int(path.split(".")[1])].stiffness.shared
            spread = {"std": STIFFNESS_SPREAD * value}
            values[path] = {
                "value": value,
                **(
                    spread
                    if shared is None
                    else {"shared": shared.model_dump() | {"std": STIFFNESS_SPREAD}}
                ),
            }
    for i, joint in enumerate(rig.joints):
        if (path := f"joints.{i}.spring.stiffness") in middle:
            common = {"name": f"springs_{drives[0]}", "std": SPRINGS_SPREAD}
            values[path] = {"value": middle[path], "std": 0.0, "shared": common}
            if springs is not None:
                values[path] = {"value": middle[path], "std": springs.stds[path]}
        stiff = 0.0
        for k, tendon in enumerate(rig.tendons):
            stiff += (
                middle.get(f"tendons.{k}.stiffness", 0.0) * tendon.arms().get(joint.name, 0.0) ** 2
            )
        values[f"joints.{i}.inertia"] = max(stiff, 1e-3) / QUASI_STATIC**2
    for name in drives:
        torque = sweep_channels_of(rig, name)[1]
        at = rig.sensor_names.index(torque)
        values[f"sensors.{at}.noise"] = max(rig.sensors[at].noise, scatter)
        way = sweeps[name][0].way
        for i, joint in enumerate(rig.joints):
            tendons = [
                tendon
                for tendon in rig.tendons
                if tendon.drive == name and joint.name in tendon.arms()
            ]
            if not tendons or joint.coupled is not None:
                continue
            up = way > 0 if is_pair(rig, name) else way * tendons[0].arms()[joint.name] > 0
            values[f"joints.{i}.initial"] = {"value": joint.travel[1 if up else 0], "std": AT_STOP}
    return rig.with_values(values)


def _with_ranges(
    rig: Rig, values: Mapping[str, object], springs: Springs | None
) -> dict[str, object]:
    """Return the values with wider stds: a radius and a zero are known no better than the joints'
    ranges by which they were found.
    """
    wider = {
        path: value for path, value in values.items() if not path.endswith((".initial", ".noise"))
    }
    for tendon in rig.tendons:
        path = f"tendons.{tendon.name}.slack"
        if isinstance(
            found := wider.get(path), dict
        ):  # the prior of the search is wide, since tendons may be loose
            wider[path] = found | {"std": min(found["std"], tendon.slack.std)}
    for i, joint in enumerate(rig.joints):
        path = f"joints.{joint.name}.spring.stiffness"
        if isinstance(found := wider.get(path), dict):
            std = (
                SPRINGS_APART * found["value"]
                if springs is None
                else springs.stds[f"joints.{i}.spring.stiffness"]
            )
            wider[path] = {"value": found["value"], "std": float(f"{std:.3g}")}
    for drive in rig.drives:
        if drive.kind != "capstan":
            continue
        tendon = next(tendon for tendon in rig.tendons if tendon.drive == drive.name)
        arms = tendon.arms()
        joints = {joint.name: joint for joint in rig.joints}
        off = [abs(arm) * joints[name].stops_std for name, arm in arms.items()]
        travel = sum(abs(arm) * float(np.ptp(joints[name].travel)) for name, arm in arms.items())
        of_radius = np.sqrt(2) * np.hypot.reduce(off) / travel
        of_zero = np.hypot.reduce(off) / np.sqrt(2)
        position = sweep_channels_of(rig, drive.name)[0]
        for path, size in (
            (f"drives.{drive.name}.radius", of_radius * drive.radius.value),
            (f"sensors.{position}.bias", of_zero / drive.radius.value),
        ):
            found = wider.get(path)
            if isinstance(found, dict):
                wider[path] = found | {"std": float(f"{np.hypot(found['std'], size):.3g}")}
    return wider
