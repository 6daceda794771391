"""The drawing of a rig: every part with its name and sizes, texts apart from each other and from
tendons, and the way each tendon turns a joint.
"""

from __future__ import annotations

from collections import Counter
from itertools import combinations
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from typer.testing import CliRunner

from distal import Rig, load_rig
from distal.cli.app import app
from distal.reports import draw_rig, rig_svg
from distal.reports.rig_drawing import FONT, GAP
from distal.results import COLOURS, save_figure
from distal.rig import shipped_rigs
from distal.units import quantity

ODD = {path.stem: path for path in (Path(__file__).with_name("odd_rigs")).glob("*.toml")}
ARROWS = ("↺", "↻", "○")
RIGS = [*shipped_rigs(), *sorted(ODD)]


def rig_of(name: str) -> Rig:
    return load_rig(ODD.get(name, name))


def texts_of(rig: Rig) -> list[str]:
    return [text.get_text() for text in draw_rig(rig).axes[0].texts]


def boxes_of(made: Figure) -> list[tuple[str, Any]]:
    """Return each text of a figure with its box [pixels]."""
    made.set_dpi(150)  # as images are saved
    canvas = FigureCanvasAgg(made)
    canvas.draw()
    texts = [text for text in made.axes[0].texts if text.get_text()]
    return [(text.get_text(), text.get_window_extent(canvas.get_renderer())) for text in texts]


def crossings_of(rig: Rig, tendon: str) -> list[str]:
    """Return for each joint that a tendon turns, from the left, its arrow and the first line below
    it.
    """
    axes = draw_rig(rig).axes[0]
    names = [text for text in axes.texts if text.get_text() == tendon]
    (name,) = (text for text in names if text.get_position()[0] > GAP)
    at = {tuple(text.get_position()): text.get_text() for text in axes.texts}
    level = name.get_position()[1]
    arrows = sorted(xy for xy, text in at.items() if text in ARROWS and xy[1] == level)
    below = (
        max((xy for xy in at if xy[0] == x and xy[1] < y), key=lambda xy: xy[1]) for x, y in arrows
    )
    return [f"{at[arrow]} {at[text]}" for arrow, text in zip(arrows, below)]


@pytest.mark.parametrize("name", RIGS)
def test_texts_are_inside_and_apart_from_each_other_and_from_tendons(name: str) -> None:
    made = draw_rig(rig_of(name))
    boxes = boxes_of(made)
    assert len(boxes) > 10
    for text, box in boxes:
        outside = min(box.x0, box.y0, made.bbox.width - box.x1, made.bbox.height - box.y1) < 0
        assert not outside, f"{text} leaves the figure"
    for (text, a), (other, b) in combinations(boxes, 2):
        across, up = min(a.x1, b.x1) - max(a.x0, b.x0), min(a.y1, b.y1) - max(a.y0, b.y0)
        # boxes are as high as the tallest letters of a font: a pixel of air may be shared
        assert across <= 1.0 or up <= 1.5, f"{text} lies on {other}"
    (axes,) = made.axes
    for line in axes.lines:  # of tendons and joints
        ends = axes.transData.transform(line.get_xydata())
        (x0, y0), (x1, y1) = ends.min(axis=0), ends.max(axis=0)
        for text, box in boxes:
            across = min(x1, box.x1) - max(x0, box.x0)
            up = min(y1, box.y1) - max(y0, box.y0)
            assert min(across, up) <= -1.0, f"a line lies on {text}"
    for shape in axes.collections:  # of drives and joints
        frame = axes.transData.transform_bbox(shape.get_paths()[0].get_extents())
        for text, box in boxes:
            if frame.contains(box.x0, (box.y0 + box.y1) / 2):
                assert frame.contains(box.x1, box.y1), f"{text} leaves its frame"


@pytest.mark.parametrize("name", RIGS)
def test_each_part_is_named_once_and_each_sensor_stands_at_its_part(name: str) -> None:
    rig = rig_of(name)
    texts = draw_rig(rig).axes[0].texts
    bold = [t for t in texts if t.get_fontweight() == "bold" and t.get_text() not in ARROWS]
    named = Counter(text.get_text() for text in bold if text.get_fontsize() == FONT)
    assert named == Counter([*rig.joint_names, *rig.drive_names, *rig.tendon_names])
    sensors = [text.get_text()[2:] for text in texts if text.get_text().startswith("◉ ")]
    assert sorted(text.split(":")[0] for text in sensors if ":" in text) == sorted(rig.sensor_names)


def test_a_tendon_turns_each_joint_the_way_the_rig_says() -> None:
    rig = load_rig("finger-n-plus-1")
    assert crossings_of(rig, "t1") == ["↺ +8 mm", "↺ +7 mm", "↺ +6 mm"]
    assert crossings_of(rig, "t3") == ["↻ −8 mm", "↺ +7 mm"]
    flipped = rig.with_values({"tendons.t1.crossings.1.side": -1})
    assert crossings_of(flipped, "t1") == ["↺ +8 mm", "↻ −7 mm", "↺ +6 mm"]


