"""Joints in a drawing: pulleys, pins and cams of their true radius, links, springs, stops, sensors,
and the text on them.

In all functions, positions of joints are in inches, `scale` is in inches per metre, and `lines` is
the text on a joint, whose badges are repeated on the drawn joint.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, dist, pi, sin

import numpy as np

from distal.arrays import Floats
from distal.reports.drawing.labels import label_of, rounded_label
from distal.reports.drawing.pose import Stand
from distal.reports.drawing.routes import Wheel, route_heading
from distal.reports.drawing.sensors import sensor_lines
from distal.reports.drawing.sheet import BADGE, DrawnLine, Point, Sheet, arc, on_circle
from distal.results import FAINT, INK, PALE, SOFT, WHITE
from distal.rig import Joint, Linkage, Meeting, Polynomial, Rig

REACH = pi / 3
"""Angle on both sides within which a cam's outline shows its moment arms [rad]; outside it the
outline is closed smoothly. Source: layout.
"""

LINK = 10.0
"""Width of a link [pt]. Source: layout."""


def meetings_at(rig: Rig, joint: Joint) -> list[Meeting]:
    """Return the meetings of tendons with a joint; each says how a tendon acts on it."""
    return [
        meeting
        for tendon in rig.tendons
        for meeting in tendon.meetings
        if joint.name in meeting.joints
    ]


def joint_lines(rig: Rig, index: int, turn: int) -> list[DrawnLine]:
    """Return the lines of text on a joint: its name, axis, sizes and sensors.

    Args:
        index: index of the joint.
        turn: +1 where a positive angle turns counter-clockwise on paper, −1 where it turns
            clockwise.
    """
    joint = rig.joints[index]
    texts = list[str]()
    if rig.is_chain or joint.gravity is not None:
        texts.append(f"axis {axis_name(joint.axis)} {'⊙' if turn > 0 else '⊗'}")
    if joint.coupled is not None:
        shift = f" + {label_of(joint.coupled.offset, 'rad')}" if joint.coupled.offset else ""
        texts.append(f"θ = {rounded_label(joint.coupled.ratio)} θ of {joint.coupled.joint}{shift}")
    texts += _sizes(rig, joint)
    if joint.spring is not None:
        texts.append(f"spring {label_of(joint.spring.stiffness.value, 'N m/rad')}")
        texts.append(f"relaxed at {label_of(joint.spring.rest_angle.value, 'rad')}")
    if joint.extension_spring is not None:
        texts.append(f"spring {label_of(joint.extension_spring.stiffness.value, 'N/m')}")
    if joint.friction is not None:
        size = label_of(joint.friction.radius.value, "m")
        mu = rounded_label(joint.friction.coefficient.value)
        texts.append(f"axle r {size}, μ {mu}")
    if joint.backlash is not None:
        texts.append(f"backlash {label_of(joint.backlash.width.value, 'rad')}")
    body = joint.link or joint.gravity
    if body is not None and not body.mass.absent:
        texts.append(f"link {label_of(body.mass.value, 'kg')}")
    return [DrawnLine(joint.name, bold=True), *map(DrawnLine, texts), *sensor_lines(rig, joint)]


def _sizes(rig: Rig, joint: Joint) -> list[str]:
    """Return the sizes of the insertions at a joint, one text for each kind."""
    kinds: dict[tuple[str, str], list[float]] = {}
    for meeting in meetings_at(rig, joint):
        shape = meeting.shape
        if isinstance(shape, Polynomial):
            kinds.setdefault(("arms by polynomial", ""), [])
            continue
        behind = ""
        if isinstance(shape, Linkage) and shape.centre.value != 0.0:
            behind = f" at {label_of(shape.centre.value, 'rad')}"
        kinds.setdefault((shape.DRAWN, behind), []).append(shape.radius.value)
    texts = []
    for (name, behind), radii in kinds.items():
        sizes = dict.fromkeys(rounded_label(1e3 * radius) for radius in sorted(radii, reverse=True))
        texts.append(f"{name} {', '.join(sizes)} mm{behind}" if sizes else name)
    return texts


def axis_name(axis: tuple[float, float, float]) -> str:
    """Return the name of a joint's axis, given as a unit vector: x, −y, or its components."""
    for k, name in enumerate("xyz"):
        if abs(abs(axis[k]) - 1.0) < 1e-9:
            return f"{'−' if axis[k] < 0 else ''}{name}"
    return "(" + ", ".join(f"{part:.2g}" for part in axis).replace("-", "−") + ")"


