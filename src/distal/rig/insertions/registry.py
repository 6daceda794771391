"""The kinds of insertions: a new one is a file beside this one, and an entry here."""

from __future__ import annotations

from typing import Annotated, get_args

from pydantic import Field

from distal.rig.insertions.linkage import CrossedLinkage, Linkage
from distal.rig.insertions.pinned import CrossedPinned, Pinned
from distal.rig.insertions.polynomial import Polynomial
from distal.rig.insertions.pulley import CrossedPulley, Pulley

Shape = Pinned | Pulley | Linkage | Polynomial
"""How a tendon meets a joint."""

Insertion = Annotated[Pinned | Pulley | Linkage, Field(discriminator="kind")]
"""How a tendon that crosses only one joint meets it."""

Crossing = Annotated[
    CrossedPinned | CrossedPulley | CrossedLinkage | Polynomial, Field(discriminator="kind")
]
"""How a tendon that crosses several joints meets one of them (a polynomial: several)."""

KINDS = tuple(get_args(shape.model_fields["kind"].annotation)[0] for shape in get_args(Shape))
"""What ``kind`` may be in a rig file."""
