"""The lab of a rig: one HTML file on which it moves and is estimated; sliders change the true
rig.
"""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Mapping
from html import escape
from math import inf, log, log1p
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.confidence import BAND, COVERED_TEXT
from distal.estimators.estimator_protocol import DEAD
from distal.export.c_source import filled
from distal.logs import write_whole
from distal.reports.page import page, resource
from distal.results import COLOURS
from distal.rig import Rig, angle_names, log_factor, number
from distal.rig.components import REACH
from distal.run.health import HEALTH
from distal.simulation.plant import equilibrium
from distal.units import unit_factor
from tools.lab.chain_shape import chain_shape, tension_scale
from tools.lab.plant_source import ExportedPlant, resting_inputs
from tools.lab.webassembly import LabModule, lab_module

WINDOW = 12.0
"""Length of the time axis of the curves [s]. Source: layout."""

FACTORS = {
    "friction": (
        "friction",
        r"friction\.(coefficient|constant|load)$|path\.friction$|hysteresis\.(constant|slope)$",
    ),
    "stiffness": ("tendon stiffness", r"^tendons\.\d+\.stiffness$"),
    "pretension": ("pre-tension", r"^tendons\.\d+\.pretension$"),
    "arm": (
        "moment arms",
        r"^tendons\.\d+\.(insertion|crossings\.\d+)\.(radius|arm|offset|lever)$",
    ),
}
"""Name of a slider → its label, and the pattern of the plant's parameters that it multiplies."""

EXPERIMENTS: dict[str, tuple[dict[str, float], str]] = {
    "As described": (
        {},
        "Everything is as the rig file says: the band is as wide as what the file leaves unknown.",
    ),
    "Friction × 3": (
        {"friction": 1.585},
        "Friction holds the joint back while the tendons stretch. The filter learns how much, as "
        "far as its prior allows.",
    ),
    "Soft tendons": (
        {"stiffness": -1},
        "Tendons half as stiff stretch twice as far: that is what inextensible tendons leave out.",
    ),
    "Hang a load on": (
        {"load": 0.6},
        "A constant torque pulls the joint. What is not declared is taken for friction or "
        "something else.",
    ),
    "Wrong moment arms": (
        {"arm": 0.1375},
        "Arms 10 % larger than in the file: no sensor at the motors can tell. A reference is "
        "needed once, to fit.",
    ),
    "Unplug a sensor": (
        {"dead": 1},
        f"$sensor$ is dead. After {DEAD:g} s the health says so, and the band grows: what the "
        "sensor told is not known any more.",
    ),
}
"""Name of an experiment → settings of the sliders, and a text that says what to look at in it.

Factors are powers of two, a load is a share of the largest one, and of the sensors that are read
the first is dead.
"""

POSTURES = 17
"""Number of angles of each joint at which the positions of the drives are computed. Source:
judgement.
"""

STIFF = 20.0
"""Ratio of the stiffness of a drive's position loop to that of its tendons. Source: judgement."""


def lab_page(rig: Rig, path: str | Path, estimator: str | None = None, source: str = "RIG") -> Path:
    """Write the lab of a rig as one HTML file and return its path; the page fetches nothing when
    opened.

    The filter believes the rig, and the true rig is the same until a slider is moved.

    Args:
        estimator: name of the filter.
        source: what the rig is called in the command that the page shows.

    Raises:
        ExportError: ziglang is not installed or failed, or the plant or the filter cannot be
            written in C.
        EstimationError: the estimator cannot run on this rig.
        OutputError: the file cannot be written.
    """
    module = lab_module(rig, estimator)
    constants = _constants(rig, module, source)
    parts = [
        f"<style>{resource('lab.css', 'tools.lab')}</style>",
        _body(rig, module, constants),
        _script_with(
            "lab-data",
            constants,
            resource("chain.js", "tools.lab"),
            resource("lab.js", "tools.lab"),
        ),
    ]
    lead = (
        "The rig moves in your browser, and a filter says where its joints are from what its "
        "motors measure. Change what "
        "is true, while the filter still believes the rig file, and see when you can leave the "
        "encoder out."
    )
    write_whole(path, page(f"Lab: {rig.name}", lead, parts))
    return Path(path)


