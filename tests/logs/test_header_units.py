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
from distal.logs import MessageReader, read_truth, write_columns, write_log
from distal.logs.table_cells import name_and_unit


@pytest.fixture(scope="module")
def rig() -> Rig:
    """The scenario's rig, whose sensors leave the unit to the log."""
    rig = scenario_rig(load_scenario("series-1"))
    return rig.with_values({f"sensors.{name}.unit": None for name in ("x1", "x2", "u1", "u2")})


@pytest.fixture(scope="module")
def log(rig: Rig) -> Log:
    return simulate(rig, "series-1", 0).select(slice(0, 60))


Renamed = Callable[[Log, Rig, dict[str, tuple[str, float]]], pl.DataFrame]


@pytest.fixture
def renamed(tmp_path: Path) -> Renamed:
    """Return a log with other headers: column → header and factor on its numbers."""

    def call(log: Log, rig: Rig, change: dict[str, tuple[str, float]]) -> pl.DataFrame:
        write_log(log, rig, tmp_path / "plain.csv")
        columns = pl.read_csv(tmp_path / "plain.csv").to_dict()
        for name, (new, factor) in change.items():
            columns[new] = factor * columns.pop(name)
        return pl.DataFrame(columns)

    return call


def check(read: Log, log: Log) -> None:
    np.testing.assert_allclose(read.time, log.time, atol=1e-12)
    for name in ("x1", "x2", "u1", "u2"):
        np.testing.assert_allclose(read.channels[name], log.channels[name], rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("kind", ["csv", "parquet", "polars", "pandas"])
def test_units_in_the_header_count_where_the_rig_gives_none(
    renamed: Renamed, log: Log, rig: Rig, tmp_path: Path, kind: str
) -> None:
    degrees = float(np.rad2deg(1.0))
    units = {
        "t": ("t [ms]", 1e3),
        "x1": ("x1 [mm]", 1e3),
        "x2": ("x2 [m]", 1.0),
        "u1": ("u1 [mN]", 1e3),
        "true_theta": ("true_theta [deg]", degrees),
    }
    frame, path = renamed(log, rig, units), tmp_path / f"log.{kind}"
    if kind in ("csv", "parquet"):
        getattr(frame, f"write_{kind}")(path)
    read = read_log({"polars": frame, "pandas": frame.to_pandas()}.get(kind, path), rig)
    check(read, log)
    np.testing.assert_allclose(read.truth["theta"], log.truth["theta"], rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize(("unit", "size"), [("m", 1.0), ("mm", 1e3), ("um", 1e6)])
def test_the_unit_of_a_header_counts_before_the_rigs(
    renamed: Renamed, log: Log, rig: Rig, unit: str, size: float
) -> None:
    in_mm = rig.with_values({"sensors.x1.unit": "mm"})
    check(read_log(renamed(log, rig, {"x1": (f"x1 [{unit}]", size)}), in_mm), log)


@pytest.mark.parametrize(
    ("headers", "said"),
    [
        ({"x1": "x1 [N]"}, r"column 'x1 \[N\]': unit 'N' has the wrong dimension"),
        ({"x1": "x1 [left]"}, r"column 'x1 \[left\]': unit 'left' is not known"),
        ({"t": "t [mm]"}, r"column 't \[mm\]': unit 'mm' has the wrong dimension"),
        (
            {"x1": "x1 [mm]", "x2": "x1 [m]"},
            r"column 'x1' is there twice, as 'x1 \[mm\]' and 'x1 \[m\]'",
        ),
        ({"true_theta": "true_theta [m]"}, r"column 'true_theta \[m\]': unit 'm' is no angle"),
    ],
)
def test_what_is_refused(
    renamed: Renamed, log: Log, rig: Rig, headers: dict[str, str], said: str
) -> None:
    with pytest.raises(LogError, match=said):
        read_log(renamed(log, rig, {name: (text, 1.0) for name, text in headers.items()}), rig)


def test_a_reference_in_no_unit_costs_itself_only(renamed: Renamed) -> None:
    """Nobody asked for it; where somebody does, it is refused."""
    capstan = load_rig("capstan-joint")
    values = np.linspace(0.0, 0.1, 40)
    made = Log(0.005 * np.arange(40), dict.fromkeys(capstan.sensor_names, values))
    frame = renamed(made, capstan, {"encoder": ("encoder [blob]", 1.0)})
    said = r"column 'encoder \[blob\]': unit 'blob' is no angle; write 'rad' or 'deg'"
    with pytest.warns(DistalWarning, match=rf"{said}: left out"):
        read = read_log(frame, capstan)
    assert not read.truth
    np.testing.assert_array_equal(read.channels["motor_angle"], values)
    with pytest.raises(LogError, match=said):
        read_log(frame, capstan, "encoder")


def test_a_column_that_the_rig_names_with_its_unit_is_that_column(
    renamed: Renamed, log: Log, rig: Rig
) -> None:
    whole = rig.with_values({"sensors.x1.column": "x1 [mm]", "sensors.x1.unit": "m"})
    check(read_log(renamed(log, rig, {"x1": ("x1 [mm]", 1.0)}), whole), log)


def test_counts_need_counts_per_turn(renamed: Renamed) -> None:
    bench = load_rig("lab-bench")
    made = simulate(bench, "lab-bench", 0).select(slice(0, 40))
    said = {"motor_counts": ("motor_counts [count]", 1.0), "current_mA": ("current_mA [A]", 1e-3)}
    read = read_log(renamed(made, bench, said), bench)
    for name in ("motor_angle", "motor_torque"):
        np.testing.assert_allclose(read.channels[name], made.channels[name], rtol=1e-9, atol=1e-12)
    said["motor_counts"] = ("motor_counts [deg]", 1.0)
    with pytest.raises(LogError, match=r"motor_counts \[deg\]': counts need unit = \"count\""):
        read_log(renamed(made, bench, said), bench)


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
