"""A binary log that is damaged or too large is an error of this log."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from distal import Rig, estimate_batch
from distal.errors import LogError
from distal.logs import read_table

TIME = np.arange(50) / 100
FRAME = pl.DataFrame({"t": TIME, "a": np.arange(50.0), "text": ["x"] * 50})


@pytest.fixture
def path(tmp_path: Path) -> Path:
    made = tmp_path / "run.parquet"
    FRAME.write_parquet(made)
    return made


def test_names_are_names(tmp_path: Path, path: Path) -> None:
    """A bracket or a star is a letter of a name, not a pattern of names."""
    for name in ("run[1].parquet", "r*n.parquet", "run?.parquet", "a=b.parquet", "%41.parquet"):
        with pytest.raises(LogError, match="No such file"):
            read_table(tmp_path / name, ["a"])
        FRAME.with_columns(pl.col("a") + 7).write_parquet(tmp_path / "made")
        (tmp_path / "made").rename(tmp_path / name)
        assert read_table(tmp_path / name, ["a"]).columns["a"][0] == 7
    assert read_table(path, ["a"]).columns["a"][0] == 0


def test_only_what_is_asked_for_is_read(path: Path) -> None:
    assert list(read_table(path, ["t", "a"]).columns) == ["t", "a"]
    with pytest.raises(
        LogError, match=r"column 'aa' is missing; did you mean 'a'\? \(known: a, t, text\)"
    ):
        read_table(path, ["t", "aa"])
    with pytest.raises(LogError, match="row 1, column 'text': 'x' is not a finite number"):
        read_table(path)


def test_memory_by_the_header(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A column of one value takes no room in a file: a few kB here are 480 MB in memory."""
    path = tmp_path / "long.parquet"
    pl.select(pl.repeat(0.5, 20_000_000).alias("a")).write_parquet(path)
    assert path.stat().st_size < 300_000
    monkeypatch.setenv("DISTAL_MAX_MEMORY", "300 MB")
    with pytest.raises(
        LogError, match=r"20,000,000 rows of 1 columns or more, about 0.5 GB .* 0.3 GB are allowed"
    ):
        read_table(path, ["a"])


def test_memory_that_no_header_tells(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A list with any number of values in a row is no vector."""
    path = tmp_path / "nested.parquet"
    pl.select(pl.repeat(0.5, 1_500_000).implode().alias("a"), pl.lit(0.0).alias("t")).write_parquet(
        path
    )
    monkeypatch.setenv("DISTAL_MAX_MEMORY", "8 MB")
    with pytest.raises(LogError, match="holds lists as text"):
        read_table(path, ["t", "a"])


def test_one_damaged_log_of_many(tmp_path: Path, pulley_rig: Rig) -> None:
    """It is left out and said; the others of a batch are estimated."""
    names = [tmp_path / f"{i}.parquet" for i in range(3)]
    for name in names:
        pl.DataFrame({"t": TIME, **dict.fromkeys(("x1", "x2", "u1", "u2"), TIME)}).write_parquet(
            name
        )
    content = names[1].read_bytes()
    names[1].write_bytes(content[: len(content) // 2])
    failed: dict[str, Exception] = {}
    results = list(estimate_batch(names, pulley_rig, "inextensible", skip=failed.__setitem__))
    assert [len(result) for result in results] == [50, 50]
    assert list(failed) == [str(names[1])]
