"""Commands of the drives for a whole desired trajectory of the joints at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
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
from distal.estimators import LARGEST_ANGLE
from distal.inverse.commands import Commands
from distal.inverse.distribution import Prefer
from distal.inverse.expected_readings import readings
from distal.inverse.held import held_kernel, held_layout
from distal.inverse.learned import LearnedShift
from distal.inverse.least_tension import LEAST_TENSION, SLACKEST, TAUTEST, least_tension_of
from distal.inverse.out_of_reach import TINY, beyond, not_reached, within_stops
from distal.inverse.reached import position_variances, spread_kernel, stiffness_function
from distal.inverse.servo import followable, gives_way, sent
from distal.inverse.setpoint_function import CommandModel
from distal.kernels import Advanced, Feed, Kernel, advance, kernel_of, structure_of
from distal.rig import Rig, as_rig
from distal.run import LOST
from distal.simulation.plant import inside_function

Indices = NDArray[np.intp]

SETTLES = 3
"""Number of rounds in which the drives' positions and the internal state are made to agree at the
start. Source: judgement.
"""


class Inverse:
    """Commands of the drives that bring the joints to desired angles: positions, speeds and forces,
    with the band of the angles.

    ```python
    commands = distal.Inverse("finger-2n")(time, {"mcp": mcp, "pip": pip})  # [s], [rad]
    commands.write("commands.csv")
    ```

    The commands compensate friction in the direction of motion, and stretch, backlash and creep by
    the model; see `CommandModel`.

    Args:
        rig: the description, or a shipped rig's name, or a path.
        least_tension: tension that commands keep in each tendon that has a drive of its own:
            newtons, or a text with a unit.
        prefer: what is least where there are more drives than joints: "tension", the sum of the
            pulls, or "heat", the sum of their squares.

    Raises:
        CommandError: `least_tension` is no tension that the tendons can have, or `prefer` is
            unknown.
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
        self.rig = as_rig(rig)
        self.least_tension = least_tension_of(least_tension, self.rig)
        if prefer not in get_args(Prefer):
            raise CommandError(f"prefer: {' or '.join(get_args(Prefer))}, {prefer!r} came")
        self.model = CommandModel(self.rig, prefer)
        self._compiled = compiled
        self._kernel = self._kernel_of("command", CommandModel.function)
        self._band = self._kernel_of("band", spread_kernel)

    def _kernel_of(self, kind: str, make: Callable[[CommandModel], ca.Function]) -> Kernel:
        model = self.model
        prefer = self.model.prefer
        structure = structure_of(kind, model.mechanism, prefer=prefer)
        return kernel_of(structure, lambda: make(model), self._compiled)

    @cached_property
    def joints(self) -> tuple[str, ...]:
        """Names of the free joints, whose angles are desired; the other joints follow these."""
        return tuple(self.rig.joints[j].name for j in self.model.free)

    def __call__(
        self, time: Sequence[float] | Floats, angles: Floats | Mapping[str, Floats]
    ) -> Commands:
        """Return the commands for desired angles over time.

        Args:
            time: rising stamps [s], (k,); the closer they are, the better jumps are resolved.
            angles: desired angles of the free joints [rad], (k, n_free) in their order, or by name.

        Raises:
            CommandError: the shapes do not fit, a joint is missing or unknown, stamps do not rise,
                or a number is not finite or far beyond any joint's angle.
        """
        stamps = np.asarray(time, dtype=np.float64)
        desired = self._desired(stamps, angles)
        notes, held = within_stops(self.model, stamps, desired)
        added = unsure = np.zeros((len(stamps), len(self.rig.joints)))
        run = self._run(stamps, held)
        if self._learned is not None:
            added, unsure = self._learned(stamps, self._readings(run))
            # far from the logs a map says nothing, and the rig is taken as it is described
            lost = np.sqrt(unsure) > LOST
            added, unsure = (np.where(lost, 0.0, part) for part in (added, unsure))
            run = self._run(stamps, held - added[:, self.model.free])
        read = {name: self.model.y.view(run.ys, name) for name in self.model.y.names}
        mechanism = self.model.mechanism
        full = np.array(self.model.mechanism.spread)
        offsets = np.array(mechanism.offsets).ravel()
        positions = read["positions"]
        got = self._followed(stamps, positions)
        cut = self._cut(run, read, got)
        rows = np.flatnonzero(cut.any(axis=1))
        angles = self._held(run, read["angles"], got, rows)
        reached = angles + added[:, self.model.free]
        ahead = np.column_stack(
            [sent(stamps, positions[:, i], drive) for i, drive in enumerate(self.rig.drives)]
        )
        soft, dead = gives_way(self.rig)
        ahead += soft * read["forces"] + dead * self.model.kernel_state.view(
            run.kernel_states, "drives_turned"
        )
        stds = np.sqrt(self._variances(angles, got, run.kernel_states, rows))
        notes += [
            *not_reached(self.model, stamps, held, reached, cut),
            *beyond(self.model, stamps, read, run.kernel_states, self.least_tension),
        ]
        return Commands(
            self.rig,
            stamps,
            desired=desired @ full.T + offsets,
            angles=reached @ full.T + offsets,
            stds=np.sqrt((stds @ np.abs(full).T) ** 2 + unsure),
            positions=positions,
            sent=readings(self.model, ahead),
            speeds=np.gradient(positions, stamps, axis=0),
            forces=read["forces"],
            tensions=read["tensions"],
            notes=tuple(notes),
        )

    def _followed(self, time: Floats, positions: Floats) -> Floats:
        """Return the positions of drives no faster than these can go, (k, n_drives)."""
        servos = [drive.servo for drive in self.rig.drives]
        fastest = [inf if s is None or s.fastest is None else s.fastest for s in servos]
        each = zip(positions.T, fastest)
        return np.column_stack([followable(time, position, most) for position, most in each])

    def _cut(self, run: Advanced, read: Mapping[str, Floats], got: Floats) -> Bools:
        """Return where a drive's position or pull is not the one that the desired angles ask for,
        (k, n_drives).
        """
        asked = self.model.kernel_state.view(run.kernel_states, "positions")
        cut: Bools = (np.abs(asked - got) > TINY) | (np.abs(read["short"]) > TINY)
        return cut

    def _held(self, run: Advanced, angles: Floats, positions: Floats, cut: Indices) -> Floats:
        """Return the angles of the free joints, (k, n_free) [rad]; in the rows `cut`, where a drive
        cannot do what is asked, the angles at which they rest.
        """
        if not len(cut):
            return angles
        layout = held_layout(self.model)
        rows = np.zeros((len(angles), 1))
        rows[cut] = 1.0
        inside = self.model.kernel_state.view(run.kernel_states, "inside")
        parts = {"angles": angles, "positions": positions, "inside": inside, "cut": rows}
        feed = np.column_stack([parts[name] for name in layout.names])
        kernel = self._kernel_of("held", held_kernel)
        begin = np.append(angles[0], 0.0)
        return advance(kernel, Feed(begin, feed, self._parameters)).ys

    def _run(self, time: Floats, angles: Floats) -> Advanced:
        rows = self._rows(time, angles)
        return advance(self._kernel, Feed(self._begin(rows[0]), rows, self._parameters))

    @cached_property
    def _learned(self) -> LearnedShift | None:
        """Corrections by the maps of a fit; None where the rig has no map."""
        return None if self.rig.map is None else LearnedShift(self.rig, self._compiled)

    def _readings(self, run: Advanced) -> dict[str, dict[str, Floats]]:
        """Return kind of sensor → drive or tendon → what such a sensor would read, (k,)."""
        view = self.model.y.view
        rig = self.rig
        at = readings(self.model, view(run.ys, "positions"))
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
        """Return the stiffness of each free joint at rest while the drives and the other joints are
        held, (n_free,) [N m/rad].

        Args:
            angles: of the free joints [rad], in their order or by name.
            tension: least tension of the tendons: newtons, or a text with a unit.

        Raises:
            CommandError: an angle is missing, or the tension is none that the tendons can have.
        """
        still = np.array([0.0, 1.0])
        each = (
            {name: np.full(2, angle) for name, angle in angles.items()}
            if isinstance(angles, Mapping)
            else None
        )
        desired = self._desired(
            still,
            each if each is not None else np.tile(np.asarray(angles, dtype=np.float64), (2, 1)),
        )
        row = self._rows(still, desired)[0]
        row[self.model.x["lowest"]] = least_tension_of(tension, self.rig)
        kernel_state = self._begin(row)
        positions = kernel_state[self.model.kernel_state["positions"]]
        inside = kernel_state[self.model.kernel_state["inside"]]
        found: Floats = (
            self._stiffness(desired[0], positions, np.concatenate([self._parameters, inside]))
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
        """Return the least tension of the tendons, from `SLACKEST` on, at which every free joint
        has a desired stiffness or more [N].

        Args:
            angles: of the free joints [rad], in their order or by name.
            stiffness: desired stiffness [N m/rad].

        Raises:
            CommandError: no tension up to `TAUTEST` gives this stiffness; the message names the
                stiffness at both ends.
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

    def _desired(self, time: Floats, angles: Floats | Mapping[str, Floats]) -> Floats:
        names = self.joints
        if isinstance(angles, Mapping):
            if set(angles) != set(names):
                raise CommandError(
                    f"angles are wanted of the joints {', '.join(names)} (coupled ones follow), "
                    f"{', '.join(angles)} came"
                )
            angles = np.column_stack([np.asarray(angles[name], dtype=np.float64) for name in names])
        desired = (
            np.asarray(angles, dtype=np.float64).reshape(len(time), -1)
            if len(time)
            else np.zeros((0, 0))
        )
        if time.ndim != 1 or len(time) < 2 or desired.shape != (len(time), len(names)):
            raise CommandError(
                f"wanted are {len(names)} angles ({', '.join(names)}) at each of two stamps or "
                "more; "
                f"{desired.shape[-1]} at {len(time)} came"
            )
        unknown = np.argwhere(~np.isfinite(desired))
        if len(unknown) or not np.isfinite(time).all():
            where = (
                f"{names[unknown[0][1]]} has none at {time[unknown[0][0]]:g} s"
                if len(unknown)
                else "a stamp is none"
            )
            raise CommandError(f"wanted angles and their stamps are finite numbers; {where}")
        far = np.argwhere(np.abs(desired) > LARGEST_ANGLE)
        if len(far):
            row, joint = far[0]
            raise CommandError(
                f"{names[joint]} is wanted at {desired[row, joint]:.3g} rad; no joint turns beyond "
                f"{LARGEST_ANGLE:g} rad"
            )
        if not np.all(np.diff(time) > 0.0):
            raise CommandError("stamps of wanted angles rise from one to the next")
        return desired

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
    def _parameters(self) -> Floats:
        values = self.model.mechanism.parameters.values
        inside = self.model.kernel_state["inside"]
        return values[: len(values) - (inside.stop - inside.start)]

    def _begin(self, row: Floats) -> Floats:
        """Return the kernel state before the first sample: the drives hold the first angles and
        have been at rest for long.
        """
        model = self.model
        kernel_state = np.zeros(self.model.kernel_state.size)
        for _ in range(SETTLES):
            first = advance(self._kernel, Feed(kernel_state, row, self._parameters))
            kernel_state[model.kernel_state["positions"]] = model.y.view(first.ys[-1], "positions")
            kernel_state[model.kernel_state["pulls"]] = model.kernel_state.view(
                first.kernel_states[-1], "pulls"
            )
            if model.kernel_state["inside"].stop > model.kernel_state["inside"].start:
                joints = np.array(model.mechanism.spread) @ model.y.view(first.ys[-1], "angles")
                q = np.concatenate(
                    [
                        joints + np.array(model.mechanism.offsets).ravel(),
                        kernel_state[model.kernel_state["positions"]],
                    ]
                )
                of_rig = self._parameters[: len(self._parameters) - len(model.derived)]
                inside = inside_function(model.mechanism)(q, of_rig)
                kernel_state[model.kernel_state["inside"]] = np.array(inside).ravel()
        return kernel_state

    def _variances(
        self, angles: Floats, positions: Floats, kernel_states: Floats, cut: Indices
    ) -> Floats:
        """Return the variances of the free joints' angles, (k, n_free) [rad²]; in the rows `cut`
        friction may act either way.
        """
        view = self.model.kernel_state.view
        turned = view(kernel_states, "turned").copy()
        turned[cut] = 0.0
        unsure = np.tile(position_variances(self.rig), (len(angles), 1))
        rows = np.column_stack([angles, positions, turned, unsure, view(kernel_states, "inside")])
        return advance(self._band, Feed(np.zeros(1), rows, self._parameters)).ys
