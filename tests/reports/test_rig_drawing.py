"""The drawing of a rig: labels inside the figure and apart from each other, parts to scale, tendons
that touch pulleys.
"""

from __future__ import annotations

from itertools import combinations, pairwise
from math import cos, hypot, pi, sin
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.text import Text
from typer.testing import CliRunner

from distal import Rig, load_rig
from distal.cli.app import app
from distal.reports import draw_rig, rig_svg
from distal.reports.drawing.labels import label_of
from distal.reports.drawing.pose import stands, views_of
from distal.reports.drawing.routes import WRAP, Wheel, route, route_heading
from distal.results import COLOURS
from distal.rig import build_rig, shipped_rigs

LONG = "a_name_that_has_thirty_letters"


def joint(name: str = "j", **more: Any) -> dict[str, Any]:
    return {"name": name, "inertia": 1e-5, **more}


def capstan(name: str, radius: float = 0.005, **more: Any) -> dict[str, Any]:
    return {"name": name, "kind": "capstan", "inertia": 1e-5, "radius": radius, **more}


def slider(name: str) -> dict[str, Any]:
    return {"name": name, "kind": "slider", "mass": 0.01}


def pulley(of: str, radius: float, side: int) -> dict[str, Any]:
    return {"joint": of, "kind": "pulley", "radius": radius, "side": side}


def tendon(name: str, drive: str, *crossings: dict[str, Any], **more: Any) -> dict[str, Any]:
    return {"name": name, "drive": drive, "crossings": crossings, "stiffness": 5e3, **more}


def link(length: float) -> dict[str, Any]:
    return {"mass": 0.01, "centre": [length / 2, 0, 0]}


