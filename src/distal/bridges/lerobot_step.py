"""A step of LeRobot's processors (0.4 or newer) that adds joint angles to what a robot observes,
live.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Literal

from lerobot.configs.types import FeatureType, PipelineFeatureType, PolicyFeature
from lerobot.processor import ObservationProcessorStep, ProcessorStepRegistry

from distal.run import LiveInLogUnits

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
        self._live = LiveInLogUnits(self.rig, self.unit)
        self._begun = time.monotonic()

    def observation(self, observation: dict[str, object]) -> dict[str, object]:
        """Return an observation with the joint angles, NaN where there is no estimate."""
        values = {
            column: observation.get(column.removeprefix(STATE)) for column in self._live.columns
        }
        angles = self._live.step(time.monotonic() - self._begun, values)
        stds = self._live.stds
        named = {f"{joint}.angle": angle for joint, angle in angles.items()}
        return observation | named | {f"{joint}.angle_std": std for joint, std in stds.items()}

    def reset(self) -> None:
        """Forget everything: an episode begins."""
        self._live.reset()

    def get_config(self) -> dict[str, str]:
        """Return what makes the same step again."""
        return {"rig": self.rig, "unit": self.unit}

    def transform_features(
        self, features: dict[PipelineFeatureType, dict[str, PolicyFeature]]
    ) -> dict[PipelineFeatureType, dict[str, PolicyFeature]]:
        """Return the features with those that are added."""
        added = {
            f"{joint}.{what}": PolicyFeature(type=FeatureType.STATE, shape=(1,))
            for joint in self._live.rig.joint_names
            for what in ("angle", "angle_std")
        }
        observed = PipelineFeatureType.OBSERVATION
        return features | {observed: features.get(observed, {}) | added}
