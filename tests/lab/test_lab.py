"""The lab in headless Chromium: its numbers are Python's, it is used by keys, it fits, and it is quick."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from distal import Rig, estimate, load_rig, read_log
from distal.cli.app import app
from distal.errors import ExportError
from distal.estimators import external_torques_of, make_estimator
from distal.export.plant import c_plant
from distal.kernels import Kernel
from distal.lab import lab_page
from distal.simulation.inputs import BodyInputs
from distal.simulation.plant import at_rest, plant_function
from tests.browser import BROWSER, Page, opened

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(BROWSER is None, reason="needs a browser"),
    pytest.mark.skipif(importlib.util.find_spec("ziglang") is None, reason="needs ziglang"),
]
LOAD = "document.querySelector('input[name=load]')"
NAMES = ("template", "wrist-instrument", "da-vinci-grasper")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("lab")


@pytest.fixture(scope="module", params=NAMES)
def rig(request: pytest.FixtureRequest) -> Rig:
    # of the chain's joints each has a torque that nobody measures
    return load_rig(
        request.param, ["joints.*.external_torque.std=0.05 N m"] if request.param == "wrist-instrument" else ()
    )


@pytest.fixture(scope="module")
def path(rig: Rig, folder: Path) -> Path:
    return lab_page(rig, folder / f"{len(rig.joints)}-{len(rig.sensors)}.html")


@pytest.fixture(scope="module")
def page(path: Path) -> Iterator[Page]:
    with opened(path) as page:
        for _ in range(200):
            if page.value("'first' in lab.dataset"):
                break
            time.sleep(0.05)
        yield page


def moved(rig: Rig, pulls: np.ndarray) -> np.ndarray:
    """Return the coordinates after each sample, by the plant's kernel in Python."""
    made = c_plant(rig, "plant")
    n, nj = made.plant.n_bodies, made.plant.n_joints
    held = BodyInputs(np.zeros((1, n)), np.zeros((1, n)), np.zeros((1, n, 3)))
    held.effort[0, nj:] = [drive.nominal_force.value for drive in rig.drives]
    kernel = Kernel(plant_function(made.plant, made.count))
    carry, _ = at_rest(made.plant, held, made.start, kernel)
    rows = np.column_stack(
        [np.repeat(pulls, made.parts, axis=0), np.full(made.parts * len(pulls), made.interval / made.parts)]
    )
    ys = kernel.scan(carry, rows, made.plant.parameters.values)[1]
    return ys[made.parts - 1 :: made.parts, :nj]


@pytest.mark.compiled
def test_the_numbers_are_pythons(page: Page, rig: Rig, folder: Path) -> None:
    """The motion and the estimate over 5 s to 1e-9 and over 60 s to 1e-6, from the log that the page saves."""
    page.value("lab.pause()")
    nj = len(rig.joints)
    for duration, tolerance in ((5.0, 1e-9), (60.0, 1e-6)):
        interval = 1 / max(sensor.rate for sensor in rig.sensors)
        script = f"""(() => {{
          lab.begin();
          const pulls = [], rows = [lab.last()];
          for (let k = 0; k < {round(duration / interval) - 1}; k++) {{
            lab.run({interval}); pulls.push(lab.acted()); rows.push(lab.last());
          }}
          return {{ pulls, rows, csv: lab.csv() }};
        }})()"""
        found = page.value(script)
        rows, pulls = (
            np.array([[np.nan if x is None else x for x in row] for row in found["rows"]]),
            np.array(found["pulls"]),
        )
        np.testing.assert_allclose(rows[1:, 1 : 1 + 4 * nj : 4], moved(rig, pulls), atol=tolerance)
        (folder / "lab.csv").write_text(found["csv"])
        log = read_log(folder / "lab.csv", rig)
        known = estimate(log, rig)
        np.testing.assert_allclose(rows[:, 2 : 1 + 4 * nj : 4], known.angles, atol=tolerance)
        np.testing.assert_allclose(rows[:, 3 : 1 + 4 * nj : 4], known.angle_stds, atol=tolerance)
        plain = estimate(log, rig, "inextensible")
        np.testing.assert_allclose(rows[:, 4 : 1 + 4 * nj : 4], plain.angles, atol=tolerance)
        assert np.abs(np.diff(rows[:, 1])).max() > 1e-4  # it moves


@pytest.mark.compiled
def test_the_drawn_torques_are_each_joints_own(page: Page, rig: Rig, folder: Path) -> None:
    """The true torque is what acts on that joint, the told one and its std are Python's estimate from the saved log."""
    page.value("lab.pause()")
    torques = page.value("JSON.parse(document.getElementById('lab-data').textContent).torques")
    names, nj = [joint.name for joint in rig.joints], len(rig.joints)
    assert len(torques) == sum(joint.external_torque.std > 0 for joint in rig.joints)
    for k, (_, _, joint) in enumerate(torques):
        page.value(f"document.getElementById('joint').value = '{joint}'")
        page.value("document.getElementById('joint').dispatchEvent(new Event('change'))")
        page.value(f"{LOAD}.value = {LOAD}.max")
        found = page.value("(lab.begin(), lab.run(3), { last: lab.last(), acted: lab.acted(), csv: lab.csv() })")
        row = np.array(found["last"][1 + 4 * nj + 3 * k :][:3])
        assert row[0] == found["acted"][joint] > 0.0
        (folder / "touched.csv").write_text(found["csv"])
        known = estimate(read_log(folder / "touched.csv", rig), rig)
        at = external_torques_of(make_estimator("adaptive", rig))[names[joint]]
        assert row[1] == pytest.approx(known.means[-1, at], abs=1e-9)
        assert row[2] == pytest.approx(np.sqrt(known.variances[-1, at]), abs=1e-9)
    page.value(f"{LOAD}.value = 0; lab.begin()")


