"""Headers that say their unit: what is written is read, in degrees and radians, with the unit and
without.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from distal import Log, Rig, estimate, load_rig, load_scenario, read_log, scenario_rig, simulate
from distal.errors import DistalWarning, LogError
from distal.logs import MessageReader, header, read_truth, write_columns, write_log
from distal.logs.cells import name_and_unit


@pytest.fixture(scope="module")
def rig() -> Rig:
    """The scenario's rig, whose sensors leave the unit to the log."""
    rig = scenario_rig(load_scenario("series-1"))
    return rig.with_values({f"sensors.{name}.unit": None for name in ("x1", "x2", "u1", "u2")})


@pytest.fixture(scope="module")
def log(rig: Rig) -> Log:
    return simulate(rig, "series-1", 0).select(slice(0, 60))


def renamed(log: Log, rig: Rig, path: Path, change: dict[str, tuple[str, float]]) -> Path:
    """Write a log with other headers: column → header and factor on its numbers."""
    plain = path.with_name("plain.csv")
    write_log(log, rig, plain)
    frame = pl.read_csv(plain)
    columns = {
        change.get(name, (name, 1.0))[0]: change.get(name, (name, 1.0))[1] * frame[name]
        for name in frame.columns
    }
    (
        pl.DataFrame(columns).write_parquet
        if path.suffix == ".parquet"
        else pl.DataFrame(columns).write_csv
    )(path)
    return path


def test_a_header_is_name_and_unit() -> None:
    assert header("theta", "rad") == "theta [rad]"
    assert header("theta", "") == "theta"
    assert name_and_unit("external_torque [N m]") == ("external_torque", "N m")
    for plain in ("theta", "position[0]", "/joint_states[left_wrist].position", "[rad]"):
        assert name_and_unit(plain) == (plain, None)


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_units_in_the_header_count_where_the_rig_gives_none(
    log: Log, rig: Rig, tmp_path: Path, ending: str
) -> None:
    units = {
        "t": ("t [ms]", 1e3),
        "x1": ("x1 [mm]", 1e3),
        "x2": ("x2 [m]", 1.0),
        "u1": ("u1 [mN]", 1e3),
    }
    units["true_theta"] = ("true_theta [deg]", float(np.rad2deg(1.0)))
    read = read_log(renamed(log, rig, tmp_path / f"log.{ending}", units), rig)
    np.testing.assert_allclose(read.time, log.time, atol=1e-12)
    for name in ("x1", "x2", "u1", "u2"):
        np.testing.assert_allclose(read.channels[name], log.channels[name], rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(read.truth["theta"], log.truth["theta"], rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize(("unit", "size"), [("m", 1.0), ("mm", 1e3), ("um", 1e6)])
def test_the_unit_of_a_header_counts_before_the_rigs(
    log: Log, rig: Rig, tmp_path: Path, unit: str, size: float
) -> None:
    in_mm = rig.with_values({"sensors.x1.unit": "mm"})
    path = renamed(log, rig, tmp_path / "log.csv", {"x1": (f"x1 [{unit}]", size)})
    read = read_log(path, in_mm).channels["x1"]
    np.testing.assert_allclose(read, log.channels["x1"], rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"x1": ("x1 [N]", 1.0)}, r"column 'x1 \[N\]': unit 'N' has the wrong dimension"),
        ({"x1": ("x1 [left]", 1.0)}, r"column 'x1 \[left\]': unit 'left' is not known"),
        ({"t": ("t [mm]", 1.0)}, r"column 't \[mm\]': unit 'mm' has the wrong dimension"),
        (
            {"x1": ("x1 [mm]", 1.0), "x2": ("x1 [m]", 1.0)},
            r"column 'x1' is there twice, as 'x1 \[mm\]' and 'x1 \[m\]'",
        ),
        (
            {"true_theta": ("true_theta [m]", 1.0)},
            r"column 'true_theta \[m\]': unit 'm' is no angle",
        ),
    ],
)
def test_what_is_refused(
    log: Log, rig: Rig, tmp_path: Path, change: dict[str, tuple[str, float]], said: str
) -> None:
    with pytest.raises(LogError, match=said):
        read_log(renamed(log, rig, tmp_path / "log.csv", change), rig)


