"""The sets of terms that are tried for a discrepancy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

PLAYS = (0.25, 0.5, 1.0)
"""Half-widths of plays that are tried, in standard deviations of the reading."""


@dataclass(frozen=True)
class Choice:
    """A set of terms.

    Args:
        name: what it is called in a note.
        terms: see `Discrepancy`.
        play: half-width of plays, in standard deviations of the reading.
        corrects: whether the angle is corrected; else only its band is sized.
    """

    name: str
    terms: tuple[str, ...]
    play: float = 0.5
    corrects: bool = True


NO_CORRECTION = Choice("the angle is not corrected", ("1",), corrects=False)


def choices(channels: Sequence[str], efforts: Sequence[str], joints: Sequence[str]) -> list[Choice]:
    """Return the sets of terms that are tried, fewer terms first.

    Args:
        channels: names of the sensors that tell something of their own.
        efforts: those of them that are forces, torques or tensions.
        joints: names of the joints.
    """
    own = tuple(f"angle({joint})" for joint in joints)
    linear = ("1", *channels)
    squares = tuple(f"{a}*{b}" for i, a in enumerate(channels) for b in channels[i:] if not (a == b and a in efforts))
    magnitudes = tuple(f"{name}*abs({name})" for name in efforts)
    places = tuple(name for name in channels if name not in efforts)
    sets = [
        NO_CORRECTION,
        Choice("a constant", ("1",)),
        Choice("linear in what the sensors read", linear),
        Choice("linear in what the sensors read and in the filter's own angle", (*linear, *own)),
    ]
    for width in PLAYS:
        plays = tuple(f"play({name})" for name in channels)
        said = f"with a play of {width:g} std"
        sets.append(Choice(f"linear, {said}", (*linear, *plays), width))
        sets.append(Choice(f"linear with the filter's own angle, {said}", (*linear, *plays, *own), width))
        if efforts:
            mixed = tuple(f"{place}*play({effort})" for place in places for effort in efforts)
            curved = (*linear, *(f"play({name})" for name in efforts), *squares, *magnitudes, *mixed)
            sets.append(Choice(f"curves, {said}", curved, width))
            sets.append(Choice(f"curves with the filter's own angle, {said}", (*curved, *own), width))
    return sets
