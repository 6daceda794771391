"""Hours of a scenario, simulated piece by piece: the plant's parameters change as its schedule
says, and the memory that is used does not grow.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fnmatch import fnmatchcase
from math import ceil, sqrt
from pathlib import Path

import numpy as np

from distal.arrays import Floats
from distal.errors import ScenarioError
from distal.kernels import Feed, advance
from distal.logs import Log
from distal.model import Mechanism
from distal.rig import Rig, as_rig, named
from distal.simulation.plant import PlantMotion, at_rest, plant_kernel, rows_of
from distal.simulation.readings import Sampler, stamps_of
from distal.simulation.scenario import Rezero, Scenario, load_scenario
from distal.simulation.signal_inputs import BodyInputs, body_inputs
from distal.simulation.simulate import log_of, prepare
from distal.suggestions import did_you_mean

PIECE = 60.0
"""Length of a piece, within which the plant's parameters are constant [s]. Source: judgement."""

HOUR = 3600.0
"""Length of an hour [s]. Source: definition (unit conversion)."""

LEAST = 0.05
"""Least share of its first value to which a parameter of the plant may fall. Source: judgement."""


@dataclass(frozen=True)
class Piece:
    """A part of a long log; its time goes on from the piece before.

    Args:
        known: the joints' angles where a rezero gives them, NaN elsewhere [rad], (k, n_joints).
    """

    log: Log
    known: Floats


def simulate_pieces(
    rig: Rig | str | Path, scenario: Scenario | str | Path, seed: int = 0
) -> Iterator[Piece]:
    """Simulate hours of a scenario and yield what the sensors read, minute after minute.

    A parameter of the plant on the scenario's ``[schedule]`` is p(t) = p (1 + rate t + w(t)), where
    w is a random walk; it changes from one piece to the next. During the scenario's ``[rezero]``
    its drives' pulls replace the usual ones. The seed decides the sensors' errors and the random
    walks.

    Raises:
        ScenarioError: the scenario does not fit the rig, or the motion left all bounds.
        RigError: the plant's values are wrong.
    """
    scenario = scenario if isinstance(scenario, Scenario) else load_scenario(scenario)
    rig = as_rig(rig)
    if scenario.control is not None:
        raise ScenarioError("control: loops are not closed over hours; take [control] out")
    length = min(PIECE, scenario.duration)
    prepared = prepare(rig, scenario.model_copy(update={"duration": length}), seed, period=length)
    plant = prepared.plant
    dt = prepared.dt
    steps = len(prepared.inputs.effort)
    scheduled = [(parameters_at(plant, path), change) for path, change in scenario.schedule.items()]
    rezero = scenario.rezero
    rezeroing = scenario if rezero is None else _pulls(scenario, rezero)
    kernel = plant_kernel(plant, prepared.count)
    kernel_state, y = at_rest(plant, prepared.inputs, prepared.start, kernel)
    walks = np.zeros(len(scheduled))
    rng = np.random.default_rng([seed, 1])
    sampler = Sampler(plant, seed)
    for k in range(ceil(scenario.duration / length - 1e-9)):
        begin = k * length
        p = plant.parameters.values.copy()
        for i, (at, change) in enumerate(scheduled):
            p[at] *= max(1.0 + change.per_hour * begin / HOUR + walks[i], LEAST)
            walks[i] += change.walk * sqrt(length / HOUR) * rng.normal()
        grid = begin + dt * np.arange(steps + 1, dtype=np.float64)
        inputs = body_inputs(scenario, plant, grid[:-1])
        if rezero is not None:
            _replace(inputs, body_inputs(rezeroing, plant, grid[:-1]), rezero, plant, grid[:-1])
        kernel_states, ys = advance(kernel, Feed(kernel_state, rows_of(inputs, dt), p))
        motion = PlantMotion(plant, np.vstack([y, ys]))
        kernel_state = kernel_states[-1]
        y = ys[-1:]
        motion.check()
        stamps = stamps_of(plant.rig, begin, begin + length)
        log = log_of(motion, grid, stamps, sampler.read(motion.y, grid, stamps), scenario)
        yield Piece(log, _known(scenario.rezero, plant.rig, stamps))


def parameters_at(plant: Mechanism, path: str) -> list[int]:
    """Return the indices of the plant's parameters that a path names. Components may stand in it by
    name or by index; ``*`` stands for all components of a kind.

    Raises:
        ScenarioError: the path names no parameter of the plant.
    """
    names = plant.parameters.names
    paths = [named(plant.rig, name) for name in names]
    matches = [
        i
        for i, pair in enumerate(zip(paths, names))
        if any(name.count(".") == path.count(".") and fnmatchcase(name, path) for name in pair)
    ]
    if not matches:
        raise ScenarioError(
            f"schedule: the plant has no number '{path}'{did_you_mean(path, paths)}"
        )
    return matches


def _pulls(scenario: Scenario, rezero: Rezero) -> Scenario:
    """Return the scenario with the pulls of a rezero in place of its own."""
    if rezero.lasts >= rezero.every:
        raise ScenarioError(
            f"rezero: it lasts {rezero.lasts:g} s and comes every {rezero.every:g} s; leave time "
            "between"
        )
    return scenario.model_copy(update={"drives": rezero.drives})


def _since(rezero: Rezero, time: Floats) -> Floats:
    """Return the time since the last rezero began [s], infinite before the first one, which comes
    after `every`.
    """
    return np.where(time >= rezero.every, np.mod(time, rezero.every), np.inf)


def _replace(
    inputs: BodyInputs, pulls: BodyInputs, rezero: Rezero, plant: Mechanism, time: Floats
) -> None:
    """Put a rezero's pulls in place of the inputs of its drives, at the times when it lasts."""
    names = plant.rig.drive_names
    bodies = np.array([plant.n_joints + names.index(name) for name in rezero.drives])
    at = np.ix_(np.flatnonzero(_since(rezero, time) < rezero.lasts), bodies)
    inputs.effort[at] = pulls.effort[at]
    inputs.added_inertia[at] = pulls.added_inertia[at]
    inputs.servo[at] = pulls.servo[at]


def _known(rezero: Rezero | None, rig: Rig, stamps: Floats) -> Floats:
    """Return the angles that a rezero gives at `stamps` [s], NaN elsewhere [rad], (k, n_joints)."""
    angles = np.full((len(stamps), len(rig.joints)), np.nan)
    if rezero is not None:
        since = _since(rezero, stamps)
        late = (since >= rezero.lasts / 2) & (since < rezero.lasts)
        joint = 0 if rezero.joint is None else rig.joint_names.index(rezero.joint)
        angles[late, joint] = rezero.angle
    return angles
