"""What a hostile stranger tried: each is refused in one line, or does what it says, and never a
traceback.
"""

from __future__ import annotations

import os
import subprocess
import sys
from datetime import date
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from distal import estimate, load_rig, make_estimator, read_log, simulate
from distal.errors import DistalError, DistalWarning, EstimationError, LogError, RigError
from distal.rig import rig_text
from distal.units import unit_factor
from tests.cli.test_cli import refused as refused_here
from tests.cli.test_cli import run  # noqa: F401
from tests.helpers import PULLEYS
from tests.support.maps import with_learned_map

GOOD = "t,x1,u1,x2,u2\n" + "".join(f"{0.01 * i},{1e-4 * i},2.0,1e-3,2.0\n" for i in range(30))
CLI = [sys.executable, "-c", "from distal.cli import main; main()"]


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "log.csv"
    path.write_text(GOOD)
    return path


def cli(*words: object, **environment: str) -> subprocess.CompletedProcess[str]:
    settings = {**os.environ, "PYTHONUTF8": "1", **environment}
    return subprocess.run(
        [*CLI, *map(str, words)],
        env=settings,
        capture_output=True,
        text=True,
        check=False,
        errors="replace",
    )


@pytest.mark.parametrize(
    "assignment",
    [
        'tendons.0.name="std"',
        'drives.0.name="left_std"',
        'sensors.x1.column="true_theta"',
        "sensors.x1.noise=1e150",
        "sensors.x1.rate=1e300",
        "sensors.x1.rate=1e9",
        "joints.0.inertia=1" + 400 * "0",
        "joints.0.inertia=5e-324",
        "tendons.0.insertion.radius=1e-200",
        "tendons.0.insertion.free_length=1e-200",
        "stepping.largest_step=5e-324",
        'joints.0.inertia="1 kg m^2 * 9**9**9**9"',
        'joints.0.inertia="1 kg^9^9^9"',
        'sensors.x1.unit="1 m"',
        'sensors.x1.unit="m;"',
        "joints.².inertia=1",
        "joints.0.inertia=1\nfoo=2",
        "joints.0.inertia=" + 3000 * "[",
    ],
)
def test_odd_values_of_a_rig(assignment: str) -> None:
    with pytest.raises(RigError) as caught:
        load_rig("paper-2008-printed", [assignment])
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 700


def test_powers_in_units_still_work() -> None:
    assert unit_factor("kg m^2", "kg m^2") == 1.0
    assert unit_factor("kg·m²·s⁻²", "N m") == 1.0
    assert unit_factor("m/s**2", "m/s^2") == 1.0


def test_numpy_numbers_are_numbers(paper_rig) -> None:
    rig = paper_rig.with_values(
        {"tendons.0.stiffness": np.float32(700), "drives.0.mass": np.int64(1)}
    )
    assert rig.tendons[0].stiffness.value == 700.0
    for wrong in (None, [], {1: 2}, {"joints.0.inertia": 10**400}, {"joints.0.inertia": {}}):
        with pytest.raises(RigError):
            paper_rig.with_values(wrong)  # type: ignore[arg-type]


@pytest.mark.filterwarnings("ignore::distal.errors.DistalWarning")
def test_a_filter_that_leaves_all_bounds_names_the_map_that_the_rig_has(
    log: Path, paper_rig
) -> None:
    rig = paper_rig.with_values({"drives.0.stops": None, **PULLEYS})
    with_line = with_learned_map([simulate(rig, "series-2", 1)], rig, "readings")
    wild = pl.col("t").is_between(0.145, 0.175)
    frame = pl.read_csv(log).with_columns(x1=pl.when(wild).then(9e6).otherwise(pl.col("x1")))
    for described, words in (
        (rig, r"left all bounds at 0\.1.*largest_step$"),
        (with_line, "or take the estimator regression"),
    ):
        with pytest.raises(EstimationError, match=words):
            estimate(read_log(frame, described), described, "inextensible")


@pytest.mark.parametrize("name", ["adaptive", "inextensible", "elastic"])
@pytest.mark.parametrize("value", [1e300, -1e300, 1e10])
def test_a_wild_value_is_taken_as_missing(log: Path, paper_rig, name: str, value: float) -> None:
    """Its square would be infinite: it says nothing, and the estimate is as if it were not
    there.
    """
    frame, at = pl.read_csv(log), pl.col("t") == 0.15
    for column in ("x1", "u2"):
        wild, gone = (
            frame.with_columns(pl.when(at).then(v).otherwise(pl.col(column)).alias(column))
            for v in (value, None)
        )
        with pytest.warns(
            DistalWarning, match=f"sensor '{column}' has 1 wild value, the first at 0.15 s"
        ):
            one = estimate(read_log(wild, paper_rig), paper_rig, name)
        other = estimate(read_log(gone, paper_rig), paper_rig, name)
        assert np.array_equal(one.means, other.means)