SPRUNG = joint(
    gravity={"mass": 0.05, "distance": 0.03, "hanging_angle": "30 deg"},
    spring={"stiffness": 0.2},
    stops=["-30 deg", "100 deg"],
)
PULLED = joint(
    extension_spring={
        "stiffness": 200.0,
        "free_length": 0.01,
        "radius": 0.012,
        "distance": 0.025,
        "line_angle": 2.0,
    }
)
SHEATH = {"friction": 0.1, "wrap": "180 deg", "nodes": 3}
POLYNOMIAL = {
    "kind": "polynomial",
    "joints": ["a", "b"],
    "terms": [{"powers": [2, 0], "coefficient": 0.004}, {"powers": [0, 1], "coefficient": 0.005}],
    "range": [["-30 deg", "60 deg"], ["-30 deg", "60 deg"]],
}
ODD: dict[str, dict[str, Any]] = {
    "one tendon, spring, gravity": {
        "joints": [SPRUNG],
        "drives": [slider("d")],
        "tendons": [tendon("only", "d", pulley("j", 0.01, 1))],
        "sensors": [
            {"name": "tension", "measures": "tension", "of": "only"},
            {"name": "torque", "measures": "torque", "of": "j"},
        ],
    },
    "names of thirty letters": {
        "joints": [
            joint(LONG + "1", link=link(0.04)),
            joint(LONG + "2", offset=[0.04, 0, 0], link=link(0.04)),
        ],
        "drives": [capstan(LONG + "3"), slider(LONG + "4")],
        "tendons": [
            tendon(
                LONG + "5", LONG + "3", pulley(LONG + "1", 0.008, 1), pulley(LONG + "2", 0.006, 1)
            ),
            tendon(
                LONG + "6", LONG + "3", pulley(LONG + "1", 0.008, -1), pulley(LONG + "2", 0.006, -1)
            ),
            tendon(LONG + "7", LONG + "4", pulley(LONG + "1", 0.007, -1)),
        ],
        "sensors": [{"name": LONG + "8", "measures": "position", "of": LONG + "3", "gear": 30}],
    },
    "radii from 2 to 40 mm": {
        "joints": [
            joint("big", stops=["-170 deg", "170 deg"], link=link(0.1)),
            joint("small", offset=[0.1, 0, 0.03], stops=["-10 deg", "10 deg"]),
        ],
        "drives": [
            capstan("m", 0.002),
            capstan("n", 0.03, stops=[-3.0, 3.0], backlash={"width": 0.02}),
        ],
        "tendons": [
            tendon(f"{name}{side}", name, *(pulley(of, radius, side) for of, radius in crossed))
            for name, crossed in (("m", [("big", 0.04)]), ("n", [("big", 0.002), ("small", 0.002)]))
            for side in (1, -1)
        ],
    },
    "sheaths, extension spring, gear": {
        "joints": [PULLED],
        "drives": [capstan("spool", 0.004)],
        "tendons": [
            tendon("a", "spool", pulley("j", 0.01, 1), path=SHEATH),
            tendon("b", "spool", pulley("j", 0.01, -1), slack="1 mm"),
        ],
        "sensors": [{"name": "phi", "measures": "position", "of": "spool", "gear": 30}],
    },
    "coupled": {
        "joints": [
            joint("a", link=link(0.025), stops=["0 deg", "90 deg"]),
            joint("b", offset=[0.025, 0, 0], coupled={"joint": "a", "ratio": -0.8, "offset": 0.1}),
        ],
        "drives": [capstan("m")],
        "tendons": [
            tendon("f", "m", pulley("a", 0.006, 1)),
            tendon("e", "m", pulley("a", 0.006, -1)),
        ],
    },
    "axes that meet, two on the base": {
        "joints": [
            joint("a", link=link(0.0)),
            joint("b", axis="x"),
            joint("c", parent="base", offset=[0, 0.03, 0]),
        ],
        "drives": [slider("d"), slider("e")],
        "tendons": [
            tendon("t", "d", pulley("a", 0.006, 1), pulley("b", 0.004, 1)),
            tendon("u", "e", pulley("c", 0.006, -1)),
        ],
    },
    "polynomial, cam, pin": {
        "joints": [
            joint("a", link=link(0.04)),
            joint("b", offset=[0.04, 0, 0], axis="-y", stops=[-0.5, 1.0]),
        ],
        "drives": [slider("d"), slider("e")],
        "tendons": [
            tendon("t", "d", POLYNOMIAL),
            tendon(
                "u",
                "e",
                {"kind": "linkage", "joint": "a", "radius": 0.007, "side": -1, "slope": 0.3},
                {"kind": "pinned", "joint": "b", "radius": 0.006, "free_length": 0.2, "side": -1},
            ),
        ],
    },
    "twelve joints": {
        "joints": [
            joint(f"j{k}", offset=[0.012 * (k > 0), 0, 0], axis="yz"[k % 2], link=link(0.012))
            for k in range(12)
        ],
        "drives": [capstan(f"m{k}", 0.004) for k in range(6)],
        "tendons": [
            tendon(
                f"t{k}{side}".replace("-", "m"),
                f"m{k}",
                *(pulley(f"j{q}", 0.004, side) for q in range(2 * k + 2)),
            )
            for k in range(6)
            for side in (1, -1)
        ],
    },
}


def odd_rig(name: str) -> Rig:
    return build_rig(
        {
            "name": f"{name}, $x^2$ and many more words than one line of a narrow drawing has",
            **ODD[name],
        },
        name,
    )


def labels(made: Figure) -> dict[str, Any]:
    """Return every text of a figure that is seen, with its box in pixels."""
    canvas = FigureCanvasAgg(made)
    canvas.draw()
    renderer = canvas.get_renderer()
    texts: list[Text] = []
    for axes in made.axes:
        texts += axes.texts
        if axes.axison:
            legend = axes.get_legend()
            texts += [
                axes.title,
                axes.xaxis.label,
                axes.yaxis.label,
                *(legend.get_texts() if legend else []),
            ]
            for axis in (axes.xaxis, axes.yaxis):
                low, high = sorted(axis.get_view_interval())
                texts += [
                    tick.label1 for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high
                ]
    seen = [text for text in texts if text.get_text().strip()]
    boxes = [(t.get_text(), t.get_window_extent(renderer)) for t in seen]
    return {f"{k}: {text}": box for k, (text, box) in enumerate(boxes)}


