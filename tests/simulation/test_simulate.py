"""Scenarios and simulation: what is done to a rig, what its sensors say, what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from distal import Rig, load_rig, load_scenario, scenario_rig, shipped_scenarios, simulate
from distal.errors import ScenarioError
from distal.model import Mechanism
from distal.rig import angle_names
from distal.simulation import build_scenario
from distal.simulation.plant import output_layout
from distal.simulation.simulate import Sampler, stamps_of

EXAMPLE = """
rig = "paper-2008-printed"
duration = "3 s"
[plant]
"joints.0.friction.coefficient" = 0.6
[initial]
link = "-25 deg"
[drives.left]
weight = [["0 s", "2 N"], ["1 s", "6 N"]]
[drives.right]
weight = "2 N"
[joints.link]
hand = { angle = [["0 s", "-25 deg"], ["2 s", "-25 deg"]], stiffness = "3 N m/rad" }
"""


def scenario(text: str, tmp_path: Path) -> Path:
    path = tmp_path / "scenario.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_example_runs(tmp_path: Path) -> None:
    path = scenario(EXAMPLE, tmp_path)
    log = simulate("paper-2008-printed", path, seed=1)
    assert len(log) == 300
    assert log.rate == pytest.approx(100)
    assert np.rad2deg(log.truth["theta"][0]) == pytest.approx(-25)
    assert set(log.channels) == {"x1", "u1", "x2", "u2", "encoder"}


@pytest.mark.parametrize("seed", [-1, 1.0, "one"])
def test_a_seed_is_a_whole_number_from_0(seed: object) -> None:
    with pytest.raises(ScenarioError, match="seed: must be a whole number from 0"):
        simulate("paper-2008-printed", "series-2", seed=seed)  # type: ignore[arg-type]


def test_same_seed_same_log_other_seed_same_truth() -> None:
    loaded = load_scenario("series-2")
    rig = scenario_rig(loaded)
    one, two, three = simulate(rig, loaded, 1), simulate(rig, loaded, 1), simulate(rig, loaded, 2)
    for name in one.channels:
        np.testing.assert_array_equal(one.channels[name], two.channels[name])
    assert not np.array_equal(one.channels["u1"], three.channels["u1"])
    np.testing.assert_array_equal(one.truth["theta"], three.truth["theta"])


@pytest.mark.more
def test_shipped_scenarios_fit_their_rigs() -> None:
    assert "series-2" in shipped_scenarios()
    for name in shipped_scenarios():
        loaded = load_scenario(name)
        rig = scenario_rig(loaded)
        truth = simulate(rig, loaded).truth
        for name in angle_names([joint.name for joint in rig.joints]):
            assert np.all(np.isfinite(truth[name]))


def test_it_starts_in_equilibrium() -> None:
    """At rest under 2 N each, nothing moves until the weight changes."""
    loaded = load_scenario("series-2")
    log = simulate(scenario_rig(loaded), loaded)
    before = log.time < 0.99
    for name in ("theta", "position_left", "position_right"):
        assert np.ptp(log.truth[name][before]) < 1e-9
    np.testing.assert_allclose(log.truth["force_left"][before], 2.0, atol=1e-6)


def test_a_hung_weight_has_inertia_and_a_force_has_none(paper_rig: Rig) -> None:
    """Held link, step from 2 to 6 N: the slider swings at sqrt(k/(m + W/g)), or at sqrt(k/m) with a
    massless force.
    """
    wide = paper_rig.with_values(
        {"drives.0.stops": [-0.05, 0.05], "sensors.x1.rate": 1000, "sensors.u1.rate": 1000}
    )
    base = {"rig": "paper-2008-printed", "duration": "1 s", "drives": {"right": {"weight": "2 N"}}}
    hold = {"joints": {"link": {"hand": {"angle": "0 deg", "stiffness": "3000 N m/rad"}}}}
    points = [["0 s", "2 N"], ["0.1 s", "6 N"]]
    swings = {}
    for kind in ("weight", "force"):
        drives = {**base["drives"], "left": {kind: points}}  # type: ignore[dict-item]
        log = simulate(wide, build_scenario({**base, **hold, "drives": drives}))
        x = log.truth["position_left"][100:400]
        peak = int(np.argmax(x > x.min() + 0.98 * np.ptp(x)))
        swings[kind] = np.pi / (peak * 1e-3)
    k, mass = 806.0, 1e-3
    assert swings["weight"] == pytest.approx(np.sqrt(k / (mass + 6 / 9.80665)), rel=0.2)
    assert swings["force"] > 5 * swings["weight"]


def test_the_load_cell_reads_the_dynamic_force() -> None:
    """U = W − (W/g) ẍ: the force follows the slider's acceleration, and is W at rest."""
    loaded = load_scenario("series-2")
    rig = scenario_rig(loaded).with_values({"sensors.x1.rate": 1000})
    log = simulate(rig, loaded)
    x, u = log.truth["position_left"], log.truth["force_left"]
    acceleration = np.gradient(np.gradient(x, log.time), log.time)
    moving = (log.time > 1.05) & (log.time < 2.0)
    expected = 6 - 6 / 9.80665 * acceleration
    assert np.sqrt(np.mean((u - expected)[moving] ** 2)) < 0.15
    assert np.abs(u[log.time < 0.99] - 2).max() < 1e-6


