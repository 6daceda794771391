"""The map of a search: which statements of the paper hold on which plants, as a figure, as a file
and in words.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from itertools import compress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from distal.logs import check_outputs, outputs_in, write_together
from distal.paper.claims import statements
from distal.paper.rig_search import READINGS, UNKNOWNS, Search
from distal.results import BLACK, COLOURS, PALE, figure, figure_bytes, make_folder

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SEARCH_FILES = ("search.png", "search.svg", "search.json")
"""Names of the files that `write_search` writes."""


def write_search(search: Search, out: str | Path) -> None:
    """Write a search's map and its values to a folder, which is made where it does not exist.

    Raises:
        OutputError: a file cannot be written.
    """
    check_outputs(outputs_in(out, SEARCH_FILES, "the search"))
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
    across = 1
    up = 2
    with figure(4, 3, (7.2, 8.4), sharex=True, sharey=True) as (drawing, axes):
        for i, (position, statement) in enumerate(zip(axes, statements())):
            for reading, name in enumerate(READINGS):
                read_so = search.readings == reading
                marker = "os"[reading]
                for holds, colour, size in ((False, PALE, 3.0), (True, COLOURS[reading], 9.0)):
                    shown = read_so & (search.held[:, i] == holds)
                    x = search.values[shown, across]
                    y = search.values[shown, up]
                    label = f"holds, read by {name}" if holds else None
                    position.scatter(
                        x,
                        y,
                        s=size,
                        marker=marker,
                        color=colour,
                        linewidths=0,
                        alpha=0.7,
                        label=label,
                    )
            position.plot(
                *search.values[best, [across, up]],
                marker="*",
                color=BLACK,
                markersize=11,
                linestyle="none",
            )
            title = f"{statement.key}: {int(search.held[:, i].sum())} of {len(search.values)}"
            position.set_title(title, fontsize=9, loc="left")
        for position in axes[9:]:
            position.set_xlabel(UNKNOWNS[across].name, fontsize=8)
        for position in axes[::3]:
            position.set_ylabel(UNKNOWNS[up].name, fontsize=8)
        axes[0].plot(
            [],
            [],
            marker="*",
            color=BLACK,
            linestyle="none",
            markersize=9,
            label="plant with the most",
        )
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
