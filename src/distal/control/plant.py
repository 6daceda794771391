"""A simulated plant that a controller drives: it goes on by one period at a time and says what its sensors read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import ceil, exp, isfinite
from pathlib import Path
from typing import Protocol

import numpy as np

from distal.arrays import Floats
from distal.errors import ControlError, ScenarioError, did_you_mean
from distal.kernels import Feed, Kernel, advance
from distal.logs import Log
from distal.model import Mechanism
from distal.rig import Rig, travel_of
from distal.sensors import SensorErrors
from distal.simulation import Scenario
from distal.simulation.plant import Motion, at_rest, plant_function, rows_of
from distal.simulation.readings import Readings
from distal.simulation.simulate import SIMULATED, Prepared, prepare, stamps_of, true_motion

SHORTEST_PERIOD = 1e-4
"""No controller of a tendon is called more often [s]."""


class SteppedPlant(Protocol):
    """What a controller may drive: period after period, with what the rig's sensors read."""

    @property
    def rig(self) -> Rig:
        """The rig as filters know it."""

    @property
    def time(self) -> float:
        """Time since the start [s]."""

    @property
    def finished(self) -> bool:
        """Whether there is no further period."""

    @property
    def angles(self) -> Floats:
        """True angles of the joints now [rad], (n_joints,)."""

    def reset(self, seed: int = 0) -> list[tuple[float, Floats]]:
        """Go back to the start and return the samples at time zero."""

    def step(self, commands: Mapping[str, float]) -> list[tuple[float, Floats]]:
        """Go on by one period and return the samples in it: stamps [s], values in the order of the rig's sensors [SI]."""

    def log(self) -> Log:
        """Return what the sensors have read so far, with the truth beside it."""