def test_a_reference_in_no_unit_costs_itself_only(tmp_path: Path) -> None:
    """Nobody asked for it; where somebody does, it is refused."""
    capstan = load_rig("capstan-joint")
    made = Log(
        0.005 * np.arange(40), {name: np.linspace(0.0, 0.1, 40) for name in capstan.sensor_names}
    )
    path = renamed(made, capstan, tmp_path / "log.csv", {"encoder": ("encoder [blob]", 1.0)})
    said = r"column 'encoder \[blob\]': unit 'blob' is no angle; write 'rad' or 'deg'"
    with pytest.warns(DistalWarning, match=rf"{said}: left out"):
        read = read_log(path, capstan)
    assert not read.truth
    np.testing.assert_array_equal(read.channels["motor_angle"], made.channels["motor_angle"])
    with pytest.raises(LogError, match=said):
        read_log(path, capstan, "encoder")


def test_a_column_that_the_rig_names_with_its_unit_is_that_column(
    log: Log, rig: Rig, tmp_path: Path
) -> None:
    whole = rig.with_values({"sensors.x1.column": "x1 [mm]", "sensors.x1.unit": "m"})
    read = read_log(renamed(log, rig, tmp_path / "log.csv", {"x1": ("x1 [mm]", 1.0)}), whole)
    np.testing.assert_array_equal(read.channels["x1"], log.channels["x1"])


def test_counts_need_counts_per_turn(tmp_path: Path) -> None:
    bench = load_rig("lab-bench")
    made = simulate(bench, "lab-bench", 0).select(slice(0, 40))
    said = {"motor_counts": ("motor_counts [count]", 1.0), "current_mA": ("current_mA [A]", 1e-3)}
    read = read_log(renamed(made, bench, tmp_path / "log.csv", said), bench)
    for name in ("motor_angle", "motor_torque"):
        np.testing.assert_allclose(read.channels[name], made.channels[name], rtol=1e-9, atol=1e-12)
    said["motor_counts"] = ("motor_counts [deg]", 1.0)
    with pytest.raises(LogError, match=r"motor_counts \[deg\]': counts need unit = \"count\""):
        read_log(renamed(made, bench, tmp_path / "log.csv", said), bench)


@pytest.mark.parametrize("strip", [False, True])
@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_an_estimate_is_a_truth(log: Log, rig: Rig, tmp_path: Path, unit: str, strip: bool) -> None:
    """In degrees the unit has to be there; without one, radians are meant."""
    result = estimate(log, rig, "inextensible", compiled=False)
    columns = result.columns(unit)
    assert list(columns) == ["t [s]", f"theta [{unit}]", f"theta_std [{unit}]"]
    if strip:
        columns = {name_and_unit(text)[0]: values for text, values in columns.items()}
    write_columns(columns, tmp_path / "estimate.csv")
    found = read_truth(tmp_path / "estimate.csv", log.time)["theta"]
    scale = 1.0 if unit == "rad" or not strip else np.rad2deg(1.0)
    np.testing.assert_allclose(found, scale * result.theta, rtol=1e-12, atol=1e-15)


def test_a_stream_reads_them_too(rig: Rig) -> None:
    reader = MessageReader(rig, ("x1", "u1"))
    reader.header("t [ms],x1 [mm],u1")
    time, sample = reader.csv("2000,3,4")
    assert time == pytest.approx(2.0)
    np.testing.assert_allclose(sample, [3e-3, 4.0])
    reader.header("t,x1,u1 [N]")
    time, sample = reader.csv("2,3,4")
    assert (time, list(sample)) == (2.0, [3.0, 4.0])
    with pytest.raises(LogError, match="unit 'deg' is an angle"):
        reader.header("t,x1 [deg],u1")


def test_a_frame_may_say_units(log: Log, rig: Rig, tmp_path: Path) -> None:
    frame = pl.read_csv(renamed(log, rig, tmp_path / "log.csv", {"x1": ("x1 [mm]", 1e3)}))
    readers: list[Callable[[], object]] = [lambda: frame, frame.to_pandas]
    for made in readers:
        np.testing.assert_allclose(
            read_log(made(), rig).channels["x1"], log.channels["x1"], rtol=1e-12, atol=1e-15
        )
