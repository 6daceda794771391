"""A rig from a MuJoCo model: joints and links as they are there, tendons by what MuJoCo says of their lengths."""

from distal.rig.mjcf.importer import Imported, from_mujoco
from distal.rig.mjcf.lengths import Disagreement, compare_lengths
from distal.rig.mjcf.loading import load_model

__all__ = ["Disagreement", "Imported", "compare_lengths", "from_mujoco", "load_model"]
