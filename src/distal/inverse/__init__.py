"""Inverse of a rig: commands for its drives that bring its joints to desired angles."""

from distal.inverse.command_trajectory import Commands, Inverse
from distal.inverse.feedforward import Feedback
from distal.inverse.live_inverse import Command, LiveInverse

__all__ = ["Command", "Commands", "Feedback", "Inverse", "LiveInverse"]
