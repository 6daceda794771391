"""The raw descriptions of the sensors of drives and joints."""

from __future__ import annotations

from collections.abc import Mapping

from distal.from_logs.column_units import ColumnRole
from distal.from_logs.found_parts import FoundDrive, FoundJoint
from distal.from_logs.motion_data import counts_of
from distal.from_logs.raw_values import Raw, column_of, number
from distal.rig import Guess

SURE_ZERO = 0.01
"""Least standard deviation of the zero of a drive with two tendons [rad]. Source: judgement."""


RESTING = 20
"""Samples in a row with one value, from which on a sensor is quantised [1]. Source: judgement."""


ABOVE_NOISE = 1.1
"""Least step of such a sensor per its noise [1]. Source: judgement."""


def drive_sensors(drive: FoundDrive, rates: Mapping[str, float]) -> list[Raw]:
    """Return the sensors of a drive; `rates` are the columns' samples per second [Hz]."""
    sizes = drive.sizes
    column = drive.position
    position: Raw = {
        "name": f"{drive.name}_position",
        "measures": "position",
        "of": drive.name,
        "column": column_of(column),
        "unit": column.unit,
    }
    if column.si == "count":
        counts = counts_of(column)
        is_seen = column.values.turn is not None
        position["counts_per_turn"] = counts if is_seen else Guess(counts, "counts of encoders")
    if sizes.gear != 1.0:
        position["gear"] = Guess(sizes.gear, "gears of motors")
    position |= {
        "sign": sizes.position_sign,
        "rate": number(rates[column.header]),
        **_errors(column),
    }
    if sizes.is_pair:
        position["bias"] = {
            "value": number(drive.structure.zero / sizes.gear, "rad"),
            "std": number(max(drive.structure.zero_spread / sizes.gear, SURE_ZERO), "rad"),
        }
    if drive.effort is None:
        return [position]
    effort = drive.effort
    force: Raw = {
        "name": f"{drive.name}_force",
        "measures": "force",
        "of": drive.name,
        "column": column_of(effort),
        "unit": effort.unit,
    }
    if effort.si == "A":
        constant = number(sizes.torque_constant, "N m/A")
        force["torque_constant"] = Guess(constant, "forces: torque constants")
    elif effort.si == "N" and not sizes.is_slider:
        force["lever"] = Guess(number(1e3 * sizes.lever, "mm"), "lengths: levers of load cells")
    force |= {
        "sign": sizes.effort_sign,
        "rate": number(rates[effort.header]),
        **_errors(effort),
    }
    return [position, force]


def _errors(column: ColumnRole) -> Raw:
    """Return noise and resolution of a column; one that stays at a value has steps above its
    noise, so that nobody takes it for a dead sensor.
    """
    errors: Raw = {"noise": _noise(column)}
    step = column.values.step
    if column.values.stays >= RESTING:
        step = max(step, ABOVE_NOISE * column.values.noise)
    if step > 0.0 and column.si != "count":
        errors["resolution"] = number(step, column.unit)
    return errors


def _noise(column: ColumnRole) -> object:
    """Return the noise of a column in its unit, at least that of its steps."""
    noise = max(column.values.noise, 0.3 * column.values.step, 1e-6 * column.values.width)
    return number(noise, "count" if column.si == "count" else column.unit)


def reference(joint: FoundJoint, rates: Mapping[str, float]) -> Raw:
    """Return the reference sensor of a joint, whose zero is that of the joint: no log tells
    another; `rates` are the columns' samples per second [Hz].
    """
    return {
        "name": f"{joint.name}_reference",
        "measures": "angle",
        "of": joint.name,
        "column": column_of(joint.angle),
        "unit": joint.angle.unit,
        "rate": number(rates[joint.angle.header]),
        "noise": _noise(joint.angle),
    }
