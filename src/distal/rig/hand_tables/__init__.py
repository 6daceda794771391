"""A rig of a hand from its table, or from files of its own software."""
