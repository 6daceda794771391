"""A controller in the loop with a simulated rig and an estimator, and how well a joint keeps to its
reference.

In: a rig and a control scenario; out: what the joint did, and its error to the reference, with an
encoder, the estimate or displacements fed back. A command acts one period after the sample that it
is computed from.

    import distal

    scenario = distal.load_scenario("control-paper")
    print(distal.closed_loop(distal.scenario_rig(scenario), scenario, seed=1))

The shipped controllers are a PID whose torques the moment arms turn into commands of the drives,
and the rig's inverse, which adds the forces that the reference's own motion needs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil, exp, inf, isfinite, nan
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, TypeAlias

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.confidence import BAND, COVERED_TEXT
from distal.errors import ControlError, ScenarioError, did_you_mean
from distal.estimators import ESTIMATORS, usual_estimator
from distal.expressions import Vector
from distal.inverse import Feedback, LiveInverse
from distal.inverse.feedforward import solved
from distal.inverse.live_inverse import REMEMBERED, feedback_torques
from distal.kernels import Evaluation, Feed, Layout, advance
from distal.logs import Log
from distal.model import Mechanism
from distal.results import (
    BLACK,
    SOFT,
    band_colour,
    curve_style,
    figure,
    legend_above,
    save_figure,
)
from distal.rig import Rig, as_rig, effort_unit
from distal.run import LiveEstimator, Monitor, Reading
from distal.sensor_models import quantisation_variance, quantised_values
from distal.simulation import Control, JointControl, Scenario, simulate_plant
from distal.simulation.plant import (
    at_rest,
    check_motion,
    check_names,
    plant_kernel,
)
from distal.simulation.scenario import as_scenario
from distal.simulation.simulate import Sampler, log_of, prepare, stamps_of
from distal.units import to_si

SMOOTHED = 0.3
"""Share with which a new difference of the angle enters the smoothed speed of k_d: an encoder's
steps are spread over about three periods. Source: judgement.
"""

KEPT = 0.75
"""Share of the co-contraction below which no tension falls; a torque may use the rest. Source:
judgement.
"""


def allocated(mechanism: Mechanism, angles: Vector, torques: Vector, tension: float) -> Vector:
    """Return the drives' commands U = (∂ℓ/∂s)ᵀ T for torques on the joints, with the tensions T = c
    + (Aᵀ)⁺ τ by the joints' moment arms A.

    The constant tensions c make no torque: they are `tension` [N] in all tendons, less the part
    that would make one. They are raised by a common factor where otherwise a slider's tendon would
    have to push. The joints are at `angles` [rad], (n_joints,), and need the `torques` τ [N m],
    (n_joints,).
    """
    rig = mechanism.rig
    nj = mechanism.n_joints
    slopes = mechanism.length_jacobian(ca.vertcat(angles, ca.SX.zeros(mechanism.n_drives)))
    arms = -ca.mtimes(slopes[:, :nj], mechanism.spread).T
    square = ca.mtimes(arms, arms.T)
    needed, making = (
        ca.mtimes(arms.T, solved(square, right))
        for right in (ca.mtimes(mechanism.spread.T, torques), ca.sum2(arms))
    )
    constant = tension * (1 - making)
    share = ca.SX(1)
    for i, tendon in enumerate(rig.tendons):
        if rig.drive(tendon.drive).kind == "slider":
            lifts = constant[i] > 1e-6 * tension
            share = ca.fmax(
                share, ca.if_else(lifts, -needed[i] / ca.if_else(lifts, constant[i], 1), 1)
            )
    return ca.mtimes(slopes[:, nj:].T, share * constant + needed)


def feedback_of(joint: JointControl) -> Feedback:
    """Return the feedback that the gains of a scenario stand for."""
    return Feedback(
        0.0,
        joint.deadband,
        joint.proportional,
        joint.integral,
        joint.derivative,
        joint.torque_limit or inf,
    )


class PID:
    """A PID controller of the angles of some joints, a callable for `simulate` and `closed_loop`.

    The torques of `feedback_torques`, with the error of each joint's angle and the smoothed speed
    of the joint, become commands by `allocated`. While an angle is missing or not known the last
    commands are held.

    Args:
        joints: reference and gains by joint.
        period: time between two calls [s].
        co_contraction: tension of all tendons without a torque [N].
    """

    def __init__(
        self, rig: Rig, joints: Mapping[str, JointControl], period: float, co_contraction: float
    ) -> None:
        n = len(joints)
        self._rig = rig
        self._joints = joints
        self._layout = layout = Layout(
            **dict.fromkeys((*REMEMBERED, "speed", "last"), n), begun=1, commands=len(rig.drives)
        )
        self._memory = np.zeros(layout.size)
        mechanism = Mechanism(rig)
        angles = ca.SX.sym("angles", mechanism.n_joints)
        memory = ca.SX.sym("memory", layout.size)
        reference = ca.SX.sym("reference", n)
        before = layout.parts(memory)
        at = [rig.joint_names.index(name) for name in joints]
        turned = (angles[at] - before["last"]) / period
        speed = before["speed"] + before["begun"] * SMOOTHED * (turned - before["speed"])
        made = feedback_torques(
            Feedback.gains([feedback_of(joint) for joint in joints.values()]),
            before=before,
            error=reference - angles[at],
            lag=-speed,
            dt=period,
        )
        torques = ca.SX.zeros(mechanism.n_joints)
        torques[at] = made.torques
        after = layout.joined(
            **made.after,
            speed=speed,
            last=angles[at],
            begun=ca.SX(1),
            commands=allocated(mechanism, angles, torques, co_contraction),
        )
        p = mechanism.parameters
        known = ca.substitute(after, p.symbols, ca.DM(p.values))
        # the commands are a part of the memory afterwards
        law = ca.Function("pid", [angles, memory, reference], [ca.densify(known)])
        self._law = Evaluation(law)

    def __call__(
        self, time: float, measured: Mapping[str, float], estimate: Reading
    ) -> dict[str, float]:
        """Return the commands by drive at a `time` [s] from the `estimate`. What is `measured` is
        not used.
        """
        if not estimate.unusable:
            desired = references_at(self._joints, time)
            (self._memory,) = self._law(estimate.angles, self._memory, [*desired.values()])
        commands = self._layout.view(self._memory, "commands")
        return dict(zip(self._rig.drive_names, commands.tolist()))


def commanded_forces(
    rig: Rig, joints: Mapping[str, JointControl], co_contraction: float
) -> tuple[Controller, Teller]:
    """Return a controller by `LiveInverse` for drives that follow forces, and what tells it the
    angles: the inverse has a filter of its own, so that no second one runs.

    Args:
        joints: reference and gains by joint; other joints stay where they are.
        co_contraction: tension of all tendons without a torque [N]; each tendon keeps at least the
            share `KEPT` of it.
    """
    feedback = {name: feedback_of(one) for name, one in joints.items()}
    inverse = LiveInverse(
        rig, least_tension=KEPT * co_contraction, feedback=feedback, compensates=True
    )
    at = [rig.sensor_names.index(channel) for channel in inverse.channels]
    forces = dict.fromkeys(rig.drive_names, 0.0)

    def tell(stamp: float, values: Floats) -> Reading:
        command = inverse.step(stamp, references_at(joints, stamp), values[at])
        forces.update(zip(rig.drive_names, command.forces.tolist()))
        return command.reading

    return lambda time, measured, estimate: forces.copy(), tell


def references_at(joints: Mapping[str, JointControl], time: float) -> dict[str, float]:
    """Return the desired angle of each joint at a `time` [s], by joint [rad]."""
    return {name: float(one.reference.at(np.array(time))) for name, one in joints.items()}


if TYPE_CHECKING:
    from matplotlib.figure import Figure


Samples: TypeAlias = list[tuple[float, Floats]]
"""Stamps [s], each with values in the order of the rig's sensors [SI]."""


