"""Commands of drives over time, the angles that they reach, and what they cannot do, in words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from distal.arrays import Bools, Floats
from distal.inverse.feedforward import TURNS, CommandModel
from distal.logs import write_columns
from distal.rig import Rig, angle_names, effort_unit, gain_of, log_factor, position_unit, std_name
from distal.units import rounded, unit_factor

NAMED_JOINTS = 3
"""Number of joints that are named as not at their desired angles. Source: layout."""

TINY = 1e-9
"""Difference up to which two positions [m, rad], or two pulls [N], are equal. Source: rounding
(positions and pulls that are equal).
"""


@dataclass(frozen=True, repr=False)
class Commands:
    """Commands of the drives over time, and the angles of the joints that they reach, SI.

    Args:
        time: stamps [s], (k,).
        desired: desired angles, (k, n_joints) [rad].
        angles: angles that the commands reach by the model, (k, n_joints) [rad].
        stds: standard deviations of the true angles about `angles` in an open loop, (k, n_joints)
            [rad].
        positions: of the drives, (k, n_drives) [m, rad].
        sent: setpoints of drives that follow positions, as their sensors read them: they make up
            for lag, delay and compliance of the rig's `servo`, (k, n_drives) [m, rad].
        speeds: of the drives, (k, n_drives) [m/s, rad/s].
        forces: of the drives, (k, n_drives) [N, N m].
        tensions: of the tendons at their drives, (k, n_tendons) [N].
        notes: what cannot be reached, and why.
    """

    rig: Rig
    time: Floats
    desired: Floats
    angles: Floats
    stds: Floats
    positions: Floats
    sent: Floats
    speeds: Floats
    forces: Floats
    tensions: Floats
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return (
            f"Commands({self.rig.name}, {len(self.time)} samples, "
            f"{self.time[-1] - self.time[0]:g} s)"
        )

    def columns(self, unit: str = "rad") -> dict[str, Floats]:
        """Return the columns of a file of commands: setpoints and forces of the drives, in the
        columns and units of the rig's sensors, their speeds, then the reached angles and their
        stds.

        The position of a drive is the one that is `sent`. A drive without a sensor of its position
        or force has columns in SI: ``DRIVE_position [m]``, ``DRIVE_force [N]``.

        Args:
            unit: of the angles, "rad" or "deg".
        """
        rig = self.rig
        read = expected_readings(rig, self.sent, self.forces, self.tensions)
        sensors = {(sensor.of, sensor.measures): sensor for sensor in reversed(rig.sensors)}
        columns = {rig.log.time.column: self.time / unit_factor(rig.log.time.unit, "s")}
        for i, drive in enumerate(rig.drives):
            for kind, own, values in (
                ("position", position_unit(drive), self.sent),
                ("force", effort_unit(drive), self.forces),
            ):
                sensor = sensors.get((drive.name, kind))
                if sensor is None:
                    columns[f"{drive.name}_{kind} [{own}]"] = values[:, i]
                else:
                    read_there = sensor.sign * read[sensor.name]
                    columns[sensor.log_column] = read_there / log_factor(sensor)
            columns[f"{drive.name}_speed [{position_unit(drive)}/s]"] = self.speeds[:, i]
        factor = unit_factor(unit, "rad")
        for j, name in enumerate(angle_names(rig.joint_names)):
            columns[f"{name} [{unit}]"] = self.angles[:, j] / factor
            columns[f"{std_name(name)} [{unit}]"] = self.stds[:, j] / factor
        return columns

    def write(self, path: str | Path, unit: str = "rad") -> None:
        """Write `columns` to a CSV or Parquet file, angles in a `unit`, "rad" or "deg".

        Raises:
            OutputError: the file cannot be written.
        """
        write_columns(self.columns(unit), path)


def expected_readings(
    rig: Rig, positions: Floats, forces: Floats, tensions: Floats
) -> dict[str, Floats]:
    """Return what the sensors of drives and tendons would read, by sensor, (k,) each [SI].

    Args:
        positions: as the drives' sensors read them, (k, n_drives) [m, rad].
        forces: of the drives, (k, n_drives) [N, N m].
        tensions: of the tendons at their drives, (k, n_tendons) [N].
    """
    of = {
        "position": dict(zip(rig.drive_names, positions.T)),
        "force": dict(zip(rig.drive_names, forces.T)),
        "tension": dict(zip([tendon.name for tendon in rig.tendons], tensions.T)),
    }
    found = {}
    for sensor in rig.sensors:
        true = of.get(sensor.measures, {}).get(sensor.of)
        if true is not None and sensor.measures == "position":
            found[sensor.name] = true
        elif true is not None:
            found[sensor.name] = gain_of(sensor).value * true + sensor.bias.value
    return found


def within_stops(model: CommandModel, time: Floats, desired: Floats) -> tuple[list[str], Floats]:
    """Return which desired angles lie beyond stops, in words, and the angles limited to the stops,
    (k, n_free) [rad].

    Args:
        model: the inverse of the rig.
        time: stamps [s], (k,).
        desired: angles of the free joints [rad], (k, n_free).
    """
    joints = [model.rig.joints[j] for j in model.free]
    stops = np.array([joint.stops or (-np.inf, np.inf) for joint in joints])
    held = np.clip(desired, *stops.T)
    notes = []
    for joint, (low, high), beyond in zip(joints, np.rad2deg(stops), np.abs(held - desired).T):
        if beyond.max() > TURNS:
            notes.append(
                f"{joint.name} is wanted {rounded(np.rad2deg(beyond.max()), 3)}° beyond its stops "
                f"({low:.4g} to {high:.4g}°), {_first(time, beyond > TURNS)}"
            )
    return notes, held


def not_reached(
    model: CommandModel, time: Floats, desired: Floats, reached: Floats, cut: Bools
) -> list[str]:
    """Return which joints do not reach their desired angles, in words, the farthest first.

    Args:
        model: the inverse of the rig.
        time: stamps [s], (k,).
        desired: angles of the free joints [rad], (k, n_free).
        reached: angles that the free joints reach with what is sent [rad], (k, n_free).
        cut: where drives cannot do what the desired angles ask for, (k, n_drives).
    """
    joints = [model.rig.joints[j].name for j in model.free]
    away = np.abs(reached - desired)
    far = [k for k in np.argsort(-away.max(axis=0)) if away[:, k].max() > TURNS]
    if not far:
        return []
    each = [
        f"{joints[k]} {rounded(np.rad2deg(away[:, k].max()))}° ({_first(time, away[:, k] > TURNS)})"
        for k in far[:NAMED_JOINTS]
    ]
    more = f" and {len(far) - NAMED_JOINTS} more" if len(far) > NAMED_JOINTS else ""
    names = [model.rig.drives[i].name for i in np.flatnonzero(cut.any(axis=0))]
    why = (
        f"{', '.join(names)} cannot do what is wanted, which leaves joints off by up to"
        if names
        else "fewer drives than joints, these follow their springs, off by up to"
    )
    return [f"{why}: {', '.join(each)}{more}"]


def beyond(
    model: CommandModel,
    time: Floats,
    read: Mapping[str, Floats],
    asked: Floats,
    least: float,
) -> list[str]:
    """Return which limits of drives are passed, and which tendons go slack, in words.

    Args:
        model: the inverse of the rig.
        time: stamps [s], (k,).
        read: part of the kernel's output, such as "forces" → its values, (k, n) each, SI.
        asked: positions of the drives that the desired angles ask for, (k, n_drives) [m, rad].
        least: least tension of the tendons [N].
    """
    notes = []
    for i, drive in enumerate(model.rig.drives):
        unit = effort_unit(drive)
        needed = read["forces"][:, i] + drive.lever * read["short"][:, i]
        largest = float(np.abs(needed).max())
        if _is_passed(largest, drive.limit):
            notes.append(
                f"{drive.name} would need {largest:.3g} {unit}, its limit is "
                f"{drive.limit:.3g} {unit}"
            )
        reaches = None if drive.servo is None else drive.servo.fastest
        fastest = float(np.abs(np.gradient(read["positions"][:, i], time)).max())
        if _is_passed(fastest, reaches):
            notes.append(
                f"{drive.name} would need a speed of {fastest:.3g}, it reaches {reaches:.3g}: it "
                "is late there"
            )
        cut = np.abs(asked[:, i] - read["positions"][:, i]) > TINY
        if drive.stops is not None and cut.any():
            low, high = drive.stops
            notes.append(
                f"{drive.name} would have to go beyond its range [{low:.4g}, {high:.4g}], "
                f"{_first(time, cut)}"
            )
    for i, tendon in enumerate(model.rig.tendons):
        slack = read["tensions"][:, i] < 0.5 * min(least, 1e-3)
        if slack.any():
            notes.append(f"tendon {tendon.name} goes slack, {_first(time, slack)}")
    return notes


def _is_passed(needed: float, limit: float | None) -> bool:
    """Return whether a limit is passed by as much as the three digits show that are said of it."""
    return limit is not None and float(f"{needed:.3g}") > float(f"{limit:.3g}")


def _first(time: Floats, at: Bools) -> str:
    """Return in words when something is so for the first time."""
    return f"first at {time[at][0]:.4g} s"