def test_nothing_begins_with_nonsense(paper_rig) -> None:
    made = make_estimator("elastic", paper_rig)
    for sample in ([0, 0, 1e300, 2], [1e300, 0, 2, 2], ["a", 0, 2, 2], {"x1": 0}, None, [[0], 1]):
        with pytest.raises(EstimationError):
            made.initial(0, sample)
    for time in (float("nan"), float("inf"), None, "x"):
        with pytest.raises(EstimationError):
            made.initial(time, [0, 0, 2, 2])
    with pytest.raises(EstimationError):
        made.scan(made.initial(0, [0, 0, 2, 2]), np.array([1e18]), np.array([[0, 0, 2, 2]]))


def test_odd_calls(log: Path, paper_rig) -> None:
    read = read_log(log, paper_rig)
    for words in (
        {"estimator": ["adaptive"]},
        {"estimator": 3},
        {"truth": "zz"},
    ):
        with pytest.raises(DistalError):
            estimate(read, paper_rig, **words)  # type: ignore[arg-type]
    for name, rig in (([], paper_rig), (None, "paper-2008"), ("elastic", "paper-2008-printed")):
        with pytest.raises(DistalError):
            make_estimator(name, rig)  # type: ignore[arg-type]


def test_odd_stamps(log: Path, paper_rig) -> None:
    frame = pl.read_csv(log)
    for last in (1e18, 1e300):
        far = last * (1.0 + pl.col("t"))  # of two rows: one alone is a wild stamp
        wide = frame.with_columns(t=pl.when(pl.col("t") > 0.27).then(far).otherwise(pl.col("t")))
        with pytest.raises(EstimationError, match=r"gap of .* too long"):
            estimate(wide, paper_rig)
    slow = pl.DataFrame(
        {"t": 900.0 * np.arange(30), **{c: frame[c] for c in ("x1", "u1", "x2", "u2")}}
    )
    said = r"stamps are 900 s apart, .* every 0\.01 s\. .* set the sensors' rate to the log's"
    with pytest.raises(LogError, match=said):
        estimate(slow, paper_rig)
    epoch = frame.with_columns(
        t=1.7e9 + pl.when(pl.col("t").is_between(0.045, 0.065)).then(0.01).otherwise(pl.col("t"))
    )
    with pytest.raises(
        LogError, match=r"row 5: time goes back \(0\.0(1|0999)\d* s after 0\.0(4|399)\d* s"
    ):
        read_log(epoch, paper_rig)


def test_parquet_types_are_not_numbers_by_accident(tmp_path: Path, paper_rig, log: Path) -> None:
    frame = pl.read_csv(log)
    path = tmp_path / "odd.parquet"
    for column, values in (("x1", date(2026, 1, 1)), ("x1", True), ("t", True)):
        frame.with_columns(pl.lit(values).alias(column)).write_parquet(path)
        with pytest.raises(LogError, match=f"column '{column}' holds"):
            read_log(path, paper_rig)
    frame.with_columns(pl.lit(date(2026, 1, 1)).alias("t")).write_parquet(path)
    with pytest.raises(
        LogError, match=r"30 rows share each stamp of 't'.*too few digits"
    ):  # a date is a stamp, but not the same for all rows
        read_log(path, paper_rig)
    frame.with_columns(u1=pl.lit(float("inf"))).write_parquet(path)
    with pytest.raises(LogError, match="row 1, column 'u1': 'inf'"):
        read_log(path, paper_rig)


def test_truth_without_a_value(tmp_path: Path, log: Path, paper_rig) -> None:
    frame = pl.read_csv(log).with_columns(
        th=pl.lit(None, dtype=pl.Float64), encoder=pl.lit(None, dtype=pl.Float64)
    )
    with pytest.raises(LogError, match=r"the truth \(column 'th'\) has no value at all"):
        read_log(frame, paper_rig, truth="th")
    assert "theta" not in read_log(frame, paper_rig).truth  # a reference that was never connected
    between = tmp_path / "between.csv"
    between.write_text("t,theta\n0.0011,1\n0.0012,1\n")
    with pytest.raises(LogError, match="no value at all"):
        read_log(log, paper_rig, truth=between)
    with pytest.raises(LogError, match="which is no angle"):
        read_log(frame.with_columns(th=pl.lit(1e300)), paper_rig, truth="th")


