"""`distal estimate`, the joint angle over a log or many, and `distal stream`, the same while the
samples arrive.
"""

from __future__ import annotations

import csv
import json
import os
import sys
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import chain, starmap
from math import degrees, isfinite, nan
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Argument, Option

from distal.cli.shared_options import (
    RIG,
    EstimatorOption,
    RigOption,
    SetOption,
    UnitOption,
    check_command_outputs,
    check_ending,
    check_folder,
    continue_on_failure,
    estimators,
    failure,
    homing_time,
    joint_angle,
    progress_bar,
    rigs,
    say,
    table,
    warn,
    working,
)
from distal.confidence import BAND, COVERED_TEXT
from distal.errors import (
    Content,
    DistalError,
    DistalWarning,
    DivergedError,
    EstimationError,
    LogError,
    OutputError,
    printable,
)

if TYPE_CHECKING:
    from distal.logs import Episode, Log, MessageReader
    from distal.results import Estimate
    from distal.rig import Rig
    from distal.run import Monitor, Reading


@dataclass
class Comparison:
    """What estimators found: estimates, rows of the table of errors, and why others failed."""

    results: list[Estimate]
    rows: list[tuple[str, ...]]
    notes: dict[str, None]
    failed: dict[str, str]


def compared(
    log: Log,
    rig: Rig,
    names: list[str],
    home: float | None,
    unasked: bool,
    smooth: bool,
    every: bool,
) -> Comparison:
    """Return what the estimators find, the smoothed estimate first where it is asked for.

    Where the first estimator fails, the others are still shown before its error is raised. In a
    comparison that was not asked for, only the first estimate stays in memory; with `every` it has
    all states, not only angles and torques.
    """
    from distal.estimators.regression_estimator import NEEDS
    from distal.run import estimate
    from distal.run import smooth as smoothed

    found = Comparison([], [], {}, {})
    runs: dict[str, Callable[..., Estimate]] = {
        name: partial(estimate, log, rig, name, homing=home, covariances=False, every=every)
        for name in names
    }
    if smooth:
        runs = {"smoothing": partial(smoothed, log, rig)} | runs
    # in a comparison by default, an estimator that cannot run is a row with what it needs
    has_map = rig.map is not None and rig.map.readings
    if unasked and not has_map and home is None and "regression" in runs:
        del runs["regression"]
        found.failed["regression"] = f"regression {NEEDS}"
    lost: DistalError | None = None
    with working("estimating") as show:
        for name, run in runs.items():
            show(f"estimating with {name}")
            try:
                result = run()
            except DistalError as problem:
                # some errors have the name
                found.failed[name] = f"{name}: {str(problem).removeprefix(f'{name}: ')}"
                if name == next(iter(runs)):
                    lost = problem
                continue
            found.notes |= dict.fromkeys(result.notes)
            if result.truths is not None:
                found.rows.append(_row(result))
            if not (unasked and found.results):
                found.results.append(result)
    if lost is not None:
        if found.rows:
            say_errors(found)
        raise _explained(lost, log, rig, home) if isinstance(lost, DivergedError) else lost
    return found


def _explained(problem: DivergedError, log: Log, rig: Rig, home: float | None) -> DivergedError:
    """Return the error of an estimate that left all bounds, with what would explain it in front, if
    anything would.
    """
    from distal.diagnosis import why_diverged

    causes = ""
    doing = "looking for what made the estimate leave all bounds"
    with continue_on_failure(doing), working(doing):
        causes = "; ".join(finding.text for finding in why_diverged(log, rig, home))
    return DivergedError(f"{causes}: {problem}") if causes else problem


def half_in_words(result: Estimate, digits: int = 3) -> str:
    """Return the median half-width of an estimate's band [°] in words."""
    import numpy as np

    from distal.results import UNKNOWN

    half = degrees(BAND * np.median(result.angle_stds))
    return f"±{half:.{digits}f}" if half <= UNKNOWN else "not known"


def _row(result: Estimate) -> tuple[str, ...]:
    """Return the cells of an estimate in the table of errors."""
    return (
        result.estimator,
        f"{degrees(result.rms_error()):.3f}",
        f"{degrees(result.max_error()):.3f}",
        f"{100 * result.inside_band():.0f} %",
        half_in_words(result),
    )


