"""How a tendon meets its joint: one file for each kind, its description and its geometry."""

from distal.rig.insertions.crossed import Guide, Size
from distal.rig.insertions.linkage import Linkage
from distal.rig.insertions.pinned import Pinned
from distal.rig.insertions.polynomial import Polynomial
from distal.rig.insertions.pulley import Pulley
from distal.rig.insertions.registry import KINDS, Crossing, Insertion, Shape

__all__ = [
    "KINDS",
    "Crossing",
    "Guide",
    "Insertion",
    "Linkage",
    "Pinned",
    "Polynomial",
    "Pulley",
    "Shape",
    "Size",
]
