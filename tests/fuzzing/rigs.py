"""Hostile rig files: shipped ones with lines, values, keys and bytes changed, and `--set` of
anything.
"""

from __future__ import annotations

import random
import tomllib
from datetime import date
from pathlib import Path
from typing import Any

import tomlkit

from distal.errors import DistalError
from distal.model import Mechanism, stiffest_frequency, substeps
from distal.rig import edited_text, load_rig, shipped_rigs
from tests.fuzzing.outcome import BYTES, TAKEN, Outcome, broken, damaged, refusal

VALUES: tuple[Any, ...] = (
    0,
    1,
    -1,
    0.0,
    -0.0,
    1e-300,
    1e300,
    -1e9,
    5e-324,
    2**63,
    10**30,
    float("nan"),
    float("inf"),
    True,
    False,
    date(2026, 1, 1),
    "",
    "std",
    "1 mm",
    "-3 deg",
    "10 %",
    "1e999 N",
    "1 parsec",
    "1 N m/A",
    "1,5 mm",
    "1 mm ± 2 mm",
    "link",
    "left",
    "²",
    "joints",
    "\x00",
    "\x1b[2J",
    "é" * 300,
    "a" * 5000,
    [],
    [[]],
    [0],
    ["1 mm", "2 mm"],
    [1, 0],
    ["a"] * 50,
    {},
    {"value": 1},
    {"value": "1 N", "std": "10 %"},
    {"std": 1},
    {"value": {}},
    {"kind": "pulley"},
    {"kind": "pinned"},
    {"name": "x"},
)
KEYS = (
    "name",
    "value",
    "std",
    "kind",
    "of",
    "shared",
    "stops",
    "friction",
    "x",
    "a.b",
    "²",
    "",
    " ",
    "__class__",
    "model_fields",
)
MARKS = (*BYTES, *(mark.encode() for mark in "=[]{}#'.-e"), b"9" * 400, b"[[joints]]\n")


def changed(seed: int) -> tuple[bytes, list[str]]:
    """Return the bytes of a shipped rig with changes, and what is set in it.

    Args:
        seed: of the changes.
    """
    rng = random.Random(seed)
    text = edited_text(rng.choice(shipped_rigs()))
    kind, assignments = rng.randrange(4), list[str]()
    if kind < 2:
        data = damaged(rng, text.encode(), MARKS)
    else:
        raw = tomllib.loads(text)
        for _ in range(rng.choice([1, 1, 1, 2, 5])):
            where, parent, key = _position(rng, raw)
            if kind == 2:
                _change(rng, raw, parent, key)
            else:
                rubbish = [
                    _toml(rng.choice(VALUES)),
                    "",
                    "[",
                    "x y",
                    "1 mm",
                    _toml(rng.choice(KEYS)),
                ]
                assignments.append(f"{where}={rng.choice(rubbish)}")
        data = _dumped(raw)
    return data, assignments


def attempt(seed: int, folder: Path) -> Outcome:
    """Load a changed rig and look at its equations as `distal rig check` does; return what came of
    it.

    Args:
        seed: of the change.
        folder: to write the file to.
    """
    (data, assignments), path = changed(seed), folder / "rig.toml"
    path.write_bytes(data)
    try:
        rig = load_rig(path, assignments)
        mechanism = Mechanism(rig)
        substeps(mechanism, 1.0 / max((sensor.rate for sensor in rig.sensors), default=100.0))
        stiffest_frequency(mechanism)
    except DistalError as problem:
        outcome = refusal(problem)
    except Exception as problem:
        outcome = broken((seed, assignments), problem)
    else:
        outcome = TAKEN
    return outcome if path.read_bytes() == data else broken(seed, "the rig file was changed")


def _position(rng: random.Random, raw: Any) -> tuple[str, Any, Any]:
    """Return the path of a value anywhere in a description, what holds it, and its key."""
    where, parent = [], raw
    while True:
        keys = list(parent) if isinstance(parent, dict) else list(range(len(parent)))
        if not keys:
            return ".".join(map(str, where)) or "name", raw, next(iter(raw), "name")
        key = rng.choice(keys)
        where.append(key)
        inner = parent[key]
        if not isinstance(inner, (dict, list)) or rng.random() < 0.15:
            return ".".join(map(str, where)), parent, key
        parent = inner


def _change(rng: random.Random, raw: Any, parent: Any, key: Any) -> None:
    what = rng.randrange(5)
    if what == 0:
        del parent[key]
    elif what == 1 and isinstance(parent, dict):
        parent[rng.choice(KEYS)] = rng.choice([parent[key], rng.choice(VALUES)])
    elif what == 2 and isinstance(parent, list):
        parent.append(parent[key])
    elif what == 3:
        parent[key] = _position(rng, raw)[1]
    else:
        parent[key] = rng.choice(VALUES)


def _toml(value: Any) -> str:
    try:
        return tomlkit.item(value).as_string()
    except Exception:
        return repr(value)


def _dumped(raw: Any) -> bytes:
    try:
        return tomlkit.dumps(raw).encode("utf-8", "replace")
    except Exception:  # a description that no TOML file can hold
        return b"name = 1\n"
