"""Commands of the drives for a whole desired trajectory: the setpoints of their servos, the angles
that the joints reach, with the band of an open loop, and what they cannot do, in words.

A setpoint is what a drive is sent so that, with its servo's speed limit, lag and delay, it follows
positions. Joints rest where friction l holds the residual torque r, |r(θ, s, p)| ≤ l, at the
drives' positions s that are really sent. At the desired angles r is zero, unless a drive is cut at
the end of its range, at its force limit or at its speed limit. Then Newton's steps find θ, from
the angles of the sample before and within the stops: far from there the geometry of a tendon has
other solutions. Since r(θ, s, p) = 0 there, dθ/dp = −(∂r/∂θ)⁻¹ ∂r/∂p. The parameters p have the
stds of the rig file, and the positions those of their sensors. A joint whose friction has not
turned over may rest anywhere within the friction limit l of that.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import compress
from math import radians
from pathlib import Path

import casadi as ca
import numpy as np
from scipy.ndimage import uniform_filter1d

from distal.arrays import Bools, Floats
from distal.errors import CommandError
from distal.estimators import LARGEST_ANGLE, AdaptiveFilter, first_values
from distal.expressions import Matrix, Vector
from distal.inverse.feedforward import (
    LEAST_TENSION,
    ROUNDS,
    STEPS,
    TURNS,
    CommandModel,
    least_tension_of,
    limited,
    solved,
    traced,
)
from distal.inverse.live_inverse import readings
from distal.inverse.motor_safety import by_drive
from distal.kernels import (
    Advanced,
    Feed,
    Layout,
    advance,
    kernel_of,
    mean_of,
    structure_of,
    variances_of,
)
from distal.logs import write_columns
from distal.rig import (
    Capstan,
    Rig,
    Slider,
    angle_names,
    as_rig,
    effort_unit,
    gain_of,
    log_factor,
    part_of,
    position_unit,
    std_name,
)
from distal.rig.components import Servo
from distal.run.health import LOST
from distal.simulation.plant import rest_function
from distal.units import rounded, unit_factor

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
    found = {}
    for measures, read in (("position", positions), ("force", forces), ("tension", tensions)):
        for sensor in rig.sensors_of(measures):
            found[sensor.name] = read[:, part_of(sensor, rig)]
            if measures != "position":
                found[sensor.name] = gain_of(sensor).value * found[sensor.name] + sensor.bias.value
    return found


def first_time(time: Floats, at: Bools, words: str) -> list[str]:
    """Return in words what is so `at` some samples, (k,), and at what `time` first [s]; nothing
    where it never is.
    """
    return [f"{words}, first at {time[at][0]:.4g} s"] if at.any() else []


def within_stops(model: CommandModel, time: Floats, desired: Floats) -> tuple[list[str], Floats]:
    """Return which desired angles lie beyond stops, in words, and the angles limited to the stops,
    (k, n_free) [rad].

    Args:
        model: the inverse of the rig.
        time: stamps [s], (k,).
        desired: angles of the free joints [rad], (k, n_free).
    """
    stops = np.array([joint.stops or (-np.inf, np.inf) for joint in model.joints])
    held = np.clip(desired, *stops.T)
    notes = []
    for name, (low, high), off in zip(model.joint_names, np.rad2deg(stops), (desired - held).T):
        far = rounded(np.rad2deg(np.abs(off).max()), 3)
        words = f"{name} is wanted {far}° beyond its stops ({low:.4g} to {high:.4g}°)"
        notes += first_time(time, np.abs(off) > TURNS, words)
    return notes, held


def not_reached(
    model: CommandModel, time: Floats, desired: Floats, reached: Floats, cut: Bools
) -> list[str]:
    """Return which joints do not reach their desired angles, in words.

    Args:
        model: the inverse of the rig.
        time: stamps [s], (k,).
        desired: angles of the free joints [rad], (k, n_free).
        reached: angles that the free joints reach with what is sent [rad], (k, n_free).
        cut: where drives cannot do what the desired angles ask for, (k, n_drives).
    """
    names = ", ".join(compress(model.rig.drive_names, np.any(cut, axis=0)))
    why = (
        f"{names} cannot do what is wanted"
        if names
        else "joints that outnumber their drives follow their springs"
    )
    notes = []
    for name, away in zip(model.joint_names, np.abs(reached - desired).T):
        off = rounded(np.rad2deg(away.max()))
        notes += first_time(time, away > TURNS, f"{name} is off by up to {off}°, as {why}")
    return notes


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
        needed = read["forces"][:, i] + drive.lever * read["short"][:, i]
        speeds = np.gradient(read["positions"][:, i], time)
        for values, limit, unit in (
            (needed, drive.limit, effort_unit(drive)),
            (speeds, (drive.servo or Servo()).fastest, f"{position_unit(drive)}/s"),
        ):
            largest = f"{np.abs(values).max():.3g}"
            if limit is not None and float(largest) > float(f"{limit:.3g}"):
                words = f"{drive.name} would need {largest} {unit}, its limit is {limit:.3g} {unit}"
                notes.append(words)
        low, high = drive.stops or (0.0, 0.0)
        words = f"{drive.name} would have to go beyond its range [{low:.4g}, {high:.4g}]"
        notes += first_time(time, np.abs(asked[:, i] - read["positions"][:, i]) > TINY, words)
    for tendon, tensions in zip(model.rig.tendon_names, read["tensions"].T):
        notes += first_time(time, tensions < 0.5 * min(least, 1e-3), f"tendon {tendon} goes slack")
    return notes


LARGEST_TURN = radians(2.0)
"""Largest turn of a joint in one of Newton's steps; within it, a joint that was left behind counts
as back at its desired angle [rad]. Source: judgement.
"""

SOFTEST = 1e-9
"""Stiffness that is added to every joint, so that a joint which nothing holds has a wide but finite
band [N m/rad]. Source: rounding (division by a stiffness of zero).
"""


class RestModel(CommandModel):
    """The inverse of a rig, with the angles at which its joints rest as a second kernel."""

    @cached_property
    def rest_x(self) -> Layout:
        """Layout of a sample of that kernel: desired angles, drives' positions and their variances,
        the directions of friction, the internal state, and whether a drive is cut.
        """
        return Layout(
            angles=self.nf,
            positions=self.nd,
            variances=self.nd,
            turned=self.nf,
            inside=self.n_inside,
            cut=1,
        )

    def rest_function(self) -> ca.Function:
        """Return the kernel (kernel_state, x, p) → (kernel_state⁺, y) of the angles at which free
        joints rest and their variances, y = (θ_free [rad], σ² [rad²]), (2 n_free,).

        The kernel state is (θ_free, whether joints were left behind). As long as they were not,
        θ_free are the desired angles.
        """
        kernel_state = ca.MX.sym("kernel_state", self.nf + 1)
        x = ca.MX.sym("x", self.rest_x.size)
        p = ca.MX.sym("p", self.n_parameters)
        came = self.rest_x.parts(x)
        parameters = ca.vertcat(p, came["inside"])
        angles = kernel_state[: self.nf]
        for _ in range(STEPS):
            step = self._step(angles, came["positions"], parameters)
            angles = self.within_stops(angles + step, parameters)
        away = ca.fabs(angles - came["angles"]) > LARGEST_TURN
        stays = ca.logic_and(kernel_state[self.nf] > 0, ca.dot(away, away) > 0)
        behind = ca.logic_or(came["cut"] > 0, stays)
        angles = ca.if_else(behind, angles, came["angles"])
        # friction may act either way where a drive is cut
        turned = came["turned"] * (1 - came["cut"])
        spread = self._spread(angles, came["positions"], turned, came["variances"], parameters)
        following = ca.vertcat(angles, behind)
        return ca.Function("rest", [kernel_state, x, p], [following, ca.vertcat(angles, spread)])

    @traced
    def _step(self, free: Vector, positions: Vector, p: Vector) -> list[Vector]:
        """Function (θ_free, s, p) → Newton's step towards rest; a joint whose residual torque
        friction holds stays.
        """
        lacks, friction = self.lacking(free, positions, ca.SX.zeros(self.nf))
        beyond = lacks - limited(lacks, friction)
        return [limited(-solved(self._slopes(lacks, free), beyond), LARGEST_TURN)]

    def _slopes(self, lacks: Vector, free: Vector) -> Matrix:
        """Return the derivatives of the residual torques by the angles."""
        return ca.jacobian(lacks, free) - SOFTEST * ca.SX.eye(self.nf)

    @traced
    def _spread(
        self, free: Vector, positions: Vector, turned: Vector, variances: Vector, p: Vector
    ) -> list[Vector]:
        """Function (θ_free, s, d, σ_s², p) → variances of θ_free [rad²].

        They follow from the variances σ_s² of the drives' positions, from friction that has not
        turned over, by its directions d, and from the stds of the rig's parameters: of each one's
        own error, and of each error that several share.
        """
        lacks, friction = self.lacking(free, positions, turned)
        slopes = self._slopes(lacks, free)
        by_positions = ca.mtimes(ca.jacobian(lacks, positions), ca.diag(ca.sqrt(variances)))
        # all torques within friction that has not turned over are equally likely: the variance is a
        # third of its square
        left = ca.sqrt(friction**2 * ca.fmax(1 - turned**2, 0) / 3)
        errors = [by_positions, ca.diag(left)]
        parameters = self.mechanism.parameters
        by_parameters = ca.jacobian(lacks, p)
        for i in np.flatnonzero(parameters.independent_stds > 0.0).tolist():
            std = self.number(p, [f"{parameters.names[i]}.std"])
            errors.append(by_parameters[:, i] * std)
        for name, (_, members) in parameters.shared.items():
            std = self.number(p, [f"shared.{name}.std"])
            errors.append(ca.mtimes(by_parameters[:, members], p[members]) * std)
        return [ca.sum2(solved(slopes, ca.horzcat(*errors)) ** 2)]


def position_variances(rig: Rig) -> Floats:
    """Return the variances of the drives' positions by the zeros and the linearity of their
    sensors, (n_drives,) [m², rad²].
    """
    # the largest error by a curve counts as two standard deviations, as in the filter
    return by_drive(
        rig, "position", lambda s: s.bias.total_std**2 + (s.linearity / 2) ** 2, otherwise=0.0
    )


def followable(time: Floats, positions: Floats, drive: Slider | Capstan) -> Floats:
    """Return a drive's positions, no faster than its servo can go, (k,).

    A jump is spread to both sides of it: the result is the mean of a rate limiter that is run
    forwards and one that is run backwards. Of the jump of a drive at a reversal, which takes up
    stretch, half comes before the joint turns.

    Args:
        time: rising stamps [s], (k,).
        positions: (k,) [m, rad].
        drive: the drive with its servo.
    """
    fastest = (drive.servo or Servo()).fastest
    if fastest is None:
        return positions
    most = fastest * np.diff(time)
    forth = _rate_limited(positions, most)
    back = _rate_limited(positions[::-1], most[::-1])[::-1]
    return (forth + back) / 2


def _rate_limited(positions: Floats, most: Floats) -> Floats:
    """Return positions that change by no more than `most` from each sample to the next."""
    limited = positions.copy()
    for k, step in enumerate(most):
        limited[k + 1] = min(max(positions[k + 1], limited[k] - step), limited[k] + step)
    return limited


def sent(time: Floats, positions: Floats, drive: Slider | Capstan) -> Floats:
    """Return the setpoints u(t) = s(t + T) + ds/dt(t + T)/(2π f) of a drive that follows positions,
    (k,).

    Its servo has the bandwidth f and the delay T; without one the positions s are sent as they are.

    Args:
        time: rising stamps [s], (k,).
        positions: s, no faster than the servo can go, (k,) [m, rad].
        drive: the drive with its servo.
    """
    servo = drive.servo or Servo()
    step = float(np.median(np.diff(time)))
    lag = servo.lag - servo.delay
    # a servo cannot follow a corner: corners are rounded over its lag, so that the lead stays small
    width = 2 * round(lag / step / 2) + 1
    rounded = uniform_filter1d(positions, width, mode="nearest")
    ahead = np.interp(time + servo.delay, time, rounded)
    speed = np.interp(time + servo.delay, time, np.gradient(rounded, time))
    command: Floats = ahead + lag * speed
    return command


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
        self.joints = model.joint_names
        """Names of the free joints, whose angles are desired; the other joints follow these."""
        self._filter = None if self.rig.map is None else AdaptiveFilter(self.rig, compiled)
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
        was = model.kernel_state.views(run.kernel_states)
        read = model.y.views(run.ys)
        positions = read["positions"]
        got = np.column_stack([followable(stamps, *each) for each in zip(positions.T, drives)])
        asked = was["positions"]
        cut = (np.abs(asked - got) > TINY) | (np.abs(read["short"]) > TINY)
        resting = model.rest_x.rows(
            angles=read["angles"],
            positions=got,
            variances=np.tile(position_variances(self.rig), (len(stamps), 1)),
            turned=was["turned"],
            inside=was["inside"],
            cut=np.any(cut, axis=1, keepdims=True),
        )
        begin = np.array([*read["angles"][0], 0.0])
        rested = advance(self._rest, Feed(begin, resting, self._parameters)).ys
        rests, variances = np.hsplit(rested, 2)
        reached = rests + added[:, model.free]
        ahead = np.column_stack([sent(stamps, *each) for each in zip(got.T, drives)])
        notes += not_reached(model, stamps, held, reached, cut)
        notes += beyond(model, stamps, read, asked, self.least_tension)
        spread = np.array(model.mechanism.spread)
        offsets = np.array(model.mechanism.offsets).ravel()
        return Commands(
            self.rig,
            stamps,
            desired=desired @ spread.T + offsets,
            angles=reached @ spread.T + offsets,
            stds=np.sqrt((np.sqrt(variances) @ np.abs(spread).T) ** 2 + unsure),
            positions=positions,
            sent=readings(self.rig, ahead + read["gives"]),
            speeds=np.gradient(positions, stamps, axis=0),
            forces=read["forces"],
            tensions=read["tensions"],
            notes=tuple(notes),
        )

    def _run(self, time: Floats, angles: Floats) -> Advanced:
        """Return the run of the kernel. Before the first sample the drives hold the first angles
        and have been at rest for long.
        """
        model = self.model
        speeds = np.gradient(angles, time, axis=0)
        rows = model.x.rows(
            dt=np.diff(time, prepend=time[0]),
            angles=angles,
            speeds=speeds,
            accelerations=np.gradient(speeds, time, axis=0),
            torques=np.zeros((len(time), len(self.rig.joints))),
            lowest=np.full(len(time), self.least_tension),
        )
        layout = model.kernel_state
        kernel_state = np.zeros(layout.size)
        for _ in range(ROUNDS):
            first = advance(self._kernel, Feed(kernel_state, rows[0], self._parameters))
            y = model.y.views(first.ys[-1])
            kernel_state[layout["positions"]] = y["positions"]
            kernel_state[layout["pulls"]] = layout.view(first.kernel_states[-1], "pulls")
            if model.n_inside:
                of_rig = self._parameters[: model.n_parameters - len(model.derived)]
                q = ca.vertcat(model.all_joints(y["angles"]), y["positions"])
                inside, _ = rest_function(model.mechanism)(q, of_rig)
                kernel_state[layout["inside"]] = inside.full().ravel()
        return advance(self._kernel, Feed(kernel_state, rows, self._parameters))

    def _added_by_maps(
        self, estimator: AdaptiveFilter, time: Floats, run: Advanced
    ) -> tuple[Floats, Floats]:
        """Return what maps add to the joints' angles [rad] and the variances of that [rad²], (k,
        n_joints) each, at the readings that commands would give.

        Far from the logs a map says nothing: both are zero there, and the rig is taken as it is
        described.
        """
        y = self.model.y.views(run.ys)
        at = readings(self.rig, y["positions"])
        expected = expected_readings(self.rig, at, y["forces"], y["tensions"])
        nothing = np.full(len(time), np.nan)
        samples = np.column_stack([expected.get(name, nothing) for name in estimator.channels])
        begin = estimator.initial(time[0], first_values(samples))
        kernel_states, ys = estimator.advanced(begin, time, samples)
        means = mean_of(kernel_states, begin.size)
        spreads = variances_of(kernel_states, begin.size)
        added = estimator.report.means(means, ys) - means
        variances = estimator.report.variances_of(spreads, ys) - spreads
        joints = slice(len(self.rig.joints))
        unsure = np.maximum(variances[:, joints], 0.0)
        known = np.sqrt(unsure) <= LOST
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
            angles = np.column_stack([angles[name] for name in names])
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
