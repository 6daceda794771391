"""The lab of the paper's rig that the site and the demo show is what the package writes now."""

from __future__ import annotations

import json
import re
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from tools.lab.html_page import STIFF, _largest_load, _motion, _positions, _servo
from tools.lab.plant_source import ExportedPlant, c_plant
from tools.lab.webassembly import _GLUE

from distal import Rig, load_rig
from distal.rig.components import REACH

SHOWN = Path(__file__).parents[2] / "docs" / "lab.html"


def test_the_page_that_is_shown_is_of_now() -> None:
    """`make lab` writes it; what ziglang makes of the same C may differ from version to version."""
    text = SHOWN.read_text(encoding="utf-8")
    for package, name in (
        ("tools.lab", "lab.js"),
        ("tools.lab", "lab.css"),
        ("tools.lab", "chain.js"),
    ):
        shown = resources.files(package).joinpath(name).read_text(encoding="utf-8")
        assert shown in text
    found = re.search(r"id='lab-data'>(.*?)</script>", text)
    assert found is not None
    data = json.loads(found[1])
    assert data["joints"] == ["link"]
    assert len(data["code"]) > 40_000


def test_what_scripts_read_is_what_pages_hold() -> None:
    """A name that only one of both has shows itself in a browser alone, as an empty page."""
    shown = SHOWN.read_text(encoding="utf-8")
    found = re.search(r"id='lab-data'>(.*?)</script>", shown)
    assert found is not None
    script = resources.files("tools.lab").joinpath("lab.js").read_text(encoding="utf-8")
    assert set(re.findall(r"\bdata\.(\w+)", script)) <= set(json.loads(found[1]))
    viewed = set(re.findall(r'view\("(\w+)"', script))
    exported = set(re.findall(r"EXPORTED\((\w+)\)", _GLUE))
    assert viewed
    assert viewed <= exported


@pytest.fixture(scope="module")
def capstan() -> tuple[Rig, ExportedPlant]:
    rig = load_rig("capstan-joint").with_values({"joints.0.initial": 0.1})
    return rig, c_plant(rig, "plant")


def test_joints_swing_within_their_stops_each_at_a_pace_of_its_own() -> None:
    """About the middle, over 70 % of the range and ± 1.2 rad at most; without stops about
    where it begins.
    """
    rig = load_rig("finger-2n").with_values(
        {"joints.0.stops": [-0.3, 1.5], "joints.1.stops": [-4.0, 2.0]}
    )
    first, second = _motion(rig)
    assert (first["centre"], first["amplitude"]) == pytest.approx((0.6, 0.35 * 1.8))
    assert (second["centre"], second["amplitude"]) == pytest.approx((-1.0, REACH))
    assert [row["from"] for row in (first, second)] == [joint.initial.value for joint in rig.joints]
    assert first["pace"] == 1.0
    assert 0.5 < second["pace"] < 1.0
    free_rig = load_rig("capstan-joint").with_values(
        {"joints.0.initial": 0.2, "joints.0.stops": None}
    )
    (free,) = _motion(free_rig)
    found = (free["from"], free["centre"], free["amplitude"])
    assert found == pytest.approx((0.2, 0.2, 0.35 * 2.0 * REACH))


def test_drives_stand_where_their_tendons_are_as_taut_as_at_the_start(
    capstan: tuple[Rig, ExportedPlant],
) -> None:
    """Of a capstan without torque r θ/R from its place at the start, at angles on both sides that
    the joint is led to.
    """
    rig, plant = capstan
    (table,), (motion,) = _positions(rig, plant), _motion(rig)
    radius, arm = rig.drives[0].radius.value, rig.tendons[0].arms()["jaw"]  # type: ignore[union-attr]
    angles = np.linspace(table["from"], table["to"], len(table["rows"]))
    assert table["from"] <= motion["centre"] - motion["amplitude"] + 1e-12
    assert table["to"] >= motion["centre"] + motion["amplitude"] - 1e-12
    assert (table["from"] + table["to"]) / 2 == pytest.approx(motion["from"])
    np.testing.assert_allclose(
        np.ravel(table["rows"]), abs(arm) / radius * (angles - motion["from"]), atol=1e-6
    )


def test_position_loops_are_stiff_and_damped_at_seven_tenths(
    capstan: tuple[Rig, ExportedPlant],
) -> None:
    """Twenty times the tendons' Σ k R², and c = 2 · 0.7 √(k J)."""
    rig, plant = capstan
    drive = rig.drives[0]
    tendons = sum(tendon.stiffness.value for tendon in rig.tendons) * drive.radius.value**2  # type: ignore[union-attr]
    ((stiffness, damping),) = _servo(plant)
    assert stiffness == pytest.approx(STIFF * tendons)
    assert damping / (2 * np.sqrt(stiffness * drive.inertia.value)) == pytest.approx(0.7)  # type: ignore[union-attr]


def test_the_largest_load_is_half_of_what_the_tendons_hold() -> None:
    """Σ |r| T of the tendon that holds most, to one digit; one that is just straight holds what
    half a millimetre gives.
    """
    rig = load_rig("capstan-joint")
    arm, stiffness = abs(rig.tendons[0].arms()["jaw"]), rig.tendons[0].stiffness.value
    assert _largest_load(rig, np.array([20.0, 50.0])) == float(f"{0.5 * 50.0 * arm:.1g}")
    assert _largest_load(rig, np.array([0.0, 0.05])) == float(f"{0.5 * 5e-4 * stiffness * arm:.1g}")
    slack = rig.with_values({"tendons.*.stiffness": 1e-3})
    assert _largest_load(slack, np.zeros(2)) == 1e-3
