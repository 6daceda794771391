"""From a wanted trajectory of the joints to what the drives do, for a whole trajectory at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from math import inf
from pathlib import Path
from typing import get_args

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from distal.arrays import Bools, Floats
from distal.errors import CommandError
from distal.inverse.command import FARTHEST, CommandModel
from distal.inverse.commands import Commands
from distal.inverse.distribution import Prefer
from distal.inverse.held import held_kernel, held_layout
from distal.inverse.learned import LearnedShift
from distal.inverse.reached import place_variances, spread_kernel, stiffness_function
from distal.inverse.readings import readings
from distal.inverse.servo import followable, sent
from distal.kernels import Advanced, Feed, Kernel, advance
from distal.rig import Rig, load_rig
from distal.rounded import rounded
from distal.run import LOST
from distal.simulation.plant import inside_function
from distal.units import to_si

Indices = NDArray[np.intp]

LEAST_TENSION = 1.0
"""Tension that every tendon keeps where nothing else is asked for [N]."""

SLACKEST, TAUTEST = 0.1, 500.0
"""Between these a tension is looked for that makes a joint stiff [N]."""

NEAR = float(np.deg2rad(0.1))
"""An angle that is missed by less is reached [rad]."""

SETTLES = 3
"""Rounds until the drives' places and what moves inside agree at the start."""

NAMED = 3
"""So many joints are named that are not where they are wanted."""

TINY = 1e-9
"""Places that differ by less are one [m, rad], as are pulls [N]."""

SHARE = 1.02
"""A limit counts as passed from this multiple of it on."""


def least_tension_of(value: float | str, rig: Rig) -> float:
    """Return a least tension [N], given in newtons or as a text with a unit.

    Raises:
        CommandError: it is none, or no tendon of the rig can have it.
    """
    try:
        tension = to_si(value, "N")
    except ValueError as problem:
        raise CommandError(f"least_tension: {problem}") from None
    if not 0.0 <= tension < inf:
        raise CommandError(f"least_tension: at least 0 N, {value} came")
    for tendon in rig.tendons:
        most = max(FARTHEST * tendon.stiffness.value, TAUTEST)
        if tension > most:
            raise CommandError(
                f"least_tension: {value} would stretch tendon '{tendon.name}' by more than "
                f"{FARTHEST:g} m; up to {rounded(most, 3)} N can be"
            )
    return tension