def draw_link(sheet: Sheet, stand: Stand, ends: Sequence[Point]) -> None:
    """Draw the link that a joint turns, from the joint to each of the `ends`: the joints on it, or
    its tip.
    """
    for end in ends:
        sheet.bar([stand.centre, end], PALE if stand.described else WHITE, LINK, order=1.0)
    if stand.mass_at is None:
        return
    from matplotlib.patches import Wedge

    x, y = stand.mass_at
    sheet.disc((x, y), 0.05, WHITE, order=2.6)
    sheet.take((x - 0.05, y - 0.05, x + 0.05, y + 0.05))
    for start in (0, 180):
        sheet.patch(
            Wedge((x, y), 0.05, start, start + 90, facecolor=INK, edgecolor="none", zorder=2.7)
        )


def draw_coupling(sheet: Sheet, leader: Point, follower: Point, ratio: float) -> None:
    """Draw a rigid coupling of two joints as a belt, which is crossed where the `ratio` of their
    angles is negative.
    """
    for way in (1, -1):
        first = Wheel(leader, min(max(0.12 * abs(ratio), 0.06), 0.24), way)
        last = Wheel(follower, 0.12, way if ratio > 0 else -way)
        along = route_heading(first, last)
        sheet.disc(leader, first.radius, "none", INK, order=3.1, ls=(0, (6, 2, 1, 2)))
        sheet.line(
            [first.point(along), last.point(along)], INK, 0.9, ls=(0, (6, 2, 1, 2)), zorder=3.1
        )


def draw_joint(
    sheet: Sheet,
    rig: Rig,
    index: int,
    stand: Stand,
    scale: float,
    around: float,
    lines: Sequence[DrawnLine],
) -> None:
    """Draw what turns about a joint's axis, its springs and sensors.

    Args:
        index: index of the joint.
        stand: where the joint is drawn.
        scale: scale of the drawing [in/m].
        around: radius at which its stops are drawn [in].
    """
    joint = rig.joints[index]
    centre = stand.centre
    _draw_wheels(sheet, rig, joint, stand, scale)
    axle = scale * joint.friction.radius.value if joint.friction is not None else 0.0
    sheet.disc(centre, max(axle, 0.04), FAINT, SOFT, order=2.8)
    sheet.disc(centre, 0.022, INK, order=2.9)
    if joint.spring is not None:
        start = max(0.09, axle + 0.025)
        out = max(0.75 * around - 0.1, start + 0.09)
        first = stand.towards + pi
        spiral = [
            on_circle(
                centre, 0.09 + (out - 0.09) * k / 90, first - stand.turn * 5 * pi * (1 - k / 90)
            )
            for k in range(91)
        ]
        sheet.line(spiral, INK, 1.0, zorder=3.2)
    if joint.extension_spring is not None:
        spring = joint.extension_spring
        on_link = on_circle(centre, scale * spring.radius.value, stand.towards)
        on_base = on_circle(
            centre,
            scale * spring.distance.value,
            stand.towards + stand.turn * spring.line_angle.value,
        )
        sheet.line(coil(on_link, on_base), INK, 1.0, zorder=3.2)
        sheet.disc(on_link, 0.03, WHITE, order=3.3)
        sheet.disc(on_base, 0.03, INK, order=3.3)
    if joint.stops is not None:
        _draw_stops(sheet, joint.stops, stand, around)
    first = stand.towards + stand.turn * 0.30 * min(1.0, 0.3 / around)
    last = stand.towards + stand.turn * max(0.75 * min(1.0, 0.4 / around), 0.5)
    sheet.arrow(arc(centre, around, first, last), INK)
    sheet.write_near(on_circle(centre, around + 0.1, last), (cos(last), sin(last)), "+θ")
    sheet.mark(
        lines, {"θ": centre, "τ": on_circle(centre, max(0.5 * around, 2.2 * BADGE), stand.towards)}
    )