def say_errors(comparison: Comparison) -> None:
    """Print the errors of each estimator as a table, and the reasons of those that failed."""
    table(
        "error against truth",
        [
            "estimator",
            "RMS [°]",
            "maximum [°]",
            f"inside {COVERED_TEXT} band",
            "median band [°]",
        ],
        [*comparison.rows, *((name, "–", "–", "–", "–") for name in comparison.failed)],
    )
    for reason in comparison.failed.values():
        say(reason)


FEW = 4
"""Number of warnings printed for many logs; the others are counted. Source: layout."""


LogsArgument = Annotated[
    list[Path],
    Argument(
        metavar="LOG...",
        help="CSV, Parquet, HDF5, MCAP, a ROS bag or a LeRobot dataset, with the columns that "
        "the rig's sensors name.",
    ),
]
RigOfLogOption = Annotated[
    str | None,
    Option(
        help=f"{RIG} A log of `distal simulate` has its rig beside it.",
        autocompletion=rigs,
    ),
]
OutOption = Annotated[
    Path | None,
    Option(
        help="Where to write the first estimator's estimate (CSV or Parquet); of several "
        "logs, a folder."
    ),
]
IntoOption = Annotated[
    Path | None,
    Option(
        help="Of one LeRobot dataset: folder for a copy of it with joint angles, their stds "
        "and health words."
    ),
]
EstimatorsOption = Annotated[
    list[str] | None,
    Option(
        "--estimator",
        "-e",
        help=(
            "adaptive, elastic, inextensible, regression, ekf-2008 (the paper's filter) or ekf "
            "(the same with the rig's noise); repeatable, the first is written. Default: "
            "adaptive; where the angle is known, all but the last two, to compare."
        ),
        autocompletion=estimators,
    ),
]
TruthOption = Annotated[
    str | None,
    Option(help="True joint angle: a column of LOG, or a file with t and theta in rad."),
]
PlotOption = Annotated[
    Path | None,
    Option(
        help="Draw a picture (PNG, SVG or PDF): of the estimators that -e names, else of adaptive."
    ),
]
PanelOption = Annotated[
    list[str] | None,
    Option(help="What else --plot draws: innovations, forces, health, or all. Repeatable."),
]
SmoothOption = Annotated[
    bool,
    Option("--smooth", help="Write the adaptive estimate smoothed over the whole log (offline)."),
]
HomingOption = Annotated[
    str | None,
    Option(help="Use the reference for this long (e.g. 3s), then only compare with it."),
]
HomingAngleOption = Annotated[
    list[str] | None,
    Option(
        help="Without a reference: the joint stands here while homing, e.g. '0 deg ± 1 deg', "
        "or 'pip: 0 deg'."
    ),
]
WhatIfOption = Annotated[
    bool, Option(help="Rerun with one change at a time: what explains it, what is untested.")
]
FindingsOption = Annotated[
    bool,
    Option("--findings", help="List each finding on the log and the rig, on a line of its own."),
]
EveryOption = Annotated[
    bool, Option("--all", help="Write all states to --out, not only time, angles and torques.")
]


