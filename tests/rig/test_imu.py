"""An IMU on a link: one file in `distal.rig.sensors`, and everything that there is for sensors
works with it.
"""

import re
import tomllib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from tools.size import sizes
from typer.testing import CliRunner

import distal
from distal import LiveEstimator, Log, Rig, estimate, load_rig, load_scenario, simulate, smooth
from distal.cli.app import app
from distal.errors import RigError
from distal.estimators import AdaptiveFilter, first_values
from distal.fitting.fitted_file import fitted_text
from distal.rig import build_rig, independent_parts, rig_text
from distal.rig.sensors.imu import VALUES as IMU_VALUES
from distal.run import samples_of
from distal.study.design_space import built_values, draws_of, scores

TABLE = """
[[sensors]]
name = "imu"
measures = "imu"
of = "pip"
rate = "200 Hz"
numbers = ["rate_y", "force_x", "force_z"]
mounting = { value = 0.0, std = "3 deg" }
noise = { rate = "0.5 deg/s", force = "0.3 m/s^2" }
bias = { rate = { value = 0.0, std = "1 deg/s", drift = "0.05 deg/s" }, force = { value = 0.0, std = "0.1 m/s^2" } }
"""
VALUES = ("imu_rate_y", "imu_force_x", "imu_force_z")
MOUNTED = 0.05


def with_imu(table: str = TABLE, name: str = "finger-2n") -> Rig:
    return build_rig(tomllib.loads(rig_text(name)[0] + table), "a rig with an IMU")


@pytest.fixture(scope="module")
def rig() -> Rig:
    return with_imu()


@pytest.fixture(scope="module")
def logs(rig: Rig) -> list[Log]:
    """Logs of a plant whose IMU is mounted at another angle than the rig says."""
    plant = rig.with_values({f"sensors.{name}.mounting": MOUNTED for name in VALUES})
    scenario = load_scenario("finger", ['duration="6 s"'])
    return [simulate(plant, scenario, seed) for seed in (21, 22, 23, 24)]


def test_its_numbers_are_those_of_two_turns_about_one_axis() -> None:
    """By hand: a link turned by θ_mcp + θ_pip + mounting about y; the base hangs gravity along
    −z.
    """
    exact = with_imu(re.sub(r"(noise|bias) = .*\n", "", TABLE))
    rig = exact.with_values({f"sensors.{name}.mounting": MOUNTED for name in VALUES})
    log = simulate(rig, load_scenario("finger", ['duration="3 s"']), 1)
    turned = log.truth["theta_mcp"] + log.truth["theta_pip"] + MOUNTED
    np.testing.assert_allclose(log.channels["imu_force_x"], -9.80665 * np.sin(turned), atol=1e-9)
    np.testing.assert_allclose(log.channels["imu_force_z"], 9.80665 * np.cos(turned), atol=1e-9)
    # the rate is the derivative of the sum, to the error of a central difference
    rate = np.gradient(turned, log.time)[1:-1]
    assert np.ptp(rate) > 1.0
    np.testing.assert_allclose(log.channels["imu_rate_y"][1:-1], rate, atol=0.02 * np.ptp(rate))


def test_a_chain_whose_axes_differ() -> None:
    """Angular velocity and gravity of a wrist's last link, by matrices in NumPy: ω is of Rᵀ Ṙ."""
    table = '\n[[sensors]]\nname = "imu"\nmeasures = "imu"\nof = "jaw"\nrate = "1 kHz"\n'
    rig = build_rig(tomllib.loads(rig_text("wrist-instrument")[0] + table), "wrist with an IMU")
    assert rig.base.orientation == (0.0, 0.0, 0.0)
    log = simulate(rig, load_scenario("wrist", ['duration="8 s"']), 1)
    joints = [joint.name for joint in rig.joints]

    def cross(a: tuple[float, ...]) -> np.ndarray:
        return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])

    def world(row: int) -> np.ndarray:
        turned = np.eye(3)
        for j, name in enumerate(joints):  # each sits on the one before it
            k, angle = cross(rig.joints[j].axis), log.truth[f"theta_{name}"][row]
            turned = turned @ (np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k)
        return turned

    row = int(np.argmax(np.abs(log.channels["imu_rate_x"][:-1])))
    force = [log.channels[f"imu_force_{axis}"][row] for axis in "xyz"]
    np.testing.assert_allclose(force, -world(row).T @ np.array(rig.base.gravity), atol=1e-9)
    assert np.count_nonzero(np.abs(force) > 0.1) > 1
    spin = (
        world(row).T @ (world(row + 1) - world(row - 1)) / (log.time[row + 1] - log.time[row - 1])
    )
    rate = np.array([log.channels[f"imu_rate_{axis}"][row] for axis in "xyz"])
    # a central difference over 2 ms
    np.testing.assert_allclose(
        rate, [spin[2, 1], spin[0, 2], spin[1, 0]], atol=0.01 * np.abs(rate).max()
    )
    assert np.count_nonzero(np.abs(rate) > 0.01) > 1


