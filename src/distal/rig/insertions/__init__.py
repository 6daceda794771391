"""How a tendon meets its joint: one file for each kind, its description and its geometry."""

from distal.rig.insertions.crossed import Crossed, Guide, Size
from distal.rig.insertions.linkage import CrossedLinkage, Linkage
from distal.rig.insertions.pinned import CrossedPinned, Pinned
from distal.rig.insertions.polynomial import Polynomial, Term
from distal.rig.insertions.pulley import CrossedPulley, Pulley
from distal.rig.insertions.registry import KINDS, Crossing, Insertion, Shape

__all__ = [
    "KINDS",
    "Crossed",
    "CrossedLinkage",
    "CrossedPinned",
    "CrossedPulley",
    "Crossing",
    "Guide",
    "Insertion",
    "Linkage",
    "Pinned",
    "Polynomial",
    "Pulley",
    "Shape",
    "Size",
    "Term",
]