def _script_with(name: str, table: Mapping[str, object], *scripts: str) -> str:
    """Return the HTML of scripts and of the data that they read, which stand as JSON in an element
    called `name`.
    """
    packed = json.dumps(table, separators=(",", ":")).replace("<", "\\u003c")
    return (
        f"<script type='application/json' id='{name}'>{packed}</script>\n"
        f"<script>{''.join(scripts)}</script>"
    )


def _constants(rig: Rig, module: LabModule, source: str) -> dict[str, Any]:
    """Return the data of a rig that the page's script reads."""
    plant = module.plant
    mechanism = module.plant.plant
    n = mechanism.n_bodies
    nj = mechanism.n_joints
    most = _largest_load(rig, plant.first[2 * n : 2 * n + mechanism.n_tendons])
    names = rig.joint_names
    zeros = {sensor.of: sensor.bias.value for sensor in rig.sensors_of("position")}
    sensors = rig.sensors
    scales = [
        unit_factor(rig.log.time.unit, "s"),
        *(sensor.sign * log_factor(sensor) for sensor in sensors),
    ]
    columns = [rig.log.time.column, *(sensor.log_column for sensor in sensors)]
    columns += [f"true_{name}" for name in angle_names(names)]
    return {
        "code": base64.b64encode(module.code).decode(),
        "shape": chain_shape(rig, 0.0),
        "joints": names,
        "tendons": rig.tendon_names,
        "sensors": rig.sensor_names,
        "read": [rig.sensor_names.index(channel) for channel in module.filter.estimator.channels],
        "bodies": n,
        "interval": plant.interval,
        "band": BAND,
        "window": WINDOW,
        "numbers": len(mechanism.parameters.names),
        "told": list(module.outputs),
        "plain": module.inextensible,
        "torques": [
            [field.name, field.std, names.index(field.joint)]
            for field in module.filter.fields[len(names) :]
        ],
        "health": [[word, meaning] for word, meaning in HEALTH.items()],
        "start": plant.start.tolist(),
        "effort": resting_inputs(mechanism)[0, : mechanism.n_bodies].tolist(),
        "motion": _motion(rig),
        "positions": _positions(rig, plant),
        "servo": _servo(plant),
        "hand": [most / 0.2, 0.02 * most / 0.2],
        "loadMost": most,
        "factors": {
            factor: [
                i for i, path in enumerate(mechanism.parameters.names) if re.search(pattern, path)
            ]
            for factor, (_, pattern) in FACTORS.items()
        },
        "columns": columns,
        "scales": [*scales, *[1.0] * nj],
        "commanded": list(module.commanded),
        "zeros": [zeros.get(drive.name, 0.0) for drive in rig.drives],
        "command": f"distal estimate lab.csv --rig {source} -e {module.filter.estimator.name} "
        "gives the same angles.",
    }


def _motion(rig: Rig) -> list[dict[str, float]]:
    """Return how each joint is moved: its first angle, centre and amplitude [rad], and its pace, 1
    for the first joint.
    """
    rows = []
    for j, joint in enumerate(rig.joints):
        start = centre = joint.initial.value
        low, high = joint.travel
        if joint.stops is not None:
            centre = (low + high) / 2
        amplitude = min(0.35 * (high - low), REACH)
        rows.append(
            {"from": start, "centre": centre, "amplitude": amplitude, "pace": 1.0 - 0.27 * j % 1}
        )
    return rows


