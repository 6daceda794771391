"""A rig from a MuJoCo model: joints and links are taken as they are, tendons from the lengths that
MuJoCo computes.
"""

from distal.rig.mjcf.bodies import joint_name, tendon_name
from distal.rig.mjcf.loading import EMBEDDED, mujoco_module, rest_lengths

__all__ = ["EMBEDDED", "joint_name", "mujoco_module", "rest_lengths", "tendon_name"]
