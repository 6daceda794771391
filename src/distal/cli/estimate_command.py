"""`distal estimate`: the joint angle over a log."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from distal.cli.console import continue_on_failure, failure, say, table, working
from distal.cli.paths import check_command_outputs, check_ending, to_file
from distal.cli.shared_options import (
    PlotOption,
    RepeatedOption,
    RigOption,
    SetOption,
    TruthOption,
    UnitOption,
    estimators,
    homing_time,
    joint_angle,
    settings,
)
from distal.errors import DistalError, DivergedError, EstimationError

if TYPE_CHECKING:
    from distal.logs import Log
    from distal.results import Estimate
    from distal.rig import Rig


MOST_FULL = 6
"""Number of joints up to which the filters on the full state are compared unasked; with more, a
compiler takes minutes. Source: judgement.
"""


def estimate_command(
    logs: Annotated[
        list[Path],
        Argument(
            metavar="LOG...",
            help="CSV, Parquet, HDF5, MCAP, a ROS bag or a LeRobot dataset, with the columns that "
            "the rig's sensors name.",
        ),
    ],
    rig: RigOption,
    *,
    out: Annotated[
        Path | None,
        Option(
            help="Where to write the first estimator's estimate (CSV or Parquet); of several "
            "logs, a folder."
        ),
    ] = None,
    estimator: Annotated[
        list[str] | None,
        Option(
            "--estimator",
            "-e",
            help=(
                "adaptive, ekf, ekf-2008, elastic, inextensible or regression; repeatable, the "
                "first is "
                "written. Default: adaptive; where the angle is known, all of them, to compare."
            ),
            autocompletion=estimators,
        ),
    ] = None,
    truth: TruthOption = None,
    plot: PlotOption = None,
    panel: Annotated[
        list[str] | None,
        Option(help="What else --plot draws: innovations, forces, health, or all. Repeatable."),
    ] = None,
    smooth: Annotated[
        bool,
        Option(
            "--smooth", help="Write the adaptive estimate smoothed over the whole log (offline)."
        ),
    ] = False,
    homing: Annotated[
        str | None,
        Option(help="Use the reference for this long (e.g. 3s), then only compare with it."),
    ] = None,
    homing_angle: Annotated[
        list[str] | None,
        Option(
            help="Without a reference: the joint stands here while homing, e.g. '0 deg ± 1 deg', "
            "or 'pip: 0 deg'."
        ),
    ] = None,
    what_if: Annotated[
        bool, Option(help="Rerun with one change at a time: what explains it, what is untested.")
    ] = True,
    findings: Annotated[
        bool,
        Option(
            "--findings", help="List each finding on the log and the rig, on a line of its own."
        ),
    ] = False,
    unit: UnitOption = "rad",
    every: Annotated[
        bool, Option("--all", help="Write all states to --out, not only time, angles and torques.")
    ] = False,
    level: Annotated[
        float, Option(help="Share of the errors that bands hold, as they are printed and drawn.")
    ] = 0.95,
    repeated: RepeatedOption = None,
    scheduler: Annotated[
        str | None,
        Option(
            help="Address of a Dask scheduler, tcp://host:8786: its workers estimate, from the "
            "same files."
        ),
    ] = None,
    set_: SetOption = None,
) -> None:
    """Estimate the joint angle over a log, or many; where the truth of one is known, compare all
    estimators with it.
    """
    from distal.confidence import half_width
    from distal.estimators import DEFAULT, AdaptiveFilter
    from distal.logs import episodes_of, file_of, is_dataset, read_log, true_angles, write_together
    from distal.results import PANELS, check_panels, plot_kind
    from distal.rig import load_rig
    from distal.run import smooth as smoothed

    if out is None and (unit != "rad" or every):
        raise EstimationError(
            f"{'--all' if every else '--unit'} is about the file of --out, which is not given"
        )
    half_width(level)  # raises where it is no level
    home = homing_time(homing)
    if smooth and home is not None:
        raise EstimationError(
            "--smooth uses the whole log and --homing its beginning; give one of them"
        )
    if smooth and set(estimator or ()) - {"adaptive"}:
        raise EstimationError(
            f"--smooth is of adaptive; leave out -e {', '.join(estimator or ())}, or --smooth"
        )
    if len(logs) > 1 or is_dataset(logs[0]) or scheduler is not None:
        sources = [
            source
            for path in logs
            for source in (episodes_of(path) if is_dataset(path) else [path])
        ]
        _check_for_many(
            len(sources),
            {
                "--homing-angle": bool(homing_angle),
                "--plot": plot is not None,
                "--panel": bool(panel),
                "--smooth": smooth,
                "--findings": findings,
                "a second --estimator": len(estimator or ()) > 1,
            },
        )
        from distal.cli.many_logs_command import estimate_many, estimates_of

        check_command_outputs(estimates_of(sources, out), logs=logs, rig=rig, truth=truth)
        description = load_rig(rig, settings(set_, repeated))
        name = (estimator or [DEFAULT])[0]
        estimate_many(
            sources,
            description,
            name,
            truth,
            home,
            out,
            unit=unit,
            every=every,
            level=level,
            scheduler=scheduler,
        )
        return
    panels = check_panels(PANELS if "all" in (panel or ()) else tuple(dict.fromkeys(panel or ())))
    if plot is not None:
        plot_kind(plot)
    elif panels:
        raise EstimationError("--panel says what --plot draws; give --plot too")
    check_command_outputs(
        [*to_file("--out", out), *to_file("--plot", plot)], logs=logs, rig=rig, truth=truth
    )
    check_ending(out, "a table")
    description = load_rig(rig, settings(set_, repeated))
    with working(f"reading {logs[0]}"):
        log = read_log(logs[0], description, truth)
    _describe(log, description)
    is_known = true_angles(log, description.joint_names) is not None
    names = _names(estimator, description, is_known)
    origin = log.truth_source
    if homing_angle:
        log, description = _at_home(log, description, homing_angle, home)
    if what_if and home is None and DEFAULT in names:
        # the diagnosis's kernel is compiled while the estimate runs; errors come from the estimate
        with suppress(DistalError):
            AdaptiveFilter(description, "lanes").kernel.begin_lanes()
    comparison = _Comparison(level, comparing=estimator is None)
    _estimates(log, description, names, home, comparison)
    if smooth:
        with working("smoothing"):
            comparison.add(smoothed(log, description), 0)
    results = comparison.results
    files: dict[Path, bytes | str] = {}
    if out is not None:
        files[out] = file_of(results[0].columns(unit, every=every), out)
    if plot is not None:
        with working("drawing"):
            files[plot] = _picture(
                log, description, results if estimator else results[:1], panels, plot
            )
    write_together(files)
    if comparison.rows:
        read = "not read" if homing_angle else "used"
        used = (
            f"; {read} for the first {home:g} s, compared with afterwards"
            if home is not None
            else ""
        )
        say(f"truth: {origin}{used}")
        _compare(comparison)
    else:
        for reason in comparison.failed.values():
            failure(reason)
    _say(
        comparison,
        log,
        description,
        home,
        what_if=what_if,
        findings=findings,
        written=(out, plot),
    )


def _check_for_many(count: int, asked: Mapping[str, bool]) -> None:
    """Raise where an option that is for one log is given with several."""
    wrong = [option for option, is_asked in asked.items() if is_asked]
    if wrong:
        raise EstimationError(f"{', '.join(wrong)} is for one log, {count} came; give one log")


def _names(asked: list[str] | None, rig: Rig, is_known: bool) -> list[str]:
    """Return the names of the estimators to run: those asked for, else the default, and all others
    where the truth is known.
    """
    from distal.estimators import DEFAULT, ESTIMATORS, make_estimator

    for name in asked or ():
        if name not in ESTIMATORS:
            make_estimator(name, rig)  # raises an error that lists the names
    names = list(dict.fromkeys(asked or ([DEFAULT, *ESTIMATORS] if is_known else [DEFAULT])))
    left = [name for name in names if name.startswith("ekf")]
    if asked or len(rig.joints) <= MOST_FULL or not left:
        return names
    # these filters treat all joints together; adaptive treats each finger by itself
    say(
        f"{' and '.join(left)} left out: a compiler takes minutes over {len(rig.joints)} joints; "
        "ask with -e"
    )
    return [name for name in names if name not in left]


def _at_home(log: Log, rig: Rig, positions: list[str], home: float | None) -> tuple[Log, Rig]:
    """Return the log and the rig with the joints' known angles while homing."""
    from distal.homing import at_known_angle

    if home is None:
        raise EstimationError(
            "--homing-angle says where the joint stands while homing; give --homing too, e.g. 0.5s"
        )
    for position in positions:
        joint, (angle, std) = joint_angle(position)
        log, rig = at_known_angle(log, rig, home, angle, std, joint)
        say(
            f"home: {joint or 'the joint'} stands at {degrees(angle):g}° ± {degrees(std):g}° for "
            f"the first {home:g} s"
        )
    return log, rig