class SteppedPlant(Protocol):
    """What a plant must offer to be driven by a controller, period after period."""

    @property
    def rig(self) -> Rig:
        """The rig as filters know it."""

    @property
    def time(self) -> float:
        """Time since the start [s]."""

    @property
    def finished(self) -> bool:
        """Whether the plant has no further period."""

    @property
    def angles(self) -> Floats:
        """True angles of the joints now [rad], (n_joints,)."""

    def reset(self, seed: int = 0) -> Samples:
        """Go back to the start and return the samples at time zero."""

    def step(self, commands: Mapping[str, float]) -> Samples:
        """Go on by one period with the `commands` by drive [N or N m]. Return the samples in it:
        stamps [s], and values in the order of the rig's sensors [SI].
        """

    def log(self) -> Log:
        """Return what the sensors have read so far, with the truth beside it."""


class ControlledPlant:
    """A scenario on a rig whose drives a controller commands: call `reset`, then `step` for each
    `period` [s].

    A command is a force of a slider [N] or a torque of a capstan [N m]; it is added to what the
    scenario does. The drive's `limit` cuts it and the drive follows it with its `lag`. A negative
    command of a slider counts as zero, since it cannot push its tendons.

    Raises:
        ControlError: the period is too short, or longer than the scenario.
        ScenarioError: the scenario does not fit the rig.
    """

    def __init__(
        self, rig: Rig | str | Path, scenario: Scenario | str | Path, period: float
    ) -> None:
        if not period > 0.0:
            raise ControlError(f"period: a time above 0 s, {period:g} s came")
        prepared = prepare(rig, scenario, period=period)
        duration = prepared.scenario.duration
        if period > duration:
            raise ControlError(f"period: {period:g} s is longer than the scenario, {duration:g} s")
        self.prepared = prepared
        self.rig = prepared.rig
        self.period = period
        self.plant = plant = prepared.plant
        self._drives = plant.rig.drives
        self._kernel = plant_kernel(plant, prepared.count)
        self.begin = at_rest(plant, prepared.rows, prepared.start, self._kernel)
        self._per_period = round(period / prepared.dt)
        self._rows = prepared.rows
        self._grid = prepared.grid(len(self._rows) + 1)
        self._stamps = stamps_of(plant.rig, 0.0, duration)
        latest = max((sensor.delay for sensor in plant.rig.sensors), default=0.0)
        self._looks_back = ceil(latest / prepared.dt) + self._per_period + 1
        # the share of a change of its command that a drive follows within an interval
        self._shares = np.array(
            [1.0 - exp(-prepared.dt / d.lag) if d.lag > 0.0 else 1.0 for d in self._drives]
        )
        self._highest = np.array([inf if d.limit is None else d.limit for d in self._drives])
        is_slider = [drive.kind == "slider" for drive in self._drives]
        self._lowest = np.where(is_slider, 0.0, -self._highest)
        self.reset()

    @property
    def time(self) -> float:
        """Time since the start [s]."""
        return self._done * self.prepared.dt

    @property
    def finished(self) -> bool:
        """Whether the scenario is over."""
        return self._done >= len(self._rows)

    @property
    def angles(self) -> Floats:
        """True angles of the joints now [rad], (n_joints,)."""
        return self._y[self._done, : self.plant.n_joints].copy()

    def reset(self, seed: int = 0) -> Samples:
        """Go back to the start and return the samples at time zero; see `step`."""
        rig = self.plant.rig
        (self._kernel_state, first) = self.begin
        self._done = 0
        self._taken = 0
        self._y = np.full((len(self._rows) + 1, first.shape[1]), np.nan)
        self._y[0] = first[0]
        self._efforts: Floats = np.zeros(len(self._drives))
        self._samples = np.full((len(self._stamps), len(rig.sensors)), np.nan)
        self._sampler = Sampler(self.plant, seed)
        return self._read()

    def step(self, commands: Mapping[str, float]) -> Samples:
        """Go on by one period and return the samples in it: their stamps [s] and the sensors'
        values [SI], NaN for a sensor without one.

        Args:
            commands: by drive [N or N m]; a drive that is missing gets none.

        Raises:
            ControlError: there is no such drive, a command is no number, or the scenario is over.
            ScenarioError: the motion left all bounds.
        """
        if self.finished:
            raise ControlError("the scenario is over; call reset")
        names = self.plant.rig.drive_names
        asked = np.zeros(len(names))
        for name, command in commands.items():
            if name not in names:
                raise ControlError(
                    f"the controller commands '{name}', the rig has no such "
                    f"drive{did_you_mean(name, names)}"
                )
            is_number = isinstance(command, (int, float, np.floating, np.integer))
            if not (is_number and isfinite(command)):
                raise ControlError(
                    f"the controller's command for '{name}' at {self.time:g} s is no number: "
                    f"{command!r}"
                )
            asked[names.index(name)] = command
        desired = np.clip(asked, self._lowest, self._highest)
        end = min(self._done + self._per_period, len(self._rows))
        drives = slice(self.plant.n_joints, self.plant.n_bodies)
        rows = self._rows[self._done : end].copy()
        for row in rows:
            self._efforts += self._shares * (desired - self._efforts)
            row[drives] += self._efforts
        feed = Feed(self._kernel_state, rows, self.plant.parameters.values)
        kernel_states, ys = advance(self._kernel, feed)
        self._kernel_state = kernel_states[-1]
        self._y[self._done + 1 : end + 1] = ys
        try:
            check_motion(self.plant, ys)
        except ScenarioError as problem:
            pulls = ", ".join(
                f"{drive.name} {pull:.3g}" for drive, pull in zip(self._drives, self._efforts)
            )
            raise ScenarioError(f"at {self.time:g} s, commands {pulls}: {problem}") from None
        self._done = end
        return self._read()

    def log(self) -> Log:
        """Return what the sensors have read so far, with the truth beside it."""
        read = slice(self._taken)
        y = self._y[: self._done + 1]
        return log_of(self.prepared, y, self._stamps[read], self._samples[read])

    def _read(self) -> Samples:
        """Return the samples whose stamps have come."""
        end = int(np.searchsorted(self._stamps, self.time + 1e-9, side="right"))
        stamps = self._stamps[self._taken : end]
        rows = slice(max(0, self._done - self._looks_back), self._done + 1)
        samples = self._sampler.read(self._y[rows], self._grid[rows], stamps)
        self._samples[self._taken : end] = samples
        self._taken = end
        return [*zip(stamps.tolist(), samples)]