def estimate_command(
    logs: LogsArgument,
    rig: RigOfLogOption = None,
    *,
    out: OutOption = None,
    into: IntoOption = None,
    estimator: EstimatorsOption = None,
    truth: TruthOption = None,
    plot: PlotOption = None,
    panel: PanelOption = None,
    smooth: SmoothOption = False,
    homing: HomingOption = None,
    homing_angle: HomingAngleOption = None,
    what_if: WhatIfOption = True,
    findings: FindingsOption = False,
    unit: UnitOption = None,
    every: EveryOption = False,
    set_: SetOption,
) -> None:
    """Estimate the joint angle over a log, or many; where the truth of one is known, compare all
    estimators with it.
    """
    from distal.estimators import usual_estimator
    from distal.logs import file_of, read_log, sources_of, true_angles, write_together
    from distal.rig import angle_unit
    from distal.simulation import rig_of_logs

    if into is not None:
        others = (out, plot, panel, estimator, truth, smooth, homing, homing_angle, every)
        if len(logs) != 1 or any(others):
            raise EstimationError("--into is of one dataset, with --rig, --set and --unit alone")
        with_dataset(logs[0], rig_of_logs((), rig, set_)[0], into, unit)
        return
    asked = estimator or []
    home = homing_time(homing)
    sources = sources_of(logs)
    several = sources != logs[:1]
    of_file = {"--all": every, "--unit": unit}
    _check_given(out is None, of_file, "is about the file of --out, which is not given")
    unlike = {"--homing": homing, f"-e {', '.join(asked)}": set(asked) - {"adaptive"}}
    _check_given(smooth, unlike, "does not go with --smooth: adaptive, over the whole log")
    for_one = {
        "--homing-angle": homing_angle,
        "--plot": plot,
        "--panel": panel,
        "--smooth": smooth,
        "--findings": findings,
        "a second --estimator": asked[1:],
    }
    _check_given(several, for_one, f"is for one log, {len(sources)} came; give one log")
    panels = _panels(panel or [], plot)
    outputs = estimates_of(sources, out) if several else [out, plot]
    check_command_outputs(outputs, logs=logs, rig=rig, truth=truth, makes_folder=several)
    if not several:
        check_ending(out, "a table")
    description, changed = rig_of_logs(sources, rig, set_)
    in_unit = unit or angle_unit(description.sensors)
    if several:
        name = asked[0] if asked else usual_estimator(description)
        _estimate_many(sources, description, name, truth, home, out, in_unit, every)
        return
    with working(f"reading {logs[0]}"):
        log = read_log(logs[0], description, truth)
    _describe(log, description, changed)
    names = _names(asked, description, true_angles(log, description.joint_names) is not None)
    origin = str(log.truth_source)
    if homing_angle:
        log, description = _at_home(log, description, homing_angle, home)
    comparison = compared(log, description, names, home, not asked, smooth, every)
    results = comparison.results
    files = dict[Path, Content]()
    if out is not None:
        files[out] = file_of(results[0].columns(in_unit, every=every), out)
    if plot is not None:
        drawn = results if asked else results[:1]
        files[plot] = _picture(log, description, drawn, panels, plot)
    with working("writing"):
        write_together(files)
    files.clear()  # of a log of hours the columns are large
    _say_truth(comparison, origin, home, "not read" if homing_angle else "used")
    _say(comparison, log, description, home, (out, plot), what_if=what_if, findings=findings)


def _panels(asked: list[str], plot: Path | None) -> tuple[str, ...]:
    """Return the panels to draw, where the path of the plot is one."""
    from distal.results import PANELS, check_panels, plot_kind

    _check_given(plot is None, {"--panel": asked}, "says what --plot draws; give --plot too")
    if plot is not None:
        plot_kind(plot)
    return check_panels(PANELS if "all" in asked else [*dict.fromkeys(asked)])


def _check_given(wrong: bool, options: Mapping[str, object], why: str) -> None:
    """Raise an `EstimationError` where it is wrong that one of the options is given."""
    given = [option for option, value in options.items() if value]
    if wrong and given:
        raise EstimationError(f"{', '.join(given)} {why}")


def _say_truth(comparison: Comparison, origin: str, home: float | None, read: str) -> None:
    """Say how far the estimates are from the truth, or why there are none."""
    if not comparison.rows:
        for reason in comparison.failed.values():
            failure(reason)
        return
    used = ""
    if home is not None:
        used = f"; {read} for the first {home:g} s, compared with afterwards"
    say(f"truth: {origin}{used}")
    say_errors(comparison)


def with_dataset(dataset: Path, rig: Rig, into: Path, unit: str | None) -> None:
    """Write a copy of a dataset with joint angles, and print what it has."""
    from distal.bridges.lerobot import with_angles
    from distal.rig import angle_unit

    with _few_warnings(), working(f"estimating {dataset}"):
        written = with_angles(dataset, rig, into, unit or angle_unit(rig.sensors))
    words = ", ".join(f"{word} {share:.0%}" for word, share in written.words.items())
    say(f"wrote {into}: {written.episodes} episodes, {written.rows} rows; health: {words}")


def _check_names(names: Sequence[str], rig: Rig) -> None:
    """Raise an `EstimationError` where a name is that of no estimator."""
    from distal.estimators import ESTIMATORS, make_estimator

    for name in names:
        if name not in ESTIMATORS:
            make_estimator(name, rig)  # raises an error that lists the names


def _names(asked: list[str], rig: Rig, is_known: bool) -> list[str]:
    """Return the names of the estimators to run: those asked for, else the default, and where the
    truth is known all others that do not only run on request.
    """
    from distal.estimators import ESTIMATORS, ON_REQUEST, usual_estimator

    _check_names(asked, rig)
    usual = usual_estimator(rig)
    compared = [name for name in ESTIMATORS if name not in ON_REQUEST] if is_known else []
    return list(dict.fromkeys(asked or [usual, *compared]))


