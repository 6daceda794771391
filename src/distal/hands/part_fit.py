"""The numbers of one part of a hand, a finger or a joint, by the sweeps of its motors: each of its
forms is fitted, and the likeliest is taken.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np

from distal.errors import FitError
from distal.fitting import Options
from distal.fitting.fitted_parameter import assignments
from distal.fitting.parameter_estimates import ParameterEstimates, from_starts, problem_of
from distal.hands.findings import LOOSE, longer
from distal.hands.springs_from_stops import Springs, springs_of
from distal.hands.starts import Start, is_pair, pair_starts, single_starts
from distal.hands.sweeps import Sweep, sweep_channels_of
from distal.logs import Log
from distal.rig import Capstan, Number, Rig, Subsystem, named, number

SCATTER = 0.25
"""What a model leaves of a motor's torque, as a share of the torque that moves it: friction is not
the same everywhere.
"""

FASTER = 1.5
SPRUNG = 4.0
"""In usual motion it leaves this many times what it does in the slow routine, the second of joints
that share a tendon: docs/results/hands.md.
"""

ZERO_SPREAD = 0.05
"""Prior of a motor's zero about what its contacts say, as a share of its travel."""

STIFFNESS_SPREAD = 0.3
"""Prior of a tendon's stiffness about what the slope at its end says, as a share."""

PRETENSION = {"value": 2.0, "std": 2.0}
"""Prior of the tension of a pair that is not slack [N]."""

SPRINGS_SPREAD = 0.6
SPRINGS_APART = 0.35
"""Prior of what the springs of a finger have in common, and how far each may be from it, as shares:
one motor hardly tells which of them is stiffer (docs/results/hands.md).
"""

QUASI_STATIC = 300.0
"""Of a slow routine the joints' inertia says nothing: it is such that they have this frequency,
whose steps are few [rad/s].
"""

NOT_SLACK = {"value": 0.0, "std": 0.0}
"""Of such a pair [m]."""

RADIUS_SPREAD = 0.25
"""Prior of a spool's radius where the travel is not that of the rig's, as a share; the slack is
then what the rig says.
"""

Form = Literal["slack", "stretched", "radius"]

SLACK = (0.3e-3, 1.5e-3)
"""Prior of the slack of each tendon of a pair, its mean and std, wider than a hand's own: it may be
loose [m].
"""

AT_STOP = float(np.deg2rad(1.0))
"""How well a joint's angle is known at the end of a sweep [rad]."""


def part_values(
    log: Log, part: Subsystem, sweeps: Mapping[str, Sequence[Sweep]]
) -> dict[str, object]:
    """Return path by names → value of a part's numbers, in the likeliest of its forms: pairs slack,
    stretched, or on spools of another radius than the rig has.
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
        # what the channels' values are worth differs from search to search; the plain sums can be
        # compared
        found.append((float(problem.costs([parameters.optimum.z])[0]), formed, parameters))
    cost, formed, parameters = min(found, key=lambda one: one[0])
    if not np.isfinite(cost):
        raise FitError(
            f"{log.source}: no rig with the motors {', '.join(drives)} moves as this log does"
        )
    fitted = parameters.problem.filter.rig
    # what the routine did not tell beyond its contacts and slopes is what these say
    begun = {
        named(fitted, path): _spread(number(fitted, path))
        for path in _starts(formed, drives, sweeps, ())[0]
    }
    values = {
        path: value
        for path, value in assignments(parameters.fitted, fitted).items()
        if not path.endswith(".hold")
    }
    # the model misses more of a motor's torque than its sensor does, and more yet in motion that is
    # faster
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
    """Return the rig with pairs of tendons under tension instead of slack, or with spools whose
    radii are not known.
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
    """Return path by names → value of what one form has otherwise than the rig as it came."""
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
    """Return the starts of a part: of several motors the first starts of all, then the others one
    motor at a time.
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
    """Return the rig of the fit: zeros and stiffness by contacts and slopes, noise by friction,
    angles by the first end.
    """
    values = dict[str, object]()
    middle = starts[len(starts) // 2]
    # one number for all motors of a hand: a noise is a constant of the kernel, which parts of one
    # kind then share
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
    """Return the values with what is not known of the joints' ranges: the zero is no better than
    their middle.
    """
    wider = {
        path: value for path, value in values.items() if not path.endswith((".initial", ".noise"))
    }
    for tendon in rig.tendons:
        path = f"tendons.{tendon.name}.slack"
        if isinstance(
            found := wider.get(path), dict
        ):  # the search's prior is wide, for tendons that came off
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