Controller: TypeAlias = Callable[[float, Mapping[str, float], Reading], Mapping[str, float]]
"""Function (time [s], readings by sensor [SI], estimate) → commands by drive [N or N m]."""

Teller: TypeAlias = Callable[[float, Floats], Reading]
"""Function (stamp [s], sample of all sensors) → the estimate of the angles that the controller is
given.
"""

ENCODER = "encoder"
"""Name of the feedback by an encoder in the joint."""

RATIO = "ratio"
"""Name of the feedback by the displacements alone, divided by the radii."""

COMMAND = "command"
"""Name of the feedback by `adaptive` with a controller that adds two forces: those that the rig's
inverse gives for the reference, and those of the gains.
"""

ENCODER_STEP: float = Control.model_fields["encoder_resolution"].default
"""Step of the encoder where there is no ``[control]`` [rad]: the default of one."""


@dataclass(frozen=True, repr=False)
class ClosedLoop:
    """What a controlled rig did; arrays have a row for each call of the controller.

    Args:
        rig: as filters know it.
        log: what the sensors read, with the truth beside it.
        feedback: name of what told the controller the angles.
        time: of the calls [s], (k,).
        angles: true ones [rad], (k, n_joints).
        estimates: angles that the controller was told [rad], (k, n_joints).
        stds: standard deviations of their errors, as told [rad], (k, n_joints).
        commands: by drive [N or N m], (k,) each.
        references: desired angles by joint [rad], (k,) each; empty where the controller has its
            own.
    """

    rig: Rig
    log: Log
    feedback: str
    time: Floats
    angles: Floats
    estimates: Floats
    stds: Floats
    commands: Mapping[str, Floats]
    references: Mapping[str, Floats]

    def __repr__(self) -> str:
        return f"ClosedLoop({self.feedback}, {len(self.time)} commands in {self.time[-1]:g} s)"


