"""The search for the rig that the paper's authors may have had: which statements hold on which
plant.

`python -m benchmarks.paper_search --out DIR` draws plants over what is not printed, runs every test
on each (20 minutes on two cores), and writes a map and the values of all plants. All that decides
the outcome is in this module and in `claims.toml`: the unknowns with their ranges, how plants are
drawn, how the inextensible estimate is read, and how the best plant is chosen. It is the same for
all statements.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from itertools import combinations, compress
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from distal.arrays import Bools, Floats
from distal.errors import DistalError
from distal.logs import check_outputs, write_together
from distal.reports.paper_2008 import Plant, measured, run_series, statements
from distal.results import BLACK, COLOURS, PALE, figure, figure_bytes, make_folder
from distal.simulation import Scenario

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class UnknownOfRig:
    """A parameter that the paper does not print, or that its measurements contradict; the search
    tries values from `low` to `high`.
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
"""Unknowns of the search: friction of the sliders and of the axle, and the angle to which the hand
turned the link on each side.

The paper prints a preload of 4.9 N; its range is the 20 % that the rig file assumes. Beyond 30° the
sliders would reach their stops, and the paper says that they did not.
"""

READINGS = ("geometry", "x/r")
"""Ways in which the inextensible estimate may turn a displacement into an angle; each plant is
tried with both.
"""

DRAWN = (256, 128, 64)
"""Number of plants in each round; the first round draws over the whole ranges, the later ones near
the best plants.
"""

NEAR = (1.0, 0.25, 0.1)
"""Width of the box from which each round draws, as a share of the unknowns' ranges."""

BEST = 8
"""Number of best plants around which the next round draws."""

NEEDED = ("series-1-soft", "series-1", "series-2", "series-2-high")
"""Scenarios of the tests on which the statements are measured."""


@dataclass(frozen=True)
class DrawnPlant(Plant):
    """A plant of the search, on which a hand turns the link to an angle [rad] on each side in
    Series 1.
    """

    turned: float = 0.0

    def scenario(self, series: str) -> Scenario:
        """Return a shipped scenario on this plant."""
        scenario = super().scenario(series)
        hand = scenario.joints["link"].hand if "link" in scenario.joints else None
        if hand is None:
            return scenario
        share = self.turned / max(abs(angle) for angle in hand.angle.values)
        signal = replace(hand.angle, values=tuple(share * angle for angle in hand.angle.values))
        turning = hand.model_copy(update={"angle": signal})
        link = scenario.joints["link"].model_copy(update={"hand": turning})
        return scenario.model_copy(update={"joints": {"link": link}})


def plant_of(values: Floats, reading: str) -> Plant:
    """Return the plant with given unknowns.

    Args:
        values: values of the `UNKNOWNS`, (6,).
        reading: reading of the inextensible estimate, one of `READINGS`.
    """
    constant, load, *joint, turned = (float(value) for value in values)
    changed: dict[str, object] = {}
    for i in (0, 1):
        changed |= {f"drives.{i}.friction.constant": constant, f"drives.{i}.friction.load": load}
    changed |= zip(
        (f"joints.0.friction.{part}" for part in ("exponent", "reference", "preload")), joint
    )
    return DrawnPlant("drawn", changed, reading == "x/r", float(np.deg2rad(turned)))


def margins_of(plant: Plant) -> Floats:
    """Return the margin of each statement on a plant, (12,), which is −∞ where the plant cannot be
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
    """The plants that a search tried, and the margins of the statements on them.

    Args:
        values: values of the `UNKNOWNS`, (n, 6).
        readings: reading of the inextensible estimate, as index into `READINGS`, (n,).
        margins: margin of each statement, (n, 12).
    """

    values: Floats
    readings: NDArray[np.int_]
    margins: Floats

    @property
    def ever(self) -> Bools:
        """Whether each statement holds on any plant, (12,)."""
        return np.atleast_1d(self.held.any(axis=0))

    @property
    def held(self) -> Bools:
        """Whether each statement holds on each plant, (n, 12)."""
        return np.asarray(self.margins >= 0.0)

    def order(self, without: int | None = None) -> NDArray[np.int_]:
        """Return the indices of the plants, best first, (n,).

        The best plant is that on which most statements hold; among equals it is that with the
        largest least margin of the statements that hold.

        Args:
            without: index of a statement that does not count, or None.
        """
        margins = self.margins if without is None else np.delete(self.margins, without, axis=1)
        held = margins >= 0.0
        least = np.min(np.where(held, margins, np.inf), axis=1)
        return np.lexsort((-least, -held.sum(axis=1)))

    def tested(self) -> tuple[bool, ...]:
        """Return for each statement whether it holds on the plant that the other eleven statements
        choose.
        """
        return tuple(
            bool(self.held[self.order(without=i)[0], i]) for i in range(self.margins.shape[1])
        )

    def excluding(self) -> list[tuple[int, int]]:
        """Return the pairs of statements that each hold on some plant, but never on the same one,
        by index.
        """
        held = self.held
        pairs = combinations(np.flatnonzero(self.ever).tolist(), 2)
        return [(i, j) for i, j in pairs if not (held[:, i] & held[:, j]).any()]


def search_rigs(advance: Callable[[int], None]) -> Search:
    """Return the search over plants: the first are drawn over the unknowns' ranges, later ones near
    the best so far.

    Sobol's sequence covers the ranges. Each later round draws in boxes around the `BEST` plants.

    Args:
        advance: called with the number of plants that are done.
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


