"""Numbers of a rig in the words and units of its user."""

from __future__ import annotations

import numpy as np

from distal.fitting.fitted import FittedNumber
from distal.rig import Rig

COMMON = {
    "rad": ("deg", float(np.rad2deg(1.0))),
    "rad/s": ("deg/s", float(np.rad2deg(1.0))),
    "m": ("mm", 1e3),
    "N/m": ("N/mm", 1e-3),
    "N m": ("mN m", 1e3),
    "N m s": ("mN m s", 1e3),
}
"""Unit → the one that people use for sizes of fingers and instruments, and how many of it there are."""


def in_words(rig: Rig, path: str) -> str:
    """Return a number's name as one says it: "spring stiffness of joint pip" for ``joints.0.spring.stiffness``.

    Args:
        rig: the description.
        path: of the number; ``*`` stands for all parts of a kind.
    """
    kind, _, rest = path.partition(".")
    index, _, tail = rest.partition(".")
    parts = getattr(rig, kind, None)
    if not isinstance(parts, tuple) or not tail:
        return path
    what = " ".join(word for word in tail.replace("_", " ").split(".") if not word.isdigit())
    if index == "*":
        return f"{what} of all {kind}"
    if not index.isdigit() or int(index) >= len(parts):
        return path
    steps = tail.split(".")
    if steps[0] == "crossings" and kind == "tendons":  # where a tendon passes over a joint
        return f"{' '.join(steps[2:])} of tendon {parts[int(index)].name} at {parts[int(index)].joints[int(steps[1])]}"
    return f"{what} of {kind[:-1]} {parts[int(index)].name}"


def name_of(rig: Rig, part: FittedNumber) -> str:
    """Return what a fitted number is called, in the user's names.

    Args:
        rig: the description.
        part: the number.
    """
    return in_words(rig, part.name)


def sizes(part: FittedNumber) -> tuple[str, str, str]:
    """Return what a number was, what it is with its standard error, and its unit, in a unit that people use.

    Args:
        part: the number.
    """
    unit, factor = COMMON.get(part.si, (part.si, 1.0))
    prior = "" if np.isnan(part.prior_std) else f" ± {factor * part.prior_std:.2g}"
    before = f"{factor * part.start:.4g}{prior}"
    if not part.identified:
        return before, "as it was", unit
    error = f" ± {factor * part.error:.2g}" if np.isfinite(part.error) else ""
    return before, f"{factor * part.value:.4g}{error}", unit