def simulate(
    rig: Rig | str | Path,
    scenario: Scenario | str | Path,
    seed: int = 0,
    *,
    controller: Controller | None = None,
    period: float | str | None = None,
    estimator: str | None = None,
) -> Log:
    """Simulate a scenario on a rig and return what its sensors read, with the truth beside it.

    The plant is `rig` with the scenario's ``[plant]`` values. It starts at rest, its drives in
    equilibrium. All sensors of the rig are sampled at their own rates; a sensor without a value at
    the stamp of another one is NaN there. A controller is called every period with what has been
    read and estimated by then; its commands act one period later.

    Args:
        rig: as filters know it; or a shipped rig's name, or a path.
        scenario: what is done to it; or a shipped scenario's name, or a path. Its ``[control]`` is
            used where there is no `controller`.
        seed: of the sensors' errors; the same seed gives the same log.
        controller: (time, measured, estimate) → commands by drive.
        period: time between two calls of the controller, seconds or a text with a unit.
        estimator: what tells the controller the angles: an estimator's name, "encoder" or "ratio";
            default that of ``[control]``, else adaptive.

    Returns:
        log: channels by sensor name; truth holds ``theta`` [rad], ``external_torque`` [N m] and, by
            drive or tendon name, ``position_…``, ``force_…`` and ``tension_…``.

    Raises:
        ScenarioError: the scenario does not fit the rig, or the motion left all bounds.
        RigError: the plant's values are wrong.
        ControlError: the controller failed, or asked for what is not possible.
    """
    scenario = as_scenario(scenario)
    if controller is None and scenario.control is None:
        return simulate_plant(rig, scenario, seed)
    return closed_loop(
        rig, scenario, seed, controller=controller, period=period, feedback=estimator
    ).log


