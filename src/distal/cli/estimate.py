"""`distal estimate`: the joint angle over a log."""

from __future__ import annotations

from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from distal.cli.console import failure, say, table
from distal.cli.options import (
    MemoryOption,
    PlotOption,
    RepeatedOption,
    RigOption,
    SetOption,
    TruthOption,
    estimators,
    joint_angle,
    seconds,
    settings,
)
from distal.cli.outputs import check_outputs, to_file
from distal.errors import DistalError, EstimationError

if TYPE_CHECKING:
    from distal.logs import Log
    from distal.results import Estimate
    from distal.rig import Rig


MOST_FULL = 6
"""With more joints the filters on the full state are compared only where they are asked for."""


def estimate_command(
    logs: Annotated[
        list[Path],
        typer.Argument(
            metavar="LOG...", help=("CSV, Parquet, MCAP or a ROS bag, with the columns that the rig's sensors name.")
        ),
    ],
    rig: RigOption,
    *,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", help=("Where to write the first estimator's estimate (CSV or Parquet); of several logs, a folder.")
        ),
    ] = None,
    estimator: Annotated[
        list[str] | None,
        typer.Option(
            "--estimator",
            "-e",
            help=(
                "adaptive, affine, ekf, ekf-2008, elastic or inextensible; repeatable, the first is "
                "written. Default: adaptive; where the angle is known, all of them, to compare."
            ),
            autocompletion=estimators,
        ),
    ] = None,
    truth: TruthOption = None,
    plot: PlotOption = None,
    panel: Annotated[
        list[str] | None,
        typer.Option("--panel", help=("What else --plot draws: innovations, forces, health, or all. Repeatable.")),
    ] = None,
    passes: Annotated[
        int,
        typer.Option(
            "--passes",
            min=1,
            help=(
                "ekf and ekf-2008: filter this many times; each pass begins with the covariance at the end of the last."
            ),
        ),
    ] = 1,
    smooth: Annotated[
        bool, typer.Option("--smooth", help="Write the adaptive estimate smoothed over the whole log (offline).")
    ] = False,
    homing: Annotated[
        str | None,
        typer.Option("--homing", help="Use the reference for this long (e.g. 3s), then only compare with it."),
    ] = None,
    homing_angle: Annotated[
        list[str] | None,
        typer.Option(
            "--homing-angle",
            help="Without a reference: the joint stands here while homing, e.g. '0 deg ± 1 deg', or 'pip: 0 deg'.",
        ),
    ] = None,
    what_if: Annotated[
        bool,
        typer.Option(
            "--what-if/--no-what-if", help="Rerun with one change at a time: what explains it, what is untested."
        ),
    ] = True,
    unit: Annotated[str, typer.Option("--unit", help="Of the angles in --out: rad or deg.")] = "rad",
    every: Annotated[
        bool, typer.Option("--all", help="Write all states to --out, not only time, angles and torques.")
    ] = False,
    repeated: RepeatedOption = None,
    max_memory: MemoryOption = None,
    set_: SetOption = None,
) -> None:
    """Estimate the joint angle over a log, or many; where the truth of one is known, compare all estimators with it."""
    from distal.diagnosis import diagnose
    from distal.estimators import DEFAULT, ESTIMATORS, make_estimator
    from distal.estimators.affine import NEEDS
    from distal.homing import at_known_angle
    from distal.logs import file_of, read_log, true_angles, write_together
    from distal.results import ANGLE_UNITS, PANELS, check_panels, figure_bytes, plot_estimates, plot_kind
    from distal.rig import load_rig
    from distal.run import estimate, log_health
    from distal.run import smooth as smoothed

    if out is None and (unit != "rad" or every):
        raise EstimationError(f"{'--all' if every else '--unit'} is about the file of --out, which is not given")
    if unit not in ANGLE_UNITS:
        raise EstimationError(f"--unit {unit}: angles are written in {' or '.join(ANGLE_UNITS)}")
    if len(logs) > 1:
        asked = {
            "--homing-angle": bool(homing_angle),
            "--plot": plot is not None,
            "--smooth": smooth,
            "--passes": passes > 1,
        }
        asked["a second --estimator"] = len(estimator or ()) > 1
        wrong = [name for name, there in asked.items() if there]
        if wrong:
            raise EstimationError(f"{', '.join(wrong)} is for one log, {len(logs)} came; give one log")
        from distal.cli.batch import estimate_many, estimates_of

        check_outputs(estimates_of(logs, out), logs=logs, rig=rig, truth=truth)
        home = seconds(homing) if homing is not None else None
        described, name = load_rig(rig, settings(set_, repeated)), (estimator or [DEFAULT])[0]
        estimate_many(logs, described, name, truth, home, out, unit=unit, every=every)
        return
    log = logs[0]
    panels = check_panels(PANELS if "all" in (panel or ()) else tuple(dict.fromkeys(panel or ())))
    if plot is not None:
        plot_kind(plot)
    elif panels:
        raise EstimationError("--panel says what --plot draws; give --plot too")
    check_outputs([*to_file("--out", out), *to_file("--plot", plot)], logs=logs, rig=rig, truth=truth)
    description = load_rig(rig, settings(set_, repeated))
    data = read_log(log, description, truth)
    _describe(data, description)
    origin = data.truth_source
    known = true_angles(data, [joint.name for joint in description.joints]) is not None
    for name in estimator or ():
        if name not in ESTIMATORS:
            make_estimator(name, description)  # says what is allowed
    names = list(dict.fromkeys(estimator or ([DEFAULT, *ESTIMATORS] if known else [DEFAULT])))
    if not estimator and len(description.joints) > MOST_FULL:
        # their joints are filtered together, where those of adaptive are finger by finger
        left = [name for name in names if name.startswith("ekf")]
        names = [name for name in names if name not in left]
        if left:
            joints = len(description.joints)
            say(f"{' and '.join(left)} left out: a compiler takes minutes over {joints} joints; ask with -e")
    home = seconds(homing) if homing is not None else None
    for known_place in homing_angle or ():
        if home is None:
            raise EstimationError(
                "--homing-angle says where the joint stands while homing; give --homing too, e.g. 0.5s"
            )
        which, place = joint_angle(known_place)
        data, description = at_known_angle(data, description, home, *place, which)
        about, off = map(degrees, place)
        say(f"home: {which or 'the joint'} stands at {about:g}° ± {off:g}° for the first {home:g} s")
    # in a comparison that nobody chose, what cannot run is a row that says what it needs
    missing = estimator is None and description.affine is None and home is None
    lost: DistalError | None = None
    results, failed = [], {"affine": f"affine {NEEDS}"} if missing and "affine" in names else {}
    for name in names:
        if name in failed:
            continue
        try:
            results.append(estimate(data, description, name, passes, homing=home))
        except DistalError as problem:
            failed[name] = f"{name}: {str(problem).removeprefix(f'{name}: ')}"  # most name themselves
            lost = lost or (problem if name == names[0] else None)
    if lost is not None:  # what is to be written; the others are shown all the same
        if known and results:
            _compare(results, failed)
        raise lost
    if smooth:
        if home is not None:
            raise EstimationError("--smooth uses the whole log and --homing its beginning; give one of them")
        results.insert(0, smoothed(data, description))
    made: dict[Path, bytes | str] = {}
    if out is not None:
        made[out] = file_of(results[0].columns(unit, every=every), out)
    if plot is not None:
        drawn = results if estimator else results[:1]
        health = log_health(data, description) if "health" in panels else None
        figure = plot_estimates(drawn, panels=panels, log=data, rig=description, health=health)
        made[plot] = figure_bytes(figure, plot)
    write_together(made)
    if known:
        read = "not read" if homing_angle else "used"
        used = f"; {read} for the first {home:g} s, compared with afterwards" if home is not None else ""
        say(f"truth: {origin}{used}")
        _compare(results, failed)
    else:
        for why in failed.values():
            failure(why)
    final = results[0]
    for joint in range(len(final.joint_names)):
        say(final.in_words(joint))
    notes = list(dict.fromkeys(note for result in results for note in result.notes))
    for note in notes:
        if note != final.unseen:
            say(note)
    # a smoothed estimate is of the same log and rig, and its innovations are the filter's
    say(diagnose(final, data, description, home, what_if=what_if).text)
    for path in (out, plot):
        if path is not None:
            say(f"wrote {path}")
    if final.unseen is not None:
        say(final.unseen)