@dataclass
class _Comparison:
    """What estimators found.

    In a comparison that was not asked for, only the first estimate stays in memory.

    Args:
        level: of the bands.
        comparing: whether estimators are compared that nobody asked for.
    """

    level: float
    comparing: bool
    results: list[Estimate] = field(default_factory=list)
    rows: list[tuple[str, ...]] = field(default_factory=list)
    notes: dict[str, None] = field(default_factory=dict)
    failed: dict[str, str] = field(default_factory=dict)

    def add(self, result: Estimate, at: int) -> None:
        """Take in an estimate, whose row stands `at` a position in the table."""
        result = replace(result, level=self.level)
        self.notes |= dict.fromkeys(result.notes)
        if result.truths is not None:
            self.rows.insert(at, _row(result))
        if at == 0 or not self.comparing:
            self.results.insert(at, result)


def _estimates(
    log: Log, rig: Rig, names: list[str], home: float | None, comparison: _Comparison
) -> None:
    """Put what the estimators find, and the reasons why some fail, into `comparison`.

    Where the first estimator fails, the others are still shown before its error is raised.
    """
    from distal.estimators.regression_estimator import NEEDS
    from distal.run import estimate

    # in a comparison by default, an estimator that cannot run is a row with what it needs
    has_map = rig.map is not None and rig.map.readings
    if comparison.comparing and not has_map and home is None and "regression" in names:
        comparison.failed["regression"] = f"regression {NEEDS}"
    lost: DistalError | None = None
    with working("estimating") as show:
        for name in (name for name in names if name not in comparison.failed):
            show(f"estimating with {name}")
            try:
                result = estimate(log, rig, name, homing=home, covariances=False)
                comparison.add(result, len(comparison.rows or comparison.results))
            except DistalError as problem:
                comparison.failed[name] = (
                    f"{name}: {str(problem).removeprefix(f'{name}: ')}"  # some errors have it
                )
                lost = lost or (problem if name == names[0] else None)
    if lost is not None:
        if comparison.rows:
            _compare(comparison)
        raise _explained(lost, log, rig, home) if isinstance(lost, DivergedError) else lost


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