def closed_loop(
    rig: Rig | str | Path,
    scenario: Scenario | str | Path,
    seed: int = 0,
    *,
    controller: Controller | None = None,
    period: float | str | None = None,
    feedback: str | None = None,
) -> ClosedLoop:
    """Run a controller on a simulated rig and return what the rig did; see `simulate`.

    Controller, period and feedback are by default those of the scenario's ``[control]``. A feedback
    is "encoder", "ratio", "command" or an estimator's name; a `period` is seconds or a text with a
    unit.

    Raises:
        ScenarioError: the scenario does not fit the rig, or the motion left all bounds.
        ControlError: the controller failed, or asked for what is not possible.
    """
    scenario = as_scenario(scenario)
    rig = as_rig(rig)
    control = scenario.control or Control.model_construct(feedback=usual_estimator(rig), joints={})
    joints = control.joints
    if controller is None:
        if not joints:
            raise ControlError("no controller: give one, or a [control] table in the scenario")
        check_names(joints, rig.joint_names, "control.joints", "joint", ControlError)
    try:
        length = control.period if period is None else to_si(period, "s")
    except ValueError as problem:
        raise ControlError(f"period: {problem}") from None
    feedback = feedback or control.feedback
    plant = ControlledPlant(rig, scenario, length)
    if controller is None and feedback == COMMAND:
        controlled = commanded_forces(rig, joints, control.co_contraction)
        run = _run(plant, *controlled, feedback, seed)
    else:
        used = controller or PID(rig, joints, length, control.co_contraction)
        run = run_controller(plant, used, feedback, seed, encoder_step=control.encoder_resolution)
    if controller is not None:
        return run
    references = {name: joint.reference.at(run.time) for name, joint in joints.items()}
    return replace(run, references=references)


def run_controller(
    plant: SteppedPlant,
    controller: Controller,
    feedback: str,
    seed: int = 0,
    *,
    encoder_step: float = ENCODER_STEP,
) -> ClosedLoop:
    """Run a controller on a plant that steps, of this package or of another simulator, until the
    plant has finished; return what the rig did.

    The feedback "encoder" is an encoder in the joint with steps of `encoder_step` [rad]; "ratio"
    and estimators' names are as for `closed_loop`.

    Raises:
        ControlError: the controller failed, or asked for what is not possible.
    """
    name = "inextensible" if feedback == RATIO else feedback
    if name not in (ENCODER, *ESTIMATORS):
        allowed = [ENCODER, RATIO, COMMAND, *ESTIMATORS]
        raise ControlError(
            f"feedback: '{name}' is none of {', '.join(allowed)}{did_you_mean(name, allowed)}"
        )
    if name == ENCODER:
        std = encoder_step * quantisation_variance(1.0) ** 0.5

        def tell(stamp: float, values: Floats) -> Reading:
            angles = quantised_values(plant.angles, encoder_step).tolist()
            return Reading(stamp, tuple(angles), (std,) * len(angles), "ok")

        return _run(plant, controller, tell, feedback, seed)
    monitor = Monitor(LiveEstimator(plant.rig, name))
    at = [plant.rig.sensor_names.index(channel) for channel in monitor.channels]
    return _run(plant, controller, lambda t, read: monitor.take(t, read[at]), feedback, seed)