def check_labels(made: Figure) -> None:
    boxes = labels(made)
    assert len(boxes) > 5
    width, height = made.bbox.width, made.bbox.height
    for text, box in boxes.items():
        outside = min(box.x0, box.y0, width - box.x1, height - box.y1) < 0
        assert not outside, f"{text} leaves the figure"
    for (one, a), (other, b) in combinations(boxes.items(), 2):
        across, up = min(a.x1, b.x1) - max(a.x0, b.x0), min(a.y1, b.y1) - max(a.y0, b.y0)
        # boxes are as high as the tallest letters of a font: a pixel of air may be shared
        assert across <= 1.0 or up <= 1.5, f"{one} lies on {other}"


@pytest.mark.parametrize("name", shipped_rigs())
def test_labels_of_shipped_rigs_are_inside_and_apart(name: str) -> None:
    check_labels(draw_rig(load_rig(name)))


@pytest.mark.parametrize("name", ODD)
def test_labels_of_odd_rigs_are_inside_and_apart(name: str) -> None:
    check_labels(draw_rig(odd_rig(name)))


def test_parts_are_to_scale_and_tendons_touch_pulleys() -> None:
    rig = load_rig("finger-n-plus-1")
    (axes,) = draw_rig(rig).axes
    lines = {tuple(np.round(line.get_xydata().ravel(), 3)): line for line in axes.lines}
    circles = [patch for patch in axes.patches if isinstance(patch, Circle)]
    bar = next(text for text in axes.texts if text.get_text() == "20 mm")
    rule = [
        line
        for line in lines.values()
        if line.get_lw() == 2.0 and abs(np.mean(line.get_xdata()) - bar.get_position()[0]) < 1e-6
    ]
    scale = float(np.ptp(rule[0].get_xdata())) / 0.02
    pulleys = {(round(c.center[0] / scale, 4), round(c.radius / scale, 4)) for c in circles}
    assert {
        (0.0, 0.008),
        (0.0, 0.0075),
        (0.045, 0.007),
        (0.045, 0.0065),
        (0.07, 0.006),
        (0.07, 0.0055),
    } <= pulleys
    for tendon, colour in zip(rig.tendons, COLOURS):
        way = np.vstack(
            [
                line.get_xydata()
                for line in axes.lines
                if line.get_color() == colour and line.get_lw() == 1.5
            ]
        )
        for joint, at in (("mcp", 0.0), ("pip", 0.045), ("dip", 0.07)):
            arm = tendon.arms().get(joint)
            if arm is None:
                continue
            from_axis = way - [at * scale, 0.0]
            nearest = np.hypot(*from_axis.T).min() / scale
            # tendons on equal pulleys lie side by side: as much as that they may be further out
            assert abs(arm) - 1e-5 < nearest < abs(arm) + 1e-3
            # about y, which points into the paper, what pulls to +θ passes below
            touching = from_axis[np.argmin(np.hypot(*from_axis.T))]
            assert np.sign(touching[1]) == -np.sign(arm)


def test_a_route_touches_circles() -> None:
    wheels = [Wheel((0.0, 0.0)), Wheel((2.0, 0.3), 0.5, -1), Wheel((4.0, -0.2), 0.8, 1)]
    for one, other in pairwise(wheels):
        along = route_heading(one, other)
        start, end = np.array(one.point(along)), np.array(other.point(along))
        assert np.allclose((end - start) / np.hypot(*(end - start)), [cos(along), sin(along)])
        for wheel, touch in ((one, start), (other, end)):
            assert hypot(*(touch - wheel.centre)) == pytest.approx(wheel.radius)
            assert (touch - wheel.centre) @ [cos(along), sin(along)] == pytest.approx(
                0.0, abs=1e-12
            )
    points = np.array(route(wheels, WRAP))
    assert np.hypot(*(points - wheels[1].centre).T).min() == pytest.approx(0.5)
    last = points[-1] - wheels[2].centre
    assert np.hypot(*last) == pytest.approx(0.8)
    assert cos(route_heading(wheels[1], wheels[2]) + WRAP - pi / 2) == pytest.approx(last[0] / 0.8)


