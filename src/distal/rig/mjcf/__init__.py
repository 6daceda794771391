"""A rig from a MuJoCo model: joints and links are taken as they are, tendons from the lengths that
MuJoCo computes.
"""

from distal.rig.mjcf.bodies import joint_name, tendon_name
from distal.rig.mjcf.excursion import compare_lengths
from distal.rig.mjcf.importer import from_mujoco
from distal.rig.mjcf.loading import AssumedOfModels, load_model, mujoco_module, rest_lengths

__all__ = [
    "AssumedOfModels",
    "compare_lengths",
    "from_mujoco",
    "joint_name",
    "load_model",
    "mujoco_module",
    "rest_lengths",
    "tendon_name",
]
