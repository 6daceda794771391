"""Signs in a log that a unit is wrong, in words."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from distal.logs.log import LARGEST_READING, Log
from distal.rig import Capstan, Rig, angle_names


def doubts_of_units(log: Log, rig: Rig) -> Iterator[str]:
    """Yield a sentence for each sign that a unit is wrong: readings, intervals or angles of an
    unlikely size.
    """
    drives = {drive.name: drive for drive in rig.drives}
    for sensor in rig.sensors_of("position"):
        values = log.channels[sensor.name]
        values = np.where(np.abs(values) > LARGEST_READING, np.nan, values)
        if not np.isfinite(values).any():
            continue
        drive = drives[sensor.of]
        span = float(np.nanmax(values) - np.nanmin(values))
        lever = drive.radius.value if isinstance(drive, Capstan) else 1.0
        # a joint turns by a few radians at most, and a tendon stretches by less than that
        travel = (
            span * lever / max(*(t.total_arm for t in rig.tendons if t.drive == sensor.of), 1e-12)
        )
        if travel > 50.0:
            hint = "mm" if sensor.si == "m" else "deg"
            yield (
                f"{log.source}: '{sensor.log_column}' spans {span:.3g} {sensor.si} when read in "
                f"'{sensor.unit or sensor.si}', far more than the joint can turn; is the log in "
                f"{hint}? "
                f"(--set 'sensors.{sensor.name}.unit=\"{hint}\"')"
            )
    rate = max((sensor.rate for sensor in rig.sensors), default=0.0)
    step = float(np.median(np.diff(log.time)))
    if rate > 0.0 and not 0.05 < step * rate < 20.0:
        yield (
            f"{log.source}: the stamps are {step:g} s apart, the rig's sensors give a value every "
            f"{1 / rate:g} s; is "
            "the unit of time right? (--set 'log.time.unit=\"ms\"', or the sensors' rate)"
        )
    joints = rig.joint_names
    names = dict(zip(joints, angle_names(joints)))
    for sensor in rig.sensors_of("angle"):
        theta = log.truth.get(names[sensor.of])
        largest = 0.0 if theta is None else float(np.nanmax(np.abs(theta), initial=0.0))
        if largest > 20.0:
            yield (
                f"{log.source}: the reference angle reaches {largest:.3g} rad; is it in degrees? "
                f"(--set 'sensors.{sensor.name}.unit=\"deg\"')"
            )
