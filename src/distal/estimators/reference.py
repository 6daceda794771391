"""A reference of the joint's angle: a sensor that is read while it is there (homing, fitting), or a truth column."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from distal.errors import EstimationError
from distal.logs import Log
from distal.rig import Rig, Sensor, build_rig

Floats = NDArray[np.float64]

TRUTH_NOISE = np.deg2rad(0.1)
"""Standard deviation of a truth that is no sensor of the rig [rad]."""

FROM_SENSOR = "the reference sensor"
"""How the origin of a log's truth ends where it is the rig's own angle sensor."""


def with_reference(rig: Rig, log: Log) -> tuple[Rig, Sensor]:
    """Return a rig in which the log's truth is a sensor of the joint's angle, and that sensor.

    It is the rig's own where the truth comes from it; else one called ``reference`` is added, with `TRUTH_NOISE`.

    Args:
        rig: the description.
        log: with a truth.

    Raises:
        EstimationError: the log has no truth.
    """
    if "theta" not in log.truth:
        raise EstimationError(
            f"{log.source}: homing needs the joint's angle for a while; give --truth, or log the column of the rig's "
            "angle sensor"
        )
    own = rig.sensors_of("angle")
    if own and log.truth_source.endswith(FROM_SENSOR):
        sensor: Sensor = own[0]
        if sensor.noise == 0.0 and sensor.resolution == 0.0:
            path = f"sensors.{[each.name for each in rig.sensors].index(sensor.name)}.noise"
            rig = rig.with_values({path: TRUTH_NOISE})
            sensor = rig.sensors_of("angle")[0]
        return rig, sensor
    return added_reference(rig, 1.0 / float(np.median(np.diff(log.time))) if len(log) > 1 else 100.0)


def added_reference(rig: Rig, rate: float) -> tuple[Rig, Sensor]:
    """Return the rig with one more sensor of the joint's angle, and that sensor.

    Args:
        rig: the description.
        rate: of the sensor [Hz].
    """
    own, names = rig.sensors_of("angle"), {sensor.name for sensor in rig.sensors}
    name = next(n for n in ("reference", "reference_angle", "reference_angle_2") if n not in names)
    raw = rig.model_dump()
    added = {"name": name, "measures": "angle", "of": rig.joints[0].name, "noise": TRUTH_NOISE}
    if own:
        added["bias"] = own[0].bias.model_dump()  # how far the model's angle and the joint's may be apart
    raw["sensors"] = [*raw["sensors"], {**added, "rate": float(np.clip(rate, 1e-3, 1e6))}]
    described = build_rig(raw, rig.name)
    return described, described.sensors[-1]


def check_homing(homing: float, log: Log) -> None:
    """Refuse a time of homing that leaves nothing to home by, or nothing to estimate.

    Args:
        homing: [s].
        log: that it is for.

    Raises:
        EstimationError: see above.
    """
    span = float(log.time[-1] - log.time[0])
    if not np.isfinite(homing) or not 0.0 < homing < span:
        raise EstimationError(
            f"homing must be longer than 0 s and shorter than the log ({span:g} s), {homing:g} s came"
        )
    if not np.isfinite(log.truth["theta"][log.time - log.time[0] < homing]).any():
        raise EstimationError(f"{log.source}: the reference has no value in the first {homing:g} s; homing needs one")


def homed(theta: Floats, log: Log, homing: float) -> Floats:
    """Return an angle shifted so that its mean error over the first moments is zero: homing without a filter.

    Args:
        theta: [rad], (k,).
        log: with a truth.
        homing: how long the reference is known [s].
    """
    early = (log.time - log.time[0] < homing) & np.isfinite(log.truth["theta"])
    shifted: Floats = theta - np.mean(theta[early] - log.truth["theta"][early])
    return shifted