def _at_home(log: Log, rig: Rig, positions: list[str], home: float | None) -> tuple[Log, Rig]:
    """Return the log and the rig with the joints' known angles while homing."""
    from distal.homing import at_known_angle

    if home is None:
        raise EstimationError(
            "--homing-angle says where the joint stands while homing; give --homing too, e.g. 0.5s"
        )
    for position in positions:
        joint, angle, std = joint_angle(position)
        log, rig = at_known_angle(log, rig, home, angle, std, joint)
        say(
            f"home: {joint or 'the joint'} stands at {degrees(angle):g}° ± {degrees(std):g}° for "
            f"the first {home:g} s"
        )
    return log, rig


def _picture(
    log: Log, rig: Rig, drawn: list[Estimate], panels: tuple[str, ...], path: Path
) -> bytes:
    """Return the figure of estimates as a file, in the format of the path's ending."""
    from distal.logs import shown
    from distal.results import figure_bytes, plot_estimates
    from distal.run import log_health

    # of a rig that logs taught, health says where it is touched or outside of these logs
    with working("drawing"):
        health = log_health(log, rig) if "health" in panels or rig.map is not None else None
        drawing = plot_estimates(
            drawn,
            panels=[p for p in panels if p != "innovations" or drawn[0].measured],
            log=log,
            rig=rig,
            health=health,
            title=f"{rig.name}: {shown(Path(log.source).name)}",
        )
        return figure_bytes(drawing, path)


def _say(
    comparison: Comparison,
    log: Log,
    rig: Rig,
    home: float | None,
    written: tuple[Path | None, ...],
    *,
    what_if: bool,
    findings: bool,
) -> None:
    """Print the angle in words, notes, which files were written, and at last the diagnosis."""
    from distal.diagnosis import diagnose

    final = comparison.results[0]
    for joint in range(len(final.joint_names)):
        say(final.in_words(joint))
    for note in comparison.notes:
        if note != final.unseen:
            say(note)
    for path in filter(None, written):
        say(f"wrote {path}")
    if final.unseen is not None:
        say(final.unseen)
    # a smoothed estimate is of the same log and rig, and its innovations are the filter's
    doing = "testing what the log says of the rig"
    with continue_on_failure(doing):
        with working(doing):
            diagnosis = diagnose(final, log, rig, home, what_if=what_if)
        say(diagnosis.text)
        if findings:
            for finding in diagnosis.findings:
                say(f"  {finding.text}")


def _describe(log: Log, rig: Rig, changed: Sequence[str]) -> None:
    """Print what was read: samples, time, rate, missing readings and gaps, and what the log's
    scenario changes in the rig.
    """
    import numpy as np

    span = f"{log.time[0]:g} to {log.time[-1]:g} s, {log.rate:.4g} Hz"
    say(f"read {log.source}: {len(log)} samples, {span}; rig: {rig.name}")
    if rig.left_out is not None:
        say(f"  {rig.left_out.in_words()}")
    if rig.taken:
        say(f"  the scale of {' and '.join(rig.taken)} is assumed (distal rig check says more)")
    if log.stamps is not None:
        begins = np.datetime64(int(log.stamps[0]), "ns").astype("datetime64[ms]")
        say(
            f"  begins at {begins} UTC; t counts from there, the column 'stamp' is the original "
            "[ns]"
        )
    from distal.rig import log_unit

    for sensor in rig.sensors:
        if sensor.name in log.channels:
            missing = int(np.isnan(log.channels[sensor.name]).sum())
            unit = sensor.unit or f"{log_unit(sensor)}, or as its header says"
            say(
                f"  {sensor.name}: {sensor.measures} of {sensor.of}, column "
                f"'{sensor.log_column}' in {unit}" + (f", {missing} missing" if missing else "")
            )
    gaps = log.gaps()
    if gaps:
        begin, end = max(gaps, key=lambda gap: gap[1] - gap[0])
        say(
            f"  {len(gaps)} gap{'s' if len(gaps) > 1 else ''}, the longest {end - begin:.3g} s at "
            f"{begin:g} s"
        )
    if changed:
        say(f"  as the log's scenario has it: {', '.join(changed)}")