def _run(
    plant: SteppedPlant, controller: Controller, tell: Teller, feedback: str, seed: int
) -> ClosedLoop:
    """Return the loop of a controller that is told the angles by `tell`."""
    rows = list[tuple[float, Floats, Sequence[float], Sequence[float]]]()
    requests = list[Mapping[str, float]]()
    measured = dict[str, float]()
    reading = None
    waiting = dict[str, float]()
    names = plant.rig.sensor_names
    samples = plant.reset(seed)
    while True:
        for stamp, values in samples:
            reading = tell(stamp, values)
            measured |= {
                name: number for name, number in zip(names, values.tolist()) if number == number
            }
        assert reading is not None
        time = plant.time
        try:
            asked = controller(time, dict(measured), reading)
        except Exception as problem:
            reason = ": ".join(filter(None, (type(problem).__name__, str(problem))))
            raise ControlError(f"the controller failed at {time:g} s: {reason}") from problem
        if not isinstance(asked, Mapping):
            raise ControlError(
                f"the controller returns commands by drive, {asked!r:.60} came at {time:g} s"
            )
        rows.append((time, plant.angles, reading.angles, reading.angle_stds))
        requests.append(asked)
        samples = plant.step(waiting)
        waiting = dict(asked)
        if plant.finished:
            break
    times, angles, estimates, stds = map(np.array, zip(*rows))
    commands = {
        name: np.array([float(request.get(name, 0.0)) for request in requests])
        for name in plant.rig.drive_names
    }
    log = plant.log()
    return ClosedLoop(plant.rig, log, feedback, times, angles, estimates, stds, commands, {})


@dataclass(frozen=True)
class Tracking:
    """How one joint keeps to its reference.

    Args:
        rms: of the true angle's deviation from the reference [rad].
        effort: RMS of all commands [N or N m].
        estimate_rms: RMS error of the angle that the controller was told [rad].
    """

    joint: str
    rms: float
    effort: float
    estimate_rms: float


def trackings_of(run: ClosedLoop) -> tuple[Tracking, ...]:
    """Return how each controlled joint that has a reference keeps to it."""
    effort = _rms(np.array([*run.commands.values()]))
    trackings = []
    for name, reference in run.references.items():
        j = run.rig.joint_names.index(name)
        angle = run.angles[:, j]
        trackings.append(
            Tracking(name, _rms(angle - reference), effort, _rms(run.estimates[:, j] - angle))
        )
    return tuple(trackings)


def _rms(errors: Floats) -> float:
    """Return the root mean square of the known numbers; NaN where none is known."""
    known = errors[np.isfinite(errors)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else nan


MOST_LIMIT = 3.0
"""End of the axis of deviations, as a multiple of the best run's; a run that is lost leaves the
axis. Source: layout.
"""


def plot_control(runs: Sequence[ClosedLoop], path: str | Path | None = None) -> Figure:
    """Draw the reference and, for each feedback, the true angle, its deviation and a command; also
    the error of the first estimator with its 95 % band.

    The `runs` are of one scenario with different feedbacks; the joint is the first one that is
    controlled.
    """
    first = runs[0]
    name = next(iter(first.references))
    j = first.rig.joint_names.index(name)
    reference = np.rad2deg(first.references[name])
    time = first.time
    with figure(3, 1, (6.5, 6.2), sharex=True, height_ratios=(3, 2, 2)) as (drawing, axes):
        angles, deviations, commands = axes
        angles.plot(time, reference, color=BLACK, lw=1.0, dashes=(4, 2), label="reference")
        worst = []
        for k, run in enumerate(runs):
            angle = np.rad2deg(run.angles[:, j])
            away = angle - reference
            look = {"lw": 1.2, **curve_style(k)}
            angles.plot(time, angle, label=f"fed back by {run.feedback}", **look)
            deviations.plot(time, away, **look)
            worst.append(float(np.quantile(np.abs(away), 0.98)))
            effort = next(iter(run.commands.values()))
            # a feedback that chatters stands behind the others
            commands.plot(time, effort, zorder=3 - 0.1 * k, **look)
        estimated = next((run for run in runs if run.feedback not in (ENCODER, RATIO)), None)
        if estimated is not None:
            error = np.rad2deg(estimated.estimates[:, j] - estimated.angles[:, j])
            half = BAND * np.rad2deg(estimated.stds[:, j])
            label = f"error of {estimated.feedback} and its {COVERED_TEXT} band"
            deviations.plot(time, error, color=SOFT, lw=1, label=label)
            deviations.fill_between(time, error - half, error + half, color=band_colour(SOFT), lw=0)
            legend_above(deviations)
        limit = MOST_LIMIT * min(worst)
        span = float(np.ptp(reference)) or 1.0
        angles.set_ylim(reference.min() - 0.4 * span, reference.max() + 0.4 * span)
        deviations.set_ylim(-limit, limit)
        angles.set_ylabel(f"angle of {name} [°]")
        deviations.set_ylabel("from reference [°]")
        drive = first.rig.drives[0]
        commands.set_ylabel(f"command {drive.name} [{effort_unit(drive)}]")
        commands.set_xlabel("time [s]")
        legend_above(angles)
    return save_figure(drawing, path)