class Inverse:
    """What drives have to do so that the joints get to wanted angles: places, speeds and forces,
    and the band of the angle.

    ```python
    commands = distal.Inverse("finger-2n")(time, {"mcp": mcp, "pip": pip})  # [s], [rad]
    commands.write("commands.csv")
    ```

    Friction is made up for in the direction of motion, and stretch, plays and creep by the model;
    see `CommandModel`.

    Args:
        rig: the description, or a shipped rig's name, or a path.
        least_tension: that every tendon keeps where there are more of them than joints: newtons, or
            a text with a unit.
        prefer: what is least there, "tension" or "heat": the sum of the pulls, or of their squares.

    Raises:
        CommandError: the tension or the preference is none.
        RigError: the rig is unknown or wrong.
    """

    def __init__(
        self,
        rig: Rig | str | Path,
        *,
        least_tension: float | str = LEAST_TENSION,
        prefer: Prefer = "tension",
        compiled: bool = True,
    ) -> None:
        self.rig = rig if isinstance(rig, Rig) else load_rig(rig)
        self.least_tension = least_tension_of(least_tension, self.rig)
        if prefer not in get_args(Prefer):
            raise CommandError(f"prefer: {' or '.join(get_args(Prefer))}, {prefer!r} came")
        self.model = CommandModel(self.rig, prefer)
        self._compiled = compiled
        self._kernel = Kernel(self.model.function(), compiled)
        self._band = Kernel(spread_kernel(self.model), compiled)

    @cached_property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints that move by themselves, whose angles are wanted."""
        return tuple(self.rig.joints[j].name for j in self.model.free)

    def __call__(
        self, time: Sequence[float] | Floats, angles: Floats | Mapping[str, Floats]
    ) -> Commands:
        """Return the commands for wanted angles over time.

        Args:
            time: rising stamps [s], (k,); the closer, the better jumps are resolved.
            angles: of the joints that move by themselves [rad], (k, n_free) in their order, or by
                their names.

        Raises:
            CommandError: the shapes do not fit, a joint is missing or unknown, or a number is not
                finite.
        """
        stamps = np.asarray(time, dtype=np.float64)
        wanted = self._wanted(stamps, angles)
        notes, held = self._within_stops(stamps, wanted)
        added = unsure = np.zeros((len(stamps), len(self.rig.joints)))
        run = self._run(stamps, held)
        if self._learned is not None:
            shift, unsure = self._learned(stamps, self._readings(run))
            unsure = np.where(np.sqrt(unsure) <= LOST, unsure, 0.0)
            if self._learned.is_constant:
                added = shift
                run = self._run(stamps, held - added[:, self.model.free])
        read = {name: self.model.y.view(run.ys, name) for name in self.model.y.names}
        mechanism, full = self.model.mechanism, np.array(self.model.mechanism.spread)
        offsets, places = np.array(mechanism.offsets).ravel(), read["places"]
        got = self._followed(stamps, places)
        cut = self._cut(run, read, got)
        rows = np.flatnonzero(cut.any(axis=1))
        angles = self._held(run, read["angles"], got, rows)
        reached = angles + added[:, self.model.free]
        ahead = np.column_stack(
            [sent(stamps, places[:, i], drive) for i, drive in enumerate(self.rig.drives)]
        )
        stds = np.sqrt(self._variances(angles, got, run.carries, rows))
        notes += [
            *self._not_reached(stamps, held, reached, cut),
            *self._beyond(stamps, read, run.carries),
        ]
        return Commands(
            self.rig,
            stamps,
            wanted=wanted @ full.T + offsets,
            angles=reached @ full.T + offsets,
            stds=np.sqrt((stds @ np.abs(full).T) ** 2 + unsure),
            places=places,
            sent=readings(self.model, ahead),
            speeds=np.gradient(places, stamps, axis=0),
            forces=read["forces"],
            tensions=read["tensions"],
            notes=tuple(notes),
        )

    def _followed(self, time: Floats, places: Floats) -> Floats:
        """Return the places of drives no faster than these can go, (k, n_drives)."""
        servos = [drive.servo for drive in self.rig.drives]
        fastest = [inf if s is None or s.fastest is None else s.fastest for s in servos]
        each = zip(places.T, fastest)
        return np.column_stack([followable(time, place, most) for place, most in each])

    def _cut(self, run: Advanced, read: Mapping[str, Floats], got: Floats) -> Bools:
        """Return where drives are not at the places at which joints are as wanted, (k,
        n_drives).
        """
        asked = self.model.carry.view(run.carries, "places")
        cut: Bools = (np.abs(asked - got) > TINY) | (np.abs(read["short"]) > TINY)
        return cut

    def _held(self, run: Advanced, angles: Floats, places: Floats, cut: Indices) -> Floats:
        """Return the angles of free joints, in the rows where drives were `cut` those at which they
        rest, (k, n_free) [rad].
        """
        if not len(cut):
            return angles
        layout, rows = held_layout(self.model), np.zeros((len(angles), 1))
        rows[cut] = 1.0
        inside = self.model.carry.view(run.carries, "inside")
        parts = {"angles": angles, "places": places, "inside": inside, "cut": rows}
        feed = np.column_stack([parts[name] for name in layout.names])
        kernel = Kernel(held_kernel(self.model), self._compiled)
        begin = np.append(angles[0], 0.0)
        return advance(kernel, Feed(begin, feed, self._numbers)).ys

    def _run(self, time: Floats, angles: Floats) -> Advanced:
        rows = self._rows(time, angles)
        return advance(self._kernel, Feed(self._begin(rows[0]), rows, self._numbers))

    @cached_property
    def _learned(self) -> LearnedShift | None:
        """What maps of a fit add to the angles; None where there is none."""
        return None if self.rig.discrepancy is None else LearnedShift(self.rig, self._compiled)

    def _readings(self, run: Advanced) -> dict[str, dict[str, Floats]]:
        """Return what sensors of drives and tendons would read in a run."""
        view, rig = self.model.y.view, self.rig
        at = readings(self.model, view(run.ys, "places"))
        of = {"position": at, "force": view(run.ys, "forces")}
        found = {
            kind: {drive.name: part[:, i] for i, drive in enumerate(rig.drives)}
            for kind, part in of.items()
        }
        tensions = view(run.ys, "tensions")
        return found | {
            "tension": {tendon.name: tensions[:, i] for i, tendon in enumerate(rig.tendons)}
        }

    def stiffness(
        self, angles: Sequence[float] | Floats | Mapping[str, float], tension: float | str
    ) -> Floats:
        """Return how stiff each free joint is at rest, its drives and the other joints held,
        (n_free,) [N m/rad].

        Args:
            angles: of the free joints [rad], in their order or by name.
            tension: least tension of the tendons: newtons, or a text with a unit.

        Raises:
            CommandError: an angle is missing, or the tension is none.
        """
        still = np.array([0.0, 1.0])
        each = (
            {name: np.full(2, angle) for name, angle in angles.items()}
            if isinstance(angles, Mapping)
            else None
        )
        wanted = self._wanted(
            still,
            each if each is not None else np.tile(np.asarray(angles, dtype=np.float64), (2, 1)),
        )
        row = self._rows(still, wanted)[0]
        row[self.model.x["lowest"]] = least_tension_of(tension, self.rig)
        carry = self._begin(row)
        places, inside = carry[self.model.carry["places"]], carry[self.model.carry["inside"]]
        found: Floats = (
            self._stiffness(wanted[0], places, np.concatenate([self._numbers, inside]))
            .full()
            .ravel()
        )
        return found

    @cached_property
    def _stiffness(self) -> ca.Function:
        return stiffness_function(self.model)

    def pretension(
        self, angles: Sequence[float] | Floats | Mapping[str, float], stiffness: float
    ) -> float:
        """Return the least tension of the tendons at which each free joint is so stiff [N].

        Args:
            angles: of the free joints [rad], in their order or by name.
            stiffness: that is wanted [N m/rad].

        Raises:
            CommandError: no tension up to `TAUTEST` gives it; the message says what they give.
        """

        def lacks(tension: float) -> float:
            return stiffness - float(self.stiffness(angles, tension).min())

        if lacks(SLACKEST) <= 0.0:
            return SLACKEST
        if lacks(TAUTEST) > 0.0:
            ends = [f"{stiffness - lacks(tension):.3g}" for tension in (SLACKEST, TAUTEST)]
            raise CommandError(
                f"stiffness: {stiffness:.3g} N m/rad is more than the tendons give: {ends[0]} at "
                f"{SLACKEST:g} N, {ends[1]} "
                f"at {TAUTEST:g} N; tendons whose stiffness does not grow with their tension "
                "hardly change it"
            )
        return float(brentq(lacks, SLACKEST, TAUTEST, xtol=1e-3))

    def _wanted(self, time: Floats, angles: Floats | Mapping[str, Floats]) -> Floats:
        names = self.joints
        if isinstance(angles, Mapping):
            if set(angles) != set(names):
                raise CommandError(
                    f"angles are wanted of the joints {', '.join(names)} (coupled ones follow), "
                    f"{', '.join(angles)} came"
                )
            angles = np.column_stack([np.asarray(angles[name], dtype=np.float64) for name in names])
        wanted = (
            np.asarray(angles, dtype=np.float64).reshape(len(time), -1)
            if len(time)
            else np.zeros((0, 0))
        )
        if time.ndim != 1 or len(time) < 2 or wanted.shape != (len(time), len(names)):
            raise CommandError(
                f"wanted are {len(names)} angles ({', '.join(names)}) at each of two stamps or "
                "more; "
                f"{wanted.shape[-1]} at {len(time)} came"
            )
        unknown = np.argwhere(~np.isfinite(wanted))
        if len(unknown) or not np.isfinite(time).all():
            where = (
                f"{names[unknown[0][1]]} has none at {time[unknown[0][0]]:g} s"
                if len(unknown)
                else "a stamp is none"
            )
            raise CommandError(f"wanted angles and their stamps are finite numbers; {where}")
        if not np.all(np.diff(time) > 0.0):
            raise CommandError("stamps of wanted angles rise from one to the next")
        return wanted

    def _within_stops(self, time: Floats, wanted: Floats) -> tuple[list[str], Floats]:
        """Return what lies beyond stops in words, and the angles cut at them."""
        notes, held = list[str](), wanted.copy()
        for k, j in enumerate(self.model.free):
            joint = self.rig.joints[j]
            if joint.stops is None:
                continue
            held[:, k] = np.clip(wanted[:, k], *joint.stops)
            beyond = np.abs(held[:, k] - wanted[:, k])
            if beyond.max() > NEAR:
                low, high = np.rad2deg(joint.stops)
                notes.append(
                    f"{joint.name} is wanted {rounded(np.rad2deg(beyond.max()), 3)}° beyond its "
                    "stops "
                    f"({low:.4g} to {high:.4g}°), "
                    f"first at {time[beyond > NEAR][0]:.4g} s"
                )
        return notes, held

    def _rows(self, time: Floats, angles: Floats) -> Floats:
        speeds = np.gradient(angles, time, axis=0)
        parts = {
            "dt": np.diff(time, prepend=time[0]),
            "angles": angles,
            "speeds": speeds,
            "accelerations": np.gradient(speeds, time, axis=0),
            "torques": np.zeros((len(time), len(self.rig.joints))),
            "lowest": np.full(len(time), self.least_tension),
        }
        return np.column_stack([parts[name] for name in self.model.x.names])

    @property
    def _numbers(self) -> Floats:
        values, inside = self.model.mechanism.parameters.values, self.model.carry["inside"]
        return values[: len(values) - (inside.stop - inside.start)]

    def _begin(self, row: Floats) -> Floats:
        """Return the carry before the first sample: drives where they hold the first angles, at
        rest for long.
        """
        model, carry = self.model, np.zeros(self.model.carry.size)
        for _ in range(SETTLES):
            first = advance(self._kernel, Feed(carry, row, self._numbers))
            carry[model.carry["places"]] = model.y.view(first.ys[-1], "places")
            carry[model.carry["pulls"]] = model.carry.view(first.carries[-1], "pulls")
            if model.carry["inside"].stop > model.carry["inside"].start:
                joints = np.array(model.mechanism.spread) @ model.y.view(first.ys[-1], "angles")
                q = np.concatenate(
                    [
                        joints + np.array(model.mechanism.offsets).ravel(),
                        carry[model.carry["places"]],
                    ]
                )
                carry[model.carry["inside"]] = np.array(
                    inside_function(model.mechanism)(q, self._numbers)
                ).ravel()
        return carry

    def _variances(self, angles: Floats, places: Floats, carries: Floats, cut: Indices) -> Floats:
        """Return variances of the free joints' angles; in rows where drives were `cut`, friction
        may be either way.
        """
        view = self.model.carry.view
        turned = view(carries, "turned").copy()
        turned[cut] = 0.0
        unsure = np.tile(place_variances(self.rig), (len(angles), 1))
        rows = np.column_stack([angles, places, turned, unsure, view(carries, "inside")])
        return advance(self._band, Feed(np.zeros(1), rows, self._numbers)).ys

    def _not_reached(self, time: Floats, wanted: Floats, reached: Floats, cut: Bools) -> list[str]:
        """Return which joints do not get where they are wanted, the farthest first, in words."""
        away = np.abs(reached - wanted)
        far = [k for k in np.argsort(-away.max(axis=0)) if away[:, k].max() > NEAR]
        if not far:
            return []
        each = [
            f"{self.joints[k]} {rounded(np.rad2deg(away[:, k].max()))}° (first at "
            f"{time[away[:, k] > NEAR][0]:.4g} s)"
            for k in far[:NAMED]
        ]
        more = f" and {len(far) - NAMED} more" if len(far) > NAMED else ""
        names = [self.rig.drives[i].name for i in np.flatnonzero(cut.any(axis=0))]
        why = (
            f"{', '.join(names)} cannot do what is wanted, which leaves joints off by up to"
            if names
            else "fewer drives than joints, these follow their springs, off by up to"
        )
        return [f"{why}: {', '.join(each)}{more}"]

    def _beyond(self, time: Floats, read: Mapping[str, Floats], carries: Floats) -> list[str]:
        """Return which limits of drives are passed, and which tendons would go slack, in words."""
        notes = []
        asked = self.model.carry.view(carries, "places")
        for i, drive in enumerate(self.rig.drives):
            unit = "N" if drive.kind == "slider" else "N m"
            needed = read["forces"][:, i] + self.model.radius(i) * read["short"][:, i]
            largest = float(np.abs(needed).max())
            if drive.limit is not None and largest > SHARE * drive.limit:
                notes.append(
                    f"{drive.name} would need {largest:.3g} {unit}, its limit is "
                    f"{drive.limit:.3g} {unit}"
                )
            servo = drive.servo
            fastest = float(np.abs(np.gradient(read["places"][:, i], time)).max())
            if servo is not None and servo.fastest is not None and fastest > SHARE * servo.fastest:
                notes.append(
                    f"{drive.name} would need a speed of {fastest:.3g}, it reaches "
                    f"{servo.fastest:.3g}: it is late there"
                )
            cut = np.abs(asked[:, i] - read["places"][:, i]) > TINY
            if drive.stops is not None and cut.any():
                low, high = drive.stops
                notes.append(
                    f"{drive.name} would have to go beyond its range [{low:.4g}, {high:.4g}], "
                    f"first at {time[cut][0]:.4g} s"
                )
        for i, tendon in enumerate(self.rig.tendons):
            slack = read["tensions"][:, i] < 0.5 * min(self.least_tension, 1e-3)
            if slack.any():
                notes.append(f"tendon {tendon.name} goes slack, first at {time[slack][0]:.4g} s")
        return notes