def _draw_stops(sheet: Sheet, stops: tuple[float, float], stand: Stand, around: float) -> None:
    """Draw the range of a joint as an arc between two blocks, which the middle of its link meets at
    the stops.
    """
    from matplotlib.patches import Wedge

    centre = stand.centre
    (low, high) = (stand.towards + stand.turn * angle for angle in stops)
    sheet.line(arc(centre, around, low, high), SOFT, 0.7, ls=(0, (4, 2)), zorder=2.95)
    for angle, outwards, stop in ((low, -stand.turn, stops[0]), (high, stand.turn, stops[1])):
        sheet.line(
            [centre, on_circle(centre, around, angle)], SOFT, 0.5, ls=(0, (4, 2)), zorder=2.95
        )
        edges = (edge * (180 / pi) for edge in sorted((angle, angle + outwards * (0.06 / around))))
        block = Wedge(centre, around + 0.06, *edges, width=0.12, facecolor=INK, zorder=4.5)
        sheet.patch(block, on_circle(centre, around + 0.06, angle))
        out = (cos(angle), sin(angle))
        sheet.write_near(on_circle(centre, around + 0.13, angle), out, label_of(stop, "rad"))


def _draw_wheels(sheet: Sheet, rig: Rig, joint: Joint, stand: Stand, scale: float) -> None:
    """Draw a joint's pulleys, the largest first; for other insertions, a dashed circle with the
    moment arm at zero angle.
    """
    meetings = meetings_at(rig, joint)
    wheels = dict.fromkeys(
        (m.shape.kind, round(abs(m.arms({})[joint.name]) * scale, 4)) for m in meetings
    )
    for kind, size in sorted(wheels, key=lambda wheel: -wheel[1]):
        if kind == "pulley":
            sheet.disc(stand.centre, size, PALE, SOFT, order=2.0, lw=0.8)
        elif kind != "linkage":
            sheet.disc(stand.centre, size, "none", SOFT, order=2.05, ls=(0, (2, 2)))
    cams = [meeting for meeting in meetings if isinstance(meeting.shape, Linkage)]
    if cams:
        _draw_cam(sheet, joint, cams, stand, scale)
    if not meetings:
        sheet.disc(stand.centre, 0.12, PALE, SOFT)


def _draw_cam(
    sheet: Sheet, joint: Joint, cams: Sequence[Meeting], stand: Stand, scale: float
) -> None:
    """Draw the outline of a pulley that is not round.

    Its radius in a direction is the moment arm at the angle at which a tendon leaves the cam there.
    """
    from matplotlib.patches import Polygon

    low, high = joint.stops or (-REACH, REACH)
    angles = np.linspace(max(low, -REACH), min(high, REACH), 41)
    positions = []
    arms = []
    for meeting in cams:
        # above the axis lie the tendons that pull counter-clockwise
        touches = pi / 2 if meeting.side == stand.turn else -pi / 2
        positions += [touches - stand.turn * float(angle) for angle in angles]
        arms += [abs(meeting.arms({joint.name: float(angle)})[joint.name]) for angle in angles]
    # a smooth curve through them: a short Fourier series, its higher terms kept small where nothing
    # is known
    orders = np.arange(1, 6)

    def series(at: Floats) -> Floats:
        return np.column_stack(
            [np.ones_like(at), *(f(k * at) for k in orders for f in (np.cos, np.sin))]
        )

    terms = series(np.array(positions))
    penalty = np.diag([0.0, *np.repeat(0.03 * orders**2, 2)])
    weights = np.linalg.solve(terms.T @ terms + penalty, terms.T @ np.array(arms))
    round_about = np.linspace(0.0, 2 * pi, 181)
    points = [
        on_circle(stand.centre, scale * r, a)
        for a, r in zip(round_about, series(round_about) @ weights)
    ]
    sheet.patch(Polygon(points, facecolor=PALE, edgecolor=SOFT, lw=0.8, zorder=2.0), *points)


def draw_pin(sheet: Sheet, stand: Stand, pin: Point) -> None:
    """Draw the lever from a joint to the `pin` at which a tendon ends [in]."""
    sheet.bar([stand.centre, pin], FAINT, 6.0, order=2.1)
    sheet.disc(pin, 0.035, WHITE, order=4.4)


def coil(start: Point, end: Point) -> list[Point]:
    """Return the points of a spring between two points, a zigzag of 0.06 in to each side [in]."""
    length = dist(start, end) or 1.0
    teeth = max(6, 2 * round(length / 0.16))
    x, y = start
    along = ((end[0] - start[0]) / length, (end[1] - start[1]) / length)
    middle = [(0.1 + 0.8 * ((k + 0.5) / teeth), (-1) ** k * 0.06) for k in range(teeth)]
    return [
        (
            x + share * length * along[0] - aside * along[1],
            y + share * length * along[1] + aside * along[0],
        )
        for share, aside in [(0.0, 0.0), *middle, (1.0, 0.0)]
    ]
