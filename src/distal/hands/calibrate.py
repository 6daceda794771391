"""`calibrate`: the parameters of a hand from its power-on routine alone; the reference angles are
the ends of the joints' ranges.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from math import nan
from pathlib import Path

import numpy as np

from distal.errors import DistalWarning, FitError, LogError
from distal.fitting.fitted_file import MARK, write_fitted
from distal.hands.file_doubts import doubts_of
from distal.hands.finger_fit import part_values
from distal.hands.sweeps import Sweep, sweeps_of
from distal.hands.tendon_faults import Fault, check_units, faults_of, slack_of
from distal.logs import Log, Source, read_log
from distal.regression import servos_of
from distal.rig import Rig, as_rig, check_scales, independent_parts
from distal.rig.hand_tables.rig_of_table import ASSUMED


@dataclass(frozen=True)
class Calibrated:
    """A hand after its power-on routine.

    Args:
        rig: the calibrated rig.
        start: the rig before.
        values: path by names → value, for all that was found.
        faults: of the tendons and motors.
        notes: what was not found, and why.
    """

    rig: Rig
    start: Rig
    values: Mapping[str, object]
    faults: tuple[Fault, ...]
    notes: tuple[str, ...]

    def save(
        self, path: str | Path, source: str = "of the hand itself", text: str | None = None
    ) -> None:
        """Write the rig file.

        Args:
            path: of the file.
            source: what the rig was calibrated by; the head of the file names it.
            text: the rig file as it was, whose comments are kept; None has none.

        Raises:
            OutputError: the file cannot be written; what stood there is unchanged.
        """
        head = f"{MARK}calibrate` to the power-on routine {source}\n\n"
        write_fitted(path, self.rig, self.start, self.values, head, text)


def calibrate(
    log: Log | Source,
    rig: Rig | str | Path,
    stopped: Mapping[str, str] | None = None,
    accept: bool = False,
) -> Calibrated:
    """Return a hand with its zeros, spools, slack or pre-tension, friction and stiffness as its
    power-on routine shows them.

    In the log each motor goes slowly to both ends of its travel and back, at least three times,
    with its angle and its torque. The ends of the joints' ranges are the reference; the rig says
    how well they are known (`stops_std`). Independent subsystems are calibrated separately, side by
    side. Gaps in the readings are filled by interpolation.

    Where the ends of a motor's travel contradict the rig, the faults say what is likely wrong in
    it. Only with `accept` is that corrected, and the notes say what was. Otherwise the motor keeps
    the rig's numbers, and its zero is written as unknown, so that it gets no goals. A zero that has
    moved is taken as it is found, and said.

    Args:
        log: of the power-on routine, or its file.
        rig: of the hand, or its name or path.
        stopped: motor whose routine ended too early → why; these motors are not calibrated.
        accept: whether what is likely wrong in the rig is corrected.

    Raises:
        LogError: the log cannot be read, or no motor sweeps in it.
        CommandError: the rig's scale of force was taken.
        FitError: the rig has sliders, a unit in the log is wrong, or no rig with these motors moves
            as the log does.
    """
    rig = as_rig(rig).bare()
    sliders = [drive.name for drive in rig.drives if drive.kind != "capstan"]
    if sliders:
        raise FitError(
            f"'{rig.name}': {', '.join(sliders)} are sliders; a power-on routine is for motors "
            "that wind tendons"
        )
    check_scales(rig, "a calibration by the motors' torques", "torque")
    log = _bridged(log if isinstance(log, Log) else read_log(log, rig, ranged=False))
    sweeps, stopped = _sweeps(log, rig, {} if stopped is None else stopped)
    check_units(rig, sweeps, log.source)
    faults = (
        *(
            Fault("stopped", name, f"{name}: its routine ended before its end: {why}")
            for name, why in stopped.items()
        ),
        *(
            fault
            for drive in rig.drives
            if drive.name not in stopped
            for fault in faults_of(rig, drive.name, sweeps[drive.name])
        ),
    )
    moved = {fault.drive for fault in faults if fault.kind in ("slipped", "stopped")}
    doubts = doubts_of(rig, {name: of for name, of in sweeps.items() if name not in moved})
    if accept and any(doubt.values for doubt in doubts):
        return _accepted(log, rig, stopped, doubts)
    wrong = {doubt.drive: doubt for doubt in doubts if doubt.kind == "file"}
    faulty = {fault.drive for fault in (*faults, *wrong.values())}
    values = dict[str, object]()
    parts = [part for part in independent_parts(rig) if part.rig.drives]
    sound = [part for part in parts if not faulty.intersection(part.rig.drive_names)]
    notes = tuple(
        f"not calibrated, as it has a fault: {', '.join(part.rig.joint_names)}"
        for part in parts
        if part not in sound
    )
    # filters of warnings hold for the whole process, so they are set once around all threads
    with warnings.catch_warnings(), ThreadPoolExecutor() as pool:
        warnings.simplefilter("ignore", DistalWarning)
        for found in pool.map(lambda part: part_values(log, part, sweeps), sound):
            values |= found
    values |= {
        path: value
        for path, value in servos_of([log], rig).items()
        if path.split(".")[1] not in faulty
    }
    for sensor in rig.sensors_of("position"):
        if sensor.of in wrong:  # no goal goes to a motor whose zero is not known
            unknown = {"value": sensor.bias.value, "std": ASSUMED.unknown_zero_std}
            values[f"sensors.{sensor.name}.bias"] = unknown
    found_rig = rig.with_values(values)
    slackened = {doubt.drive for doubt in doubts if doubt.kind == "slack"}
    sound_sweeps = {
        name: sweeps[name]
        for part in sound
        for name in part.rig.drive_names
        if name not in slackened
    }
    slack = slack_of(found_rig, rig, sound_sweeps)
    return Calibrated(found_rig, rig, values, (*doubts, *faults, *slack), notes)


def _accepted(
    log: Log, rig: Rig, stopped: Mapping[str, str], doubts: Sequence[Fault]
) -> Calibrated:
    """Return a hand calibrated after what is likely wrong in its rig is corrected."""
    values = {path: value for doubt in doubts for path, value in doubt.values.items()}
    corrected = rig.with_values(values)
    signs = dict[str, int]()
    for sensor, other in zip(rig.sensors, corrected.sensors):
        signs[sensor.name] = signs[sensor.of] = sensor.sign * other.sign
    turned = replace(
        log,
        channels={name: signs.get(name, 1) * v for name, v in log.channels.items()},
        goals={name: signs.get(name, 1) * v for name, v in log.goals.items()},
    )
    after = calibrate(turned, corrected, stopped)
    notes = [f"corrected: {d.sentence.partition('. ')[0]}" for d in doubts if d.values]
    return replace(
        after, start=rig, values={**values, **after.values}, notes=(*after.notes, *notes)
    )


def _bridged(log: Log) -> Log:
    """Return the log with gaps of its channels filled by linear interpolation."""
    channels = dict(log.channels)
    for name, values in log.channels.items():
        known = np.isfinite(values)
        if known.any():
            channels[name] = np.interp(log.time, log.time[known], values[known], nan, nan)
    return replace(log, channels=channels)


def _sweeps(
    log: Log, rig: Rig, stopped: Mapping[str, str]
) -> tuple[dict[str, tuple[Sweep, ...]], dict[str, str]]:
    """Return the sweeps of each motor, and the motors that have none, each with the reason.

    Raises:
        LogError: no motor sweeps from end to end.
    """
    sweeps = dict[str, tuple[Sweep, ...]]()
    without = dict(stopped)
    for name in rig.drive_names:
        sweeps[name] = ()
        if name not in stopped:
            try:
                sweeps[name] = sweeps_of(log, rig, name)
            except LogError as problem:
                without[name] = str(problem)
    if not any(sweeps.values()):
        raise LogError(list(without.values())[-1])
    resisted = any(sweep.resisted for of_drive in sweeps.values() for sweep in of_drive)
    if len(sweeps) > 1 and not resisted:
        raise LogError(
            f"{log.source}: no motor meets an end of its travel; is it the log of a power-on "
            "routine (see distal.hands.Routine)?"
        )
    return sweeps, without
