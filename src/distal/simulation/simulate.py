"""Simulation without a controller: a rig, a scenario and a seed become a log with the truth, the
sensors read at their own rates; and the file beside it that names its rig, and what its scenario
changed in the rig. Plants of one structure can move side by side in vector lanes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from pathlib import Path

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.errors import RigError, ScenarioError
from distal.expressions import Vector
from distal.kernels import Feed, advance_all
from distal.logs import Log, TruthSource
from distal.machine_limits import MEMORY_VARIABLE, memory_limit
from distal.model import Mechanism, Moment, substeps
from distal.rig import (
    Rig,
    angle_names,
    as_rig,
    description_path,
    load_rig,
    parse_assignment,
    parse_toml,
    read_text,
    shipped_rigs,
    torque_names,
    travel_of,
)
from distal.sensor_models import SensorErrors
from distal.simulation.plant import (
    at_rest,
    check_motion,
    equilibrium,
    initial_angles,
    longest_interval,
    output_layout,
    plant_inputs,
    plant_kernel,
)
from distal.simulation.scenario import Scenario, as_scenario


def moment_of(plant: Mechanism, y: Vector) -> Moment:
    """Return the motion at one moment from an output y, (n_y,), of a plant's kernel
    (`plant_function`).
    """
    return Moment(plant, *output_layout(plant).parts(y).values())


class Sampler:
    """What a plant's sensors read in the run of a seed, each at its own rate, along a motion that
    may come in pieces.
    """

    def __init__(self, plant: Mechanism, seed: int) -> None:
        self._rig = rig = plant.rig
        y = ca.SX.sym("y", output_layout(plant).size)
        p = plant.parameters
        moment = moment_of(plant, y)
        readings = [ca.SX(moment.read(sensor)) for sensor in rig.sensors]
        # most sensors read an output of the plant: these are taken as they are, in half the time
        outputs = {y[i].element_hash(): i for i in range(y.numel())}
        self._columns = np.array([outputs.get(of.element_hash(), -1) for of in readings])
        computed = [of for of, column in zip(readings, self._columns) if column < 0]
        values = ca.substitute(ca.vertcat(*computed), p.symbols, ca.DM(p.values))
        self._function = ca.Function("readings", [y], [ca.densify(values)])
        rngs = np.random.default_rng(seed).spawn(len(rig.sensors))
        self._errors = [
            SensorErrors(sensor, travel_of(sensor, rig), rng)
            for sensor, rng in zip(rig.sensors, rngs)
        ]

    def read(self, y: Floats, grid: Floats, stamps: Floats) -> Floats:
        """Return what the sensors read at the next `stamps`, (k, n_sensors) [SI], NaN for a sensor
        that is not due.

        Args:
            y: outputs of the plant's kernel, (n, n_y).
            grid: times of these outputs [s], (n,); between them the motion is a straight line.
            stamps: rising, of `stamps_of` [s], (k,).
        """
        read = np.full((len(stamps), len(self._errors)), np.nan)
        true: Floats = y[:, self._columns]
        if (self._columns < 0).any():
            true[:, self._columns < 0] = np.array(self._function(y.T)).T
        for k, (sensor, errors) in enumerate(zip(self._rig.sensors, self._errors)):
            times = np.round(stamps * sensor.rate) / sensor.rate
            due = np.flatnonzero(np.round(times, 9) == stamps)
            if len(due):
                at = np.interp(times[due] - sensor.delay, grid, true[:, k])
                read[due, k] = errors.read(at)
        return read


def stamps_of(rig: Rig, begin: float, end: float) -> Floats:
    """Return the stamps from `begin` up to `end`, which is excluded, at which at least one of a
    rig's sensors is sampled [s], (k,). They are rounded, so that those of several rates meet.
    """
    rates = {sensor.rate for sensor in rig.sensors} or {100.0}
    each = (np.arange(ceil(begin * r - 1e-6), ceil(end * r - 1e-6)) / r for r in rates)
    return np.unique(np.round(np.concatenate([*each]), 9))


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
    if prepared.scenario.control is not None:
        raise ScenarioError(
            f"{prepared.scenario.name or 'scenario'}: has a [control], and its loop is not closed "
            "here; use distal.closed_loop or distal control, one seed at a time"
        )
    (motion,) = motions_of([prepared])
    return sampled(prepared, motion, seed)


@dataclass(frozen=True)
class Prepared:
    """A scenario on a rig, ready to be simulated.

    Args:
        rig: as filters know it.
        plant: equations of the plant, which has the scenario's ``[plant]`` values, too.
        rows: what acts on the bodies in each interval, `plant_inputs`.
        start: coordinates at rest, (n_bodies,) [rad, m].
        dt: length of an interval [s].
        count: number of sub-steps in an interval.
    """

    rig: Rig
    scenario: Scenario
    plant: Mechanism
    rows: Floats
    start: Floats
    dt: float
    count: int

    def grid(self, size: int) -> Floats:
        """Return the first times at which intervals begin [s], (size,)."""
        times: Floats = self.dt * np.arange(size, dtype=np.float64)
        return times


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
    scenario = as_scenario(scenario)
    rig = as_rig(rig)
    if not isinstance(seed, (int, np.integer)) or seed < 0:
        raise ScenarioError(f"seed: must be a whole number from 0, {seed!r} came")
    plant = Mechanism(scenario.plant_rig(rig), remembers=True)
    dt, steps, count = timing(plant, scenario, period)
    rows = plant_inputs(scenario, plant, dt, steps)
    start = equilibrium(plant, initial_angles(scenario, plant), rows)
    return Prepared(rig, scenario, plant, rows, start, dt, count)


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
    dt, count = intervals_of(plant, period or 1.0 / fastest)
    if scenario.duration * fastest < 1.0 - 1e-9:
        raise ScenarioError(f"duration: {scenario.duration:g} s is shorter than one sample")
    # each interval has inputs and outputs of the plant, of which the inputs are five for each body
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


def motions_of(runs: Sequence[Prepared]) -> list[Floats]:
    """Return the motions of runs whose plants and sub-steps have one structure, side by side where
    there are vector lanes: of each run the outputs y of the plant's kernel at the start and after
    every interval, (k, n_y), see `plant_function`.

    Raises:
        ScenarioError: a motion left all bounds.
    """
    kernel = plant_kernel(runs[0].plant, runs[0].count)
    begun = [at_rest(run.plant, run.rows, run.start, kernel) for run in runs]
    feeds = [
        Feed(kernel_state, run.rows, run.plant.parameters.values)
        for run, (kernel_state, _) in zip(runs, begun)
    ]
    moved = advance_all(kernel, feeds, keep=())
    motions = [np.vstack([first, after.ys]) for (_, first), after in zip(begun, moved)]
    for run, motion in zip(runs, motions):
        check_motion(run.plant, motion)
    return motions


def sampled(prepared: Prepared, motion: Floats, seed: int) -> Log:
    """Return the log of a motion: what the sensors read, and the truth. The seed decides the
    sensors' errors.
    """
    stamps = stamps_of(prepared.plant.rig, 0.0, prepared.scenario.duration)
    read = Sampler(prepared.plant, seed).read(motion, prepared.grid(len(motion)), stamps)
    return log_of(prepared, motion, stamps, read)


def log_of(prepared: Prepared, y: Floats, stamps: Floats, read: Floats) -> Log:
    """Return the log of a motion with the outputs `y` of the plant's kernel, with what its sensors
    read at `stamps` [s], (k, n_sensors), and the truth: angles and torques of joints, positions and
    forces of drives, tensions.
    """
    rig = prepared.plant.rig
    channels = dict(zip(rig.sensor_names, read.T))
    n = prepared.plant.n_joints
    names = [
        *angle_names(rig.joint_names),
        *torque_names(rig.joint_names),
        *(f"position_{drive}" for drive in rig.drive_names),
        *(f"force_{drive}" for drive in rig.drive_names),
        *(f"tension_{tendon}" for tendon in rig.tendon_names),
    ]
    q, _, tensions, pulls = output_layout(prepared.plant).views(y).values()
    columns = np.hstack([q[:, :n], pulls[:, :n], q[:, n:], pulls[:, n:], tensions])
    grid = prepared.grid(len(y))
    truth = {name: np.interp(stamps, grid, column) for name, column in zip(names, columns.T)}
    return Log(stamps, channels, truth, prepared.scenario.name or "simulation", SIMULATED)


BESIDE = ".rig.toml"
"""What follows the name of a log in the name of the file. Source: definition."""


def rig_beside(log: Path, several: bool = False) -> Path:
    """Return the path of the file beside a log, or of that of several logs in a folder."""
    return log / f"all{BESIDE}" if several else log.with_name(log.name + BESIDE)


def text_beside(rig: str, values: Mapping[str, object]) -> str:
    """Return the text of the file.

    Args:
        rig: name of a shipped rig, or a path.
        values: path → value of what the scenario changed in it.
    """
    import tomlkit

    name = rig if rig in shipped_rigs() else str(description_path(rig, "distal.rig").resolve())
    head = "# What the log was simulated with, as `distal estimate` reads it.\n\n"
    return head + tomlkit.dumps({"rig": name, "set": dict(values)})


def rig_of_logs(
    logs: Iterable[object], asked: str | None, assignments: Iterable[str] = ()
) -> tuple[Rig, tuple[str, ...]]:
    """Return the rig by which logs are read, and the paths in it that their scenario changed.

    That is the rig asked for, else the one that is named beside the logs. A shipped rig does not
    know of a scenario. Where it has the joints and drives of the rig beside the logs, it gets what
    the scenario changed in that; a rig file stays as it is.

    Args:
        logs: paths, or other sources of logs, which have no file beside them.
        asked: name of a shipped rig, or a path; None: the rig beside the logs.
        assignments: ``path=value`` each, which come last.

    Raises:
        RigError: no rig is asked for and none is beside all of the logs; or a rig is wrong.
    """
    assignments = tuple(assignments)
    found = {_beside(log) for log in logs}
    path = next(iter(found)) if len(found) == 1 else None
    if path is None:
        if asked is None:
            why = (
                "the logs were simulated with different rigs or scenarios"
                if None not in found
                else "only a log that distal simulate wrote has its rig beside it"
            )
            raise RigError(
                f"which rig? --rig takes a shipped rig's name (distal rigs) or a TOML file; {why}"
            )
        return load_rig(asked, assignments), ()
    named = parse_toml(read_text(path, RigError), str(path), RigError)
    rig, values = named.get("rig"), named.get("set", {})
    if not isinstance(rig, str) or not isinstance(values, dict):
        raise RigError(f"{path}: rig is a name or path, and [set] a table of path = value")
    if asked is not None and not (asked in shipped_rigs() and _alike(load_rig(asked), rig)):
        return load_rig(asked, assignments), ()
    later = dict(parse_assignment(text, RigError) for text in assignments)
    return load_rig(asked or rig).with_values({**values, **later}), tuple(values)


def _beside(log: object) -> Path | None:
    """Return the file that belongs to a log, None where there is none."""
    if not isinstance(log, Path):
        return None
    either = (rig_beside(log), rig_beside(log.parent, several=True))
    return next((path for path in either if path.is_file()), None)


def _alike(rig: Rig, named: str) -> bool:
    other = load_rig(named)
    return (rig.joint_names, rig.drive_names) == (other.joint_names, other.drive_names)
