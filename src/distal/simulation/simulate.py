"""Simulation without a controller: a rig, a scenario and a seed become a log with the truth. Plants
of one structure can move side by side in vector lanes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil
from pathlib import Path

import numpy as np

from distal.arrays import Floats
from distal.errors import ScenarioError
from distal.kernels import Feed, advance_all
from distal.logs import Log, TruthSource
from distal.logs.memory import MEMORY_VARIABLE, memory_limit
from distal.model import Mechanism, substeps
from distal.rig import Rig, angle_names, as_rig, torque_names
from distal.simulation.plant_kernel import longest_interval, plant_kernel
from distal.simulation.plant_motion import (
    BodyInputs,
    PlantMotion,
    at_rest,
    body_inputs,
    equilibrium,
    initial_angles,
    rows_of,
)
from distal.simulation.readings import Sampler, stamps_of
from distal.simulation.scenario import Scenario, load_scenario

LONGEST_INTERVAL = 1e-3
"""Longest interval over which a scenario's signals are constant [s]. Source: judgement."""

SIMULATED = TruthSource(position="the simulation")
"""Where the truth of a simulated log comes from."""


def simulate_plant(rig: Rig | str | Path, scenario: Scenario | str | Path, seed: int = 0) -> Log:
    """Simulate a scenario without a controller: the part of `distal.simulate` that needs no
    estimator.

    Raises:
        ScenarioError: the scenario does not fit the rig or has a controller, or the motion left all
            bounds.
        RigError: the plant's values are wrong.
    """
    prepared = prepare(rig, scenario, seed)
    check_open(prepared.scenario)
    (motion,) = motions_of([prepared])
    return sampled(prepared, motion, seed)


def check_open(scenario: Scenario) -> None:
    """Refuse a scenario with a controller, which is run in another way.

    Raises:
        ScenarioError: it has a controller.
    """
    if scenario.control is not None:
        name = scenario.name or "scenario"
        raise ScenarioError(
            f"{name}: has a [control], and its loop is not closed here; use distal.closed_loop or "
            "distal control, one "
            "seed at a time"
        )


@dataclass(frozen=True)
class Prepared:
    """A scenario on a rig, ready to be simulated.

    Args:
        rig: as filters know it.
        plant: equations of the plant, which has the scenario's ``[plant]`` values, too.
        inputs: what acts on the bodies in each interval.
        start: coordinates at rest, (n_bodies,) [rad, m].
        dt: length of an interval [s].
        count: number of sub-steps in an interval.
    """

    rig: Rig
    scenario: Scenario
    plant: Mechanism
    inputs: BodyInputs
    start: Floats
    dt: float
    count: int


def prepare(
    rig: Rig | str | Path,
    scenario: Scenario | str | Path,
    seed: int = 0,
    period: float | None = None,
) -> Prepared:
    """Return a scenario on a rig, ready to be simulated. The seed is only checked; the `period` [s]
    is that of `timing`.

    Raises:
        ScenarioError: the scenario does not fit the rig.
        RigError: the plant's values are wrong.
    """
    scenario = scenario if isinstance(scenario, Scenario) else load_scenario(scenario)
    rig = as_rig(rig)
    if not isinstance(seed, (int, np.integer)) or seed < 0:
        raise ScenarioError(f"seed: must be a whole number from 0, {seed!r} came")
    plant = Mechanism(scenario.plant_rig(rig), remembers=True)
    dt, steps, count = timing(plant, scenario, period)
    grid: Floats = dt * np.arange(steps, dtype=np.float64)
    inputs = body_inputs(scenario, plant, grid)
    start = equilibrium(plant, initial_angles(scenario, plant), inputs)
    return Prepared(rig, scenario, plant, inputs, start, dt, count)


