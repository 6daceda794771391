"""One BLAS thread where small matrices are multiplied, and the caller's own limits afterwards."""

from __future__ import annotations

import threading

import numpy as np
import pytest
from threadpoolctl import ThreadpoolController, threadpool_limits

from distal import fit
from distal.machine_limits import one_blas_thread
from tests.support.foreign_plants import finger_log, finger_rig

assert np.eye(2).sum() == 2.0  # its BLAS is loaded


def threads() -> list[int]:
    return [
        one["num_threads"] for one in ThreadpoolController().info() if one["user_api"] == "blas"
    ]


@pytest.fixture(autouse=True)
def _two() -> object:
    if not threads():
        pytest.skip("threadpoolctl knows no BLAS here")
    with threadpool_limits(2, "blas"):
        yield


def test_limits_come_back_after_an_exception() -> None:
    before = threads()
    assert max(before) == 2

    def fails() -> None:
        with one_blas_thread(), one_blas_thread():
            assert set(threads()) == {1}
            raise ValueError("x")

    with pytest.raises(ValueError, match="x"):
        fails()
    assert threads() == before


@pytest.mark.parametrize("main_last", [True, False])
def test_limits_come_back_after_two_that_overlap(main_last: bool) -> None:
    before, inside, leave = threads(), threading.Event(), threading.Event()

    def other() -> None:
        with one_blas_thread():
            inside.set()
            leave.wait(10.0)

    thread = threading.Thread(target=other)
    with one_blas_thread():
        thread.start()
        assert inside.wait(10.0)
        if main_last:
            leave.set()
            thread.join()
            assert set(threads()) == {1}
    leave.set()
    thread.join()
    assert threads() == before


@pytest.mark.more
def test_a_fit_runs_with_one_and_gives_the_limits_back() -> None:
    before, seen = threads(), list[int]()

    def look(doing: str) -> None:
        seen.extend(threads())

    fit([finger_log(0, 3.0)], finger_rig(), progress=look)
    assert set(seen) == {1}
    assert threads() == before
