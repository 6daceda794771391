"""How far a drive can go: by its stops, or by what it can use."""

from __future__ import annotations

from distal.model import Mechanism

REACH = 1.2
"""A drive without stops is taken to move as far as the joint turns by this, either way [rad]."""


def travel(mechanism: Mechanism, drive: int) -> tuple[float, float]:
    """Return the ends of a drive's travel, where its sensor's linearity is defined: its stops, or what it can use.

    Without stops: ±`REACH` of the joint about the place that the nominal force stretches the tendon to; of a tendon over
    several joints what their own stops allow.
    """
    part = mechanism.rig.drives[drive]
    if part.stops is not None:
        return part.stops
    tendon = next(t for t in mechanism.rig.tendons if t.drive == part.name)
    lever = part.radius.value if part.kind == "capstan" else 1.0
    centre = 0.0 if part.kind == "capstan" else part.nominal_force.value / tendon.stiffness.value
    if len(tendon.joints) == 1:
        reach = REACH * tendon.total_arm / lever
        return centre - reach, centre + reach
    low, high, stops = centre, centre, {joint.name: joint.stops or (-REACH, REACH) for joint in mechanism.rig.joints}
    turned = tendon.winding if part.kind == "capstan" else 1
    for name, arm in tendon.arms().items():
        ends = sorted(turned * arm / lever * angle for angle in stops[name])
        low, high = low + ends[0], high + ends[1]
    return low, high