def _positions(rig: Rig, plant: ExportedPlant) -> list[dict[str, Any]]:
    """Return for each joint a table of the drives' displacements from the start, in equilibrium at
    `POSTURES` of its angles, under nominal forces.
    """
    mechanism = plant.plant
    tables = []
    nj = mechanism.n_joints
    held = resting_inputs(mechanism)
    for j, motion in enumerate(_motion(rig)):
        reach = motion["amplitude"] + abs(motion["centre"] - motion["from"])
        low = motion["from"] - reach
        high = motion["from"] + reach
        rows = []
        for angle in np.linspace(low, high, POSTURES):
            angles = plant.start[:nj].copy()
            if rig.joints[j].coupled is None:
                angles[j] = angle
            placed = (
                mechanism.spread.full() @ angles[mechanism.free]
            ) + mechanism.offsets.full().ravel()
            rows.append((equilibrium(mechanism, placed, held)[nj:] - plant.start[nj:]).tolist())
        tables.append({"from": low, "to": high, "rows": rows})
    return tables


def _servo(plant: ExportedPlant) -> list[list[float]]:
    """Return stiffness and damping of each drive's position loop, (n_drives, 2).

    The loop is `STIFF` times as stiff as the drive's tendons, with a damping ratio of 0.7.
    """
    mechanism = plant.plant
    q = ca.SX.sym("q", mechanism.n_bodies)
    p = mechanism.parameters
    stiffness = ca.mtimes(
        mechanism.length_jacobian(q).T, ca.jacobian(mechanism.elastic_forces(q), q)
    )
    function = ca.Function("servo", [q, p.symbols], [ca.diag(stiffness), mechanism.inertias()])
    diagonals = function(plant.start, p.values)
    stiffnesses, inertias = (
        np.abs(np.array(bodies)).ravel()[mechanism.n_joints :] for bodies in diagonals
    )
    k = STIFF * np.maximum(stiffnesses, 1e-6)
    return np.column_stack([k, 1.4 * np.sqrt(k * inertias)]).tolist()  # type: ignore[no-any-return]


def _largest_load(rig: Rig, tensions: Floats) -> float:
    """Return the largest torque that the slider or the hand puts on a joint [N m]: half of what the
    strongest tendon holds.
    """
    # a tendon without tension at the start counts with that of half a millimetre of elongation
    pulls = [
        pull if pull > 0.1 else 5e-4 * tendon.stiffness.value
        for tendon, pull in zip(rig.tendons, tensions)
    ]
    held = [
        sum(abs(arm) for arm in tendon.arms().values()) * pull
        for tendon, pull in zip(rig.tendons, pulls)
    ]
    return float(f"{max(0.5 * max(held, default=0.0), 1e-3):.1g}")


def _body(rig: Rig, module: LabModule, constants: dict[str, Any]) -> str:
    """Return the page's HTML."""
    most = constants["loadMost"]
    joints = [escape(joint.name) for joint in rig.joints]
    sliders = []
    for name, (label, _) in FACTORS.items():
        present = bool(constants["factors"][name]) or (
            name == "pretension" and any(constants["effort"])
        )
        reach = 0.3 if name == "arm" else 2.0  # a power of two
        sliders.append(_slider(name, label, (-reach, reach, 0.0), "×", "data-log", not present))
    sliders.append(_slider("load", "load torque", (-most, most, 0.0), "N m"))
    motion = _slider("range", "range", (0.0, 1.0, 0.7), "")
    motion += _slider("speed", "speed", (0.02, 1.0, 0.15), "Hz")
    if module.commanded:
        most_turned = float(np.rad2deg(max(row["amplitude"] for row in _motion(rig))))
        motion += "<label><input type='checkbox' id='bring'> go to the desired angle</label>"
        motion += _slider("desired", "desired angle", (-most_turned, most_turned, 0.0), "°")
    torque = (
        "<figure><svg class='chart' id='torque' role='img' aria-label='Torque from outside over "
        "time: true and estimated'></svg>"
        "<figcaption>Torque on the joint from outside: true and estimated.</figcaption></figure>"
    )
    plain = "<span class='plain'>Dashed: tendons taken as inextensible.</span>"
    blanks = {
        "experiments": "".join(
            f"<button type='button' aria-pressed='{str(not settings).lower()}' "
            f"data-set='{escape(json.dumps(settings))}' "
            f"data-why='{escape(why)}'>{name}</button>"
            for name, settings, why in _experiments(rig, module, constants)
        ),
        "scale": tension_scale("<span id='most'></span> N"),
        "rows": "".join(
            f"<tr><td>{name}</td><td class='n' id='now-{j}'></td><td class='n' "
            f"id='true-{j}'></td></tr>"
            for j, name in enumerate(joints)
        ),
        "choices": "".join(
            f"<option value='{j}'{' selected' * (j == len(joints) - 1)}>{name}</option>"
            for j, name in enumerate(joints)
        ),
        "blue": COLOURS[0],
        "level": COVERED_TEXT,
        "estimator": escape(module.filter.estimator.name),
        "plain": plain if module.inextensible else "",
        "torque": torque if constants["torques"] else "",
        "sliders": "".join(sliders),
        "dead": "".join(
            f"<label><input type='checkbox' id='dead-{i}'> "
            f"{escape(constants['sensors'][i])}</label>"
            for i in constants["read"]
        ),
        "motion": motion,
    }
    return filled(resource("lab.html", "tools.lab"), blanks)