def test_joints_are_seen_along_their_axes() -> None:
    rig = load_rig("wrist-instrument")
    assert [turn for *_, turn in views_of(rig)] == [
        -1,
        -1,
        -1,
    ]  # tendons on one side stay there on paper
    placed = stands(rig, 0.005)
    assert np.allclose([stand.centre for stand in placed], [(0, 0), (0.009, 0), (0.019, 0)])
    assert not any(stand.drawn_apart for stand in placed)
    for (right, up, turn), each in zip(views_of(rig), rig.joints):
        assert np.allclose(np.cross(right, up), turn * np.array(each.axis))
    other = stands(odd_rig("axes that meet, two on the base"), 0.006)
    assert [stand.drawn_apart for stand in other] == [False, True, True]
    hanging = stands(odd_rig("one tendon, spring, gravity"), 0.01)[0]
    # at its hanging angle of 30° the mass is below; about y angles turn clockwise
    assert hanging.mass_at == pytest.approx((0.03 * sin(pi / 6), -0.03 * cos(pi / 6)))


def test_numbers_have_fitting_units() -> None:
    said = [
        label_of(*one)
        for one in (
            (23000.0, "N/m"),
            (806.0, "N/m"),
            (0.00953, "m"),
            (0.15, "N m/rad"),
            (-0.1, "rad"),
        )
    ]
    assert said == ["23 N/mm", "806 N/m", "9.53 mm", "0.15 N·m/rad", "−5.73°"]
    assert [label_of(0.0, "rad"), label_of(0.015, "kg"), label_of(1e-7, "m")] == [
        "0°",
        "15 g",
        "0.0001 mm",
    ]


def test_what_is_written_beside_the_parts() -> None:
    texts = {text.get_text() for text in draw_rig(load_rig("lab-bench")).axes[0].texts}
    assert {
        "Finger on the bench",
        "spool r 5 mm",
        "gear 30 : 1",
        "pulley r 8 mm",
        "−50°",
        "50°",
    } <= texts
    assert {
        "k 20 N/mm, T₀ 15 N",
        "motor_angle",
        "motor_torque",
        "joint_encoder",
        "φ",
        "τ",
        "θ",
    } <= texts
    texts = {text.get_text() for text in draw_rig(load_rig("finger-underactuated")).axes[0].texts}
    assert {
        "axis y ⊗",
        "spring 0.15 N·m/rad",
        "relaxed at −10°",
        "g 9.81 m/s²",
        "+9",
        "100°",
    } <= texts
    assert "sheath 180°, μ 0.1" in {
        t.get_text() for t in draw_rig(odd_rig("sheaths, extension spring, gear")).axes[0].texts
    }


def test_an_element_for_pages_says_what_it_shows() -> None:
    text = rig_svg(load_rig("paper-2008"))
    assert text.startswith("<svg role='img' aria-label='Drawing of the rig Nylon-tendon disk")
    assert "drives left (slider), right (slider)" in text
    assert text.rstrip().endswith("</svg>")


@pytest.mark.parametrize("suffix", ["svg", "pdf", "png"])
def test_the_command_writes_each_format(suffix: str, tmp_path: Path) -> None:
    out = tmp_path / f"rig.{suffix}"
    assert CliRunner().invoke(app, ["rig", "draw", "template", "--out", str(out)]).exit_code == 0
    assert out.read_bytes()[:5] == {"svg": b"<?xml", "pdf": b"%PDF-", "png": b"\x89PNG\r"}[suffix]
