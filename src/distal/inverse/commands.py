"""Commands of drives over time, and the angles that they reach."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from distal.arrays import Floats
from distal.confidence import BAND
from distal.logs import write_columns
from distal.results import BAND_ALPHA, BLACK, COLOURS, DASHES, figure, legend_above, save_figure
from distal.rig import Rig, angle_names, gain_of, log_factor, position_unit, std_name
from distal.units import unit_factor

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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
        columns = {rig.log.time.column: self.time / unit_factor(rig.log.time.unit, "s")}
        for i, drive in enumerate(rig.drives):
            units = {
                "position": position_unit(drive),
                "force": "N" if drive.kind == "slider" else "N m",
            }
            for kind, values in (("position", self.sent[:, i]), ("force", self.forces[:, i])):
                sensor = next(
                    (one for one in rig.sensors if one.of == drive.name and one.measures == kind),
                    None,
                )
                if sensor is None:
                    columns[f"{drive.name}_{kind} [{units[kind]}]"] = values
                else:
                    # what is sent is a reading already
                    read = (
                        values
                        if kind == "position"
                        else gain_of(sensor).value * values + sensor.bias.value
                    )
                    columns[sensor.log_column] = sensor.sign * read / log_factor(sensor)
            columns[f"{drive.name}_speed [{units['position']}/s]"] = self.speeds[:, i]
        for j, name in enumerate(angle_names(rig.joint_names)):
            factor = unit_factor(unit, "rad")
            columns[f"{name} [{unit}]"] = self.angles[:, j] / factor
            columns[f"{std_name(name)} [{unit}]"] = self.stds[:, j] / factor
        return columns

    def write(self, path: str | Path, unit: str = "rad") -> None:
        """Write `columns` to a CSV or Parquet file, angles in a `unit`, "rad" or "deg".

        Raises:
            OutputError: the file cannot be written.
        """
        write_columns(self.columns(unit), path)

    def plot(
        self, path: str | Path | None = None, truth: Mapping[str, Floats] | None = None
    ) -> Figure:
        """Draw the desired and the reached angles with their 95 % band, then the drives' positions.

        Args:
            path: file of the figure; None writes none.
            truth: joint → its true angle, (k,) [rad], which is drawn too.
        """
        names = self.rig.joint_names
        rows = len(names) + 1
        with figure(rows, 1, (6.5, 1.6 + 1.6 * rows), sharex=True) as (drawing, axes):
            for j, (name, axis) in enumerate(zip(names, axes)):
                desired, angle, half = (
                    np.rad2deg(part[:, j]) for part in (self.desired, self.angles, BAND * self.stds)
                )
                axis.fill_between(
                    self.time, angle - half, angle + half, color=COLOURS[0], alpha=BAND_ALPHA, lw=0
                )
                axis.plot(
                    self.time,
                    angle,
                    color=COLOURS[0],
                    lw=1.2,
                    label="reached by the commands, 95 % band",
                )
                axis.plot(
                    self.time, desired, color=COLOURS[1], lw=1.0, dashes=(4, 2), label="desired"
                )
                if truth is not None:
                    axis.plot(self.time, np.rad2deg(truth[name]), color=BLACK, lw=1.0, label="true")
                axis.set_ylabel(f"{name} [°]")
            legend_above(axes[0])
            for i, drive in enumerate(self.rig.drives):
                scale, unit = (1e3, "mm") if drive.kind == "slider" else (180 / np.pi, "°")
                look = {
                    "color": COLOURS[i % 6],
                    "linestyle": DASHES[i % 6],
                    "label": f"{drive.name} [{unit}]",
                }
                axes[-1].plot(self.time, scale * self.positions[:, i], **look)
            axes[-1].set_ylabel("position")
            axes[-1].set_xlabel("time [s]")
            legend_above(axes[-1])
        if path is not None:
            save_figure(drawing, path)
        return drawing
