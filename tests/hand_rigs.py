"""A hand for tests: several fingers side by side in one rig, each with numbers of its own."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from typing import Any

from distal import Rig, load_rig
from distal.rig import build_rig

KINDS = ("joints", "drives", "tendons", "sensors")


def hand(fingers: Sequence[str], changes: Mapping[str, object] | None = None) -> Rig:
    """Return a rig of shipped fingers, their parts called f0_…, f1_… in their order.

    Args:
        fingers: names of shipped rigs.
        changes: path → value, in the hand.
    """
    whole: dict[str, Any] = (
        load_rig(fingers[0]).model_dump() | {kind: [] for kind in KINDS} | {"name": "hand"}
    )
    for f, name in enumerate(fingers):
        raw = copy.deepcopy(load_rig(name).model_dump())
        _renamed(raw, f"f{f}_")
        for kind in KINDS:
            whole[kind] += raw[kind]
    return build_rig(whole, "hand").with_values(dict(changes or {}))


def _renamed(raw: Any, prefix: str) -> None:
    """Put a prefix before all names of joints, drives, tendons and sensors, and of what they err by
    together.
    """
    named = {part["name"] for kind in KINDS for part in raw[kind]}
    for kind in KINDS:
        for part in raw[kind]:
            _within(part, named, prefix)
            if kind == "sensors":
                part["column"] = part["name"]
            if kind == "joints" and part["parent"] is None:
                part["parent"] = "base"


def _within(part: Any, named: set[str], prefix: str) -> None:
    if isinstance(part, dict):
        for key, value in part.items():
            if key in ("name", "joint", "drive", "of", "parent") and isinstance(value, str):
                if value in named or (key == "name" and "std" in part):
                    part[key] = prefix + value
            else:
                _within(value, named, prefix)
    elif isinstance(part, (list, tuple)):
        for value in part:
            _within(value, named, prefix)