def _slider(
    name: str,
    label: str,
    ends: tuple[float, float, float],
    unit: str,
    mark: str = "",
    hidden: bool = False,
) -> str:
    """Return the HTML of a slider with its label; `ends` are its lowest, highest and first
    value.
    """
    low, high, first = ends
    values = (
        f"min='{low:g}' max='{high:g}' step='{(high - low) / 200:.6g}' value='{first:g}' "
        f"data-unit='{unit}'"
    )
    return (
        f"<label for='set-{name}'{' hidden' * hidden}>{label} <output id='{name}-said'></output>"
        f"<input type='range' id='set-{name}' name='{name}' {values} {mark}></label>"
    )


def _experiments(
    rig: Rig, module: LabModule, constants: dict[str, Any]
) -> list[tuple[str, dict[str, Any], str]]:
    """Return the experiments that are possible with a rig: name, settings of the sliders, and
    text.
    """
    possible = []
    first = constants["read"][:1]
    sensor = {"sensor": ", ".join(constants["sensors"][i] for i in first)}
    for name, (changes, text) in EXPERIMENTS.items():
        if not all(constants["factors"].get(key, [0]) for key in changes):
            continue
        settings: dict[str, Any] = dict(changes)
        if "load" in settings:
            settings["load"] *= constants["loadMost"]
        if "dead" in settings:
            settings["dead"] = first
        filled_text = filled(text, sensor) + _distance(rig, module, constants, settings)
        possible.append((name, settings, filled_text))
    return possible


def _distance(
    rig: Rig, module: LabModule, constants: dict[str, Any], changes: dict[str, Any]
) -> str:
    """Return a sentence that says how far a change of the true rig is off what the rig file takes
    for known, in its standard deviations.
    """
    factor = next((key for key in changes if key in FACTORS), None)
    if factor is not None:
        values = [
            number(rig, module.plant.plant.parameters.names[i])
            for i in constants["factors"][factor]
        ]
        share = min(one.std / abs(one.value) for one in values if one.value)
        stds = abs(changes[factor]) * log(2.0) / log1p(share) if share else inf
        known = f"{FACTORS[factor][0]} as {f'known to ± {100 * share:.2g} %' if share else 'exact'}"
    elif "load" in changes:
        std = min(joint.external_torque.std for joint in rig.joints)
        stds = changes["load"] / std if std else inf
        known = f"a torque from outside as {f'± {std:.2g} N m' if std else 'none'}"
    else:
        return ""
    off = "" if stds == inf else f": this is {stds:.1f} standard deviations off"
    return f" The rig file takes {known}{off}."
