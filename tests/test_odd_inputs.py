"""What a hostile stranger tried: each is refused in one line, or does what it says, and never a
traceback.
"""

from __future__ import annotations

from datetime import date
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from distal import LiveEstimator, Monitor, estimate, load_rig, make_estimator, read_log, simulate
from distal.errors import DistalWarning, EstimationError, LogError, RigError
from distal.run import samples_of
from tests.cli.test_cli import refused as refused_here
from tests.cli.test_cli import run  # noqa: F401
from tests.helpers import PULLEYS
from tests.support.maps import with_learned_map

GOOD = "t,x1,u1,x2,u2\n" + "".join(f"{0.01 * i},{1e-4 * i},2.0,1e-3,2.0\n" for i in range(30))


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "log.csv"
    path.write_text(GOOD)
    return path


@pytest.mark.parametrize(
    "assignment",
    [
        'tendons.0.name="std"',
        'sensors.x1.column="true_theta"',
        "sensors.x1.noise=1e150",
        "sensors.x1.rate=1e9",
        "joints.0.inertia=1" + 400 * "0",
        "joints.0.inertia=5e-324",
        "tendons.0.insertion.radius=1e-200",
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
@pytest.mark.parametrize(("column", "value"), [("x1", 1e10), ("u2", -1e300)])
def test_a_wild_value_is_taken_as_missing(
    log: Path, paper_rig, name: str, column: str, value: float
) -> None:
    """Its square would be infinite: it says nothing, and the estimate is as if it were not
    there.
    """
    wild, gone = (
        pl.read_csv(log).with_columns(
            pl.when(pl.col("t") == 0.15).then(v).otherwise(pl.col(column)).alias(column)
        )
        for v in (value, None)
    )
    said = f"sensor '{column}' has 1 wild value, the first at 0.15 s"
    with pytest.warns(DistalWarning, match=said):
        one = estimate(read_log(wild, paper_rig), paper_rig, name)
    other = estimate(read_log(gone, paper_rig), paper_rig, name)
    assert np.array_equal(one.means, other.means)


@pytest.mark.parametrize(
    ("time", "sample"),
    [(0, [0, 0, 1e300, 2]), (0, ["a", 0, 2, 2]), (0, {"x1": 0}), (0, None), (0, [[0], 1])]
    + [(time, [0, 0, 2, 2]) for time in (float("nan"), float("inf"), None, "x")],
)
def test_nothing_begins_with_nonsense(paper_rig, time: object, sample: object) -> None:
    for begin in (make_estimator("elastic", paper_rig).initial, LiveEstimator(paper_rig).step):
        with pytest.raises(EstimationError):
            begin(time, sample)  # type: ignore[arg-type]


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


@pytest.mark.parametrize("plot", ["p.xyz", "p", "none/p.png"])
def test_nothing_is_written_by_a_command_that_fails(
    run, log: Path, tmp_path: Path, plot: str
) -> None:
    words = ("estimate", log, "--rig", "paper-2008-printed", "--plot", tmp_path / plot)
    refused_here(run(*words, "--out", tmp_path / "out.csv"))
    assert not (tmp_path / "out.csv").exists()


def test_a_wild_displacement_of_a_stream_is_as_if_it_were_missing(log: Path, paper_rig) -> None:
    angles = []
    for value in (np.nan, 10.0, -1e300):
        monitor = Monitor(LiveEstimator(paper_rig))
        samples = samples_of(read_log(log, paper_rig), monitor.channels)
        samples[15, monitor.channels.index("x1")] = value
        angles.append([monitor.take(0.01 * k, row).angle for k, row in enumerate(samples)])
    np.testing.assert_allclose(angles[1:], [angles[0]] * 2, atol=1e-12)
