"""A binary log that is damaged or too large is an error of this log."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from distal.errors import LogError
from distal.logs import read_table

FRAME = pl.DataFrame({"t": np.arange(50) / 100, "a": np.arange(50.0), "text": ["x"] * 50})


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
