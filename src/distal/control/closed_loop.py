"""A controller in the loop, period after period: plant, sensors, estimator, controller."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

import numpy as np

from distal.arrays import Floats
from distal.control.controlled_plant import ControlledPlant, SteppedPlant
from distal.control.controllers import PID, CommandedForces
from distal.errors import ControlError, did_you_mean
from distal.estimators import ESTIMATORS, usual_estimator
from distal.logs import Log
from distal.rig import Rig, as_rig
from distal.run import LiveEstimator, Monitor, Reading
from distal.sensor_errors import quantisation_variance, quantised_values
from distal.simulation import Control, Scenario, load_scenario, simulate_plant
from distal.simulation.plant_motion import check_names
from distal.units import to_si

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
    scenario = scenario if isinstance(scenario, Scenario) else load_scenario(scenario)
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
    scenario = scenario if isinstance(scenario, Scenario) else load_scenario(scenario)
    rig = as_rig(rig)
    control = scenario.control
    length = _period(period, scenario)
    feedback = feedback or (usual_estimator(rig) if control is None else control.feedback)
    if controller is not None:
        step = ENCODER_STEP if control is None else control.encoder_resolution
        return run_controller(
            ControlledPlant(rig, scenario, length), controller, feedback, seed, encoder_step=step
        )
    if control is None:
        raise ControlError("no controller: give one, or a [control] table in the scenario")
    check_names(control.joints, rig.joint_names, "control.joints", "joint", ControlError)
    plant = ControlledPlant(rig, scenario, length)
    if feedback == COMMAND:
        commanded = CommandedForces(rig, control.joints, control.co_contraction)
        run = _run(plant, commanded, commanded.tell, feedback, seed)
    else:
        pid = PID(rig, control.joints, length, control.co_contraction)
        run = run_controller(plant, pid, feedback, seed, encoder_step=control.encoder_resolution)
    return replace(
        run,
        references={name: joint.reference.at(run.time) for name, joint in control.joints.items()},
    )


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
    tell = _encoder(plant, encoder_step) if feedback == ENCODER else _estimator(plant.rig, feedback)
    return _run(plant, controller, tell, feedback, seed)


def _run(
    plant: SteppedPlant, controller: Controller, tell: Teller, feedback: str, seed: int
) -> ClosedLoop:
    """Return the loop of a controller that is told the angles by `tell`."""
    rows = list[tuple[float, Floats, Reading, Mapping[str, float]]]()
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
        asked = _called(controller, plant.time, dict(measured), reading)
        rows.append((plant.time, plant.angles, reading, asked))
        samples = plant.step(waiting)
        waiting = dict(asked)
        if plant.finished:
            break
    times, angles, readings, requests = zip(*rows)
    estimates = [reading.angles for reading in readings]
    stds = [reading.angle_stds for reading in readings]
    arrays = np.array(times), np.array(angles), np.array(estimates), np.array(stds)
    drives = plant.rig.drive_names
    commands = {
        name: np.array([float(request.get(name, 0.0)) for request in requests]) for name in drives
    }
    return ClosedLoop(plant.rig, plant.log(), feedback, *arrays, commands, {})


def _called(
    controller: Controller, time: float, measured: Mapping[str, float], reading: Reading
) -> Mapping[str, float]:
    try:
        asked = controller(time, measured, reading)
    except Exception as problem:
        reason = f"{type(problem).__name__}: {problem}" if str(problem) else type(problem).__name__
        raise ControlError(f"the controller failed at {time:g} s: {reason}") from problem
    if not isinstance(asked, Mapping):
        raise ControlError(
            f"the controller returns commands by drive, {asked!r:.60} came at {time:g} s"
        )
    return asked


def _period(period: float | str | None, scenario: Scenario) -> float:
    if period is None:
        return 0.01 if scenario.control is None else scenario.control.period
    try:
        return to_si(period, "s")
    except ValueError as problem:
        raise ControlError(f"period: {problem}") from None


def _encoder(plant: SteppedPlant, step: float) -> Teller:
    """Return the function (stamp, sample) → the reading of encoders of the true angles, with a step
    [rad].
    """

    def tell(stamp: float, values: Floats) -> Reading:
        angles = quantised_values(plant.angles, step)
        return Reading(
            stamp,
            tuple(angles.tolist()),
            (step * quantisation_variance(1.0) ** 0.5,) * len(angles),
            "ok",
        )

    return tell


def _estimator(rig: Rig, name: str) -> Teller:
    """Return the function (stamp, sample) → an estimator's reading of the angles."""
    name = "inextensible" if name == RATIO else name
    if name not in ESTIMATORS:
        allowed = [ENCODER, RATIO, COMMAND, *ESTIMATORS]
        raise ControlError(
            f"feedback: '{name}' is none of {', '.join(allowed)}{did_you_mean(name, allowed)}"
        )
    monitor = Monitor(LiveEstimator(rig, name))
    at = [rig.sensor_names.index(channel) for channel in monitor.channels]
    return lambda stamp, values: monitor.take(stamp, values[at])