@pytest.mark.compiled
def test_a_sensor_that_is_dead_from_the_beginning(page: Page, rig: Rig, folder: Path) -> None:
    """Begun anew with a dead sensor: it tells one value, and the saved log gives the page's angles."""
    page.value("lab.pause(); document.getElementById('dead-0').checked = true; lab.begin(); lab.run(2); lab.begin()")
    found = page.value("lab.run(2), { last: lab.last(), csv: lab.csv() }")
    page.value("document.getElementById('dead-0').checked = false; lab.begin()")
    (folder / "dead.csv").write_text(found["csv"])
    nj, known = len(rig.joints), estimate(read_log(folder / "dead.csv", rig), rig)
    np.testing.assert_allclose(found["last"][2 : 1 + 4 * nj : 4], known.angles[-1], atol=1e-9)
    assert np.isfinite(read_log(folder / "dead.csv", rig).channels[rig.sensors[0].name]).sum() == 1


def test_it_is_used_by_keys(page: Page, rig: Rig) -> None:
    """A slider changes what is true, a button sets them all, a dead sensor is told; without a mouse."""
    page.value("lab.begin()")
    said = "document.getElementById('friction-said').textContent"
    assert page.value(said) == "1.00 ×"
    page.value("document.querySelector('input[name=friction]').focus()")
    for _ in range(10):
        page.press("ArrowRight", 39)
    assert page.value(said) == "1.15 ×"
    page.value("document.querySelector('button[data-set*=stiffness]').focus()")
    page.press("Enter", 13)
    time.sleep(0.4)
    assert page.value(said) == "1.00 ×"
    assert page.value("document.getElementById('stiffness-said').textContent") == "0.50 ×"
    assert "half as stiff" in page.value("document.getElementById('why').textContent")
    page.value("document.getElementById('dead-0').focus()")
    page.press(" ", 32)
    page.value("document.getElementById('dead-0').checked || document.getElementById('dead-0').click()")
    page.value("lab.run(1)")
    time.sleep(0.5)
    assert page.value("document.getElementById('health').textContent").startswith("dead")
    assert ",," in page.value("lab.csv()") or "\n," in page.value("lab.csv()")
    page.value("document.querySelector('button[data-set]').click()")
    page.value("lab.begin(); lab.run(8)")
    time.sleep(0.4)
    verdict = page.value("document.getElementById('verdict').textContent")
    assert f"Without a sensor in {rig.joints[-1].name}, its angle is known to ±" in verdict
    named = "e.textContent || (e.labels && e.labels.length)"
    unnamed = f"[...document.querySelectorAll('button, input, select')].filter((e) => !({named})).length"
    assert page.value(unnamed) == 0


def test_a_link_is_pulled_by_the_mouse(page: Page) -> None:
    """The pull of the hand has the sign of where the pointer is; it ends when the button is let go."""
    page.value("lab.begin(); lab.run(3)")
    corner = "document.getElementById('rig').getBoundingClientRect()"
    box = page.value(f"(({{left, top, width, height}}) => [left, top, width, height])({corner})")
    x, y = box[0] + 0.6 * box[2], box[1] + 0.5 * box[3]
    page.ask("Input.dispatchMouseEvent", type="mousePressed", x=x, y=y, button="left", clickCount=1)
    page.ask("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y + 60, button="left")
    page.value("lab.run(0.2)")
    bodies = page.value("lab.acted().length / 5")
    held = page.value("lab.acted()")[2 * int(bodies) : 3 * int(bodies)]
    assert max(held[: int(bodies)]) > 0
    page.ask("Input.dispatchMouseEvent", type="mouseReleased", x=x, y=y, button="left", clickCount=1)
    joints = page.value("JSON.parse(document.getElementById('lab-data').textContent).joints.length")
    page.value("lab.run(0.1)")
    assert page.value("lab.acted()")[2 * int(bodies) : 2 * int(bodies) + joints] == [0] * joints


def test_it_is_small_and_quick(page: Page, path: Path) -> None:
    assert path.stat().st_size <= 400_000
    text = path.read_text(encoding="utf-8")
    assert "http://" not in text
    assert "https://" not in text
    page.value(
        "lab.times = []; document.getElementById('play').textContent === 'Pause' || document.getElementById('play').click()"
    )
    time.sleep(1.5)
    times = page.value("lab.times")
    assert len(times) > 20
    assert np.median(times) <= 8.0


def test_it_is_legible_on_a_telephone(path: Path) -> None:
    with opened(path, "", 400, 800) as page:
        time.sleep(1.0)
        assert page.value("document.documentElement.scrollWidth") <= 400
        assert page.value("document.getElementById('angles').getBoundingClientRect().width") > 330


def test_the_command_and_without_ziglang(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    done = CliRunner().invoke(app, ["lab", "capstan-joint", "--out", str(tmp_path / "lab.html")])
    assert done.exit_code == 0, done.output
    assert "one file of" in done.output
    assert "distal estimate lab.csv --rig capstan-joint -e adaptive" in (tmp_path / "lab.html").read_text(
        encoding="utf-8"
    )
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ExportError, match=r"ziglang; pip install '\.\[lab\]'"):
        lab_page(load_rig("capstan-joint"), tmp_path / "other.html")
    assert not (tmp_path / "other.html").exists()