def test_sensors_have_their_own_rates_and_delays(paper_rig: Rig) -> None:
    loaded = load_scenario("series-2")
    clean = {f"sensors.{s}.{e}": 0.0 for s in ("x1", "x2") for e in ("noise", "linearity")}
    rig = scenario_rig(loaded).with_values(
        {**clean, "sensors.x2.rate": 40, "sensors.x1.delay": "20 ms"}
    )
    log = simulate(rig, loaded)
    assert np.isfinite(log.channels["x1"]).sum() == 800
    assert np.isfinite(log.channels["x2"]).sum() == 320
    at_x1 = np.isfinite(log.channels["x1"])
    late, true = log.channels["x1"][at_x1], log.truth["position_left"][at_x1]
    np.testing.assert_allclose(late[2:], true[:-2], atol=1e-6)


def test_only_the_plant_has_the_plants_values() -> None:
    loaded = load_scenario("series-2")
    rig = scenario_rig(loaded)
    stuck = loaded.model_copy(update={"plant": {"joints.0.friction.coefficient": 2.0}})
    assert np.ptp(simulate(rig, loaded).truth["theta"]) > 1.0
    assert np.ptp(simulate(rig, stuck).truth["theta"]) < 0.05


def test_a_servo_and_a_capstan() -> None:
    loaded = build_scenario(
        {
            "rig": "capstan-joint",
            "duration": "2 s",
            "drives": {"motor": {"servo": {"angle": [["0 s", "0 deg"], ["1 s", "40 deg"]]}}},
        }
    )
    log = simulate(load_rig("capstan-joint"), loaded)
    assert np.rad2deg(log.truth["position_motor"][-1]) == pytest.approx(40, abs=2)
    assert np.rad2deg(log.truth["theta"][-1]) == pytest.approx(40 * 5 / 8, abs=1.5)


def test_linear_and_sine_signals(paper_rig: Rig) -> None:
    loaded = build_scenario(
        {
            "rig": "paper-2008-printed",
            "duration": "1 s",
            "drives": {
                "left": {"force": {"mean": "3 N", "amplitude": "0.5 N", "frequency": "2 Hz"}},
                "right": {
                    "force": {"points": [["0 s", "3 N"], ["1 s", "4 N"]], "interpolation": "linear"}
                },
            },
        }
    )
    log = simulate(paper_rig, loaded)
    np.testing.assert_allclose(log.truth["force_right"], 3 + log.time, atol=2e-3)
    np.testing.assert_allclose(
        log.truth["force_left"], 3 + 0.5 * np.sin(4 * np.pi * log.time), atol=1e-2
    )


REFUSED = [
    (
        'rig = "paper-2008-printed"\nduration = "8 s"\n[drives.lft]\nweight = 2.0',
        "the rig has no drive 'lft'; did you mean 'left'",
    ),
    (
        'rig = "paper-2008-printed"\nduration = "8 s"\n[drives.left]\ntorque = 2.0',
        "drives.left.torque: a slider cannot be pulled so",
    ),
    (
        'rig = "paper-2008-printed"\nduration = "8 s"\n[drives.left]\nweight = "-2 N"',
        "must not be negative",
    ),
    (
        'rig = "paper-2008-printed"\nduration = "8 s"\n[drives.left]\nweight = [["1 s", "2 N"], '
        '["0 s", "3 N"]]',
        "must rise",
    ),
    (
        'rig = "paper-2008-printed"\nduration = "8 s"\n[drives.left]\nwieght = 2',
        "unknown key 'wieght'; did you mean 'weight'",
    ),
    ('rig = "paper-2008-printed"\nduration = "8 s"\n[initial]\nelbow = 0', "no joint 'elbow'"),
    (
        'rig = "paper-2008-printed"\nduration = "8 s"\n[initial]\nlink = "2 mm"',
        "initial.link: unit 'mm' is no angle",
    ),
    (
        'rig = "paper-2008-printed"\nduration = "8 s"\n[plant]\n"joints.0.frction" = 0',
        "plant: .*unknown key 'frction'",
    ),
    ('rig = "paper-2008-printed"\nduration = "-8 s"', "duration: must be positive"),
    ('rig = "paper-2008-printed"\n', "duration: is missing"),
    ('duration = "8 s"\n', "rig: is missing"),
]


