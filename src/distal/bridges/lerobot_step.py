"""A step of LeRobot's processors (0.4 or newer) that adds joint angles to what a robot observes,
live.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Literal

from lerobot.configs.types import FeatureType, PipelineFeatureType, PolicyFeature
from lerobot.processor import ObservationProcessorStep, ProcessorStepRegistry

from distal.run import LiveEstimator, LogUnits, Monitor
from distal.units import unit_factor

STATE = "observation.state."
"""Before a number of a robot's state in the columns of a dataset, and not in its observations."""


@ProcessorStepRegistry.register("distal_joint_angles")
@dataclass
class JointAngles(ObservationProcessorStep):  # type: ignore[misc]
    """Adds ``JOINT.angle`` and ``JOINT.angle_std`` to each observation of a robot.

    Stamps are of the moment at which an observation comes. A motor that it lacks is missing.

    Args:
        rig: path or shipped name of the description, whose sensors name numbers of the state.
        unit: of angles and their standard deviations, "deg" or "rad".

    Raises:
        RigError: the rig is unknown or wrong.
    """

    rig: str
    unit: Literal["deg", "rad"] = "deg"

    def __post_init__(self) -> None:
        """Begin at the next observation."""
        live = LiveEstimator(self.rig)
        self._monitor = Monitor(live)
        self._units = LogUnits(live.rig, live.channels)
        joints = live.rig.joint_names
        self._added = [f"{joint}.{what}" for joint in joints for what in ("angle", "angle_std")]
        self._scale = 1.0 / unit_factor(self.unit, "rad")
        self._begun = time.monotonic()

    def observation(self, observation: dict[str, object]) -> dict[str, object]:
        """Return an observation with the joint angles, NaN where there is no estimate."""
        stamp = time.monotonic() - self._begun
        columns = self._units.columns
        values = {column: observation.get(column.removeprefix(STATE)) for column in columns}
        sample = self._units.sample(stamp, values)
        reading = self._monitor.take(stamp, sample, self._units.remarks)
        pairs = zip(reading.angles, reading.angle_stds)
        estimates = [self._scale * value for pair in pairs for value in pair]
        return observation | dict(zip(self._added, estimates))

    def reset(self) -> None:
        """Forget everything: an episode begins."""
        self._units.reset()
        self._monitor.reset()

    def get_config(self) -> dict[str, str]:
        """Return what makes the same step again."""
        return {"rig": self.rig, "unit": self.unit}

    def transform_features(
        self, features: dict[PipelineFeatureType, dict[str, PolicyFeature]]
    ) -> dict[PipelineFeatureType, dict[str, PolicyFeature]]:
        """Return the features with those that are added."""
        added = {name: PolicyFeature(type=FeatureType.STATE, shape=(1,)) for name in self._added}
        observed = PipelineFeatureType.OBSERVATION
        return features | {observed: features.get(observed, {}) | added}
