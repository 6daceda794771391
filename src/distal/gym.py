"""A Gymnasium environment: a tendon-driven rig whose joint an agent positions without its encoder (extra ``gym``)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

try:
    import gymnasium
except ImportError as problem:
    raise ImportError("distal.gym needs gymnasium; pip install '.[gym]'") from problem
import numpy as np
from numpy.typing import NDArray

from distal.arrays import Floats
from distal.control import ControlledPlant
from distal.errors import ControlError
from distal.estimators import DEFAULT
from distal.run import LiveEstimator, Monitor
from distal.simulation import Scenario, load_scenario, scenario_rig
from distal.study.plants import built_values, draws_of, scores

Observation = NDArray[np.float32]

LARGEST = 20.0
"""Force of a drive without a limit [N, N m] at an action of 1."""


class TendonEnv(gymnasium.Env[Observation, Observation]):
    """An agent that commands the drives of a rig drawn anew from its stds at each reset.

    An observation holds the readings of all sensors but those of joints [SI], then estimated angles and their stds, then
    the angles that are wanted [rad]. An action is a share of each drive's `limit`, from 0 of a slider, from −1 of a
    capstan. The reward is minus the mean distance of the true angles from what is wanted [rad].

    Args:
        scenario: with a ``[control]`` table, whose references are what is wanted; a name, a path, or itself.
        drawn: whether each reset draws a plant from the rig's stds; else the plant is the rig with its ``[plant]``.

    Raises:
        ControlError: the scenario has no ``[control]``.
    """

    metadata = {"render_modes": []}  # noqa: RUF012 (gymnasium's own form)

    def __init__(
        self, scenario: Scenario | str | Path = "control-paper", estimator: str = DEFAULT, drawn: bool = True
    ) -> None:
        self._scenario = scenario if isinstance(scenario, Scenario) else load_scenario(scenario)
        if self._scenario.control is None:
            raise ControlError("TendonEnv: the scenario has no [control], whose references are what is wanted")
        self._control, self._rig, self._drawn = self._scenario.control, scenario_rig(self._scenario), drawn
        self._estimator = estimator
        self._monitor = Monitor(LiveEstimator(self._rig, estimator))
        names = [sensor.name for sensor in self._rig.sensors]
        self._read = [k for k, sensor in enumerate(self._rig.sensors) if sensor.measures not in ("angle", "torque")]
        self._fed = [names.index(channel) for channel in self._monitor.channels]
        joints = [joint.name for joint in self._rig.joints]
        self._wanted = {joints.index(name): joint.reference for name, joint in self._control.joints.items()}
        self._largest = np.array([drive.limit or LARGEST for drive in self._rig.drives])
        low = np.array([0.0 if drive.kind == "slider" else -1.0 for drive in self._rig.drives], dtype=np.float32)
        self.action_space = gymnasium.spaces.Box(low, np.ones(len(low), dtype=np.float32))
        size = len(self._read) + 2 * len(joints) + len(self._wanted)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (size,), np.float32)
        self._values = np.zeros(len(names))

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, object] | None = None
    ) -> tuple[Observation, dict[str, object]]:
        """Begin anew with another plant and other errors of the sensors, and return the first observation."""
        super().reset(seed=seed)
        scenario, errors = self._scenario, int(self.np_random.integers(2**31))
        if self._drawn:
            draws = draws_of(self._rig)
            values = built_values(self._rig, draws, scores(draws, [errors]))
            scenario = scenario.model_copy(update={"plant": {**values, **scenario.plant}})
        self._plant = ControlledPlant(self._rig, scenario, self._control.period)
        self._monitor = Monitor(LiveEstimator(self._rig, self._estimator))
        return self._observed(self._plant.reset(errors)), {}

    def step(self, action: Observation) -> tuple[Observation, float, bool, bool, dict[str, object]]:
        """Go on by one period of the scenario's ``[control]``; an action is the share of each drive's limit."""
        pulls = np.asarray(action, dtype=np.float64) * self._largest
        commands = {drive.name: float(pull) for drive, pull in zip(self._rig.drives, pulls)}
        observation = self._observed(self._plant.step(commands))
        angles = self._plant.angles
        errors = [abs(angles[j] - target) for j, target in self._targets().items()]
        details: dict[str, object] = {"angles": angles, "health": self._reading.health}
        return observation, -float(np.mean(errors)), False, self._plant.finished, details

    def _targets(self) -> dict[int, float]:
        time = np.array([self._plant.time])
        return {j: float(reference.at(time)[0]) for j, reference in self._wanted.items()}

    def _observed(self, samples: list[tuple[float, Floats]]) -> Observation:
        for stamp, values in samples:
            self._values = np.where(np.isfinite(values), values, self._values)
            self._reading = self._monitor.take(stamp, values[self._fed])
        parts = [self._values[self._read], self._reading.angles, self._reading.angle_stds, [*self._targets().values()]]
        observation: Observation = np.nan_to_num(np.concatenate([np.asarray(part) for part in parts])).astype(
            np.float32
        )
        return observation
