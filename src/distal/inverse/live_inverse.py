"""The inverse in a control loop: readings in, commands of the drives out, with the same filter as
`LiveEstimator`, at the parameters and angles that it believes, and with feedback of the
estimated angle.

A reference r follows the desired angle w by  dr/dt = dw/dt + clip(ε/h, ± √(2 a |ε|)),  with ε = w
− r one sample h before, and is limited to the speed and the acceleration a of the joint. The angle
that is commanded is  r + T dr/dt + (T²/2) d²r/dt² + c − m,  with the lag and delay T of the drives
(`Servo`), the third term no larger than the second, and the correction m by a learned map. The
correction c follows from the estimated angle θ̂ and the error e = r − θ̂ by  dc/dt = k e  outside
of a dead band. Drives that follow forces get the torque of `feedback_torques` in addition.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from itertools import compress
from math import inf, isfinite, nan, radians
from pathlib import Path
from typing import NamedTuple

import casadi as ca
import numpy as np

from distal.arrays import Bools, Floats
from distal.confidence import BAND
from distal.errors import CommandError, EstimationError
from distal.estimators import SHORTEST, TOUCHED, AdaptiveFilter, sample_problem
from distal.estimators.adaptive import StateVector, state_vector
from distal.expressions import Scalar, Vector
from distal.inverse.feedforward import (
    LEAST_TENSION,
    ROUNDS,
    CommandModel,
    least_tension_of,
    limited,
)
from distal.inverse.motor_safety import GoalGate, columns_of, crossed_joints, known_or
from distal.kernels import Layout, Structure, kernel_of, structure_of
from distal.rig import Rig, as_rig
from distal.run import LiveEstimator, Monitor, Reading
from distal.run.health import OVERDUE

SMOOTHED = 0.005
"""Time constant with which the reference's speed and acceleration are smoothed [s]. Source:
judgement.
"""

RESPONDS = 0.1
"""Time in which a joint comes to its largest speed, and in which a drive that follows speeds makes
up for a wrong position [s]. Source: judgement.
"""

AT_END = 1e-9
"""Distance beyond a drive's range from which on the drive counts as at its end [m, rad]. Source:
rounding (positions that are equal).
"""

LEAVES = 2.0
"""Error at which a joint that rests within its dead band is corrected again, in dead bands [1].
Source: judgement.
"""


@dataclass(frozen=True)
class Feedback:
    """Feedback of a joint's estimated angle.

    Args:
        follow: rate at which the commanded angle corrects an error of the angle [1/s]; 0 for none.
        deadband: error that is not corrected [rad], so that a loop with friction and backlash does
            not hunt.
        proportional: gain for drives that follow forces [N m/rad].
        integral: gain for drives that follow forces [N m/(rad s)].
        derivative: gain for drives that follow forces [N m s/rad].
        torque_limit: of the sum of the three torques [N m].
        correction_limit: of the correction of the commanded angle [rad].

    Raises:
        CommandError: a gain is negative or not finite, or a limit is not above zero.
    """

    follow: float = 1.0
    deadband: float = radians(0.5)
    proportional: float = 0.0
    integral: float = 0.0
    derivative: float = 0.0
    torque_limit: float = 1e300
    correction_limit: float = radians(20.0)

    def __post_init__(self) -> None:
        for name, number in vars(self).items():
            is_limit = name.endswith("limit")
            if not (number > 0.0 if is_limit else 0.0 <= number < inf):
                allowed = "a number above 0" if is_limit else "0 or a finite number above"
                raise CommandError(f"feedback.{name}: {allowed}, {number} came")

    @staticmethod
    def gains(joints: Sequence[Feedback]) -> dict[str, Floats]:
        """Return name of a gain → its value for each of some joints, (n,)."""
        return {
            name: np.array([vars(joint)[name] for joint in joints]) for name in vars(Feedback())
        }


REMEMBERED = ("effort", "rests")
"""What the law remembers of each joint from sample to sample: the integral of its error [rad s],
and whether it rests.
"""


class Corrected(NamedTuple):
    """What feedback does in a sample: errors beyond the dead band [rad], its torques [N m], and
    name of what is `REMEMBERED` → its value afterwards, (n,) each.
    """

    errors: Vector
    torques: Vector
    after: dict[str, Vector]


def feedback_torques(
    gains: Mapping[str, Vector],
    *,
    before: Mapping[str, Vector],
    error: Vector,
    lag: Vector,
    dt: Scalar,
    trusted: Scalar = 1.0,
    free: Scalar = 1.0,
) -> Corrected:
    """Return what the PID law  τ = K_p e + K_i ∫ e dt + K_d de/dt  does in a sample, as an
    expression.

    In the dead band e = 0, which ends stick-slip (Armstrong-Hélouvry, Dupont and Canudas de Wit,
    Automatica 30, 1994). The torque is cut at its limit; while it is cut, the integral stands.

    Args:
        gains: by the names of `Feedback`.
        before: what is `REMEMBERED`, by name, (n,) each.
        error: desired minus estimated angles [rad], (n,).
        lag: desired minus estimated speeds [rad/s], (n,).
        dt: length of the sample [s].
        trusted: whether the estimate is known; e and its derivative are zero where it is not.
        free: whether the integral may grow.
    """
    band = gains["deadband"]
    rests = ca.fabs(error) < band * ca.if_else(before["rests"] > 0, LEAVES, 1)
    errors = trusted * ca.if_else(rests, 0, error - limited(error, band))
    effort = before["effort"]
    asked = gains["proportional"] * errors + gains["integral"] * effort
    asked += gains["derivative"] * trusted * lag
    torques = limited(asked, gains["torque_limit"])
    grown = effort + free * ca.if_else(torques == asked, errors * dt, 0)
    return Corrected(errors, torques, {"effort": grown, "rests": rests})


GUIDED = ("wished", "reference", "rate", "speed", "acceleration", "correction", *REMEMBERED)
"""State of the reference and of the feedback that is kept for each free joint."""

OF_EACH = ("fastest", *vars(Feedback()))
"""Gains of each free joint: its largest speed [rad/s], and those of its `Feedback`."""


class LiveModel:
    """The inverse of a rig in a control loop as a kernel: its function, and the layouts of its
    kernel state, of a sample, of its parameters and of its output.

    Args:
        rig: the description.
        states: of the filter that tells the angles.
        folded: whether what the rig states is a constant of the function.
    """

    def __init__(self, rig: Rig, states: StateVector, folded: bool = False) -> None:
        self.model = model = CommandModel(rig, folded)
        self.states = states
        nf = model.nf
        nd = model.nd
        self.kernel_state = Layout(
            **dict.fromkeys((*GUIDED, "last", "mapped"), nf),
            at_end=1,
            started=1,
            command=model.kernel_state.size,
        )
        self.x = Layout(
            dt=1, desired=nf, state=len(states), mapped=nf, read=nd, trusted=1, touched=1
        )
        # joints have in common: the least tension, and whether commands hold against external
        # torques (1) or not (0)
        self.parameters = Layout(
            lowest=1,
            compensates=1,
            **dict.fromkeys(OF_EACH, nf),
            of_filter=len(states.context.mechanism.parameters),
            derived=len(model.derived),
        )
        self.y = Layout(angles=nf, positions=nd, speeds=nd, forces=nd, tensions=model.nt, at_end=nd)

    @property
    def structure(self) -> Structure:
        """The structure on which the compiled kernel depends."""
        of_filter = self.states.context.mechanism.parameters.names, self.states.structure
        return structure_of("live", self.model.mechanism, filter=of_filter)

    def function(self) -> ca.Function:
        """Return the kernel (kernel_state, x, p) → (kernel_state⁺, y) of one sample, whose output y
        are the drives' commands.

        The parameters p are the gains, the filter's parameters and the inputs of `command_inputs`.
        In the sample x, `state` is the filter's mean with the angles as they are reported, `mapped`
        the correction of these by maps, and `read` what the drives' position sensors read. The
        positions in y are as these sensors would read them.
        """
        model = self.model
        states = self.states
        kernel_state = ca.MX.sym("kernel_state", self.kernel_state.size)
        x = ca.MX.sym("x", self.x.size)
        p = ca.MX.sym("p", self.parameters.size)
        was = self.kernel_state.parts(kernel_state)
        came = self.x.parts(x)
        gains = self.parameters.parts(p)
        trusted = came["trusted"]
        angles = came["state"][model.free]
        # maps that are not trusted, far from where they were learned, are not followed, nor torques
        # from outside
        mapped = ca.if_else(trusted > 0, came["mapped"], was["mapped"])
        parameters, torques = self._believed()(came["state"], gains["of_filter"], gains["derived"])
        free = came["touched"] <= TOUCHED
        guide = guided(
            was,
            gains,
            angles=angles,
            desired=model.within_stops(came["desired"], parameters),
            dt=came["dt"],
            trusted=trusted,
            free=free,
            # nothing winds up against a stop, nor against the end of a drive's range
            winds=trusted * (1 - was["at_end"]) * free,
        )
        later = model.number(parameters, ["lead"])
        bend = limited(later**2 / 2 * guide["acceleration"], ca.fabs(later * guide["speed"]))
        ahead = guide["reference"] + later * guide["speed"] + bend + guide["correction"] - mapped
        row = model.x.joined(
            dt=came["dt"],
            angles=model.within_stops(ahead, parameters),
            speeds=guide["speed"] + guide["correcting"],
            accelerations=guide["acceleration"],
            torques=trusted * gains["compensates"] * torques
            + ca.mtimes(ca.pinv(model.mechanism.spread).T, guide["pushed"]),
            lowest=gains["lowest"],
        )
        command, y = model.function()(was["command"], row, parameters)
        sent = model.y.parts(y)
        at_end = ca.fabs(model.kernel_state.part(command, "positions") - sent["positions"]) > AT_END
        positions = read_function(states)(sent["positions"], came["state"], gains["of_filter"])
        following = self.kernel_state.joined(
            **{name: guide[name] for name in GUIDED},
            last=angles,
            mapped=mapped,
            at_end=ca.dot(at_end, at_end) > 0,
            started=ca.MX(1),
            command=command,
        )
        y = self.y.joined(
            angles=sent["angles"],
            positions=positions + sent["gives"],
            speeds=sent["speeds"] + (positions - came["read"]) / RESPONDS,
            forces=model.possible(sent["forces"], parameters),
            tensions=sent["tensions"],
            at_end=at_end,
        )
        return ca.Function("live_command", [kernel_state, x, p], [following, y])

    def _believed(self) -> ca.Function:
        """Return the function (state, p, derived) → parameters of the inverse as the filter
        believes them, and external torques, (n_joints,).
        """
        model = self.model
        states = self.states
        state = ca.SX.sym("state", len(states))
        known = states.context.mechanism.parameters
        derived = ca.SX.sym("derived", len(model.derived))
        learned = dict(zip(known.names, ca.vertsplit(states.parameters(state))))
        names = model.mechanism.parameters.names[: model.n_parameters - derived.numel()]
        parameters = ca.vertcat(*(learned[name] for name in names), derived)
        outputs = [ca.densify(parameters), ca.densify(states.torques(state))]
        return ca.Function("believed", [state, known.symbols, derived], outputs)


def guided(
    was: Mapping[str, Vector],
    gains: Mapping[str, Vector],
    *,
    angles: Vector,
    desired: Vector,
    dt: Scalar,
    trusted: Scalar,
    free: Scalar,
    winds: Scalar,
) -> dict[str, Vector]:
    """Return one sample of the reference and its motion, the correction, and the torque of
    feedback, as expressions, (n_free,) each.

    Args:
        was: state before, by the names of `GUIDED`; `last` angles and whether it `started`.
        gains: by the names of `OF_EACH`.
        angles: estimated angles [rad], (n_free,).
        desired: angles within the stops [rad], (n_free,).
        dt: length of the sample [s].
        trusted: whether the estimate is known.
        free: whether nothing is touched.
        winds: whether the correction may grow.
    """
    safe = ca.fmax(dt, SHORTEST)
    share = dt / (dt + SMOOTHED)
    # it begins where the joint is, if that is known
    first = ca.if_else(trusted > 0, angles, desired)
    before, wished = (
        ca.if_else(was["started"] > 0, was[name], first) for name in ("reference", "wished")
    )
    fastest = gains["fastest"]
    most = fastest / RESPONDS
    behind = wished - before
    catching_up = limited(behind / safe, ca.sqrt(2 * most * ca.fabs(behind)))
    rate = limited(limited((desired - wished) / safe, fastest) + catching_up, fastest)
    rate = was["rate"] + limited(rate - was["rate"], most * dt)
    reference = before + rate * dt
    speed = was["speed"] + share * (rate - was["speed"])
    change = (speed - was["speed"]) / safe - was["acceleration"]
    made = feedback_torques(
        gains,
        before=was,
        error=reference - angles,
        lag=speed - was["started"] * (angles - was["last"]) / safe,
        dt=dt,
        trusted=trusted,
        # what presses on what is touched does not wind up
        free=free,
    )
    correction = limited(
        was["correction"] + winds * gains["follow"] * made.errors * dt, gains["correction_limit"]
    )
    return {
        "wished": desired,
        "reference": reference,
        "rate": rate,
        "speed": speed,
        "acceleration": was["acceleration"] + share * change,
        "correction": correction,
        **made.after,
        "correcting": (correction - was["correction"]) / safe,
        "pushed": -made.torques,
    }


def read_function(states: StateVector) -> ca.Function:
    """Return the function (positions, state, p) → readings of the drives' position sensors,
    (n_drives,) [m, rad], with the offsets and curves that the filter assumes in its `state`.
    """
    state = ca.SX.sym("state", len(states))
    mechanism = states.context.mechanism
    positions = ca.SX.sym("s", mechanism.n_drives)
    read = ca.SX(positions)
    for d in range(mechanism.n_drives):
        sensor = states.context.position_sensor(d)
        if sensor is not None:
            # the sensor's error at the true position is nearly its error at the reading
            offset = states.context.number(f"{states.context.path(sensor)}.bias")
            read[d] += positions[d] - states.position(d, positions[d], state) + offset
    return ca.Function("read", [positions, state, mechanism.parameters.symbols], [read])


def readings(rig: Rig, positions: Floats) -> Floats:
    """Return the readings of the drives' position sensors at `positions` by the rig file, both (k,
    n_drives) [m, rad].

    Where the filter cannot run on the rig, the positions themselves are returned.
    """
    try:
        states = state_vector(rig)
    except EstimationError:
        return positions
    read = read_function(states).map(len(positions))
    known = states.context.mechanism.parameters.values
    found: Floats = read(positions.T, states.means, known).full().T
    return found


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
    joints = live.model.joints
    names = live.model.joint_names
    given = (
        feedback if isinstance(feedback, Mapping) else dict.fromkeys(names, feedback or Feedback())
    )
    if not set(given) <= set(names):
        raise CommandError(
            f"feedback is for the joints {', '.join(names)}; {', '.join(given)} came"
        )
    if fastest is not None and not fastest > 0.0:
        raise CommandError(f"fastest: a speed above 0 rad/s, {fastest} came")
    parts = {
        "lowest": [least_tension_of(least_tension, rig)],
        "compensates": [compensates],
        "fastest": [fastest or np.ptp(joint.travel) / ACROSS for joint in joints],
        **Feedback.gains([given.get(name, Feedback(follow=0.0)) for name in names]),
        "of_filter": estimator.parameters[: len(estimator.parameter_names)],
        "derived": live.model.derived,
    }
    return np.concatenate([parts[name] for name in live.parameters.names])


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
        self._rig = rig = as_rig(rig)
        filter_ = AdaptiveFilter(rig, compiled)
        self._layouts = live = LiveModel(rig, filter_.states)
        self._live = LiveEstimator(rig, filter_)
        self.joints = live.model.joint_names
        self._free = live.model.free
        self._kernel = kernel_of(live.structure, live.function, compiled)
        self._parameters = live_parameters(
            live, filter_, least_tension, feedback, fastest, compensates
        )
        self._monitor = Monitor(self._live)
        self._gate = gate or GoalGate(rig)
        self._positions = columns_of(rig, filter_.channels, "position")
        self._moves = crossed_joints(rig) @ (np.array(live.model.mechanism.spread) != 0.0)
        self._begin_loop()
        self._forget()

    def _begin_loop(self) -> None:
        """Begin a loop of the kernel, with the parts of its arrays by name."""
        self._loop = self._kernel.loop(self._parameters)
        self._kernel_state = self._layouts.kernel_state.views(self._loop.kernel_state)
        self._x = self._layouts.x.views(self._loop.x)
        self._y = self._layouts.y.views(self._loop.y)

    def reset(self) -> None:
        """Forget everything: the next sample is the first."""
        self._gate.reset()
        self._monitor.reset()
        self._forget()

    def _forget(self) -> None:
        self._loop.kernel_state[:] = 0.0
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
        other._gate = copy(self._gate)
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
        if sample_problem(sample, self.channels) is None:
            sample = self._gate.believed(time, sample, self.channels)
        reading = self._monitor.take(time, sample)
        if not all(map(isfinite, reading.angles)):
            return self._command(reading, f"{reading.health} {reading.detail}")
        unread = self._gate.unread
        if self._time is None and (unread or reading.unusable):
            return self._command(reading, f"{unread} not read yet" if unread else reading.unusable)
        x = self._x
        self._asked = known_or(angles, self._asked)
        x["state"][:] = self._live.mean
        x["mapped"][:] = self._live.added_by_maps[self._free]
        # without a reading a drive counts as being where it was sent
        x["read"][:] = known_or(np.append(sample, nan)[self._positions], self._gate.expected)
        x["trusted"][0] = not reading.unusable
        x["touched"][0] = self._live.touched
        stands = self._gate.stopped @ self._moves
        if self._time is None or (stands.all() and self._gate.are_ignored):
            # it begins anew: joints did not go where their commands would have brought them
            begin = self._live.mean[self._free]
            self._asked = known_or(self._asked, begin)
            self._loop.kernel_state[:] = 0.0
            x["desired"][:] = begin
            x["dt"][0] = 0.0
            for _ in range(ROUNDS):
                self._loop.step()
        else:
            self._rest(stands | self._stood)
            x["desired"][:] = np.where(stands, self._kernel_state["reference"], self._asked)
            # after a pause the reference goes on from where it was, and does not jump
            most = OVERDUE * self._live.interval
            x["dt"][0] = np.clip(time - self._time, SHORTEST, most)
            self._loop.step()
        self._time = time
        self._stood = stands
        ended = ", ".join(compress(self._rig.drive_names, self._y["at_end"]))
        return self._command(
            reading,
            reading.unusable and f"no feedback: {reading.unusable}",
            ended and f"{ended} at the end of its range",
        )

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

    def _command(self, reading: Reading, *notes: str) -> Command:
        """Return the command of the last kernel step as it passes the gate."""
        if self._time is None:
            # the kernel has not run: its buffers are no command
            positions, speeds, forces = np.full((3, len(self._rig.drives)), nan)
            note = "; ".join([*notes, "nothing is sent before the first readings"])
            return Command(positions, speeds, forces, reading, note)
        is_new = all(map(isfinite, reading.angles))
        stays = "" if is_new else "the last command stays"
        positions = self._gate.passed(reading.time, np.where(is_new, self._y["positions"], nan))
        stands = self._gate.stopped
        speeds = np.where(stands, 0.0, self._y["speeds"])
        self._forces = np.where(stands, self._forces, self._y["forces"])
        note = "; ".join(filter(None, [*notes, stays, self._gate.note]))
        return Command(positions, speeds, self._forces.copy(), reading, note)

    def confirm(self, arrived: bool) -> None:
        """Take in whether the last command was sent; if not, the goals before it count."""
        self._gate.confirm(arrived)

    __copy__ = clone

    def __deepcopy__(self, memo: object) -> LiveInverse:
        """Return a clone."""
        return self.clone()