def _describe(log: Log, rig: Rig) -> None:
    """Print what was read: samples, time, rate, missing values, gaps."""
    import numpy as np

    say(
        f"read {log.source}: {len(log)} samples, {log.time[0]:g} to {log.time[-1]:g} s, {log.rate:.4g} Hz; "
        f"rig: {rig.name}"
    )
    if log.stamps is not None:
        begins = np.datetime64(int(log.stamps[0]), "ns").astype("datetime64[ms]")
        say(f"  begins at {begins} UTC; t counts from there, the column 'stamp' is the original [ns]")
    from distal.rig import log_unit

    for sensor in rig.sensors:
        if sensor.name in log.channels:
            missing = int(np.isnan(log.channels[sensor.name]).sum())
            unit = sensor.unit or f"{log_unit(sensor)}, or as its header says"
            column = f"  {sensor.name}: {sensor.measures} of {sensor.of}, column '{sensor.log_column}' in {unit}"
            say(column + (f", {missing} missing" if missing else ""))
    gaps = log.gaps()
    if gaps:
        longest = max(gaps, key=lambda gap: gap[1] - gap[0])
        say(
            f"  {len(gaps)} gap{'s' if len(gaps) > 1 else ''}, the longest {longest[1] - longest[0]:.3g} s "
            f"at {longest[0]:g} s"
        )


def _compare(results: list[Estimate], failed: dict[str, str]) -> None:
    """Print a row for each estimator, and of those that could not run why."""
    import numpy as np

    from distal.results import BAND

    rows = [
        (
            result.estimator,
            f"{degrees(result.rms_error()):.3f}",
            f"{degrees(result.max_error()):.3f}",
            f"{100 * result.inside_band():.0f} %",
            f"±{degrees(BAND * np.median(result.angle_stds)):.3f}",
        )
        for result in results
    ]
    rows += [(name, "–", "–", "–", "–") for name in failed]
    table("error against truth", ["estimator", "RMS [°]", "maximum [°]", "inside 95 % band", "median band [°]"], rows)
    for why in failed.values():
        say(why)
