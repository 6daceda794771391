"""The inverse in a control loop: readings in, commands of the drives out, with the same filter as
`LiveEstimator`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, nan
from pathlib import Path
from typing import Any

import numpy as np

from distal.arrays import Bools, Floats
from distal.errors import CommandError
from distal.estimators import SHORTEST, AdaptiveFilter, sample_problem
from distal.inverse.goal_gate import GoalGate, columns_of, crossed_joints
from distal.inverse.least_tension import LEAST_TENSION, least_tension_of
from distal.inverse.live_inverse_function import GAINS, layouts, live_function, live_structure
from distal.inverse.setpoint_function import CommandModel
from distal.kernels import kernel_of
from distal.rig import Rig, as_rig
from distal.run import LiveEstimator, Monitor, Reading

ACROSS = 0.25
"""Default of the fastest motion: a joint goes through its whole range in this time [s]."""

PAUSE = 3.0
"""A sample that comes later than after so many of the rig's intervals moves the reference by so
many.
"""

CLEARLY = 3.0
"""A joint that is further from its reference than so many standard deviations is elsewhere."""

FIRST = 3
"""Rounds until the drives' positions and what moves inside agree at the start."""


@dataclass(frozen=True)
class Feedback:
    """How the estimated angle is fed back.

    Args:
        follow: rate at which an error of the angle is taken out [1/s]; 0 for none.
        deadband: error that is left alone [rad], so that a loop with friction and play does not
            hunt.
        proportional: for drives that follow forces [N m/rad].
        integral: the same [N m/(rad s)].
        derivative: the same [N m s/rad].
        torque_limit: of the three together [N m].

    Raises:
        CommandError: a gain is negative, or no finite number; or no torque is allowed.
    """

    follow: float = 1.0
    deadband: float = float(np.deg2rad(0.5))
    proportional: float = 0.0
    integral: float = 0.0
    derivative: float = 0.0
    torque_limit: float = 1e300

    def __post_init__(self) -> None:
        for name in ("follow", "deadband", "proportional", "integral", "derivative"):
            gain = getattr(self, name)
            if not (isfinite(gain) and gain >= 0.0):
                raise CommandError(f"feedback.{name}: 0 or a finite number above, {gain} came")
        if not self.torque_limit > 0.0:
            raise CommandError(
                f"feedback.torque_limit: a torque above 0 N m, {self.torque_limit} came"
            )


@dataclass(frozen=True)
class Command:
    """What the drives do next, (n_drives,) each, SI.

    Args:
        positions: as their sensors would read them [m, rad]; NaN of a drive to which nothing
            is sent.
        speeds: for drives that follow speeds, which bring them to these positions too [m/s, rad/s].
        forces: [N, N m].
        reading: of the estimate on which it rests, with its health.
        note: what is not as it should be; may be empty.
    """

    positions: Floats
    speeds: Floats
    forces: Floats
    reading: Reading
    note: str = ""


def gains_of(
    model: CommandModel,
    lowest: float,
    feedback: Feedback | Mapping[str, Feedback] | None,
    fastest: float | None,
    compensates: bool = False,
) -> Floats:
    """Return the gains of `live_function`, (n_gains,): `lowest` tension [N], `fastest` motion
    [rad/s], and whether it `compensates` torques from outside; see `LiveInverse`.

    Raises:
        CommandError: a joint is unknown, or a speed is none.
    """
    joints = [model.rig.joints[j] for j in model.free]
    names = [joint.name for joint in joints]
    given = (
        feedback if isinstance(feedback, Mapping) else dict.fromkeys(names, feedback or Feedback())
    )
    if not set(given) <= set(names):
        raise CommandError(
            f"feedback is for the joints {', '.join(names)}; {', '.join(given)} came"
        )
    if fastest is not None and not fastest > 0.0:
        raise CommandError(f"fastest: a speed above 0 rad/s, {fastest} came")
    of = [given.get(name, Feedback(follow=0.0)) for name in names]
    parts = {
        "fastest": [
            np.ptp(joint.travel) / ACROSS if fastest is None else fastest for joint in joints
        ],
        "lowest": [lowest],
        "compensates": [float(compensates)],
        "follow": [one.follow for one in of],
        "deadband": [one.deadband for one in of],
        "kp": [one.proportional for one in of],
        "ki": [one.integral for one in of],
        "kd": [one.derivative for one in of],
        "torque_limit": [one.torque_limit for one in of],
    }
    return np.concatenate([np.array(parts[name], dtype=np.float64) for name in GAINS])