@contextmanager
def _few_warnings() -> Iterator[None]:
    """Print the first warnings and the number of the others, since many logs may have the same."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", DistalWarning)
        yield
    messages = list(dict.fromkeys(str(warning.message) for warning in caught))
    for message in messages[:FEW]:
        warn(message)
    if len(messages) > FEW:
        warn(
            f"and {len(messages) - FEW} more of the other logs (estimate one log alone to see its "
            "warnings)"
        )


def _estimate_many(
    logs: Sequence[Path | Episode],
    rig: Rig,
    estimator: str,
    truth: str | None,
    homing: float | None,
    out: Path | None,
    unit: str,
    every: bool,
) -> None:
    """Estimate over many logs, write each estimate to a folder, and print a line for each.

    A log that cannot be estimated is reported and skipped, and the command then ends with exit code
    2.

    Args:
        estimator: name of the estimator.
        truth: the true angle: a column of the logs, or a file; or None.
        homing: time for which the truth is used [s], or None.
        out: the folder; with None nothing is written.
        unit: of the angles that are written, "rad" or "deg".
        every: whether all states are written.

    Raises:
        EstimationError: the estimator is unknown.
    """
    from distal.diagnosis import diagnose_estimate
    from distal.logs import write_columns
    from distal.results import make_folder
    from distal.run import estimate_batch

    _check_names([estimator], rig)
    if out is not None:
        make_folder(out)
    failed = dict[str, DistalError]()
    rows = list[tuple[str, ...]]()
    waiting = iter(logs)
    with _few_warnings(), progress_bar("estimating", len(logs)) as advance:
        for result in estimate_batch(
            logs, rig, estimator, truth, homing, progress=advance, skip=failed.__setitem__
        ):
            # results come in the order of the logs
            path = next(each for each in waiting if str(each) not in failed)
            if out is not None:
                try:
                    write_columns(result.columns(unit, every=every), out / f"{path.stem}.csv")
                except OutputError as problem:
                    failed[str(path)] = problem
                    continue
            # the RMS error and the share inside the band
            known = ("–", "–") if result.truths is None else _row(result)[1:4:2]
            headline = diagnose_estimate(result).headline
            rows.append((path.name, f"{len(result)}", half_in_words(result, 2), *known, headline))
    if rows:
        columns = ["log", "samples", "median band [°]", "RMS [°]", "inside the band", "innovations"]
        table(f"{estimator} over {len(rows)} logs", columns, rows)
        if out is not None:
            say(f"wrote {len(rows)} estimates to {out}")
    for reason in failed.values():
        failure(str(reason))
    if failed:
        raise typer.Exit(2)


def estimates_of(logs: Sequence[Path | Episode], out: Path | None) -> list[Path | None]:
    """Return the file of each log's estimate.

    Raises:
        OutputError: a log came twice, two logs have the same name, or `out` is a file.
    """
    files = {
        (os.path.realpath(log if isinstance(log, Path) else log.path), log.stem) for log in logs
    }
    if len(files) < len(logs):
        raise OutputError("a log came more than once; give each once")
    if out is None:
        return []
    check_folder(out, "of several logs")
    stem, most = Counter(log.stem for log in logs).most_common(1)[0]
    if most > 1:
        raise OutputError(
            f"{stem}: another log has the name '{stem}' too; rename one, or estimate them apart"
        )
    return [out / f"{log.stem}.csv" for log in logs]


LONGEST_LINE = csv.field_size_limit()
"""Longest line that is read [bytes], so that a stream without line ends cannot fill the memory.
Source: definition (longest field of Python's csv module).
"""


def stream_command(
    rig: RigOption,
    estimator: EstimatorOption = None,
    *,
    as_json: Annotated[
        bool, Option("--json", help="Write JSON lines; default: as the input is.")
    ] = False,
    unit: UnitOption = None,
    set_: SetOption,
) -> None:
    """Read samples as CSV or JSON lines from stdin, write an estimate for each, with a word on its
    health.

    Columns and units are those that the rig's sensors name. CSV begins with a header. Each line is
    answered at once: t, theta and theta_std in the unit of the log's angles, where the rig's joint
    may be touched external_torque and external_torque_std in N m and contact, how probable it is
    that something touches it, health, detail.
    """
    from distal.logs import MessageReader
    from distal.rig import angle_unit, load_rig
    from distal.run import LiveEstimator, Monitor

    if sys.stdin is None or sys.stdout is None:
        raise OutputError("standard input or output is closed")
    described = load_rig(rig, set_)
    with working("preparing the filter"):
        live = LiveEstimator(described, estimator)
    monitor = Monitor(live)
    reader = MessageReader(described, live.channels)
    session = Session(monitor, reader, unit or angle_unit(described.sensors), as_json)
    try:
        for line in _lines():
            session.take(line)
    finally:
        session.end()
    if session.csv is None and session.no_header is not None:
        raise session.no_header


class Session:
    """One stream, from its first line to its last."""

    def __init__(
        self,
        monitor: Monitor,
        reader: MessageReader,
        unit: str = "rad",
        as_json: bool = False,
    ) -> None:
        from distal.rig import angle_names, std_name

        self._monitor = monitor
        self._reader = reader
        self._json = as_json
        units = dict.fromkeys(angle_names(monitor.rig.joint_names), unit)
        units |= dict.fromkeys(monitor.torque_names, "N m")
        self._units = {"t": "s"} | {
            column: unit for name, unit in units.items() for column in (name, std_name(name))
        }
        self._units |= dict.fromkeys(monitor.contact_names, "1")
        self.csv: bool | None = None  # not known before the first line
        self.no_header: LogError | None = None
        self._counts: Counter[str] = Counter()
        self._started = monotonic()

    def take(self, line: bytes) -> None:
        """Read a line and write the answer to it.

        Where the header of a CSV stream is read, the answer is the header of the output.
        """
        from distal.run import Reading

        # a tab at the end of a line may be an empty last cell
        text = line.decode("utf-8", "replace").strip("\r\n ").removeprefix("\ufeff").strip("\r\n ")
        if not text.strip() or (self.csv is None and text.startswith("#")):
            return
        if self.csv is None:
            # a logger that is joined midway may begin with half an object
            self.csv = not text.startswith(("{", "[")) and not text.endswith("}")
            if self.csv:
                self._begin(text)
                return
        try:
            if len(line) >= LONGEST_LINE:
                raise LogError("the line is too long")
            time, sample = self._reader.csv(text) if self.csv else self._reader.json(text)
            reading = self._monitor.take(time, sample, self._reader.remarks)
        except LogError as problem:
            reading = Reading(nan, (), (), "bad", str(problem))
        self._answer(reading)

    def _begin(self, text: str) -> None:
        """Read the header of a CSV stream, and write that of the answers."""
        from distal.logs import header

        try:
            self._reader.header(text)
        except LogError as problem:
            # a logger may say something else before its header
            if self.no_header is None:
                warn(f"{problem}; waiting for a header")
                self.no_header = problem
            self.csv = None
            return
        if self._reader.absent:
            warn(f"the stream has no column {', '.join(self._reader.absent)}")
        if not self._json:
            self._write_row([*starmap(header, self._units.items()), "health", "detail"])

    def _answer(self, reading: Reading) -> None:
        self._counts[reading.health] += 1
        values = chain(
            (reading.time,),
            *zip(reading.angles, reading.angle_stds),
            *zip(reading.torques, reading.torque_stds),
            (contact.probability for contact in reading.contacts),
        )
        message: dict[str, object] = dict.fromkeys(self._units)
        for (name, unit), value in zip(self._units.items(), values):
            if isfinite(value):
                message[name] = degrees(value) if unit == "deg" else float(value)
        message |= {"health": reading.health, "detail": printable(reading.detail)}
        if self._json or not self.csv:
            print(json.dumps(message), flush=True)
        else:
            self._write_row(message.values())

    def _write_row(self, cells: Iterable[object]) -> None:
        csv.writer(sys.stdout, lineterminator="\n").writerow(cells)
        sys.stdout.flush()

    def end(self) -> None:
        """Print on stderr how many samples came in which time, with their health words."""
        total = sum(self._counts.values())
        seconds = max(monotonic() - self._started, 1e-9)
        words = ", ".join(f"{count} {word}" for word, count in self._counts.most_common())
        print(f"{total} samples in {seconds:.1f} s{': ' + words if words else ''}", file=sys.stderr)


def _lines() -> Iterator[bytes]:
    """Yield the lines of stdin as they arrive; a line that is too long is cut, so that it is
    refused.
    """
    source = sys.stdin.buffer
    while line := source.readline(LONGEST_LINE):
        yield line
        while len(line) >= LONGEST_LINE and not line.endswith(b"\n"):
            line = source.readline(LONGEST_LINE)
