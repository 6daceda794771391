"""`distal drift`: hours of a scenario whose plant changes, once without any known angle and once
with an angle known from time to time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Option

from distal.cli.console import say, table, working
from distal.cli.paths import check_command_outputs, to_folder
from distal.cli.shared_options import ScenarioArgument, SeedOption, SetOption

if TYPE_CHECKING:
    from distal.run import PieceEstimate
    from distal.simulation import Rezero


def drift_command(
    scenario: ScenarioArgument,
    out: Annotated[Path, Option(help="Folder for the figure and the table by hours.")],
    seed: SeedOption = 0,
    *,
    set_: SetOption = None,
) -> None:
    """Simulate hours of work, and print error and band of the estimate for each; memory stays that
    of one minute.
    """
    from distal.logs import write_whole
    from distal.results import save_figure
    from distal.run import by_hour, estimate_pieces, plot_hours
    from distal.simulation import load_scenario, scenario_rig, simulate_pieces

    description = load_scenario(scenario)
    rig = scenario_rig(description, set_ or ())
    picture = out / "drift.png"
    rows_file = out / "drift.csv"
    check_command_outputs(
        to_folder("--out", out, [picture.name, rows_file.name]),
        rig=description.rig,
        scenario=scenario,
    )
    ways: dict[str, Rezero | None] = {"nothing known": None}
    if description.rezero is not None:
        ways["rezeroed"] = description.rezero
    hours_of = {}
    with working("simulating hours") as show:
        for name, rezero in ways.items():
            pieces = estimate_pieces(simulate_pieces(rig, description, seed), rig, rezero)
            hours_of[name] = by_hour(_with_progress(pieces, show, description.duration, name))
    out.mkdir(parents=True, exist_ok=True)
    save_figure(plot_hours(hours_of), picture)
    rows = []
    for name, hours in hours_of.items():
        for hour in hours:
            error = f"{degrees(hour.rms):.2f}"
            half_band = f"{degrees(hour.half_band):.2f}"
            rows.append((name, str(hour.index + 1), error, f"{100 * hour.inside:.0f}", half_band))
    columns = ["way", "hour", "RMS error [°]", "inside 95 % band [%]", "half of the band [°]"]
    write_whole(rows_file, "\n".join(",".join(row) for row in [columns, *rows]) + "\n")
    table(f"{description.name or scenario}", columns, rows, text=1)
    say(f"wrote {picture} and {rows_file.name}")


def _with_progress(
    pieces: Iterable[PieceEstimate], show: Callable[[str], None], duration: float, name: str
) -> Iterator[PieceEstimate]:
    """Yield pieces, and show which share of the `duration` [s] they are."""
    for piece in pieces:
        show(f"{name}: {100 * piece.log.time[-1] / duration:.0f} % simulated and estimated")
        yield piece
