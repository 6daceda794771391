"""The lab in headless Chromium: its numbers are Python's, it is used by keys, it fits, and it is
quick.
"""

from __future__ import annotations

import importlib.util
import re
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from tools.lab import lab_page
from tools.lab.__main__ import main
from tools.lab.plant_source import c_plant

from distal import Rig, estimate, load_rig, read_log
from distal.confidence import BAND
from distal.errors import ExportError
from distal.estimators import external_torques_of, make_estimator
from distal.model import Mechanism
from distal.rig import number
from tests.browser import BROWSER, Page, opened
from tests.lab.test_plant import by_kernel

pytestmark = [
    pytest.mark.more,  # a browser; what the page holds is in test_page
    pytest.mark.slow,
    pytest.mark.skipif(BROWSER is None, reason="needs a browser"),
    pytest.mark.skipif(importlib.util.find_spec("ziglang") is None, reason="needs ziglang"),
]
BUTTONS = "document.querySelectorAll('button[data-set]')"
NAMES = (
    "template",
    pytest.param("wrist-instrument", marks=pytest.mark.more),
    pytest.param("da-vinci-grasper", marks=pytest.mark.more),
)
of_a_chain_too = pytest.mark.parametrize(
    "rig", ["template", "wrist-instrument", NAMES[-1]], indirect=True
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("lab")


@pytest.fixture(scope="module", params=NAMES)
def rig(request: pytest.FixtureRequest) -> Rig:
    # of the chain's joints each has a torque that nobody measures
    return load_rig(
        request.param,
        ["joints.*.external_torque.std=0.05 N m"] if request.param == "wrist-instrument" else (),
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


def text(page: Page, name: str) -> str:
    return str(page.value(f"document.getElementById('{name}').textContent"))


def set_by_hand(page: Page, value: str, name: str) -> None:
    """Move a slider as a hand does: with its event."""
    page.value(
        f"(() => {{ const one = document.querySelector('input[name={name}]'); one.value = {value}; "
        "one.dispatchEvent(new Event('input')); }})()".replace("}}", "}")
    )


def choose(page: Page, joint: int) -> None:
    """Show a joint in the curves."""
    page.value(f"document.getElementById('joint').value = '{joint}'")
    page.value("document.getElementById('joint').dispatchEvent(new Event('change'))")


def times(rig: Rig, factor: float, *names: str) -> dict[str, object]:
    """Return the numbers of a rig whose path ends with one of some names, times a factor."""
    paths = [
        path
        for path in Mechanism(rig).parameters.names
        if re.search(rf"({'|'.join(names)})$", path)
    ]
    return {path: factor * number(rig, path).value for path in paths}


def changed(rig: Rig, settings: dict[str, float]) -> Rig:
    """Return the rig that is true: what sliders say, written down without looking at the page's
    list of numbers.
    """
    friction = times(
        rig,
        settings["friction"],
        r"friction\.(coefficient|constant|load)",
        r"hysteresis\.(constant|slope)",
    )
    stiffness = times(rig, settings["stiffness"], r"tendons\.\d+\.stiffness")
    pretension = times(rig, settings["pretension"], r"pretension")
    arms = times(rig, settings["arm"], r"(insertion|crossings\.\d+)\.(radius|offset|lever|arm)")
    return rig.with_values({**friction, **stiffness, **pretension, **arms})


ACT = """(() => {{ {first}; lab.begin(); const pulls = [];
  for (let k = 0; k < {steps}; k++) {{ lab.run({interval}); pulls.push(lab.acted()); }}
  const drawn = lab.drawn(), settings = {{}};
  for (const one of document.querySelectorAll('input[type=range]'))
    settings[one.name] = one.dataset.log === undefined ? Number(one.value) : 2 ** Number(one.value);
  return {{ pulls, drawn, settings, csv: lab.csv() }}; }})()"""


def compare(page: Page, rig: Rig, folder: Path, first: str, joint: int) -> dict[str, float]:
    """Act, and compare each number that is drawn after 5 s with Python's; return the sliders'
    values.
    """
    interval = 1 / max(sensor.rate for sensor in rig.sensors)
    found = page.value(ACT.format(first=first, steps=round(5.0 / interval), interval=interval))
    (folder / "drawn.csv").write_text(found["csv"])
    log = read_log(folder / "drawn.csv", rig)
    known, plain = estimate(log, rig), estimate(log, rig, "inextensible")
    pulls = np.array(found["pulls"])
    truth, identified, half, rough = np.rad2deg(
        [
            by_kernel(c_plant(rig, "plant"), pulls, changed(rig, found["settings"]))[1][:, joint],
            known.angles[1:, joint],
            BAND * known.angle_stds[1:, joint],
            plain.angles[1:, joint],
        ]
    )
    drawn = {
        "angles": [truth, identified, rough, identified - half, identified + half],
        "errors": [identified - truth, rough - truth, -half, half],
    }
    torques = external_torques_of(make_estimator("adaptive", rig))
    if rig.joints[joint].name in torques:
        at = torques[rig.joints[joint].name]
        touched, std = known.means[1:, at], np.sqrt(known.variances[1:, at])
        drawn["torque"] = [pulls[:, joint], touched, touched - BAND * std, touched + BAND * std]
    for name, columns in drawn.items():
        rows = np.array(found["drawn"][name])
        rows = rows[rows[:, 0] > 0.0]  # the first sample is before the first step
        at = np.round(rows[:, 0] / interval).astype(int) - 1
        assert len(at) > 100
        np.testing.assert_allclose(rows[:, 1:], np.column_stack(columns)[at], atol=1e-9)
    return dict(found["settings"])


@pytest.mark.more
@of_a_chain_too
def test_what_is_drawn_is_pythons_in_all_experiments_in_turn(
    page: Page, rig: Rig, folder: Path
) -> None:
    """Angle, band, and torques true and told, of each joint; what one experiment set the
    next one has not.
    """
    page.value("lab.pause()")
    last = len(rig.joints) - 1
    for joint in range(last + 1):
        choose(page, joint)
        # the experiments act on all joints: one joint shows them, the others what is theirs
        for k in range(page.value(f"{BUTTONS}.length") if joint == last else 1):
            settings = compare(page, rig, folder, f"{BUTTONS}[{k}].click()", joint)
            desired = page.value(f"JSON.parse({BUTTONS}[{k}].dataset.set)")
            for name, value in settings.items():
                plain = {"load": 0.0, "desired": 0.0, "range": 0.7, "speed": 0.15}.get(name, 1.0)
                expected = (
                    desired.get(name, 0.0)
                    if name == "load"
                    else 2 ** desired[name]
                    if name in desired
                    else plain
                )
                assert value == pytest.approx(expected, rel=0.02), name  # a slider moves in steps
            assert page.value(
                "document.querySelectorAll('input[type=checkbox]:checked').length"
            ) == len(desired.get("dead", []))
            assert text(page, "why") == page.value(f"{BUTTONS}[{k}].dataset.why")
            pressed = page.value(f"[...{BUTTONS}].map((one) => one.getAttribute('aria-pressed'))")
            assert [one == "true" for one in pressed] == [i == k for i in range(len(pressed))]


def test_a_joint_is_brought_to_a_desired_angle(page: Page, rig: Rig) -> None:
    """The inverse moves the drives: the joint goes where the slider says, to both sides, and stays
    when it is let go.
    """
    page.value("lab.pause()")
    choose(page, 0)
    page.value("document.querySelector('button[data-set]').click()")
    page.value("document.getElementById('bring').checked = true")
    joint = rig.joints[0]
    middle = np.rad2deg(joint.initial.value if joint.stops is None else sum(joint.stops) / 2)
    for desired in (8.0, -8.0):
        set_by_hand(page, str(desired), "desired")
        page.value("lab.run(4)")
        assert np.rad2deg(page.value("lab.last()")[1]) == pytest.approx(middle + desired, abs=3.0)
    page.value("document.querySelector('button[data-set]').click()")
    assert not page.value("document.getElementById('bring').checked")  # an experiment begins anew
    choose(page, len(rig.joints) - 1)


def test_it_is_used_by_keys(page: Page, rig: Rig) -> None:
    """A slider changes what is true, a button sets them all, a dead sensor is told; without a
    mouse.
    """
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
    page.value(
        "document.getElementById('dead-0').checked || document.getElementById('dead-0').click()"
    )
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
    unnamed = (
        f"[...document.querySelectorAll('button, input, select')].filter((e) => !({named})).length"
    )
    assert page.value(unnamed) == 0


def test_a_link_is_pulled_by_the_mouse(page: Page) -> None:
    """The pull of the hand has the sign of where the pointer is; it ends when the button is let
    go.
    """
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
    page.ask(
        "Input.dispatchMouseEvent", type="mouseReleased", x=x, y=y, button="left", clickCount=1
    )
    joints = page.value("JSON.parse(document.getElementById('lab-data').textContent).joints.length")
    page.value("lab.run(0.1)")
    assert page.value("lab.acted()")[2 * int(bodies) : 2 * int(bodies) + joints] == [0] * joints


def test_it_is_small_and_quick(page: Page, path: Path) -> None:
    assert path.stat().st_size <= 400_000
    text = path.read_text(encoding="utf-8")
    assert "http://" not in text
    assert "https://" not in text
    page.value(
        "lab.times = []; document.getElementById('play').textContent === 'Pause' || "
        "document.getElementById('play').click()"
    )
    time.sleep(1.5)
    times = page.value("lab.times")
    assert len(times) > 20
    assert np.median(times) <= 8.0


def test_the_command_and_without_ziglang(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    main(["capstan-joint", "--out", str(tmp_path / "lab.html"), "--set", "joints.0.damping=0.02"])
    assert "--rig capstan-joint --set joints.0.damping=0.02 -e" in (
        tmp_path / "lab.html"
    ).read_text(encoding="utf-8")
    with pytest.raises(SystemExit, match="unknown rig"):
        main(["capstan-join", "--out", str(tmp_path / "other.html")])
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ExportError, match=r"ziglang; pip install '\.\[lab\]'"):
        lab_page(load_rig("capstan-joint"), tmp_path / "other.html")
    assert not (tmp_path / "other.html").exists()
