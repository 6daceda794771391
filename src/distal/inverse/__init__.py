"""Inverse of a rig: commands for its drives that bring its joints to desired angles.

In: desired angles over time, or one by one; out: what drives are sent, the angles that they reach
and their stds. Pulls f balance the joints' torques, Rᵀ f = τ, with tendons taut; positions follow
from stretch and play.

    import numpy as np
    from distal import Inverse

    time = np.arange(0.0, 2.0, 0.01)
    commands = Inverse("capstan-joint")(time, 0.3 * np.sin(3.0 * time))
    print(commands, commands.notes)
"""

from distal.inverse.command_trajectory import Commands, Inverse
from distal.inverse.live_inverse import Command, Feedback, LiveInverse

__all__ = ["Command", "Commands", "Feedback", "Inverse", "LiveInverse"]