SEEDS = range(301, 307)
"""Seeds that were not looked at before the filter was as it is."""

WRIST = TABLE.replace("pip", "jaw").replace(
    '["rate_y", "force_x", "force_z"]', str([*IMU_VALUES]).replace("'", '"')
)


def built(rig: Rig, scenario: str, seed: int) -> Log:
    """Return the log of a plant that is drawn from what the rig does not know."""
    draws, plan = draws_of(rig), load_scenario(scenario)
    plant = rig.with_values(built_values(rig, draws, scores(draws, [seed])))
    return simulate(plant, plan.model_copy(update={"plant": {}, "duration": 6.0}), seed)


@pytest.mark.parametrize(
    ("name", "table", "most"),
    [
        ("finger-2n", TABLE, (1.0, 0.7)),
        pytest.param("wrist-instrument", WRIST, (1.0, 1.0, 1.05), marks=pytest.mark.more),
    ],
)
@pytest.mark.more
def test_it_tells_more_on_average_and_is_as_right_as_without(
    name: str, table: str, most: tuple[float, ...]
) -> None:
    """Mean RMS errors against those without it: those of the finger fall, those of the wrist at
    least do not rise.
    """
    rig = with_imu(table.replace("3 deg", "0.5 deg"), name)
    logs = [built(rig, name.split("-")[0], seed) for seed in SEEDS]
    with_it, without = ([estimate(log, of) for log in logs] for of in (rig, load_rig(name)))
    rms = [
        np.mean([np.sqrt(np.mean((r.angles - r.truths) ** 2, axis=0)) for r in results], axis=0)
        for results in (with_it, without)
    ]
    assert np.all(rms[0] < np.array(most) * rms[1])
    right, before = (
        np.mean([result.inside_band() for result in results]) for results in (with_it, without)
    )
    assert right > before - 0.02


@pytest.mark.more
def test_it_narrows_the_band_of_a_chain_and_finds_how_it_is_mounted(
    rig: Rig, logs: list[Log]
) -> None:
    def narrowness(of: Rig, plants: Sequence[Log]) -> float:
        """Return the mean std of the second joint."""
        results = [estimate(log, of) for log in plants]
        assert np.mean([result.inside_band() for result in results]) > 0.9
        return float(np.mean([result.angle_stds[:, 1] for result in results]))

    well = with_imu(TABLE.replace("3 deg", "0.5 deg"))
    plants = [
        simulate(well, load_scenario("finger", ['duration="6 s"']), seed)
        for seed in (21, 22, 23, 24)
    ]
    alone = narrowness(load_rig("finger-2n"), plants)
    assert narrowness(well, plants) < 0.78 * alone
    # hardly knowing how it is mounted it says less, and is still believed
    assert narrowness(rig, logs) < 0.88 * alone
    result = estimate(logs[0], rig)
    at = result.state_names.index("mounting_imu")
    assert result.variances[-1, at] < np.deg2rad(3.0) ** 2 / 4
    assert abs(result.means[-1, at] - MOUNTED) < 3 * np.sqrt(result.variances[-1, at])
    assert "bias_imu_rate_y" in result.state_names


@pytest.mark.more
def test_live_and_smoothed(rig: Rig, logs: list[Log]) -> None:
    log, live = logs[0], LiveEstimator(rig)
    offline, samples = estimate(log, rig), samples_of(log, live.channels)
    for time, sample in zip(log.time[:200], samples):
        live.step(time, sample)
    np.testing.assert_allclose(live.angles, offline.angles[199], atol=1e-12)
    assert smooth(log, rig).inside_band() > 0.9


def test_a_gyroscope_that_walks_has_a_state_that_walks(rig: Rig) -> None:
    states = AdaptiveFilter(rig, compiled=False).states
    walks = dict(zip(states.names, states.walks))
    assert walks["bias_imu_rate_y"] == pytest.approx(np.deg2rad(0.05))
    assert walks["bias_imu_force_x"] == walks["mounting_imu"] == 0.0
    assert states.lasting[states.names.index("mounting_imu")]


@pytest.mark.parametrize("name", ["inextensible", "elastic"])
def test_an_estimator_that_cannot_use_it_says_so(name: str, rig: Rig, logs: list[Log]) -> None:
    bare = estimate(logs[0], load_rig("finger-2n"), name)
    result = estimate(logs[0], rig, name)
    np.testing.assert_array_equal(result.angles, bare.angles)
    assert f"{name} does not read {', '.join(VALUES)}; adaptive does" in result.notes


