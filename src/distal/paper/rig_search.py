"""The search for the rig that the paper's authors had before them: which statements hold on which
plant.

Everything that decides the outcome stands here and in `claims.toml`: the unknowns with their
ranges, how plants are drawn, how the inextensible estimate is read, and how the best plant is
chosen. It is the same for all statements.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import combinations
from multiprocessing import get_context

import numpy as np
from numpy.typing import NDArray

from distal.arrays import Bools, Floats
from distal.errors import DistalError
from distal.paper.claims import measured, statements
from distal.paper.series import Plant, run_series


@dataclass(frozen=True)
class UnknownOfRig:
    """Something that the paper does not print, or that its measurements contradict: tried from
    `low` to `high`.
    """

    name: str
    unit: str
    low: float
    high: float


UNKNOWNS = (
    UnknownOfRig("slider friction, constant", "N", 0.0, 0.4),
    UnknownOfRig("slider friction by load", "", 0.0, 0.2),
    UnknownOfRig("axle friction, exponent", "", 1.0, 2.5),
    UnknownOfRig("axle friction, reference load", "N", 9.0, 17.0),
    UnknownOfRig("axle friction, preload", "N", 3.9, 5.9),
    UnknownOfRig("angle of Series 1", "deg", 15.0, 30.0),
)
"""Friction of the sliders and the axle, and how far the hand turned the link to each side.

The preload is printed, 4.9 N: its range is that of the 20 % that the rig file assumes. Beyond 30°
the sliders would reach their stops, and the paper says that they did not.
"""

READINGS = ("geometry", "x/r")
"""How the inextensible estimate turns a displacement into an angle: each plant is tried with both.
"""

DRAWN = (256, 128, 64)
"""Plants of each round: first over the whole ranges, then near the best so far."""

NEAR = (1.0, 0.25, 0.1)
"""Width of the box that a round draws from, as a share of each range."""

BEST = 8
"""How many of the best plants the next round is drawn around."""

NEEDED = ("series-1-soft", "series-1", "series-2", "series-2-high")
"""The tests that statements are about."""


def plant_of(values: Floats, reading: str) -> Plant:
    """Return the plant with `values` of the `UNKNOWNS`, (6,), and a reading of the inextensible
    estimate (`READINGS`).
    """
    constant, load, *joint, turned = (float(value) for value in values)
    changed: dict[str, object] = {}
    for i in (0, 1):
        changed |= {f"drives.{i}.friction.constant": constant, f"drives.{i}.friction.load": load}
    changed |= zip(
        (f"joints.0.friction.{part}" for part in ("exponent", "reference", "preload")), joint
    )
    return Plant("drawn", changed, float(np.deg2rad(turned)), reading == "x/r")


def margins_of(plant: Plant) -> Floats:
    """Return the margin of each statement on a plant, (12,); −∞ where the plant cannot be
    simulated.
    """
    try:
        values = measured(
            [run for series in NEEDED for run in run_series(series, plant, statements_only=True)]
        )
    except DistalError:
        return np.full(len(statements()), -np.inf)
    return np.array([statement.margin(values[statement.key]) for statement in statements()])


def _both_readings(values: Floats) -> Floats:
    return np.array([margins_of(plant_of(values, reading)) for reading in READINGS])


@dataclass(frozen=True)
class Search:
    """The plants that were tried, and the margins of the statements on them.

    Args:
        values: of the unknowns, in the order of `UNKNOWNS`, (n, 6).
        readings: of the inextensible estimate, index into `READINGS`, (n,).
        margins: of each statement, (n, 12).
    """

    values: Floats
    readings: NDArray[np.int_]
    margins: Floats

    @property
    def ever(self) -> Bools:
        """Return which statements hold on some plant, (12,)."""
        return np.atleast_1d(self.held.any(axis=0))

    @property
    def held(self) -> Bools:
        """Return which statements hold, (n, 12)."""
        return np.asarray(self.margins >= 0.0)

    def order(self, without: int | None = None) -> NDArray[np.int_]:
        """Return the plants, best first: most statements held, then the largest of the smallest
        margins held.

        The statement with the index `without` does not count.
        """
        margins = self.margins if without is None else np.delete(self.margins, without, axis=1)
        held = margins >= 0.0
        least = np.min(np.where(held, margins, np.inf), axis=1)
        return np.lexsort((-least, -held.sum(axis=1)))

    def tested(self) -> tuple[bool, ...]:
        """Return for each statement whether it holds on the plant that the other eleven choose."""
        return tuple(
            bool(self.held[self.order(without=i)[0], i]) for i in range(self.margins.shape[1])
        )

    def excluding(self) -> list[tuple[int, int]]:
        """Return the pairs of statements that hold on some plant each, and on none together."""
        held = self.held
        pairs = combinations(np.flatnonzero(self.ever).tolist(), 2)
        return [(i, j) for i, j in pairs if not (held[:, i] & held[:, j]).any()]


def search_rigs(advance: Callable[[int], None]) -> Search:
    """Return which statements hold on plants drawn over the unknowns' ranges, then closer and
    closer to the best.

    Sobol's sequence covers the ranges; each later round draws in boxes around the best plants so
    far. `advance` is called with the number of plants that are done.
    """
    from scipy.stats import qmc

    low, high = (
        np.array([getattr(unknown, end) for unknown in UNKNOWNS]) for end in ("low", "high")
    )
    tried = Search(
        np.empty((0, len(UNKNOWNS))), np.empty(0, dtype=int), np.empty((0, len(statements())))
    )
    done = 0
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:
        for number, (count, width) in enumerate(zip(DRAWN, NEAR)):
            unit = qmc.Sobol(len(UNKNOWNS), seed=2008 + number).random(count)
            if number == 0:
                values = low + unit * (high - low)
            else:
                best = tried.values[tried.order()[:BEST]]
                centres = best[np.arange(count) % len(best)]
                values = np.clip(centres + width * (unit - 0.5) * (high - low), low, high)
            margins = []
            for plant_margins in pool.map(_both_readings, values):
                margins.append(plant_margins)
                done += 1
                advance(done)
            tried = Search(
                np.vstack([tried.values, np.repeat(values, len(READINGS), axis=0)]),
                np.concatenate([tried.readings, np.tile(np.arange(len(READINGS)), count)]),
                np.vstack([tried.margins, *margins]),
            )
    return tried