SEARCH_FILES = ("search.png", "search.svg", "search.json")
"""Names of the files that `write_search` writes."""


def write_search(search: Search, out: str | Path) -> None:
    """Write a search's map and its values to a folder, which is made where it does not exist.

    Raises:
        OutputError: a file cannot be written.
    """
    check_outputs([Path(out) / name for name in SEARCH_FILES], makes_folder=True)
    folder = make_folder(out)
    drawn = draw_map(search)
    files: dict[Path, bytes | str] = {
        folder / name: figure_bytes(drawn, folder / name) for name in SEARCH_FILES[:2]
    }
    write_together(files | {folder / SEARCH_FILES[2]: to_json(search)})


def draw_map(search: Search) -> Figure:
    """Return the map of a search: for each statement a panel that shows, over two of the unknowns,
    on which plants it holds.
    """
    best = search.order()[0]
    across, up = search.values[:, 1], search.values[:, 2]
    star = {"marker": "*", "color": BLACK, "linestyle": "none"}
    with figure(4, 3, (7.2, 8.4), sharex=True, sharey=True) as (drawing, axes):
        for i, (position, statement) in enumerate(zip(axes, statements())):
            for reading, name in enumerate(READINGS):
                for holds, size in ((False, 3.0), (True, 9.0)):
                    shown = (search.readings == reading) & (search.held[:, i] == holds)
                    position.scatter(
                        across[shown],
                        up[shown],
                        s=size,
                        marker="os"[reading],
                        color=COLOURS[reading] if holds else PALE,
                        linewidths=0,
                        alpha=0.7,
                        label=f"holds, read by {name}" if holds else None,
                    )
            position.plot(across[best], up[best], markersize=11, **star)
            title = f"{statement.key}: {int(search.held[:, i].sum())} of {len(search.values)}"
            position.set_title(title, fontsize=9, loc="left")
        for position in axes[9:]:
            position.set_xlabel(UNKNOWNS[1].name, fontsize=8)
        for position in axes[::3]:
            position.set_ylabel(UNKNOWNS[2].name, fontsize=8)
        axes[0].plot([], [], markersize=9, label="plant with the most", **star)
        axes[0].scatter([], [], s=6, color=PALE, label="does not hold")
        legend = axes[0].get_legend_handles_labels()
        drawing.legend(*legend, loc="outside lower center", ncols=4, fontsize=8, markerscale=1.5)
    return drawing


def search_in_words(search: Search) -> list[str]:
    """Return the outcome of a search in words, line by line."""
    best = search.order()[0]
    keys = [statement.key for statement in statements()]
    held = search.held[best]

    def named(chosen: Iterable[object]) -> str:
        return ", ".join(compress(keys, chosen)) or "none"

    lines = [
        f"{len(search.values)} plants and readings; on the best of them {int(held.sum())} of "
        f"{len(keys)} statements hold:",
        f"  hold: {named(held)}",
        f"  do not: {named(~held)}",
        f"  hold on no plant: {named(~search.ever)}",
        "the plant:",
    ]
    for unknown, value in zip(UNKNOWNS, search.values[best]):
        lines.append(f"  {unknown.name}: {value:.3g}{' ' + unknown.unit if unknown.unit else ''}")
    pairs = [f"{keys[i]} and {keys[j]}" for i, j in search.excluding()]
    return [
        *lines,
        f"  the inextensible estimate is read by {READINGS[search.readings[best]]}",
        f"hold also on the plant that the other eleven choose: {named(search.tested())}",
        f"hold on some plant each, and on none together: {', '.join(pairs) or 'no pair'}",
    ]


def to_json(search: Search) -> str:
    """Return a search as JSON, with an entry for each plant and reading."""
    names = [
        f"{unknown.name} [{unknown.unit}]" if unknown.unit else unknown.name for unknown in UNKNOWNS
    ]
    keys = [statement.key for statement in statements()]
    rows = [
        {
            **dict(zip(names, (float(f"{value:.6g}") for value in values))),
            "reading": READINGS[reading],
            "margins": {
                key: None if np.isinf(m) else float(f"{m:.4g}") for key, m in zip(keys, margins)
            },
        }
        for values, reading, margins in zip(search.values, search.readings, search.margins)
    ]
    return (
        json.dumps(
            {"statements held at most": int(search.held.sum(axis=1).max()), "plants": rows},
            indent=1,
        )
        + "\n"
    )


def main() -> None:
    """Search, write the map, and say which statements hold."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.paper_search", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("out/paper_search"))
    out = parser.parse_args().out
    searched = search_rigs(
        lambda done: print(f"{done} of {sum(DRAWN)} plants", end="\r", file=sys.stderr)
    )
    write_search(searched, out)
    print("\n".join(search_in_words(searched)))


if __name__ == "__main__":
    main()