def test_a_long_cell_is_no_long_message(log: Path, paper_rig) -> None:
    log.write_text(GOOD.replace("2.0,1e-3", '2.0,"1e-3', 1) + "x" * 140_000)
    with pytest.raises(LogError, match=r"is a quote not closed|too") as caught:
        read_log(log, paper_rig)
    assert len(str(caught.value)) < 1200


def test_nothing_is_written_by_a_command_that_fails(run, log: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.csv"
    for plot in ("p.xyz", "p", "none/p.png"):
        refused_here(
            run(
                "estimate",
                log,
                "--rig",
                "paper-2008-printed",
                "--out",
                out,
                "--plot",
                tmp_path / plot,
            )
        )
        assert not out.exists()


@pytest.mark.more
@pytest.mark.slow  # processes of their own
def test_odd_terminals(log: Path) -> None:
    ascii_only = cli(
        "estimate", log, "--rig", "paper-2008-printed", PYTHONUTF8="0", PYTHONIOENCODING="ascii"
    )
    assert ascii_only.returncode == 0, ascii_only.stderr
    full = subprocess.run(
        [
            "bash",
            "-c",
            f"'{sys.executable}' -c 'from distal.cli import main; main()' rigs > /dev/full",
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    assert full.returncode != 0
    assert "Traceback" not in full.stderr


@pytest.mark.slow
@pytest.mark.more
def test_titles_are_plain_text(log: Path, tmp_path: Path) -> None:
    for i, name in enumerate(("cost $x^$", "日本語", "a" * 3000)):
        plot = tmp_path / f"{i}.png"
        ran = cli(
            "estimate",
            log,
            "--rig",
            "paper-2008-printed",
            "--plot",
            plot,
            "--set",
            f'name="{name}"',
        )
        assert ran.returncode == 0
        assert "Traceback" not in ran.stderr
        assert "Glyph" not in ran.stderr
        assert plot.exists()


DISTAL = f"'{sys.executable}' -c 'from distal.cli import main; main()'"


@pytest.mark.more
@pytest.mark.parametrize(
    ("source", "tail"),
    [
        pytest.param(
            "cat log.csv",
            "estimate /dev/stdin --rig paper-2008-printed --truth u1",
            marks=pytest.mark.slow,
        ),
        pytest.param("cat rig.toml", "rig show /dev/stdin --set joints.0.inertia=1"),
        pytest.param(
            f"{DISTAL} rig show paper-2008-printed",
            "rig show /dev/stdin --set joints.0.inertia=1",
            marks=pytest.mark.slow,
        ),
    ],
    ids=["log", "rig", "rig that is shown"],
)
def test_pipes(log: Path, source: str, tail: str) -> None:
    (log.parent / "rig.toml").write_text(rig_text("paper-2008-printed")[0])
    ran = subprocess.run(
        ["bash", "-c", f"{source} | {DISTAL} {tail}"],
        cwd=log.parent,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr


@pytest.mark.parametrize("size", [10.0, -1e3, 1e6, -1e300])
@pytest.mark.parametrize("column", ["x1", "x2", "u1", "u2"])
def test_a_wild_value_of_any_size_leaves_the_estimate(paper_rig, column: str, size: float) -> None:
    """One sample of a stream: a displacement as if it were missing; a force by less than the
    band.
    """
    from distal import LiveEstimator, Monitor

    def angles(value: float) -> np.ndarray:
        monitor = Monitor(LiveEstimator(paper_rig))
        at, made = monitor.channels.index(column), []
        for k in range(110):
            read = {
                "x1": 1e-3 * np.sin(k / 30),
                "x2": 1e-3 * np.cos(k / 30),
                "u1": 2.0 + 0.3 * np.sin(k / 40),
                "u2": 2.0,
            }
            sample = np.array([read[name] for name in monitor.channels])
            if k == 60:
                sample[at] = value
            made.append(monitor.take(0.01 * k, sample).angle)
        return np.array(made)

    change = np.abs(angles(size) - angles(np.nan))
    assert change.max() < (1e-12 if column.startswith("x") else np.deg2rad(0.15)), np.rad2deg(
        change.max()
    )
