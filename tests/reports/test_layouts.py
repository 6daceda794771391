"""Layouts for PlotJuggler and Foxglove: they name what a stream sends and records."""

from __future__ import annotations

import json
import re
from pathlib import Path
from xml.etree import ElementTree

from distal.logs import ESTIMATE_TOPIC, SAMPLE_TOPIC, estimate_schema

FOLDER = Path(__file__).parents[2] / "examples" / "live"
SENT = set(estimate_schema(("joint",), ("external_torque",))["properties"])  # type: ignore[call-overload]


def test_plotjuggler() -> None:
    root = ElementTree.parse(FOLDER / "plotjuggler.xml").getroot()
    names = {curve.attrib["name"] for curve in root.iter("curve")}
    live = {name.removeprefix("/") for name in names if name.startswith("/")}
    recorded = {
        name.removeprefix(f"{ESTIMATE_TOPIC}/") for name in names if not name.startswith("/")
    }
    assert live == recorded
    assert {"theta", "theta_std"} < live <= SENT
    for splitter in root.iter("DockSplitter"):
        sizes = [float(size) for size in splitter.attrib["sizes"].split(";")]
        assert len(sizes) == int(splitter.attrib["count"]) == len(list(splitter))
        assert sum(sizes) == 1.0


def test_foxglove() -> None:
    held = json.loads((FOLDER / "foxglove.json").read_text(encoding="utf-8"))
    panels = set(held["configById"])
    assert set(re.findall(r"\w+!\w+", json.dumps(held["layout"]))) == panels
    for panel in held["configById"].values():
        for path in panel.get("paths", []):
            topic, _, field = path["value"].partition(".")
            assert topic == ESTIMATE_TOPIC
            assert field in SENT
    assert held["configById"]["RawMessages!sample"]["topicPath"] == SAMPLE_TOPIC
