"""The lab in headless Chromium: its numbers are Python's, it is used by keys, it fits, and it is
quick.
"""

from __future__ import annotations

import importlib.util
import re
import time
from collections.abc import Callable, Iterator
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
from distal.kernels import Kernel
from distal.model import Mechanism
from distal.rig import number
from distal.simulation.plant import BodyInputs, at_rest, plant_function
from tests.browser import BROWSER, Page, opened

pytestmark = [
    pytest.mark.more,  # a browser; what the page holds is in test_page
    pytest.mark.slow,
    pytest.mark.skipif(BROWSER is None, reason="needs a browser"),
    pytest.mark.skipif(importlib.util.find_spec("ziglang") is None, reason="needs ziglang"),
]
LOAD = "document.querySelector('input[name=load]')"
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


def moved(rig: Rig, pulls: np.ndarray, truth: Rig | None = None, whole: bool = False) -> np.ndarray:
    """Return the coordinates after each sample, by the plant's kernel in Python.

    Args:
        truth: with the numbers that are true from the first step on; default the rig.
        whole: return all that the kernel puts out.
    """
    made = c_plant(rig, "plant")
    n, nj = made.plant.n_bodies, made.plant.n_joints
    held = BodyInputs(np.zeros((1, n)), np.zeros((1, n)), np.zeros((1, n, 3)))
    held.effort[0, nj:] = [drive.nominal_force.value for drive in rig.drives]
    kernel = Kernel(plant_function(made.plant, made.count))
    kernel_state, _ = at_rest(made.plant, held, made.start, kernel)
    rows = np.column_stack(
        [
            np.repeat(pulls, made.parts, axis=0),
            np.full(made.parts * len(pulls), made.interval / made.parts),
        ]
    )
    ys = kernel.scan(kernel_state, rows, Mechanism(truth or rig, remembers=True).parameters.values)[
        1
    ]
    return ys[made.parts - 1 :: made.parts, : None if whole else nj]


def text(page: Page, name: str) -> str:
    return str(page.value(f"document.getElementById('{name}').textContent"))


def comes(page: Page, name: str, wanted: Callable[[str], bool]) -> str:
    """Return a text as soon as it is the wanted one, or what it is after 3 s."""
    begun = time.monotonic()
    while not wanted(text(page, name)) and time.monotonic() - begun < 3.0:
        time.sleep(0.05)
    return text(page, name)


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


def compare_numbers(page: Page, rig: Rig, duration: float, tolerance: float, folder: Path) -> None:
    """Compare the motion and the estimate over a time with Python's, from the log that the page
    saves.
    """
    page.value("lab.pause()")
    nj = len(rig.joints)
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


@of_a_chain_too
def test_the_numbers_are_pythons(page: Page, rig: Rig, folder: Path) -> None:
    compare_numbers(page, rig, 5.0, 1e-9, folder)


@pytest.mark.more
def test_the_numbers_are_pythons_after_a_minute(page: Page, rig: Rig, folder: Path) -> None:
    compare_numbers(page, rig, 60.0, 1e-6, folder)


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
    interval, n, nj = (
        1 / max(sensor.rate for sensor in rig.sensors),
        len(rig.joints) + len(rig.drives),
        len(rig.joints),
    )
    found = page.value(ACT.format(first=first, steps=round(5.0 / interval), interval=interval))
    (folder / "drawn.csv").write_text(found["csv"])
    log = read_log(folder / "drawn.csv", rig)
    known, plain = estimate(log, rig), estimate(log, rig, "inextensible")
    pulls = np.array(found["pulls"])
    whole = moved(rig, pulls, changed(rig, found["settings"]), whole=True)
    truth, identified, half = (
        np.rad2deg(column[:, joint])
        for column in (whole[:, :nj], known.angles[1:], BAND * known.angle_stds[1:])
    )
    rough = np.rad2deg(plain.angles[1:, joint])

    def agree(drawn: list[list[float]], columns: list[np.ndarray]) -> None:
        rows = np.array(drawn)
        rows = rows[rows[:, 0] > 0.0]  # the first sample is before the first step
        at = np.round(rows[:, 0] / interval).astype(int) - 1
        assert len(at) > 100
        np.testing.assert_allclose(rows[:, 1:], np.column_stack(columns)[at], atol=1e-9)

    agree(
        found["drawn"]["angles"], [truth, identified, rough, identified - half, identified + half]
    )
    agree(found["drawn"]["errors"], [identified - truth, rough - truth, -half, half])
    name = rig.joints[joint].name
    torques = external_torques_of(make_estimator("adaptive", rig))
    if name in torques:
        touched, std = known.means[1:, torques[name]], np.sqrt(known.variances[1:, torques[name]])
        agree(
            found["drawn"]["torque"],
            [pulls[:, joint], touched, touched - BAND * std, touched + BAND * std],
        )
    else:
        assert found["drawn"]["torque"] == []
    now, halves, true, tensions = found["drawn"]["pictured"]
    np.testing.assert_allclose(now, known.angles[-1], atol=1e-9)
    np.testing.assert_allclose(halves, BAND * known.angle_stds[-1], atol=1e-9)
    np.testing.assert_allclose(true, whole[-1, :nj], atol=1e-9)
    # a tendon of 20 kN/m turns 1e-13 m into 2e-9 N
    np.testing.assert_allclose(
        tensions, whole[-1, 2 * n : 2 * n + len(rig.tendons)], rtol=1e-9, atol=1e-7
    )
    return dict(found["settings"])


