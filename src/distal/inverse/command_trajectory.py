"""Commands of the drives for a whole desired trajectory of the joints at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path

import casadi as ca
import numpy as np

from distal.arrays import Bools, Floats
from distal.errors import CommandError
from distal.estimators import LARGEST_ANGLE, AdaptiveFilter, first_values
from distal.inverse.command_result import (
    TINY,
    Commands,
    beyond,
    expected_readings,
    not_reached,
    within_stops,
)
from distal.inverse.feedforward import ROUNDS
from distal.inverse.live_command_function import readings
from distal.inverse.open_loop_rest import RestModel, position_variances
from distal.inverse.servo_setpoints import followable, sent
from distal.inverse.tension_distribution import LEAST_TENSION, least_tension_of
from distal.kernels import (
    Advanced,
    Feed,
    advance,
    kernel_of,
    mean_of,
    structure_of,
    variances_of,
)
from distal.rig import Rig, as_rig
from distal.run.health import LIMITS
from distal.simulation.plant_kernel import inside_function


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

    Raises:
        CommandError: `least_tension` is no tension that the tendons can have.
        RigError: the rig is unknown or wrong.
    """

    def __init__(
        self,
        rig: Rig | str | Path,
        *,
        least_tension: float | str = LEAST_TENSION,
        compiled: bool = True,
    ) -> None:
        self.rig = as_rig(rig)
        self.least_tension = least_tension_of(least_tension, self.rig)
        self.model = model = RestModel(self.rig)
        self.joints = tuple(self.rig.joints[j].name for j in model.free)
        """Names of the free joints, whose angles are desired; the other joints follow these."""
        self._compiled = compiled
        self._parameters = model.mechanism.parameters.values[: model.n_parameters]
        self._kernel = kernel_of(structure_of("command", model.mechanism), model.function, compiled)
        self._rest = kernel_of(structure_of("rest", model.mechanism), model.rest_function, compiled)

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
        model = self.model
        drives = self.rig.drives
        stamps = np.asarray(time, dtype=np.float64)
        desired = self._desired(stamps, angles)
        notes, held = within_stops(model, stamps, desired)
        run = self._run(stamps, held)
        added = unsure = np.zeros((len(stamps), len(self.rig.joints)))
        if self._filter is not None:
            added, unsure = self._added_by_maps(self._filter, stamps, run)
            run = self._run(stamps, held - added[:, model.free])
        read = {name: model.y.view(run.ys, name) for name in model.y.names}
        positions = read["positions"]
        got = np.column_stack([followable(stamps, *each) for each in zip(positions.T, drives)])
        asked = model.kernel_state.view(run.kernel_states, "positions")
        cut = (np.abs(asked - got) > TINY) | (np.abs(read["short"]) > TINY)
        rests, variances = self._rested(run, read["angles"], got, cut)
        reached = rests + added[:, model.free]
        ahead = np.column_stack([sent(stamps, *each) for each in zip(positions.T, drives)])
        soft, dead = (
            model.of_drives(ca.DM(self._parameters), key).full().ravel() for key in ("soft", "dead")
        )
        ahead += soft * read["forces"]
        ahead += dead * model.kernel_state.view(run.kernel_states, "drives_turned")
        notes += [
            *not_reached(model, stamps, held, reached, cut),
            *beyond(model, stamps, read, asked, self.least_tension),
        ]
        spread = np.array(model.mechanism.spread)
        offsets = np.array(model.mechanism.offsets).ravel()
        return Commands(
            self.rig,
            stamps,
            desired=desired @ spread.T + offsets,
            angles=reached @ spread.T + offsets,
            stds=np.sqrt((np.sqrt(variances) @ np.abs(spread).T) ** 2 + unsure),
            positions=positions,
            sent=readings(self.rig, ahead),
            speeds=np.gradient(positions, stamps, axis=0),
            forces=read["forces"],
            tensions=read["tensions"],
            notes=tuple(notes),
        )

    def _rested(
        self, run: Advanced, angles: Floats, positions: Floats, cut: Bools
    ) -> tuple[Floats, Floats]:
        """Return the angles of the free joints at which they rest [rad] and their variances
        [rad²], (k, n_free) each. These are the desired `angles`, unless a drive is `cut`.
        """
        view = self.model.kernel_state.view
        parts = {
            "angles": angles,
            "positions": positions,
            "variances": np.tile(position_variances(self.rig), (len(angles), 1)),
            "turned": view(run.kernel_states, "turned"),
            "inside": view(run.kernel_states, "inside"),
            "cut": cut.any(axis=1, keepdims=True).astype(np.float64),
        }
        rows = np.column_stack([parts[name] for name in self.model.rest_x.names])
        begin = np.array([*angles[0], 0.0])
        ys = advance(self._rest, Feed(begin, rows, self._parameters)).ys
        return ys[:, : self.model.nf], ys[:, self.model.nf :]

    def _run(self, time: Floats, angles: Floats) -> Advanced:
        speeds = np.gradient(angles, time, axis=0)
        parts = {
            "dt": np.diff(time, prepend=time[0]),
            "angles": angles,
            "speeds": speeds,
            "accelerations": np.gradient(speeds, time, axis=0),
            "torques": np.zeros((len(time), len(self.rig.joints))),
            "lowest": np.full(len(time), self.least_tension),
        }
        rows = np.column_stack([parts[name] for name in self.model.x.names])
        return advance(self._kernel, Feed(self._begin(rows[0]), rows, self._parameters))

    def _begin(self, row: Floats) -> Floats:
        """Return the kernel state before the first sample: the drives hold the first angles and
        have been at rest for long.
        """
        model = self.model
        layout = model.kernel_state
        kernel_state = np.zeros(layout.size)
        for _ in range(ROUNDS):
            first = advance(self._kernel, Feed(kernel_state, row, self._parameters))
            positions = model.y.view(first.ys[-1], "positions")
            kernel_state[layout["positions"]] = positions
            kernel_state[layout["pulls"]] = layout.view(first.kernel_states[-1], "pulls")
            if model.n_inside:
                joints = np.array(model.spread(model.y.view(first.ys[-1], "angles"))).ravel()
                of_rig = self._parameters[: model.n_parameters - len(model.derived)]
                q = np.append(joints, positions)
                inside = inside_function(model.mechanism)(q, of_rig)
                kernel_state[layout["inside"]] = np.array(inside).ravel()
        return kernel_state

    @cached_property
    def _filter(self) -> AdaptiveFilter | None:
        """The filter whose angles the maps of a fit correct; None where the rig has no map."""
        return None if self.rig.map is None else AdaptiveFilter(self.rig, self._compiled)

    def _added_by_maps(
        self, estimator: AdaptiveFilter, time: Floats, run: Advanced
    ) -> tuple[Floats, Floats]:
        """Return what maps add to the joints' angles [rad] and the variances of that [rad²], (k,
        n_joints) each, at the readings that commands would give.

        Far from the logs a map says nothing: both are zero there, and the rig is taken as it is
        described.
        """
        y = {name: self.model.y.view(run.ys, name) for name in ("forces", "tensions")}
        at = readings(self.rig, self.model.y.view(run.ys, "positions"))
        expected = expected_readings(self.rig, at, y["forces"], y["tensions"])
        nothing = np.full(len(time), np.nan)
        samples = np.column_stack([expected.get(name, nothing) for name in estimator.channels])
        begin = estimator.initial(time[0], first_values(samples))
        kernel_states, ys = estimator.advanced(begin, time, samples)
        means = mean_of(kernel_states, begin.size)
        spreads = variances_of(kernel_states, begin.size)
        added = estimator.report.means(means.copy(), ys) - means
        variances = estimator.report.variances_of(spreads.copy(), ys) - spreads
        joints = slice(len(self.rig.joints))
        unsure = np.maximum(variances[:, joints], 0.0)
        known = np.sqrt(unsure) <= LIMITS.lost
        return np.where(known, added[:, joints], 0.0), np.where(known, unsure, 0.0)

    def _desired(self, time: Floats, angles: Floats | Mapping[str, Floats]) -> Floats:
        """Return desired angles that are checked, (k, n_free) [rad]."""
        names = self.joints
        if isinstance(angles, Mapping):
            if set(angles) != set(names):
                raise CommandError(
                    f"angles are wanted of the joints {', '.join(names)} (coupled ones follow), "
                    f"{', '.join(angles)} came"
                )
            angles = np.column_stack([np.asarray(angles[name], dtype=np.float64) for name in names])
        desired = np.asarray(angles, dtype=np.float64)
        if desired.ndim == 1:
            desired = desired[:, None]
        if time.ndim != 1 or len(time) < 2 or desired.shape != (len(time), len(names)):
            raise CommandError(
                f"wanted are {len(names)} angles ({', '.join(names)}) at each of two stamps or "
                f"more; angles of the shape {desired.shape} at {len(time)} stamps came"
            )
        if not np.isfinite(time).all() or not np.all(np.diff(time) > 0.0):
            raise CommandError("stamps of wanted angles are finite and rise from one to the next")
        wrong = np.argwhere(~(np.abs(desired) <= LARGEST_ANGLE))
        if len(wrong):
            row, joint = wrong[0]
            raise CommandError(
                f"{names[joint]} is wanted at {desired[row, joint]:.3g} rad at {time[row]:g} s; "
                f"angles are finite, and no joint turns beyond {LARGEST_ANGLE:g} rad"
            )
        return desired
