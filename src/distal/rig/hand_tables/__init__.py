"""A rig of a hand from a table of its joints and motors, or from the files that a maker of hands
ships.
"""

from distal.rig.hand_tables.aero import from_aero
from distal.rig.hand_tables.described import hand_of
from distal.rig.hand_tables.orca import from_orca, orca_order
from distal.rig.hand_tables.row import Row
from distal.rig.hand_tables.table import from_table

__all__ = ["Row", "from_aero", "from_orca", "from_table", "hand_of", "orca_order"]
