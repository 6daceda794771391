"""The inverse in a control loop: readings in, commands of the drives out, with the same filter as
`LiveEstimator`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, nan
from pathlib import Path

import numpy as np

from distal.arrays import Bools, Floats
from distal.confidence import BAND
from distal.errors import CommandError
from distal.estimators import SHORTEST, AdaptiveFilter, sample_problem
from distal.inverse.feedforward import ROUNDS
from distal.inverse.goal_gate import GoalGate, columns_of, crossed_joints
from distal.inverse.live_command_function import LiveModel
from distal.inverse.pid import Feedback
from distal.inverse.tension_distribution import LEAST_TENSION, least_tension_of
from distal.kernels import Layout, kernel_of
from distal.rig import Rig, as_rig
from distal.run import LiveEstimator, Monitor, Reading
from distal.run.health import LIMITS

ACROSS = 0.25
"""Time in which a joint goes through its whole range with the default of the largest speed [s].
Source: judgement.
"""


@dataclass(frozen=True)
class Command:
    """What the drives do next, (n_drives,) each, SI.

    Args:
        positions: as the drives' sensors would read them [m, rad]; NaN of a drive to which nothing
            is sent.
        speeds: for drives that follow speeds; they lead to these positions too [m/s, rad/s].
        forces: for drives that follow forces [N, N m].
        reading: the estimate on which the command rests, with its health.
        note: what is wrong or held back, in words; may be empty.
    """

    positions: Floats
    speeds: Floats
    forces: Floats
    reading: Reading
    note: str = ""


def live_parameters(
    live: LiveModel,
    estimator: AdaptiveFilter,
    least_tension: float | str = LEAST_TENSION,
    feedback: Feedback | Mapping[str, Feedback] | None = None,
    fastest: float | None = None,
    compensates: bool = False,
) -> Floats:
    """Return the parameters of the kernel of a live inverse, (n,); see `LiveInverse`.

    Args:
        least_tension: newtons, or a text with a unit.
        fastest: largest speed of the free joints [rad/s].

    Raises:
        CommandError: the least tension is none that the tendons can have, a joint of the feedback
            is unknown, or the speed is not above zero.
    """
    rig = live.model.rig
    joints = [rig.joints[j] for j in live.model.free]
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
    gains = {
        "lowest": [least_tension_of(least_tension, rig)],
        "compensates": [compensates],
        "fastest": [fastest or np.ptp(joint.travel) / ACROSS for joint in joints],
        **Feedback.gains([given.get(name, Feedback(follow=0.0)) for name in names]),
    }
    of_filter = estimator.parameters[: len(estimator.parameter_names)]
    of_rig = live.model.derived
    return np.concatenate([*(gains[name] for name in live.gains.names), of_filter, of_rig])


class LiveInverse:
    """Commands sample by sample, from desired angles and what the sensors read.

    ```python
    inverse = distal.LiveInverse("finger-2n")
    # sample: values of inverse.channels, SI
    command = inverse.step(time, {"mcp": 0.5, "pip": 0.3}, sample)
    send(command.positions)
    ```

    The commands compensate friction and stretch as the filter learns them. While the estimate is
    not known, the correction by feedback stays as it was. The first command holds the joints where
    they are; from there they go to the desired angles. Every command passes a `GoalGate`: a drive
    whose readings are lost for 0.1 s stops, with those that move the same joints, and the desired
    angles of these joints become the angles that they have.

    Args:
        rig: the description, or a shipped rig's name, or a path.
        least_tension: tension that commands keep in each tendon that has a drive of its own:
            newtons, or a text with a unit.
        feedback: see `Feedback`; of all joints, or by their names.
        fastest: largest speed of the free joints [rad/s]; by default each goes through its range in
            0.25 s.
        compensates: whether commands hold against external torques. By default they do not: an
            object that is grasped is pressed no harder because it pushes back.
        gate: a gate that has taken in the samples before they come here; by default the inverse has
            its own.

    Raises:
        CommandError: an argument is out of its range, or names an unknown joint.
        EstimationError: the filter cannot run on this rig.
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
        self._layouts = live = LiveModel(self._rig, estimator.states)
        self._live = LiveEstimator(self._rig, estimator)
        self._free = live.model.free
        self.joints = tuple(self._rig.joints[j].name for j in self._free)
        self._kernel = kernel_of(live.structure, live.function, compiled)
        self._parameters = live_parameters(
            live, estimator, least_tension, feedback, fastest, compensates
        )
        self._monitor = Monitor(self._live)
        self._has_map = bool(estimator.report.states)
        self._gate = GoalGate(self._rig) if gate is None else gate
        self._is_believed = gate is not None
        self._positions = columns_of(self._rig, estimator.channels, "position")
        self._moves = crossed_joints(self._rig) @ (np.array(live.model.mechanism.spread) != 0.0)
        self._begin_loop()
        self.reset()

    def _begin_loop(self) -> None:
        """Begin a loop of the kernel, with the parts of its arrays by name."""
        self._loop = self._kernel.loop(self._parameters)

        def parts(layout: Layout, array: Floats) -> dict[str, Floats]:
            return {name: array[layout[name]] for name in layout.names}

        self._kernel_state = parts(self._layouts.kernel_state, self._loop.kernel_state)
        self._x = parts(self._layouts.x, self._loop.x)
        self._y = parts(self._layouts.y, self._loop.y)

    def reset(self) -> None:
        """Forget everything: the next sample is the first."""
        self._monitor.reset()
        self._loop.kernel_state[:] = 0.0
        if not self._is_believed:
            self._gate.reset()
        # these are replaced, and never changed in place: a clone may share them
        self._forces = np.full(len(self._rig.drives), nan)
        self._asked = np.full(len(self.joints), nan)
        self._stood = np.zeros(len(self.joints), dtype=bool)
        self._time: float | None = None

    def clone(self) -> LiveInverse:
        """Return a copy with the same belief, which goes on by itself."""
        other = object.__new__(LiveInverse)
        vars(other).update(vars(self))
        other._live = self._live.clone()
        other._monitor = self._monitor.clone(other._live)
        other._gate = self._gate.clone()
        other._begin_loop()
        other._loop.kernel_state[:] = self._loop.kernel_state
        other._loop.y[:] = self._loop.y
        return other

    @property
    def rig(self) -> Rig:
        """Description of the rig whose drives are commanded."""
        return self._rig

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the sensors in a sample, in its order."""
        return self._live.channels

    @property
    def estimator(self) -> LiveEstimator:
        """The filter on which the commands rest, at the last sample."""
        return self._live

    def step(
        self, time: float, desired: Sequence[float] | Floats | Mapping[str, float], sample: Floats
    ) -> Command:
        """Take in a sample and return the drives' next commands.

        A sample without an estimate (late, or of the wrong shape) leaves the last command as it is.
        Before the first estimate all numbers of the command are NaN.

        Args:
            time: of the sample [s].
            desired: angles of `joints` now [rad], in their order or by name; a joint whose angle is
                left out or not finite keeps its desired angle.
            sample: values of `channels`, SI, NaN where missing, (n_channels,).

        Raises:
            CommandError: there are more or fewer angles than joints, or a name is unknown.
        """
        angles = self._angles(desired)
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
        self._asked = np.where(np.isfinite(angles), angles, self._asked)
        x["state"][:] = self._live.mean
        if self._has_map:
            x["mapped"][:] = self._live.added_by_maps[self._free]
        # without a reading a drive counts as being where it was sent
        read = np.where(self._positions >= 0, sample[self._positions], nan)
        np.copyto(x["read"], np.where(np.isfinite(read), read, self._gate.expected))
        x["trusted"][0] = not reading.unusable
        x["touched"][0] = self._live.touched
        stands = self._gate.stopped @ self._moves
        if self._time is None or (stands.all() and self._gate.are_ignored):
            # it begins anew: joints did not go where their commands would have brought them
            begin = self._live.mean[self._free]
            self._asked = np.where(np.isfinite(self._asked), self._asked, begin)
            self._loop.kernel_state[:] = 0.0
            x["desired"][:] = begin
            x["dt"][0] = 0.0
            for _ in range(ROUNDS):
                self._loop.step()
        else:
            self._rest(stands | self._stood)
            x["desired"][:] = np.where(stands, self._kernel_state["reference"], self._asked)
            # after a pause the reference goes on from where it was, and does not jump
            x["dt"][0] = min(max(time - self._time, SHORTEST), LIMITS.overdue * self._live.interval)
            self._loop.step()
        self._time = time
        self._stood = stands
        at_end = zip(self._rig.drive_names, self._y["at_end"])
        ended = [name for name, is_cut in at_end if is_cut]
        notes = [f"no feedback: {reading.unusable}"] if reading.unusable else []
        notes += [f"{', '.join(ended)} at the end of its range"] if ended else []
        return self._command(reading, notes)

    def _angles(self, desired: Sequence[float] | Floats | Mapping[str, float]) -> Floats:
        """Return desired angles in the order of `joints`, (n_free,), NaN where one is left out."""
        if isinstance(desired, Mapping):
            known = set(desired) <= set(self.joints)
            desired = [desired.get(name, nan) for name in self.joints] if known else []
        angles = np.atleast_1d(np.asarray(desired, dtype=np.float64))
        if angles.shape != (len(self.joints),):
            raise CommandError(
                f"wanted are angles of {', '.join(self.joints)}; {len(angles)} came, or another "
                "joint's"
            )
        return angles

    def _rest(self, stands: Bools) -> None:
        """Set the references of joints that stand to where these clearly are, and keep feedback
        from winding up.
        """
        if not stands.any():
            return
        angles = self._live.mean[self._free]
        stds = self._live.angle_stds[self._free]
        away = stands & (np.abs(self._kernel_state["reference"] - angles) > BAND * stds)
        for name in ("reference", "wished"):
            np.copyto(self._kernel_state[name], angles, where=away)
        for name in ("rate", "speed", "acceleration"):
            self._kernel_state[name][stands] = 0.0
        self._kernel_state["at_end"][:] = 1.0

    def _command(self, reading: Reading, notes: list[str]) -> Command:
        """Return the command of the last kernel step as it passes the gate."""
        y = self._y
        count = len(self._rig.drives)
        if self._time is None:
            # the kernel has not run: its buffers are no command
            nothing = np.full(count, nan)
            note = "; ".join([*notes, "nothing is sent before the first readings"])
            return Command(nothing, nothing.copy(), nothing.copy(), reading, note)
        is_new = all(map(isfinite, reading.angles))
        goals = y["positions"] if is_new else np.full(count, nan)
        positions = self._gate.passed(reading.time, goals)
        stands = self._gate.stopped
        self._forces = np.where(stands, self._forces, y["forces"])
        notes = [*notes, self._gate.note] if self._gate.note else notes
        speeds = np.where(stands, 0.0, y["speeds"])
        return Command(positions, speeds, self._forces.copy(), reading, "; ".join(notes))

    @property
    def holding(self) -> Floats:
        """Forces and torques still held by drives that are stopped because readings are lost [N, N
        m]; infinite for the others, (n_drives,).
        """
        return self._gate.holding

    def confirm(self, arrived: bool) -> None:
        """Take in whether the last command was sent; if not, the goals before it count."""
        self._gate.confirm(arrived)

    def __copy__(self) -> LiveInverse:
        """Return a clone: buffers are never shared."""
        return self.clone()

    def __deepcopy__(self, memo: object) -> LiveInverse:
        """Return a clone."""
        return self.clone()