@pytest.mark.more
@of_a_chain_too
def test_what_is_drawn_is_pythons_in_all_experiments_in_turn(
    page: Page, rig: Rig, folder: Path
) -> None:
    """Angle, band, torques true and told, and tensions, of each joint; what one experiment set the
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


@pytest.mark.more
def test_each_control_changes_what_is_true(page: Page, rig: Rig, folder: Path) -> None:
    """Each slider alone, to one of its ends, against Python; what is set by hand is said and is no
    experiment any more.
    """
    page.value("lab.pause()")
    for name in page.value(
        "[...document.querySelectorAll('input[type=range]')].map((one) => one.name)"
    ):
        if page.value(f"document.querySelector('input[name={name}]').closest('label').hidden"):
            continue
        page.value(f"{BUTTONS}[0].click()")
        set_by_hand(page, f"document.querySelector('input[name={name}]').min", name)
        label = page.value(
            f"document.querySelector('input[name={name}]').labels[0].firstChild.textContent"
        ).strip()
        assert text(page, "why").startswith("Set by hand: ")
        assert label in text(page, "why")
        assert page.value("document.querySelectorAll('[aria-pressed=true]').length") == 0
        settings = compare(page, rig, folder, "", len(rig.joints) - 1)
        assert settings[name] not in (1.0, 0.7, 0.15)
    page.value(f"{BUTTONS}[0].click()")


def test_an_experiment_leaves_nothing_to_the_next_one(page: Page, rig: Rig) -> None:
    """After a load and a dead sensor for 10 s "As described" gives the numbers of a page just
    opened, to the last bit.
    """
    page.value("lab.pause(); document.getElementById('seed').value = 1")
    run = f"({BUTTONS}[0].click(), lab.run(4), lab.drawn())"
    fresh = page.value(run)
    page.value(f"{BUTTONS}[{BUTTONS}.length - 1].click(); lab.run(5)")
    set_by_hand(page, f"{LOAD}.max", "load")
    set_by_hand(page, "1", "speed")
    page.value("lab.run(5)")
    assert page.value(run) == fresh


@pytest.mark.more
def test_the_band_holds_where_the_rig_file_allows_for_what_is_done(page: Page, rig: Rig) -> None:
    """At least 88 % of the first 15 s after a click, and of those after the first 3 s, for each
    joint and three seeds.
    """
    page.value("lab.pause()")
    interval, band = 1 / max(sensor.rate for sensor in rig.sensors), BAND
    tried = 0
    for k in range(page.value(f"{BUTTONS}.length")):
        why = page.value(f"{BUTTONS}[{k}].dataset.why")
        off = re.search(r"([\d.]+) standard deviations off", why)
        if (
            "as exact" in why
            or "as none" in why
            or "is dead" in why
            or float(off[1] if off else 0) > 2
        ):
            continue
        for joint in range(len(rig.joints)):
            choose(page, joint)
            for seed in (1, 2, 3):
                rows = page.value(
                    f"(() => {{ document.getElementById('seed').value = {seed}; "
                    f"{BUTTONS}[{k}].click(); const rows = []; "
                    f"for (let i = 0; i < {round(15 / interval)}; i++) {{ lab.run({interval}); "
                    f"rows.push(lab.last()); }} "
                    "return rows; })()"
                )
                kept = np.array([[np.nan if x is None else x for x in row] for row in rows])
                true, identified, stds = (kept[:, 1 + 4 * joint + what] for what in range(3))
                inside = np.abs(identified - true) <= band * stds
                assert min(inside.mean(), inside[kept[:, 0] > 3.0].mean()) >= 0.88, (
                    why,
                    joint,
                    seed,
                )
                tried += 1
    page.value("document.getElementById('seed').value = 1")
    assert tried >= 3 * len(rig.joints)


@pytest.mark.more
def test_a_screen_reader_is_spoken_to_every_five_seconds_at_most(page: Page) -> None:
    """Clicks and sliders without pause for 12 s of the page's clock: one live region, whose text
    changes at most every 5 s.
    """
    assert (
        page.value("document.querySelectorAll('[aria-live], [role=status], [role=alert]').length")
        == 1
    )
    page.value(
        "document.getElementById('play').textContent === 'Pause' || "
        "document.getElementById('play').click()"
    )
    # the page's clock runs four times as fast from now on
    page.value(
        "lab.heard = []; lab.stamp = 0; new MutationObserver(() => lab.heard.push([lab.stamp, "
        "document.getElementById('live').textContent])).observe(document.getElementById('live'), "
        "{childList: true}); lab.frame = requestAnimationFrame; lab.began = performance.now(); "
        "requestAnimationFrame = (f) => "
        "lab.frame.call(window, (t) => f((lab.stamp = 4 * t - 3 * lab.began)))"
    )
    begun = page.value("lab.stamp = performance.now()")
    while page.value("lab.stamp") - begun < 12_000:
        page.value(f"{BUTTONS}[1].click()")
        set_by_hand(page, "1", "friction")
        time.sleep(0.025)
    heard = page.value("lab.heard")
    page.value("lab.ahead = 3 * (performance.now() - lab.began)")  # it never goes back
    page.value("requestAnimationFrame = (f) => lab.frame.call(window, (t) => f(t + lab.ahead))")
    assert 2 <= len(heard) <= 3
    assert np.diff([stamp for stamp, _ in heard]).min() >= 4900.0
    # which of the texts is read depends on the frame: why the button's experiment or the slider is
    # there, or the verdict; never the health alone
    why = page.value(f"{BUTTONS}[1].dataset.why")
    brought = ("Set by hand", "Without a sensor", "first second", why)
    assert any(text in said for _, said in heard for text in brought)


def test_slow_motion_is_said(page: Page) -> None:
    """Where each step takes 30 ms of the page's clock, the page says at which share of real time it
    moves.
    """
    page.value(
        "document.getElementById('play').textContent === 'Pause' || "
        "document.getElementById('play').click()"
    )
    page.value(f"{BUTTONS}[0].click()")
    time.sleep(1.2)  # it is judged each second
    assert text(page, "pace") == ""
    page.value(
        "lab.read = 0; lab.clock = performance.now; performance.now = () => (lab.read += 30)"
    )
    said = comes(page, "pace", lambda said: said != "")
    page.value("performance.now = lab.clock")
    assert re.fullmatch(r"Slow motion: this computer reaches 0\.\d+ of real time\.", said), said
    assert comes(page, "pace", lambda said: said == "") == ""


@pytest.mark.parametrize(("width", "height"), [(1400, 900), (400, 800)])
def test_the_sliders_are_beside_the_curves_and_the_verdict(
    path: Path, width: int, height: int
) -> None:
    """In a wide window the sliders and two curves are seen at once, on a telephone a slider and the
    verdict.
    """
    box = (
        "(id) => (({top, bottom}) => [top, "
        "bottom])(document.getElementById(id).getBoundingClientRect())"
    )
    with opened(path, "", width, height) as page:
        time.sleep(1.0)
        if width == 400:
            page.value("document.getElementById('set-load').scrollIntoView({block: 'center'})")
            time.sleep(0.5)
        seen = (
            ("verdict", "set-load")
            if width == 400
            else ("verdict", "set-friction", "set-load", "angles", "errors")
        )
        for name in seen:
            top, bottom = page.value(f"({box})('{name}')")
            assert top >= 0.0, name
            assert bottom <= height, name


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


def test_a_sensor_that_is_dead_from_the_beginning(page: Page, rig: Rig, folder: Path) -> None:
    """Begun anew with a dead sensor: it tells one value, and the saved log gives the page's
    angles.
    """
    page.value(
        "lab.pause(); document.getElementById('dead-0').checked = true; lab.begin(); lab.run(2); "
        "lab.begin()"
    )
    found = page.value("lab.run(2), { last: lab.last(), csv: lab.csv() }")
    page.value("document.getElementById('dead-0').checked = false; lab.begin()")
    (folder / "dead.csv").write_text(found["csv"])
    nj, known = len(rig.joints), estimate(read_log(folder / "dead.csv", rig), rig)
    np.testing.assert_allclose(found["last"][2 : 1 + 4 * nj : 4], known.angles[-1], atol=1e-9)
    assert np.isfinite(read_log(folder / "dead.csv", rig).channels[rig.sensors[0].name]).sum() == 1


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


def test_it_is_legible_on_a_telephone(path: Path) -> None:
    with opened(path, "", 400, 800) as page:
        time.sleep(1.0)
        assert page.value("document.documentElement.scrollWidth") <= 400
        assert page.value("document.getElementById('angles').getBoundingClientRect().width") > 330


def test_the_command_and_without_ziglang(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("--set", "joints.0.damping=0.02")
    main(["capstan-joint", "--out", str(tmp_path / "lab.html"), *words])
    assert "one file of" in capsys.readouterr().out
    assert "distal estimate lab.csv --rig capstan-joint --set joints.0.damping=0.02 -e" in (
        tmp_path / "lab.html"
    ).read_text(encoding="utf-8")
    with pytest.raises(SystemExit, match="unknown rig"):
        main(["capstan-join", "--out", str(tmp_path / "other.html")])
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ExportError, match=r"ziglang; pip install '\.\[lab\]'"):
        lab_page(load_rig("capstan-joint"), tmp_path / "other.html")
    assert not (tmp_path / "other.html").exists()
