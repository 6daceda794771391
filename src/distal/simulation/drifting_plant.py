"""Hours of a scenario, simulated piece by piece: the plant's parameters change as its schedule
says, and the memory that is used does not grow.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fnmatch import fnmatchcase
from math import ceil, sqrt

import numpy as np

from distal.arrays import Floats
from distal.errors import ScenarioError, did_you_mean
from distal.kernels import Feed, advance
from distal.logs import Log
from distal.model import Mechanism
from distal.rig import Rig, named
from distal.simulation.plant import plant_kernel
from distal.simulation.plant_motion import PlantMotion, at_rest, body_inputs, rows_of
from distal.simulation.readings import Sampler, stamps_of
from distal.simulation.scenario import Rezero, Scenario
from distal.simulation.simulate import log_of, prepare

PIECE = 60.0
"""Length of a piece, within which the plant's parameters are constant [s]. Source: judgement."""

HOUR = 3600.0
"""Length of an hour [s]. Source: definition (unit conversion)."""


@dataclass(frozen=True)
class Piece:
    """A part of a long log; its time goes on from the piece before.

    Args:
        known: the angle of the rezero's joint where it gives one, NaN elsewhere [rad], (k,).
    """

    log: Log
    known: Floats


def simulate_pieces(rig: Rig, scenario: Scenario, seed: int = 0) -> Iterator[Piece]:
    """Simulate hours of a scenario and yield what the sensors read, minute after minute.

    A parameter of the plant on the scenario's ``[schedule]`` is p(t) = p (1 + rate t + w(t)), where
    w is a random walk; it changes from one piece to the next. During the scenario's ``[rezero]``
    its drives' pulls replace the usual ones. The seed decides the sensors' errors and the random
    walks.

    Raises:
        ScenarioError: the scenario does not fit the rig, or the motion left all bounds.
        RigError: the plant's values are wrong.
    """
    if scenario.control is not None:
        raise ScenarioError("control: loops are not closed over hours; take [control] out")
    length = min(PIECE, scenario.duration)
    prepared = prepare(rig, scenario.model_copy(update={"duration": length}), seed, period=length)
    plant = prepared.plant
    dt = prepared.dt
    steps = len(prepared.inputs.effort)
    scheduled = [(parameters_at(plant, path), change) for path, change in scenario.schedule.items()]
    rezero = scenario.rezero
    kernel = plant_kernel(plant, prepared.count)
    kernel_state, y = at_rest(plant, prepared.inputs, prepared.start, kernel)
    walks = np.zeros(len(scheduled))
    rng = np.random.default_rng([seed, 1])
    sampler = Sampler(plant, seed)
    for k in range(ceil(scenario.duration / length - 1e-9)):
        begin = k * length
        p = plant.parameters.values.copy()
        for i, (at, change) in enumerate(scheduled):
            p[at] *= max(1.0 + change.per_hour * begin / HOUR + walks[i], 0.0)
            walks[i] += change.walk * sqrt(length / HOUR) * rng.normal()
        grid = begin + dt * np.arange(steps + 1, dtype=np.float64)
        inputs = body_inputs(scenario, plant, grid[:-1])
        if rezero is not None:
            drives = {**scenario.drives, **rezero.drives}
            pulled = scenario.model_copy(update={"drives": drives})
            pulls = body_inputs(pulled, plant, grid[:-1])
            lasts = _since(rezero, grid[:-1]) < rezero.lasts
            inputs.effort[lasts] = pulls.effort[lasts]
            inputs.added_inertia[lasts] = pulls.added_inertia[lasts]
            inputs.servo[lasts] = pulls.servo[lasts]
        kernel_states, ys = advance(kernel, Feed(kernel_state, rows_of(inputs, dt), p))
        motion = PlantMotion(plant, np.vstack([y, ys]))
        kernel_state = kernel_states[-1]
        y = ys[-1:]
        motion.check()
        stamps = stamps_of(plant.rig, begin, begin + length)
        log = log_of(motion, grid, stamps, sampler.read(motion.y, grid, stamps), scenario)
        yield Piece(log, _known(rezero, stamps))


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


def _since(rezero: Rezero, time: Floats) -> Floats:
    """Return the time since the last rezero began [s], infinite before the first one, which comes
    after `every`.
    """
    return np.where(time >= rezero.every, np.mod(time, rezero.every), np.inf)


def _known(rezero: Rezero | None, stamps: Floats) -> Floats:
    """Return the angle that a rezero gives at `stamps` [s], NaN elsewhere [rad], (k,)."""
    if rezero is None:
        return np.full(len(stamps), np.nan)
    since = _since(rezero, stamps)
    is_known = (since >= rezero.lasts / 2) & (since < rezero.lasts)
    return np.where(is_known, rezero.angle, np.nan)
