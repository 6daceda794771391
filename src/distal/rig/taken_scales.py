"""Scales that were taken, not measured: what needs a true one refuses them."""

from __future__ import annotations

from typing import Literal

from distal.errors import CommandError
from distal.rig.rig import Rig

SETTLED_BY = {
    "force": "one true force: a spring scale on a tendon, or a motor's torque constant",
    "length": "one true length: the diameter of a spool, or of a pulley at a joint",
}
"""Scale → the single measurement that settles it."""


def scales_in_words(rig: Rig) -> str:
    """Return a sentence on the scales that were taken, empty where all are known."""
    if not rig.taken:
        return ""
    which = " and ".join(rig.taken)
    wanting = "; ".join(SETTLED_BY[scale] for scale in rig.taken)
    return (
        f"the scale of {which} is assumed, not measured: angles do not depend on it, forces, "
        f"torques and stiffnesses do. One measurement settles it: {wanting}. Correct it in the rig "
        "file and remove it from 'taken'"
    )


def check_scales(rig: Rig, purpose: str, needs: Literal["tension", "torque"]) -> None:
    """Check that what a purpose needs has a true scale.

    Args:
        rig: with the scales that were taken.
        purpose: what is refused otherwise, which begins the message.
        needs: a torque needs the scale of force only, a tension that of length too.

    Raises:
        CommandError: a scale that it needs was taken.
    """
    needed = ("force", "length") if needs == "tension" else ("force",)
    lacking = [scale for scale in needed if scale in rig.taken]
    if lacking:
        raise CommandError(
            f"{purpose} needs a true {needs}, but the scale of {' and '.join(lacking)} of "
            f"'{rig.name}' is assumed, not measured. Measure "
            f"{'; '.join(SETTLED_BY[scale] for scale in lacking)}; correct it in the rig file and "
            "remove it from 'taken'"
        )
