"""A simulated plant that a controller drives: it goes on by one period at a time and gives what its
sensors read.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import ceil, exp, inf, isfinite
from pathlib import Path
from typing import Protocol

import numpy as np

from distal.arrays import Floats
from distal.errors import ControlError, ScenarioError, did_you_mean
from distal.kernels import Feed, advance
from distal.logs import Log
from distal.rig import Rig
from distal.simulation import Scenario
from distal.simulation.plant_kernel import plant_kernel
from distal.simulation.plant_motion import (
    PlantMotion,
    at_rest,
    rows_of,
)
from distal.simulation.readings import Sampler, stamps_of
from distal.simulation.simulate import log_of, prepare


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

    def reset(self, seed: int = 0) -> list[tuple[float, Floats]]:
        """Go back to the start and return the samples at time zero."""

    def step(self, commands: Mapping[str, float]) -> list[tuple[float, Floats]]:
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
        if period > prepared.scenario.duration:
            raise ControlError(
                f"period: {period:g} s is longer than the scenario, "
                f"{prepared.scenario.duration:g} s"
            )
        self.prepared = prepared
        self.rig = prepared.rig
        self.period = period
        self.plant = prepared.plant
        self._drives = prepared.plant.rig.drives
        self._kernel = plant_kernel(prepared.plant, prepared.count)
        self.begin = at_rest(prepared.plant, prepared.inputs, prepared.start, self._kernel)
        self._per_period = round(period / prepared.dt)
        self._all_rows = rows_of(prepared.inputs, prepared.dt)
        self._stamps = stamps_of(prepared.plant.rig, 0.0, prepared.scenario.duration)
        latest = max((sensor.delay for sensor in prepared.plant.rig.sensors), default=0.0)
        self._looks_back = ceil(latest / prepared.dt) + self._per_period + 1
        self._shares, self._lowest, self._highest = drive_parameters(
            prepared.plant.rig, prepared.dt
        )
        self.reset()

    @property
    def time(self) -> float:
        """Time since the start [s]."""
        return self._done * self.prepared.dt

    @property
    def finished(self) -> bool:
        """Whether the scenario is over."""
        return self._done >= len(self._all_rows)

    @property
    def angles(self) -> Floats:
        """True angles of the joints now [rad], (n_joints,)."""
        return self._y[self._done, : self.plant.n_joints].copy()

    def reset(self, seed: int = 0) -> list[tuple[float, Floats]]:
        """Go back to the start and return the samples at time zero; see `step`."""
        rig = self.plant.rig
        (self._kernel_state, first) = self.begin
        self._done = 0
        self._taken = 0
        self._y = np.full((len(self._all_rows) + 1, first.shape[1]), np.nan)
        self._y[0] = first[0]
        self._rows = self._all_rows.copy()
        self._efforts: Floats = np.zeros(len(self._drives))
        self._samples = np.full((len(self._stamps), len(rig.sensors)), np.nan)
        self._sampler = Sampler(self.plant, seed)
        return self._read()

    def step(self, commands: Mapping[str, float]) -> list[tuple[float, Floats]]:
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
        desired: Floats = np.clip(self._checked(commands), self._lowest, self._highest)
        end = min(self._done + self._per_period, len(self._rows))
        drives = slice(self.plant.n_joints, self.plant.n_bodies)
        for row in self._rows[self._done : end]:
            self._efforts += self._shares * (desired - self._efforts)
            row[drives] += self._efforts
        feed = Feed(self._kernel_state, self._rows[self._done : end], self.plant.parameters.values)
        kernel_states, ys = advance(self._kernel, feed)
        self._kernel_state = kernel_states[-1]
        self._y[self._done + 1 : end + 1] = ys
        try:
            PlantMotion(self.plant, ys).check()
        except ScenarioError as problem:
            pulls = ", ".join(
                f"{drive.name} {pull:.3g}" for drive, pull in zip(self._drives, self._efforts)
            )
            raise ScenarioError(f"at {self.time:g} s, commands {pulls}: {problem}") from None
        self._done = end
        return self._read()

    def log(self) -> Log:
        """Return what the sensors have read so far, with the truth beside it."""
        motion = PlantMotion(self.plant, self._y[: self._done + 1])
        grid: Floats = self.prepared.dt * np.arange(self._done + 1, dtype=np.float64)
        read = self._samples[: self._taken]
        return log_of(motion, grid, self._stamps[: self._taken], read, self.prepared.scenario)

    def _checked(self, commands: Mapping[str, float]) -> Floats:
        names = [drive.name for drive in self._drives]
        desired = np.zeros(len(names))
        for name, command in commands.items():
            if name not in names:
                raise ControlError(
                    f"the controller commands '{name}', the rig has no such "
                    f"drive{did_you_mean(name, names)}"
                )
            if not isinstance(command, (int, float, np.floating, np.integer)) or not isfinite(
                command
            ):
                raise ControlError(
                    f"the controller's command for '{name}' at {self.time:g} s is no number: "
                    f"{command!r}"
                )
            desired[names.index(name)] = command
        return desired

    def _read(self) -> list[tuple[float, Floats]]:
        """Return the samples whose stamps have come."""
        end = int(np.searchsorted(self._stamps, self.time + 1e-9, side="right"))
        stamps = self._stamps[self._taken : end]
        rows = np.arange(max(0, self._done - self._looks_back), self._done + 1)
        grid: Floats = self.prepared.dt * rows.astype(np.float64)
        samples = self._sampler.read(self._y[rows], grid, stamps)
        self._samples[self._taken : end] = samples
        self._taken = end
        return [*zip(stamps.tolist(), samples)]


def drive_parameters(rig: Rig, dt: float) -> Floats:
    """Return three numbers of each drive, (3, n_drives): the share of a change of its command that
    it follows within an interval `dt` [s], and the lowest and highest command.
    """
    shares = [1.0 - exp(-dt / drive.lag) if drive.lag > 0.0 else 1.0 for drive in rig.drives]
    high = [inf if drive.limit is None else drive.limit for drive in rig.drives]
    low = [0.0 if drive.kind == "slider" else -bound for drive, bound in zip(rig.drives, high)]
    return np.array([shares, low, high])