def timing(
    plant: Mechanism, scenario: Scenario, period: float | None = None
) -> tuple[float, int, int]:
    """Return the length of an interval [s], the number of intervals in a scenario, and the number
    of sub-steps in each.

    Whole intervals fill a `period` [s], by default the time between two samples of the fastest
    sensor.

    Raises:
        ScenarioError: the scenario is too short or too long.
    """
    fastest = max((sensor.rate for sensor in plant.rig.sensors), default=100.0)
    filled = 1.0 / fastest if period is None else period
    dt, count = intervals_of(plant, filled)
    if scenario.duration * fastest < 1.0 - 1e-9:
        raise ScenarioError(f"duration: {scenario.duration:g} s is shorter than one sample")
    # each interval has inputs and outputs of the plant, of which BodyInputs has five for each body
    size = 2 * 5 * plant.n_bodies * np.dtype(np.float64).itemsize * scenario.duration / dt
    if size > memory_limit():
        raise ScenarioError(
            f"duration: {scenario.duration:g} s in steps of {dt:g} s takes {size / 1e9:.1f} GB; "
            f"{memory_limit() / 1e9:.3g} GB are allowed ({MEMORY_VARIABLE}). Simulate a "
            "shorter time, or set lower sensor rates"
        )
    return dt, ceil(scenario.duration / dt - 1e-9), count


def intervals_of(plant: Mechanism, filled: float) -> tuple[float, int]:
    """Return the length of an interval [s] and the number of sub-steps in it. A whole number of
    intervals fills the time `filled` [s].
    """
    dt = filled / ceil(filled / min(LONGEST_INTERVAL, longest_interval(plant)) - 1e-9)
    return dt, max(2, 2 * substeps(plant, dt))


def motions_of(runs: Sequence[Prepared]) -> list[PlantMotion]:
    """Return the motions of runs whose plants and sub-steps have one structure, side by side where
    there are vector lanes.

    Raises:
        ScenarioError: a motion left all bounds.
    """
    kernel = plant_kernel(runs[0].plant, runs[0].count)
    begun = [at_rest(run.plant, run.inputs, run.start, kernel) for run in runs]
    feeds = [
        Feed(kernel_state, rows_of(run.inputs, run.dt), run.plant.parameters.values)
        for run, (kernel_state, _) in zip(runs, begun)
    ]
    moved = advance_all(kernel, feeds, keep=())
    motions = [
        PlantMotion(run.plant, np.vstack([first, after.ys]))
        for run, (_, first), after in zip(runs, begun, moved)
    ]
    for motion in motions:
        motion.check()
    return motions


def sampled(prepared: Prepared, motion: PlantMotion, seed: int) -> Log:
    """Return the log of a motion: what the sensors read, and the truth. The seed decides the
    sensors' errors.
    """
    grid: Floats = prepared.dt * np.arange(len(motion.y), dtype=np.float64)
    stamps = stamps_of(prepared.plant.rig, 0.0, prepared.scenario.duration)
    read = Sampler(prepared.plant, seed).read(motion.y, grid, stamps)
    return log_of(motion, grid, stamps, read, prepared.scenario)


def log_of(
    motion: PlantMotion, grid: Floats, stamps: Floats, read: Floats, scenario: Scenario
) -> Log:
    """Return the log of a motion at the times `grid` [s], with what its sensors read at `stamps`
    [s], (k, n_sensors).
    """
    channels = {sensor.name: read[:, k] for k, sensor in enumerate(motion.plant.rig.sensors)}
    truth = true_motion(motion, grid, stamps)
    return Log(stamps, channels, truth, scenario.name or "simulation", SIMULATED)


def true_motion(motion: PlantMotion, grid: Floats, stamps: Floats) -> dict[str, Floats]:
    """Return the truth of a log by name: angles and torques of joints, positions and forces of
    drives, tensions, (k,) each.

    The motion is at the times `grid` [s], the log has the `stamps` [s], (k,).
    """
    rig = motion.plant.rig
    n = motion.plant.n_joints
    names = [
        *angle_names(rig.joint_names),
        *torque_names(rig.joint_names),
        *(f"position_{drive}" for drive in rig.drive_names),
        *(f"force_{drive}" for drive in rig.drive_names),
        *(f"tension_{tendon}" for tendon in rig.tendon_names),
    ]
    q = motion.q
    pulls = motion.pulls
    columns = np.hstack([q[:, :n], pulls[:, :n], q[:, n:], pulls[:, n:], motion.tensions])
    return {name: np.interp(stamps, grid, column) for name, column in zip(names, columns.T)}