class ControlledPlant:
    """A scenario on a rig whose drives a controller commands: `reset`, then `step` period after period.

    A command is a force of a slider [N] or a torque of a capstan [N m]; it is added to what the scenario does. It is cut at
    the drive's `limit`, follows with its `lag`, and no slider pushes its tendons.

    Args:
        rig: as filters know it; or a shipped rig's name, or a path.
        scenario: what else is done to it; or a shipped scenario's name, or a path.
        period: time between two commands [s].

    Raises:
        ControlError: the period is too short, or longer than the scenario.
        ScenarioError: the scenario does not fit the rig.
    """

    def __init__(self, rig: Rig | str | Path, scenario: Scenario | str | Path, period: float) -> None:
        if not period >= SHORTEST_PERIOD:
            raise ControlError(f"period: at least {SHORTEST_PERIOD:g} s, {period:g} s came")
        prepared = prepare(rig, scenario, period=period)
        if prepared.scenario.schedule or prepared.scenario.rezero is not None:
            raise ControlError("the scenario has a [schedule] or [rezero], which are for distal drift; take them out")
        if period > prepared.scenario.duration:
            raise ControlError(f"period: {period:g} s is longer than the scenario, {prepared.scenario.duration:g} s")
        self._prepared, self.period = prepared, period
        self._plant, self._drives = prepared.plant, prepared.plant.rig.drives
        self._kernel = Kernel(plant_function(prepared.plant, prepared.count))
        self._begin = at_rest(prepared.plant, prepared.inputs, prepared.start, self._kernel)
        self._per_period, self._all_rows = round(period / prepared.dt), rows_of(prepared.inputs, prepared.dt)
        self._stamps = stamps_of(prepared.plant.rig, prepared.scenario.duration)
        self._lags: Floats = np.array([1.0 - exp(-prepared.dt / d.lag) if d.lag > 0.0 else 1.0 for d in self._drives])
        self._lowest: Floats = np.array([0.0 if d.kind == "slider" else -(d.limit or np.inf) for d in self._drives])
        self._highest: Floats = np.array([np.inf if d.limit is None else d.limit for d in self._drives])
        self.reset()

    @property
    def rig(self) -> Rig:
        """The rig as filters know it."""
        return self._prepared.rig

    @property
    def plant(self) -> Mechanism:
        """The plant's own equations."""
        return self._plant

    @property
    def prepared(self) -> Prepared:
        """The scenario on the rig."""
        return self._prepared

    def errors(self, seed: int) -> SensorErrors | None:
        """Return the errors of all sensors in a run; None where they are not all read once a period, at once."""
        sensors = self._plant.rig.sensors
        whole = len(self._all_rows) % self._per_period == 0
        alike = all(abs(one.rate * self.period - 1.0) < 1e-9 and one.delay == one.lag == 0.0 for one in sensors)
        if not (whole and alike and sensors):
            return None
        return _Rate(self._plant, sensors[0].rate, self._stamps, np.random.default_rng(seed).spawn(len(sensors))).errors

    @property
    def time(self) -> float:
        """Time since the start [s]."""
        return self._done * self._prepared.dt

    @property
    def finished(self) -> bool:
        """Whether the scenario is over."""
        return self._done >= len(self._all_rows)

    @property
    def angles(self) -> Floats:
        """True angles of the joints now [rad], (n_joints,)."""
        return self._y[self._done, : self._plant.n_joints].copy()

    def reset(self, seed: int = 0) -> list[tuple[float, Floats]]:
        """Go back to the start and return the samples at time zero; see `step`."""
        rig, (carry, first) = self._plant.rig, self._begin
        self._carry: Floats = carry
        self._done, self._taken = 0, 0
        self._y = np.full((len(self._all_rows) + 1, first.shape[1]), np.nan)
        self._y[0], self._rows = first[0], self._all_rows.copy()
        self._efforts: Floats = np.zeros(len(self._drives))
        self._samples = np.full((len(self._stamps), len(rig.sensors)), np.nan)
        rngs = np.random.default_rng(seed).spawn(len(rig.sensors))
        self._groups = [_Rate(self._plant, rate, self._stamps, rngs) for rate in {one.rate for one in rig.sensors}]
        return self._read()

    def step(self, commands: Mapping[str, float]) -> list[tuple[float, Floats]]:
        """Go on by one period and return the samples in it: their stamps [s] and the sensors' values [SI], NaN where none.

        Args:
            commands: by drive; one that is missing stays without a command.

        Raises:
            ControlError: there is no such drive, a command is no number, or the scenario is over.
            ScenarioError: the motion left all bounds.
        """
        if self.finished:
            raise ControlError("the scenario is over; call reset")
        wanted: Floats = np.clip(self._checked(commands), self._lowest, self._highest)
        end = min(self._done + self._per_period, len(self._rows))
        own = slice(self._plant.n_joints, self._plant.n_bodies)
        for row in self._rows[self._done : end]:
            self._efforts += self._lags * (wanted - self._efforts)
            row[own] += self._efforts
        feed = Feed(self._carry, self._rows[self._done : end], self._plant.parameters.values)
        carries, ys = advance(self._kernel, feed)
        self._carry, self._y[self._done + 1 : end + 1] = carries[-1], ys
        try:
            Motion(self._plant, ys).check()
        except ScenarioError as problem:
            pulls = ", ".join(f"{drive.name} {pull:.3g}" for drive, pull in zip(self._drives, self._efforts))
            raise ScenarioError(f"at {self.time:g} s, commands {pulls}: {problem}") from None
        self._done = end
        return self._read()

    def log(self) -> Log:
        """Return what the sensors have read so far, with the truth beside it."""
        grid: Floats = self._prepared.dt * np.arange(self._done + 1, dtype=np.float64)
        stamps, values = self._stamps[: self._taken], self._samples[: self._taken]
        truth = true_motion(Motion(self._plant, self._y[: self._done + 1]), grid, stamps)
        channels = {sensor.name: values[:, k] for k, sensor in enumerate(self._plant.rig.sensors)}
        return Log(stamps, channels, truth, self._prepared.scenario.name or "simulation", SIMULATED)

    def _checked(self, commands: Mapping[str, float]) -> Floats:
        names = [drive.name for drive in self._drives]
        wanted = np.zeros(len(names))
        for name, value in commands.items():
            if name not in names:
                raise ControlError(
                    f"the controller commands '{name}', the rig has no such drive{did_you_mean(name, names)}"
                )
            if not isinstance(value, (int, float, np.floating, np.integer)) or not isfinite(value):
                raise ControlError(f"the controller's command for '{name}' at {self.time:g} s is no number: {value!r}")
            wanted[names.index(name)] = value
        return wanted

    def _read(self) -> list[tuple[float, Floats]]:
        """Return the samples whose stamps have come."""
        end = int(np.searchsorted(self._stamps, self.time + 1e-9, side="right"))
        found = []
        for k in range(self._taken, end):
            for group in self._groups:
                if group.due[k]:
                    true = group.true(self._y[: self._done + 1], float(self._stamps[k]), self._prepared.dt)
                    self._samples[k, group.at] = group.errors.read(true[None])[0]
            found.append((float(self._stamps[k]), self._samples[k]))
        self._taken = end
        return found


class _Rate:
    """The sensors of one rate: which they are, when they are due, what they measure, and their errors."""

    def __init__(self, plant: Mechanism, rate: float, stamps: Floats, rngs: Sequence[np.random.Generator]) -> None:
        every = plant.rig.sensors
        self.at = [k for k, sensor in enumerate(every) if sensor.rate == rate]
        sensors = [every[k] for k in self.at]
        self.due = np.isin(stamps, np.round(np.arange(0.0, stamps[-1] + 0.5 / rate, 1.0 / rate), 9))
        self.errors = SensorErrors(
            sensors, [travel_of(sensor, plant.rig) for sensor in sensors], [rngs[k] for k in self.at]
        )
        self._readings = Readings(plant, sensors)
        self._delays = np.array([sensor.delay for sensor in sensors])

    def true(self, y: Floats, stamp: float, dt: float) -> Floats:
        """Return what there is to measure at a stamp; between two intervals it is a line."""
        place = np.maximum(stamp - self._delays, 0.0) / dt
        before = np.minimum((place + 1e-6).astype(np.intp), len(y) - 1)
        after, share = np.minimum(before + 1, len(y) - 1), place - before
        share[share < 1e-6] = 0.0
        # each sensor has a row of its own, by its delay
        early, late = (np.diagonal(self._readings.at(y[rows])) for rows in (before, after))
        readings: Floats = early + share * (late - early)
        return readings


def periods(duration: float, period: float) -> int:
    """Return how many periods a scenario lasts.

    Args:
        duration: of the scenario [s].
        period: of the controller [s].
    """
    return ceil(duration / period - 1e-9)
