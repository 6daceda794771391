"""The map of a search: which statements of the paper hold on which plants, as a figure, a file and in words."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from distal.logs import check_outputs, outputs_in, write_together
from distal.paper.claims import statements
from distal.paper.search import READINGS, UNKNOWNS, Search
from distal.reports import make_folder
from distal.results import BLACK, COLOURS, PALE, figure, figure_bytes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SEARCH_FILES = ("search.png", "search.svg", "search.json")
"""Files that `write_search` writes."""


def write_search(found: Search, out: str | Path) -> None:
    """Write a search's map and its numbers.

    Args:
        found: of `search`.
        out: folder, made if need be.

    Raises:
        OutputError: the folder or a file cannot be written.
    """
    check_outputs(outputs_in(out, SEARCH_FILES, "the search"))
    folder, drawn = make_folder(out), draw_map(found)
    files: dict[Path, bytes | str] = {folder / name: figure_bytes(drawn, folder / name) for name in SEARCH_FILES[:2]}
    write_together(files | {folder / SEARCH_FILES[2]: to_json(found)})


def draw_map(found: Search) -> Figure:
    """Return the map: for each statement the plants on which it holds, over two unknowns, and how many hold together.

    Args:
        found: of `search`.
    """
    best, across, up = found.order()[0], 1, 2
    with figure(4, 3, (7.2, 8.4), sharex=True, sharey=True) as (made, axes):
        for i, (place, statement) in enumerate(zip(axes, statements())):
            for reading, name in enumerate(READINGS):
                own = found.readings == reading
                marker = "os"[reading]
                for holds, colour, size in ((False, PALE, 3.0), (True, COLOURS[reading], 9.0)):
                    shown = own & (found.held[:, i] == holds)
                    x, y = found.values[shown, across], found.values[shown, up]
                    label = f"holds, read by {name}" if holds else None
                    place.scatter(x, y, s=size, marker=marker, color=colour, linewidths=0, alpha=0.7, label=label)
            place.plot(*found.values[best, [across, up]], marker="*", color=BLACK, markersize=11, linestyle="none")
            place.set_title(
                f"{statement.key}: {int(found.held[:, i].sum())} of {len(found.values)}", fontsize=9, loc="left"
            )
        for place in axes[9:]:
            place.set_xlabel(UNKNOWNS[across].name, fontsize=8)
        for place in axes[::3]:
            place.set_ylabel(UNKNOWNS[up].name, fontsize=8)
        axes[0].plot([], [], marker="*", color=BLACK, linestyle="none", markersize=9, label="plant with the most")
        axes[0].scatter([], [], s=6, color=PALE, label="does not hold")
        handles, labels = axes[0].get_legend_handles_labels()
        made.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=8, markerscale=1.5)
    return made


def described(found: Search) -> list[str]:
    """Return a search in words, a line for each thing that it says.

    Args:
        found: of `search`.
    """
    best, keys = found.order()[0], [each.key for each in statements()]
    held, tested = found.held[best], found.tested()

    def named(which: Iterable[object]) -> str:
        return ", ".join(key for key, one in zip(keys, which) if one) or "none"

    lines = [
        f"{len(found.values)} plants and readings; on the best of them {int(held.sum())} of {len(keys)} statements hold:",
        f"  hold: {named(held)}",
        f"  do not: {named(~held)}",
        f"  hold on no plant: {named(~found.ever)}",
        "the plant:",
    ]
    for unknown, value in zip(UNKNOWNS, found.values[best]):
        lines.append(f"  {unknown.name}: {value:.3g}{' ' + unknown.unit if unknown.unit else ''}")
    lines.append(f"  the inextensible estimate is read by {READINGS[found.readings[best]]}")
    lines.append(f"hold also on the plant that the other eleven choose: {named(tested)}")
    pairs = [f"{keys[i]} and {keys[j]}" for i, j in found.excluding()]
    lines.append(f"hold on some plant each, and on none together: {', '.join(pairs) or 'no pair'}")
    return lines


def to_json(found: Search) -> str:
    """Return a search as JSON, one row for each plant and reading.

    Args:
        found: of `search`.
    """
    names = [f"{each.name} [{each.unit}]" if each.unit else each.name for each in UNKNOWNS]
    keys = [each.key for each in statements()]
    rows = [
        {
            **dict(zip(names, (float(f"{value:.6g}") for value in values))),
            "reading": READINGS[reading],
            "margins": {key: None if np.isinf(m) else float(f"{m:.4g}") for key, m in zip(keys, margins)},
        }
        for values, reading, margins in zip(found.values, found.readings, found.margins)
    ]
    return json.dumps({"statements held at most": int(found.held.sum(axis=1).max()), "plants": rows}, indent=1) + "\n"
