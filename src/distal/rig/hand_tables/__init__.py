"""A rig of a hand from a table of its joints and motors, or from the files that a maker of hands
ships.
"""

from distal.rig.hand_tables.aero import from_aero
from distal.rig.hand_tables.described import AssumedOfHands, from_table, hand_of
from distal.rig.hand_tables.orca import from_orca, orca_order
from distal.rig.hand_tables.rows import Row

__all__ = [
    "AssumedOfHands",
    "Row",
    "from_aero",
    "from_orca",
    "from_table",
    "hand_of",
    "orca_order",
]