class LiveInverse:
    """Commands sample by sample, from desired angles and what the sensors read.

    ```python
    inverse = distal.LiveInverse("finger-2n")
    # sample: values of inverse.channels, SI
    command = inverse.step(time, {"mcp": 0.5, "pip": 0.3}, sample)
    send(command.positions)
    ```

    What the filter learns (friction, stretch) is made up for. While the estimate is not
    known, its correction stays as it was. The first command is for where the joints are; from there
    they go to what is desired. Every command passes a `GoalGate`: a drive whose readings are lost
    for 0.1 s stands, with those that move the same joints, and their joints are desired where they
    are.

    Args:
        rig: the description, or a shipped rig's name, or a path.
        least_tension: that every tendon keeps where there are more of them than joints: newtons, or
            a text with a unit.
        feedback: see `Feedback`; of all joints, or by their names.
        fastest: largest speed of the joints that move by themselves [rad/s]; default all of their
            range in 0.25 s.
        compensates: hold against torques from outside; default they act: what is held is pressed no
            harder because it pushes back.
        gate: that takes in the samples elsewhere, before they come here; default one of its own.

    Raises:
        CommandError: a number is none, or the filter cannot run on this rig.
    """

    def __init__(
        self,
        rig: Rig | str | Path,
        *,
        least_tension: float | str = LEAST_TENSION,
        feedback: Feedback | Mapping[str, Feedback] | None = None,
        fastest: float | None = None,
        compensates: bool = False,
        compiled: bool = True,
        gate: GoalGate | None = None,
    ) -> None:
        self._rig = as_rig(rig)
        estimator = AdaptiveFilter(self._rig, compiled)
        model = CommandModel(self._rig)
        self._setup: dict[str, Any] = {
            "least_tension": least_tension,
            "feedback": feedback,
            "fastest": fastest,
            "compensates": compensates,
            "compiled": compiled,
        }
        self._live = LiveEstimator(self._rig, estimator)
        self._free = model.free
        self.joints = tuple(self._rig.joints[j].name for j in model.free)
        self._layouts = layouts(model, estimator.states)
        structure = live_structure(model, estimator.states)
        self._kernel = kernel_of(
            structure, lambda: live_function(model, estimator.states), compiled
        )
        lowest = least_tension_of(least_tension, self._rig)
        gains = gains_of(model, lowest, feedback, fastest, compensates)
        self._monitor = Monitor(self._live)
        self._loop = self._kernel.loop(
            np.concatenate(
                [gains, estimator.parameters[: len(estimator.parameter_names)], model.derived]
            )
        )
        self._has_map = bool(estimator.report.states)
        self._gate = GoalGate(self._rig) if gate is None else gate
        self._is_believed = gate is not None
        self._positions = columns_of(self._rig, estimator.channels, "position")
        self._moves = crossed_joints(self._rig) @ (np.array(model.mechanism.spread) != 0.0)
        kernel_state = self._layouts.kernel_state
        self._kernel_state = {
            name: self._loop.kernel_state[kernel_state[name]] for name in kernel_state.names
        }
        self._x = {name: self._loop.x[self._layouts.x[name]] for name in self._layouts.x.names}
        self._y = {name: self._loop.y[self._layouts.y[name]] for name in self._layouts.y.names}
        self.reset()

    def reset(self) -> None:
        """Forget everything: the next sample is the first."""
        self._monitor.reset()
        self._loop.kernel_state[:] = 0.0
        if not self._is_believed:
            self._gate.reset()
        self._forces = np.full(len(self._rig.drives), nan)
        self._asked = np.full(len(self.joints), nan)
        self._stood = np.zeros(len(self.joints), dtype=bool)
        self._time: float | None = None

    def clone(self) -> LiveInverse:
        """Return another one with the same belief, which goes on alone."""
        other = LiveInverse(self._rig, **self._setup)
        other._live = self._live.clone()
        other._monitor = self._monitor.clone(other._live)
        other._loop.kernel_state[:], other._loop.y[:] = self._loop.kernel_state, self._loop.y
        other._gate = self._gate.clone()
        other._forces = self._forces.copy()
        other._time = self._time
        other._asked = self._asked.copy()
        other._stood = self._stood.copy()
        return other

    @property
    def rig(self) -> Rig:
        """The description."""
        return self._rig

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the sensors in a sample."""
        return self._live.channels

    @property
    def estimator(self) -> LiveEstimator:
        """The filter, at the last sample."""
        return self._live

    def step(
        self, time: float, desired: Sequence[float] | Floats | Mapping[str, float], sample: Floats
    ) -> Command:
        """Take in a sample and return the drives' next commands.

        A sample without an estimate (late, or of the wrong shape) leaves the last command as it is;
        before the first estimate there is none, and all numbers of the command are NaN.

        Args:
            time: of the sample [s].
            desired: angles of `joints` now [rad], in their order or by name; what is not finite
                stays as it was.
            sample: values of `channels`, SI, NaN where missing, (n_channels,).

        Raises:
            CommandError: an angle is missing, or there are more of them than joints.
        """
        if isinstance(desired, Mapping):
            desired = (
                [desired.get(name, nan) for name in self.joints]
                if set(desired) <= set(self.joints)
                else []
            )
        angles = np.atleast_1d(np.asarray(desired, dtype=np.float64))
        if angles.shape != (len(self.joints),):
            raise CommandError(
                f"wanted are angles of {', '.join(self.joints)}; {len(angles)} came, or another "
                "joint's"
            )
        if sample_problem(sample, self.channels) is None and not self._is_believed:
            sample = self._gate.believed(time, sample, self.channels)
        reading = self._monitor.take(time, sample)
        if not all(map(isfinite, reading.angles)):
            stays = [] if self._time is None else ["the last command stays"]
            return self._command(reading, [f"{reading.health} {reading.detail}", *stays])
        unread = self._gate.unread
        if self._time is None and unread:
            return self._command(reading, [f"{', '.join(unread)} not read yet"])
        if self._time is None and reading.unusable:
            return self._command(reading, [reading.unusable])
        x = self._x
        y = self._y
        unusable = reading.unusable
        self._asked = np.where(np.isfinite(angles), angles, self._asked)
        x["state"][:] = self._live.mean
        if self._has_map:
            x["mapped"][:] = self._live.added_by_maps[self._free]
        # without a reading a drive counts as being where it was sent
        read = np.where(self._positions >= 0, sample[self._positions], nan)
        np.copyto(x["read"], np.where(np.isfinite(read), read, self._gate.expected))
        x["trusted"][0] = not unusable
        x["touched"][0] = self._live.touched
        stopped = self._gate.stopped
        stands = stopped @ self._moves if stopped.any() else np.zeros_like(self._stood)
        if self._time is None or (stands.all() and self._gate.are_ignored):
            # it begins anew: joints did not go where their commands would have brought them
            begin = self._live.mean[self._free]
            self._asked = np.where(np.isfinite(self._asked), self._asked, begin)
            self._loop.kernel_state[:] = 0.0
            x["desired"][:] = begin
            x["dt"][0] = 0.0
            for _ in range(FIRST):
                self._loop.step()
        else:
            self._rest(stands | self._stood)
            x["desired"][:] = np.where(stands, self._kernel_state["reference"], self._asked)
            # after a pause the reference goes on from where it was, and does not jump
            x["dt"][0] = min(max(time - self._time, SHORTEST), PAUSE * self._live.interval)
            self._loop.step()
        self._time = time
        self._stood = stands
        ended = [drive.name for drive, is_cut in zip(self._rig.drives, y["at_end"]) if is_cut]
        notes = [f"no feedback: {unusable}"] if unusable else []
        notes += [f"{', '.join(ended)} at the end of its range"] if ended else []
        return self._command(reading, notes)

    def _rest(self, stands: Bools) -> None:
        """Let the references of joints that stand be where these clearly are, and feedback not wind
        up.
        """
        if not stands.any():
            return
        angles = self._live.mean[self._free]
        stds = self._live.angle_stds[self._free]
        away = stands & (np.abs(self._kernel_state["reference"] - angles) > CLEARLY * stds)
        for name in ("reference", "wished"):
            np.copyto(self._kernel_state[name], angles, where=away)
        for name in ("rate", "speed", "acceleration"):
            self._kernel_state[name][stands] = 0.0
        self._kernel_state["at_end"][:] = 1.0

    def _command(self, reading: Reading, notes: list[str]) -> Command:
        """Return what passes the gate."""
        y = self._y
        count = len(self._rig.drives)
        if self._time is None:
            # the kernel has not run: its buffers are no command
            nothing = np.full(count, nan)
            note = "; ".join([*notes, "nothing is sent before the first readings"])
            return Command(nothing, nothing.copy(), nothing.copy(), reading, note)
        is_new = all(map(isfinite, reading.angles))
        positions = self._gate.passed(
            reading.time, y["positions"] if is_new else np.full(count, nan)
        )
        stands = self._gate.stopped
        self._forces = np.where(stands, self._forces, y["forces"])
        notes = [*notes, self._gate.note] if self._gate.note else notes
        speeds = np.where(stands, 0.0, y["speeds"])
        return Command(positions, speeds, self._forces.copy(), reading, "; ".join(notes))

    @property
    def holding(self) -> Floats:
        """Forces and torques that drives hold that stand because readings are lost [N, N m];
        infinite for others, (n_drives,).
        """
        return self._gate.holding

    def confirm(self, arrived: bool) -> None:
        """Say whether the last command was sent: while commands do not arrive, joints are desired
        where they are.
        """
        self._gate.confirm(arrived)

    def __copy__(self) -> LiveInverse:
        """Return a clone: buffers are never shared."""
        return self.clone()

    def __deepcopy__(self, memo: object) -> LiveInverse:
        """Return a clone."""
        return self.clone()
