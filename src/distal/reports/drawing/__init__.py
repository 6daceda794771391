"""The parts of a rig on paper."""