def test_a_tendon_goes_from_its_drive_to_the_last_joint_that_it_turns() -> None:
    lines = draw_rig(load_rig("finger-n-plus-1")).axes[0].lines
    drawn = [line.get_xdata() for line in lines if line.get_color() in COLOURS]
    ends = [float(places[-1]) for places in drawn]
    assert ends[0] == ends[1] > ends[2] == ends[3]  # the last two end at pip, before dip
    assert list(map(len, drawn)) == [4, 4, 3, 3]  # its drive, then joints


def test_the_box_of_a_drive_reaches_along_all_its_tendons() -> None:
    axes = draw_rig(load_rig("wrist-instrument")).axes[0]
    boxes = [shape.get_paths()[0].get_extents() for shape in axes.collections]
    starts = [line.get_xydata()[0] for line in axes.lines if line.get_color() in COLOURS]
    held = [sum(box.contains(x - GAP / 4, y) for x, y in starts) for box in boxes]
    assert held == [0, 0, 0, 2, 2, 2]


def test_the_sign_of_a_drive_that_pulls_a_tendon_in() -> None:
    assert [t for t in texts_of(load_rig("wrist-instrument")) if "pulled" in t] == [
        "pulled in by +φ",
        "pulled in by −φ",
    ] * 3
    assert "pulled in by +x" in texts_of(load_rig("paper-2008"))
    raw = load_rig("wrist-instrument").with_values({"tendons.yaw_a.side": -1})
    assert texts_of(raw).count("pulled in by −φ") == 4


def test_numbers_have_fitting_units() -> None:
    sizes = ((23e3, "N/m"), (806.0, "N/m"), (0.00953, "m"), (0.15, "N m/rad"), (-0.1, "rad"))
    assert [quantity(*size) for size in sizes] == [
        "23 kN/m",
        "806 N/m",
        "9.53 mm",
        "150 mN·m/rad",
        "−5.73°",
    ]
    sizes = ((0.0, "rad"), (0.015, "kg"), (0.0, "m"), (5e-6, "m"), (12.3456, "m"), (0.1, ""))
    said = ["0°", "15 g", "0 mm", "0.005 mm", "12346 mm", "0.1"]
    assert [quantity(*size) for size in sizes] == said


@pytest.mark.parametrize(
    ("name", "lines"),
    [
        ("lab-bench", "radius 5 mm|stops −50° … 50°|◉ motor_angle: position, gear 30"),
        ("finger-underactuated", "on pip, axis y|at [25, 0, 0] mm|spring rest angle −10°"),
        ("paper-2008", "slider|stops −2.5 mm … 7.5 mm|pinned|friction radius 3.18 mm"),
        ("one_joint", "extension spring stiffness 200 N/m|slack 1 mm|path friction 0.1"),
        ("one_joint", "path wrap 180°|gravity hanging angle 30°|◉ torque: torque"),
        ("long_names", "backlash width 1.15°|stops −172° … 172°|+40 mm"),
        ("two_on_the_base", "coupled to a|coupled ratio −0.8|coupled offset 5.73°|on c, axis −x"),
        ("two_on_the_base", "on base, axis y|at [0, 30, 0] mm|0 mm|polynomial|linkage"),
    ],
)
def test_what_is_written_at_the_parts(name: str, lines: str) -> None:
    assert set(lines.split("|")) <= set(texts_of(rig_of(name)))


def test_an_axis_of_three_numbers_is_written_out() -> None:
    rig = load_rig("finger-2n").with_values({"joints.pip.axis": [-0.5, 0.01, 0.7]})
    assert "on mcp, axis −0.58x +0.012y +0.81z" in texts_of(rig)


def test_gravity_is_told_in_the_frame_of_the_world() -> None:
    rig = load_rig("hand").with_values({"base.orientation": ["0 deg", "90 deg", "0 deg"]})
    words = " ".join(texts_of(rig))
    assert "Gravity [0, 0, −9.81] m/s², base turned by [0, 90, 0]°" in words
    assert "Gravity" not in " ".join(texts_of(load_rig("template")))


def test_fingers_that_nothing_connects_are_drawn_below_one_another() -> None:
    assert draw_rig(load_rig("hand")).get_figwidth() < 12.5
    joints = load_rig("hand").joint_names
    assert [n for n in texts_of(load_rig("hand")) if n in joints] == joints


def test_a_drawing_is_valid_svg_and_says_what_it_shows(tmp_path: Path) -> None:
    element = ElementTree.fromstring(rig_svg(load_rig("paper-2008")))
    assert element.get("role") == "img"
    label = element.get("aria-label", "")
    assert label.startswith("Drawing of the rig Nylon-tendon disk")
    assert "drives left (slider), right (slider)" in label
    save_figure(draw_rig(load_rig("paper-2008")), tmp_path / "rig.svg")
    alone = ElementTree.parse(tmp_path / "rig.svg").getroot()
    assert alone.findtext("{http://www.w3.org/2000/svg}title") == label


@pytest.mark.parametrize("suffix", ["svg", "pdf", "png"])
def test_the_command_writes_each_format(suffix: str, tmp_path: Path) -> None:
    out = tmp_path / f"rig.{suffix}"
    assert CliRunner().invoke(app, ["rig", "draw", "template", "--out", str(out)]).exit_code == 0
    assert out.read_bytes()[:5] == {"svg": b"<?xml", "pdf": b"%PDF-", "png": b"\x89PNG\r"}[suffix]
