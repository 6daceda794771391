"""A study goes on where it was stopped, and its rows depend neither on that nor on who works them
off.
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from distal.errors import Content, OutputError, StudyError
from distal.logs import output_files
from distal.study import Plan, open_folder, run_study, space_of
from distal.study.runs import Columns
from tests.study.plans import small

pytest.importorskip("pyarrow")

MANY = 50
"""Designs of a study of several chunks: with two seeds 24 of them are one."""


def changes(designs: int) -> dict[str, object]:
    return {"designs": designs, "estimator": "inextensible"}


def many(designs: int = MANY) -> Plan:
    """Return a study of several chunks."""
    return small(**changes(designs))


def rows(plan: Plan, folder: Path, workers: int = 1) -> Columns:
    opened = open_folder(plan, folder)
    run_study(plan, space_of(plan), opened, workers)
    return opened.gather()


def assert_same(one: Columns, other: Columns) -> None:
    assert one.keys() == other.keys()
    for name in one.keys() - {"seconds"}:
        np.testing.assert_array_equal(one[name], other[name], err_msg=name)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Columns:
    return rows(many(), tmp_path_factory.mktemp("whole"))


def test_a_study_that_was_stopped_goes_on(whole: Columns, tmp_path: Path) -> None:
    plan = many()
    folder, done = open_folder(plan, tmp_path), list[int]()

    def stop(count: int, total: int) -> None:
        assert total == 2 * MANY
        done.append(count)
        if len(done) == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_study(plan, space_of(plan), folder, 1, progress=stop)
    assert done == [0, 48, 96]
    kept = [file.stat().st_mtime_ns for file in sorted((tmp_path / "rows").iterdir())]
    assert_same(rows(plan, tmp_path), whole)
    assert [file.stat().st_mtime_ns for file in sorted((tmp_path / "rows").iterdir())][:2] == kept


def test_rows_are_in_order_and_complete(whole: Columns) -> None:
    assert whole["design"].tolist() == [i for i in range(MANY) for _ in range(2)]
    assert whole["seed"].tolist() == [0, 1] * MANY
    assert np.isfinite(whole["rms_deg"]).all()


@pytest.mark.slow
def test_rows_do_not_depend_on_the_number_of_processes(whole: Columns, tmp_path: Path) -> None:
    assert_same(rows(many(), tmp_path, workers=2), whole)


def test_a_folder_of_another_study_is_refused(tmp_path: Path) -> None:
    open_folder(small(), tmp_path)
    open_folder(small(), tmp_path)
    with pytest.raises(
        StudyError, match="holds another study's rows; give another folder with --out"
    ):
        open_folder(small(seeds=3), tmp_path)
    (tmp_path / "study.json").write_text("{")
    with pytest.raises(StudyError, match=r"cannot be read; give another folder"):
        open_folder(small(), tmp_path)


def test_a_disk_that_is_full_loses_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plan = many()
    folder, calls = open_folder(plan, tmp_path), list[int]()
    put = output_files.put

    def full(path: Path, content: Content) -> None:
        calls.append(1)
        if len(calls) > 1:
            raise OSError(28, "No space left on device")
        put(path, content)

    monkeypatch.setattr(output_files, "put", full)
    with pytest.raises(OutputError, match="No space left on device"):
        run_study(plan, space_of(plan), folder, 1)
    assert [file.name for file in (tmp_path / "rows").iterdir()] == ["000000.parquet"]


def test_other_processes_of_the_caller_go_on() -> None:
    from multiprocessing import get_context

    from distal.study.runs import _by_processes

    child = get_context("spawn").Process(target=time.sleep, args=(60.0,))
    child.start()
    try:
        assert list(_by_processes(small(), [], 2)) == []
        child.join(0.3)
        assert child.is_alive()
    finally:
        child.terminate()
        child.join()


def failing(plan: Plan, designs: tuple[int, ...]) -> dict[str, list[object]]:
    """Return rows of which every one says the same problem, but those of a design beyond the first
    chunk.
    """
    of = [design for design in designs for _ in range(2)]
    return {"design": list(of), "problem": ["no room" if design < 24 else "" for design in of]}


def test_a_study_stops_where_all_its_first_runs_fail_alike(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """It says why, after one chunk, and leaves no rows behind: mended, it begins anew."""
    ran = list[tuple[int, ...]]()

    def run(plan: Plan, designs: tuple[int, ...]) -> dict[str, list[object]]:
        ran.append(designs)
        return failing(plan, designs)

    monkeypatch.setattr("distal.study.runs.run_chunk", run)
    plan, folder = many(), open_folder(many(), tmp_path / "latin")
    with pytest.raises(
        StudyError, match="the first 48 runs failed alike, so the study stops: no room; mend that"
    ):
        run_study(plan, space_of(plan), folder, 1)
    assert len(ran) == 1
    assert folder.chunks == {}