def _picture(
    log: Log, rig: Rig, drawn: list[Estimate], panels: tuple[str, ...], path: Path
) -> bytes:
    """Return the figure of estimates as a file, in the format of the path's ending."""
    from distal.results import figure_bytes, plot_estimates
    from distal.run import log_health

    health = log_health(log, rig) if "health" in panels else None
    return figure_bytes(plot_estimates(drawn, panels=panels, log=log, rig=rig, health=health), path)


def _say(
    comparison: _Comparison,
    log: Log,
    rig: Rig,
    home: float | None,
    *,
    what_if: bool,
    findings: bool,
    written: tuple[Path | None, ...],
) -> None:
    """Print the angle in words, notes, the diagnosis, and which files were written."""
    from distal.diagnosis import diagnose

    final = comparison.results[0]
    for joint in range(len(final.joint_names)):
        say(final.in_words(joint))
    for note in comparison.notes:
        if note != final.unseen:
            say(note)
    # a smoothed estimate is of the same log and rig, and its innovations are the filter's
    doing = "testing what the log says of the rig"
    with continue_on_failure(doing):
        with working(doing):
            diagnosis = diagnose(final, log, rig, home, what_if=what_if)
        say(diagnosis.text)
        for finding in diagnosis.findings if findings else ():
            say(f"  {finding.text}")
    for path in filter(None, written):
        say(f"wrote {path}")
    if final.unseen is not None:
        say(final.unseen)


def _describe(log: Log, rig: Rig) -> None:
    """Print what was read: samples, time, rate, missing readings and gaps."""
    import numpy as np

    from distal.rig import scales_in_words

    span = f"{log.time[0]:g} to {log.time[-1]:g} s, {log.rate:.4g} Hz"
    say(f"read {log.source}: {len(log)} samples, {span}; rig: {rig.name}")
    if rig.free_motion is not None:
        say(f"  {rig.free_motion.in_words()}")
    if rig.taken:
        say(f"  {scales_in_words(rig)}")
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
            column = (
                f"  {sensor.name}: {sensor.measures} of {sensor.of}, column "
                f"'{sensor.log_column}' in {unit}"
            )
            say(column + (f", {missing} missing" if missing else ""))
    gaps = log.gaps()
    if gaps:
        begin, end = max(gaps, key=lambda gap: gap[1] - gap[0])
        say(
            f"  {len(gaps)} gap{'s' if len(gaps) > 1 else ''}, the longest {end - begin:.3g} s at "
            f"{begin:g} s"
        )


def _row(result: Estimate) -> tuple[str, ...]:
    """Return the cells of an estimate in the table of errors."""
    import numpy as np

    return (
        result.estimator,
        f"{degrees(result.rms_error()):.3f}",
        f"{degrees(result.max_error()):.3f}",
        f"{100 * result.inside_band():.0f} %",
        f"±{degrees(result.stds_of_band * np.median(result.angle_stds)):.3f}",
    )


def _compare(comparison: _Comparison) -> None:
    """Print the errors of each estimator as a table, and the reasons of those that failed."""
    from distal.confidence import in_percent

    level = in_percent(comparison.level)
    table(
        "error against truth",
        ["estimator", "RMS [°]", "maximum [°]", f"inside {level} band", "median band [°]"],
        [*comparison.rows, *((name, "–", "–", "–", "–") for name in comparison.failed)],
    )
    for reason in comparison.failed.values():
        say(reason)
