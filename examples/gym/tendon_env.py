"""A Gymnasium environment (`pip install gymnasium`) in which an agent positions a tendon-driven joint
without its encoder.

Copy this file beside yours: `TendonEnv(scenario, rig=...)` is the environment. An action at random:
`python tendon_env.py`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import gymnasium
import numpy as np
from numpy.typing import NDArray

from distal.arrays import Floats
from distal.control import ControlledPlant
from distal.errors import ControlError
from distal.rig import Rig, angle_names, as_rig, std_name
from distal.run import LiveEstimator, Monitor, Reading
from distal.simulation import Scenario, load_scenario, scenario_rig
from distal.study.design_space import built_values, draws_of, scores

Observation = NDArray[np.float32]

LARGEST_EFFORT = 20.0
"""Effort at an action of 1 of a drive whose rig gives no limit [N, N m]. Source: judgement."""


class TendonEnv(gymnasium.Env[Observation, Observation]):
    """An agent commands the drives of a rig as built, which
    is drawn anew from the rig's stds at each reset.

    An observation holds the readings of all sensors but those of joints [SI], then estimated angles
    and their stds, then the desired angles [rad]; `observed` has their names. An action is a share
    of each drive's `limit`, from 0 (slider) or −1 (capstan) to 1, in the order of `acted`; an
    action outside of the action space is clipped to it. The reward is minus the mean distance of
    the true angles from the desired angles [rad].

    Args:
        scenario: with a ``[control]`` table, whose references are the desired angles; a name, a
            path, or a `Scenario`.
        estimator: name of the estimator whose angles the agent observes.
        drawn: whether each reset draws a plant from the rig's stds; else the plant is the rig with
            the scenario's ``[plant]``.
        rig: the description, a shipped rig's name, or a path; default the scenario's.

    Raises:
        ControlError: the scenario has no ``[control]``.
    """

    metadata = {"render_modes": []}  # noqa: RUF012 (gymnasium's own form)

    def __init__(
        self,
        scenario: Scenario | str | Path = "control-paper",
        estimator: str | None = None,
        drawn: bool = True,
        rig: Rig | str | Path | None = None,
    ) -> None:
        scenario = scenario if isinstance(scenario, Scenario) else load_scenario(scenario)
        if scenario.control is None:
            raise ControlError(
                "TendonEnv: the scenario has no [control], whose references are what is wanted"
            )
        described = scenario_rig(scenario) if rig is None else as_rig(rig)
        self._rig = described
        self._draws = draws_of(described) if drawn else ()
        self._scenario = scenario
        self._plant = self._described = ControlledPlant(
            described, scenario, scenario.control.period
        )
        self._monitor = Monitor(LiveEstimator(described, estimator))
        self._reading: Reading | None = None
        names = described.sensor_names
        self._read = [
            k
            for k, sensor in enumerate(described.sensors)
            if sensor.measures not in ("angle", "torque")
        ]
        self._fed = [names.index(channel) for channel in self._monitor.channels]
        joints = described.joint_names
        self._desired = {
            joints.index(name): joint.reference for name, joint in scenario.control.joints.items()
        }
        angles = angle_names(joints)
        self.observed = (
            *(names[k] for k in self._read),
            *angles,
            *map(std_name, angles),
            *(f"wanted_{name}" for name in scenario.control.joints),
        )
        """Names of the numbers in an observation."""
        self.acted = tuple(described.drive_names)
        """Names of the drives, in the order of an action."""
        self._largest = np.array([drive.limit or LARGEST_EFFORT for drive in described.drives])
        low = np.array(
            [0.0 if drive.kind == "slider" else -1.0 for drive in described.drives],
            dtype=np.float32,
        )
        self.action_space = self._actions = gymnasium.spaces.Box(
            low, np.ones(len(low), dtype=np.float32)
        )
        self.observation_space = gymnasium.spaces.Box(
            -np.inf, np.inf, (len(self.observed),), np.float32
        )
        self._values = np.zeros(len(names))

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, object] | None = None
    ) -> tuple[Observation, dict[str, object]]:
        """Begin again with other errors of the sensors and, with `drawn`, another plant; return the
        first observation and a dictionary with `observed` and `acted`.
        """
        super().reset(seed=seed)
        errors = int(self.np_random.integers(2**31))
        self._plant = self._described
        if self._draws:
            values = built_values(self._rig, self._draws, scores(self._draws, [errors]))
            plant = {**values, **self._scenario.plant}
            scenario = self._scenario.model_copy(update={"plant": plant})
            # of the same equations, so that nothing is compiled
            self._plant = ControlledPlant(self._rig, scenario, self._described.period)
        self._monitor.reset()
        self._values = np.zeros(len(self._values))
        observation, _ = self._observed(self._plant.reset(errors))
        return observation, {"observed": self.observed, "acted": self.acted}

    def step(self, action: Observation) -> tuple[Observation, float, bool, bool, dict[str, object]]:
        """Simulate one period of the scenario's ``[control]`` and return observation, reward,
        terminated, truncated and details; an `action` is a share of each drive's limit.

        Raises:
            ResetNeeded: `reset` was not called yet.
            ControlError: an action is not one finite number for each drive, or the scenario is
                over.
        """
        if self._reading is None:
            raise gymnasium.error.ResetNeeded(
                "TendonEnv: call reset before the first step; it draws the plant"
            )
        shares = np.asarray(action, dtype=np.float64)
        if shares.shape != self._largest.shape or not np.isfinite(shares).all():
            raise ControlError(
                f"TendonEnv: an action is a finite number for each of {', '.join(self.acted)}; "
                f"{action!r} came"
            )
        pulls = np.clip(shares, self._actions.low, self._actions.high) * self._largest
        observation, reading = self._observed(
            self._plant.step(dict(zip(self.acted, pulls.tolist())))
        )
        angles = self._plant.angles
        errors = [abs(angles[j] - target) for j, target in self._targets().items()]
        details: dict[str, object] = {"angles": angles, "health": reading.health}
        return observation, -float(np.mean(errors)), False, self._plant.finished, details

    def _targets(self) -> dict[int, float]:
        time = np.array([self._plant.time])
        return {j: float(reference.at(time)[0]) for j, reference in self._desired.items()}

    def _observed(self, samples: list[tuple[float, Floats]]) -> tuple[Observation, Reading]:
        for stamp, values in samples:
            self._values = np.where(np.isfinite(values), values, self._values)
            self._reading = self._monitor.take(stamp, values[self._fed])
        reading = self._reading
        assert reading is not None  # there is a sample at time zero
        targets = list(self._targets().values())
        parts = self._values[self._read], reading.angles, reading.angle_stds, targets
        observation: Observation = np.nan_to_num(np.concatenate(parts)).astype(np.float32)
        return observation, reading


if __name__ == "__main__":
    env = TendonEnv()
    print(*env.reset(seed=1))
    print(*env.step(env.action_space.sample()))
