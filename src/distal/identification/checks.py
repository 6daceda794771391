"""Logs that cannot be fitted, named before anything is computed or written."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from distal.errors import FitError
from distal.estimators import estimate
from distal.logs import Log
from distal.rig import Capstan, Rig, Sensor
from distal.sensors import variance

Floats = NDArray[np.float64]

STILL = 20.0
"""A drive that moves by less than this times its sensor's noise does not move."""

SMALL_TURN = np.deg2rad(2.0)
"""A drive that moves by less than this turn of the joint does not move [rad]."""

DEAD_TURN = np.deg2rad(20.0)
"""A truth that is constant while the drives would turn the joint by more than this is dead [rad]: no friction holds so."""

FITS = 0.8
"""Correlation of truth and drives from which on their ratio can be judged."""

UNIT_RANGE = (1 / 12, 12.0)
"""Ratio of the truth's motion to that which the drives make, within which units can be right."""


def check_logs(logs: Sequence[Log], rig: Rig) -> None:
    """Refuse logs without motion, dead sensors, and truths in a wrong unit or of a wrong sign.

    Args:
        logs: as read.
        rig: the description.

    Raises:
        FitError: see above; names the log and the sensor.
    """
    if not logs:
        raise FitError("no log came; a fit needs at least one")
    for log in logs:
        _check_motion(log, rig)
        _check_sensors(log, rig)
        if "theta" in log.truth:
            _check_truth(log, rig)


def _span(values: Floats) -> float:
    there = values[np.isfinite(values)]
    return float(np.quantile(there, 0.99) - np.quantile(there, 0.01)) if len(there) else 0.0


def _turn(rig: Rig, sensor: Sensor, span: float) -> float:
    """Return by how much the joint turns when a drive moves by `span` [rad]."""
    drive = next(drive for drive in rig.drives if drive.name == sensor.of)
    tendon = next(tendon for tendon in rig.tendons if tendon.drive == sensor.of)
    lever = drive.radius.value if isinstance(drive, Capstan) else 1.0
    return span * lever / tendon.insertion.radius.value


def _check_motion(log: Log, rig: Rig) -> None:
    moved = []
    for sensor in rig.sensors_of("position"):
        span = _span(log.channels[sensor.name])
        noise = np.sqrt(variance(sensor))
        moved.append(span > STILL * noise and _turn(rig, sensor, span) > SMALL_TURN)
    if moved and not any(moved):
        raise FitError(
            f"{log.source}: nothing moves (no drive by more than {np.rad2deg(SMALL_TURN):g}° of the joint); a log without "
            "motion tells nothing of friction and stiffness: leave it out"
        )


def _check_sensors(log: Log, rig: Rig) -> None:
    for sensor in rig.sensors:
        if sensor.measures == "angle" or sensor.name not in log.channels:
            continue
        values = log.channels[sensor.name]
        there = values[np.isfinite(values)]
        if len(there) > 20 and float(np.ptp(there)) == 0.0:
            raise FitError(
                f"{log.source}: sensor '{sensor.name}' is constant ({there[0]:g} {sensor.si}) over the whole log; "
                "is it connected? Leave the log out, or remove the sensor from the rig"
            )


def _check_truth(log: Log, rig: Rig) -> None:
    truth = log.truth["theta"]
    there = np.isfinite(truth)
    if there.sum() < 10:
        raise FitError(
            f"{log.source}: the truth ({log.truth_source}) has {int(there.sum())} values; at least 10 are needed"
        )
    # stretch removed where forces are measured: soft tendons let drives and joint go different ways
    baseline = "elastic" if rig.sensors_of("force") else "inextensible"
    drives = estimate(Log(log.time, log.channels, {}, log.source), rig, baseline).theta
    a, b = drives[there] - drives[there].mean(), truth[there] - truth[there].mean()
    if float(np.sqrt(np.mean(a**2))) < SMALL_TURN / 2:
        return
    if float(np.ptp(truth[there])) == 0.0 and float(np.ptp(a)) > DEAD_TURN:
        raise FitError(
            f"{log.source}: the truth ({log.truth_source}) is constant while the drives move; is the encoder connected?"
        )
    if float(b @ b) == 0.0:
        return  # the joint sticks: nothing to judge by
    correlation = float(a @ b / np.sqrt((a @ a) * (b @ b)))
    ratio = float(np.sqrt((b @ b) / (a @ a)))
    if correlation < -FITS:
        raise FitError(
            f"{log.source}: the truth ({log.truth_source}) moves against the drives (correlation {correlation:.2f}); its "
            "sign is wrong: set the angle sensor's sign = -1, or swap the tendons' sides"
        )
    if abs(correlation) > FITS and not UNIT_RANGE[0] < ratio < UNIT_RANGE[1]:
        near = "it looks like degrees read as radians" if 20.0 < ratio < 160.0 else "is the unit, or a radius, wrong?"
        near = "it looks like radians read as degrees" if 1 / 160.0 < ratio < 1 / 20.0 else near
        raise FitError(
            f"{log.source}: the truth ({log.truth_source}) moves {ratio:.3g} times as far as the drives turn the joint; "
            f"{near} (set the angle sensor's unit)"
        )
