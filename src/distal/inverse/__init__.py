"""Inverse of a rig: commands for its drives that bring its joints to desired angles."""

from distal.inverse.command_result import Commands
from distal.inverse.command_trajectory import Inverse
from distal.inverse.live_inverse import Command, LiveInverse
from distal.inverse.pid import Feedback

__all__ = ["Command", "Commands", "Feedback", "Inverse", "LiveInverse"]
