"""The inverse of a rig: what its drives do so that its joints get to desired angles."""

from distal.inverse.command_trajectory import Inverse
from distal.inverse.commands import Commands
from distal.inverse.live_inverse import Command, Feedback, LiveInverse

__all__ = ["Command", "Commands", "Feedback", "Inverse", "LiveInverse"]