@pytest.mark.parametrize(("text", "said"), REFUSED)
def test_wrong_scenarios_are_refused(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(ScenarioError, match=said) as caught:
        simulate("paper-2008-printed", scenario(text, tmp_path))
    assert "\n" not in str(caught.value)


def test_unknown_scenarios(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="unknown scenario 'series-3'; did you mean 'series-"):
        load_scenario("series-3")
    with pytest.raises(ScenarioError, match="cannot be read"):
        load_scenario(tmp_path / "missing.toml")


def test_a_rig_beside_the_scenario(tmp_path: Path) -> None:
    from distal.rig import edited_text

    (tmp_path / "mine.toml").write_text(edited_text("paper-2008-printed"), encoding="utf-8")
    path = scenario(EXAMPLE.replace('"paper-2008-printed"', '"mine.toml"'), tmp_path)
    assert scenario_rig(load_scenario(path)) == load_rig("paper-2008-printed")


def test_a_scenario_nested_too_deeply_is_one_line() -> None:
    weight: list[object] = [0]
    for _ in range(20_000):
        weight = [weight]
    with pytest.raises(ScenarioError, match=r"^scenario: nested too deeply$"):
        build_scenario(
            {"rig": "paper-2008-printed", "duration": "1 s", "drives": {"left": {"weight": weight}}}
        )


def test_a_motion_in_pieces_is_read_as_the_whole() -> None:
    """Sensors of three rates: the same noise at the same stamps, and NaN where a sensor is not
    due.
    """
    rig = load_rig("paper-2008").with_values(
        {"sensors.u1.rate": 30.0, "sensors.u2.rate": 25.0, "sensors.x1.noise": 1e-3}
    )
    plant = Mechanism(rig)
    grid = 1e-3 * np.arange(1001)
    y = np.random.default_rng(1).normal(size=(1001, 3 * plant.n_bodies + plant.n_tendons))
    whole = Sampler(plant, 2).read(y, grid, stamps_of(rig, 0.0, 1.0))
    sampler = Sampler(plant, 2)
    pieces = [
        sampler.read(y[a : b + 1], grid[a : b + 1], stamps_of(rig, 1e-3 * a, 1e-3 * b))
        for a, b in ((0, 250), (250, 600), (600, 1000))
    ]
    np.testing.assert_allclose(np.vstack(pieces), whole, rtol=0, atol=1e-9)
    due = {sensor.name: k for k, sensor in enumerate(rig.sensors)}
    assert np.isfinite(whole[:, due["u1"]]).sum() == 30
    assert np.isfinite(whole[:, due["u2"]]).sum() == 25
    other = Sampler(plant, 3).read(y, grid, stamps_of(rig, 0.0, 1.0))
    assert not np.allclose(other[:, due["x1"]], whole[:, due["x1"]], atol=1e-5, equal_nan=True)


def test_a_position_that_a_servo_follows_late_is_ahead_of_it() -> None:
    """A command is read: s + T ds/dt with the servo's lag T."""
    exact = {f"sensors.x1.{name}": 0.0 for name in ("linearity", "noise", "resolution")}
    plant = Mechanism(load_rig("template").with_values({**exact, "sensors.x1.lag": 0.1}))
    grid = 0.01 * np.arange(3)
    y = np.zeros((3, output_layout(plant).size))
    y[:, plant.n_joints] = 0.2 * grid
    y[:, plant.n_bodies + plant.n_joints] = 0.2
    np.testing.assert_allclose(Sampler(plant, 1).read(y, grid, grid)[:, 0], 0.2 * (grid + 0.1))
