"""Rigs that nobody built, drawn from a seed, each with a motion and a plant drawn from the rig's
own stds.

`random_case(seed)` gives the same rig, plant and log wherever it runs; other seeds give rigs not
looked at before. The model class is right: the plant is the rig with other numbers. Only rigs that
move as a rig should are kept (`sane`); of one seed, draws are tried until one is.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass
from itertools import count
from typing import Any

import numpy as np

from benchmarks.strangers.random_draw import Draw
from distal import DistalError, Log, Rig, simulate
from distal.rig import build_rig
from distal.simulation import build_scenario

TAG = 300
"""Keeps these draws apart from those of other benches with the same seed."""


@dataclass(frozen=True)
class RandomCase:
    """A rig, what is done to it, the plant it is done to, and the log.

    Args:
        seed: of the case.
        attempt: how many draws of this seed were not sane.
        about: the rig in a few words.
        rig: what the filters know.
        plant: values of the plant, by path.
        log: with truth.
    """

    seed: int
    attempt: int
    about: str
    rig: Rig
    plant: dict[str, Any]
    log: Log


def random_case(
    seed: int, change: Callable[[dict[str, Any]], dict[str, Any]] = lambda raw: raw
) -> RandomCase:
    """Return the first sane draw of a seed.

    Args:
        seed: of the case.
        change: what is done to the raw rig before its plant is drawn.
    """
    for attempt in count():
        rng = np.random.default_rng([seed, attempt, TAG])
        raw, scenario, about = Draw(rng).raw()
        raw = change(raw)
        try:
            rig = build_rig(raw, f"random rig {seed}")
            plant = drawn_plant(rig, seed, attempt, TAG)
            named = build_scenario(
                {**scenario, "rig": "random", "plant": plant}, f"random rig {seed}"
            )
            log = simulate(rig, named, seed)
        except DistalError:
            continue  # no equilibrium, or a motion out of all bounds: no rig that one would build
        if sane(rig, log):
            return RandomCase(seed, attempt, about, rig, plant, log)
    raise AssertionError("count() does not end")


def drawn_plant(rig: Rig, *seeds: int) -> dict[str, Any]:
    """Return the plant's values: each parameter from its own std, at most 2 of them away.

    What parameters share errs by one draw, that of the first of them. What a sign or a physical
    bound forbids is drawn no nearer to zero than a twentieth of the value. Each draw depends on the
    parameter's path, so that new keys of a rig file do not change the others.
    """
    values: dict[str, Any] = {}
    shared: dict[str, float] = {}

    def visit(part: Any, path: str) -> None:
        if isinstance(part, dict) and "value" in part and "std" in part:
            value, std, together = float(part["value"]), float(part["std"]), part.get("shared")
            if together is not None:
                std = float(together["std"]) * abs(value)  # here nothing has both
            if std <= 0.0 or path.endswith(("initial", "nominal_force")):
                return
            rng = np.random.default_rng([*seeds, zlib.crc32(path.encode())])
            z = float(np.clip(rng.normal(), -2, 2))
            if together is not None:
                z = shared.setdefault(str(together["name"]), z)
            drawn = value + z * std
            values[path] = (
                max(drawn, 0.05 * value) if value > 0.0 and not path.endswith("angle") else drawn
            )
        elif isinstance(part, dict):
            for key, inner in part.items():
                visit(inner, f"{path}.{key}" if path else str(key))
        elif isinstance(part, (list, tuple)):
            for i, inner in enumerate(part):
                visit(inner, f"{path}.{i}")

    visit(rig.model_dump(), "")
    return values


def sane(rig: Rig, log: Log) -> bool:
    """Return whether a rig moves as one that somebody would build and use.

    The joint moves by 8° or more within ±75° (pinned tendons: ±60°) and by no more than 15° between
    samples; at least seven tenths of the time no tendon is slack, and no drive stands at a stop for
    more than a fifth of it.
    """
    theta = log.truth["theta"]
    pinned = any(tendon.insertion.kind == "pinned" for tendon in rig.tendons)
    moves = np.ptp(theta) >= np.deg2rad(8) and np.abs(theta).max() <= np.deg2rad(
        60 if pinned else 75
    )
    smooth = np.abs(np.diff(theta)).max() <= np.deg2rad(15)
    taut = np.all([log.truth[f"tension_{tendon.name}"] > 1e-3 for tendon in rig.tendons], axis=0)
    free = True
    for drive in rig.drives:
        if drive.stops is not None:
            position = log.truth[f"position_{drive.name}"]
            free = (
                free
                and float(np.mean((position <= drive.stops[0]) | (position >= drive.stops[1])))
                <= 0.2
            )
    return bool(moves and smooth and np.mean(taut) >= 0.7 and free)
