"""The moving chain of `distal view`: where its joints stand, how it is played and scrubbed, what a
frame costs.
"""

from __future__ import annotations

import json
import re
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from distal import Estimate, Log, Rig, estimate, load_rig, load_scenario, simulate
from distal.reports import view_page
from tests.browser import BROWSER, Page, opened

pytestmark = pytest.mark.skipif(BROWSER is None, reason="needs a browser")


@pytest.fixture(scope="module")
def rig() -> Rig:
    return load_rig("wrist-instrument")


@pytest.fixture(scope="module")
def log(rig: Rig) -> Log:
    return simulate(rig, load_scenario("wrist", ['duration="3 s"']), 1)


@pytest.fixture(scope="module")
def result(log: Log, rig: Rig) -> Estimate:
    return estimate(log, rig)


@pytest.fixture(scope="module")
def path(result: Estimate, log: Log, rig: Rig, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return view_page(
        result, log, rig, tmp_path_factory.mktemp("moving") / "view.html", ["consistent"]
    )


@pytest.fixture(scope="module")
def page(path: Path) -> Iterator[Page]:
    with opened(path) as page:
        yield page


def test_joints_stand_where_the_angles_put_them(page: Page, result: Estimate, rig: Rig) -> None:
    for k in (0, len(result) // 2, len(result) - 1):
        at, turn, expected = np.zeros(3), Rotation.identity(), []
        for j, joint in enumerate(rig.joints):  # each sits on the one before it
            at = at + turn.apply(joint.offset)
            expected.append(at)
            turn = turn * Rotation.from_rotvec(result.angles[k, j] * np.array(joint.axis))
        # angles are rounded to a ten-thousandth of a radian
        np.testing.assert_allclose(page.value(f"moving.placesAt({k})"), expected, atol=1e-5)


def test_tensions_are_those_of_the_sensors(tmp_path: Path) -> None:
    rig = load_rig("finger-underactuated")
    servo = {"angle": {"amplitude": 0.5, "frequency": 0.4}, "stiffness": 20.0, "damping": 0.3}
    from distal.simulation import build_scenario

    scenario = build_scenario(
        {"rig": rig.name, "duration": 0.5, "drives": {"flexor": {"servo": servo}}}, "s"
    )
    log = simulate(rig, scenario, 1)
    text = view_page(estimate(log, rig), log, rig, tmp_path / "view.html").read_text(
        encoding="utf-8"
    )
    found = re.search(r"id='moving-data'>(.*?)</script>", text)
    assert found is not None
    data = json.loads(found[1])
    (tendon,), (tension,) = data["tendons"], data["tensions"]
    np.testing.assert_allclose(tendon["crossings"], [[0, 0.009], [1, 0.007], [2, 0.005]], rtol=1e-9)
    np.testing.assert_allclose(tension, log.channels["tau_flexor"] / 0.006, atol=0.006)


def test_it_is_played_and_scrubbed_by_keys(page: Page) -> None:
    clock = "document.querySelector('#moving output').textContent"
    assert page.value(clock).startswith("0.00 s of")
    page.value("document.querySelector('#moving button').focus()")
    page.press("Enter", 13)
    time.sleep(0.7)
    page.press("Enter", 13)
    after = float(page.value(clock).split()[0])
    assert 0.1 < after < 3.0
    page.value("document.querySelector('#moving input').focus()")
    page.press("End", 35)
    assert (
        page.value(clock) == "3.00 s of 3.00 s"
        or page.value(clock).split()[0] == page.value(clock).split()[3]
    )
    assert page.value("document.querySelector('#moving button').textContent") == "Play"
    # the line in the curves has gone to the end too
    assert page.value(
        "[...document.querySelectorAll('.js-plotly-plot > div')].some(d => d.style.width === '1px')"
    )


@pytest.mark.more
@pytest.mark.slow
def test_frames_are_quick_and_nothing_is_cut_off(path: Path) -> None:
    """30 frames a second leave 33 ms for each; half of that is for the browser itself."""
    for width in (1400, 400):
        with opened(path, "#play", width, 900) as page:
            time.sleep(1.0)
            assert page.value("document.documentElement.scrollWidth") <= width
            assert float(page.value("moving.dataset.work")) < 15.0
            assert int(page.value("moving.dataset.frames")) > 5
