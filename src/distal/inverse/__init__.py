"""The inverse of a rig: what its drives do so that its joints get to wanted angles."""

from distal.inverse.commands import Commands
from distal.inverse.inverse import Inverse
from distal.inverse.live import Command, Feedback, LiveInverse

__all__ = ["Command", "Commands", "Feedback", "Inverse", "LiveInverse"]
