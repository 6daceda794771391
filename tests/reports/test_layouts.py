"""The layout for PlotJuggler: it names what a stream sends."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

FOLDER = Path(__file__).parents[2] / "examples" / "live"
SENT = {"t", "theta", "theta_std", "external_torque", "external_torque_std", "health", "detail"}


def test_plotjuggler() -> None:
    root = ElementTree.parse(FOLDER / "plotjuggler.xml").getroot()
    names = {curve.attrib["name"] for curve in root.iter("curve")}
    live = {name.removeprefix("/") for name in names}
    assert {"theta", "theta_std"} < live <= SENT
    for splitter in root.iter("DockSplitter"):
        sizes = [float(size) for size in splitter.attrib["sizes"].split(";")]
        assert len(sizes) == int(splitter.attrib["count"]) == len(list(splitter))
        assert sum(sizes) == 1.0
