"""The position of a drive: of a slider a displacement, of a capstan an angle."""

from __future__ import annotations

from collections.abc import Mapping

from distal.expressions import Scalar
from distal.rig.drives import position_unit
from distal.rig.joints import REACH
from distal.rig.sensors.base import SensorBase
from distal.rig.sensors.measurand import Measurand, Motion, Part, Parts, Role


class Position(Measurand):
    """The position of a drive: s of a slider [m], φ of a capstan [rad]. A sensor with a `lag` is a
    command, which is ahead of the drive: it reads s + lag ṡ.
    """

    name = "position"
    of = "drives"
    role = Role.POSITION

    def unit(self, part: Part) -> str:
        """Return m for a slider, rad for a capstan."""
        return position_unit(part)  # type: ignore[arg-type]

    def read(
        self, sensor: SensorBase, motion: Motion, part: int, unknowns: Mapping[str, Scalar]
    ) -> Scalar:
        """Return the position of the drive, or the command that it follows."""
        position = motion.position(part)
        return position + sensor.lag * motion.rate(part) if sensor.lag > 0.0 else position

    def travel(self, sensor: SensorBase, rig: Parts, part: int) -> tuple[float, float]:
        """Return the range of the drive, see `drive_travel`."""
        return drive_travel(rig, part)


def drive_travel(rig: Parts, drive: int) -> tuple[float, float]:
    """Return the lowest and the highest position of a drive [m, rad]: its stops, or what its tendon
    lets it use.

    Without stops, the tendon's joints decide: of a tendon at one joint ±`REACH`, of a tendon over
    several joints the stops of each. The range of a slider lies about the displacement T/k at its
    nominal force T.
    """
    part = rig.drives[drive]
    if part.stops is not None:
        return part.stops
    tendon = next(t for t in rig.tendons if t.drive == part.name)
    lever = part.radius.value if part.kind == "capstan" else 1.0
    centre = 0.0 if part.kind == "capstan" else part.nominal_force.value / tendon.stiffness.value
    if len(tendon.joints) == 1:
        reach = REACH * tendon.total_arm / lever
        return centre - reach, centre + reach
    low = centre
    high = centre
    stops = {joint.name: joint.travel for joint in rig.joints}
    turned = tendon.winding if part.kind == "capstan" else 1
    for name, arm in tendon.arms().items():
        ends = sorted(turned * arm / lever * angle for angle in stops[name])
        low = low + ends[0]
        high = high + ends[1]
    return low, high