def test_a_fit_writes_its_numbers_into_the_users_file(rig: Rig) -> None:
    text = rig_text("finger-2n")[0] + TABLE
    values = {"sensors.imu_rate_y.noise": 0.02, "joints.pip.damping": 0.002}
    written = fitted_text(rig.with_values(values), rig, values, "# Fitted by `distal fit`\n", text)
    again = build_rig(tomllib.loads(written), "again")
    assert again == rig.with_values(values)
    assert "# A finger of two joints with two tendons each" in written


def test_the_command_line_takes_it(rig: Rig, logs: list[Log], tmp_path: Path) -> None:
    (tmp_path / "rig.toml").write_text(rig_text("finger-2n")[0] + TABLE, encoding="utf-8")
    log = tmp_path / "log.csv"
    names = [sensor.name for sensor in rig.sensors]
    np.savetxt(
        log,
        np.column_stack([logs[0].time, *(logs[0].channels[name] for name in names)])[:200],
        header=",".join(["time", *names]),
        delimiter=",",
        comments="",
    )
    arguments = [
        "estimate",
        str(log),
        "--rig",
        str(tmp_path / "rig.toml"),
        "--set",
        "sensors.imu_rate_y.noise=0.02",
    ]
    arguments += ["--estimator", "adaptive"]
    done = CliRunner().invoke(app, [*arguments, "--out", str(tmp_path / "out.csv")])
    assert done.exit_code == 0, done.output
    assert "imu_force_z: imu of pip, column 'imu_force_z' in m/s^2" in done.output
    drawn = CliRunner().invoke(
        app, ["rig", "draw", str(tmp_path / "rig.toml"), "--out", str(tmp_path / "rig.png")]
    )
    assert drawn.exit_code == 0, drawn.output


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('of = "pip"', 'of = "pop"'), "no joint is called 'pop'"),
        (('"rate_y", ', '"spin", '), "numbers: must be some of rate_x, rate_y, rate_z"),
        (("numbers = [", "numbers = [] # ["), "numbers: must be some of"),
        (
            ('noise = { rate = "0.5 deg/s", force = "0.3 m/s^2" }', "noise = 0.1"),
            "noise: must be a table with rate and",
        ),
        (('rate = "0.5 deg/s"', 'rate = "0.5 deg"'), "imu_rate_y"),
        (("mounting = {", "mountings = {"), "mountings"),
    ],
)
def test_what_is_wrong_is_said(change: tuple[str, str], message: str) -> None:
    with pytest.raises(RigError, match=message):
        with_imu(TABLE.replace(*change))


def test_a_sensor_of_a_new_kind_is_one_file_and_a_line_in_a_list() -> None:
    source = Path(distal.__file__).parent
    named = [
        path.relative_to(source).as_posix()
        for path in source.rglob("*.py")
        if re.search(r"\bimu\b|\bImu|Gyroscope|Accelerometer", path.read_text(encoding="utf-8"))
    ]
    # `base` only says in the description of a key which kinds there are
    assert sorted(named) == ["rig/sensors/base.py", "rig/sensors/imu.py", "rig/sensors/registry.py"]
    assert sizes()["src/distal/rig/sensors/imu.py"] <= 1200


def test_the_first_sample_may_miss_it(rig: Rig, logs: list[Log]) -> None:
    estimator = AdaptiveFilter(rig, compiled=False)
    samples = samples_of(logs[0], estimator.channels)[:30].copy()
    samples[:10, [estimator.channels.index(name) for name in VALUES]] = np.nan
    means, *_ = estimator.scan(
        estimator.initial(0.0, first_values(samples)), logs[0].time[:30], samples
    )
    assert np.isfinite(means).all()


def test_sensors_of_joints_stay_with_their_finger() -> None:
    """A torque on a joint, as an angle, goes with the part that has the joint, where a hand is
    taken apart.
    """
    hand = load_rig("hand")
    joints = [hand.joints[0].name, hand.joints[-1].name]
    added = [
        {"name": f"torque_{of}", "measures": "torque", "of": of, "noise": 0.01} for of in joints
    ]
    raw = hand.model_dump()
    raw["sensors"] = [*raw["sensors"], *added]
    parts = independent_parts(Rig.model_validate(raw))
    assert len(parts) > 1
    for of in joints:
        (part,) = (part for part in parts if of in [joint.name for joint in part.rig.joints])
        assert f"torque_{of}" in [sensor.name for sensor in part.rig.sensors]
