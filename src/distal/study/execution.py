"""Run the chunks of a study by processes of this computer or by a Dask cluster; both call the same
function on the same list.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool

from distal.cluster import on_cluster
from distal.errors import StudyError
from distal.study.description import Plan
from distal.study.design_space import Space
from distal.study.runs import Rows, run_chunk
from distal.study.storage import Folder

Progress = Callable[[int, int], None]
Chunk = tuple[int, tuple[int, ...]]

FIRST_RUNS = 20
"""Number of runs after which a new study, but for a grid, stops where all of them failed by the
same error [1]. Source: judgement.
"""


def run_study(
    plan: Plan,
    space: Space,
    folder: Folder,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Progress | None = None,
) -> None:
    """Run those chunks of a study whose rows its folder lacks; rows are written as chunks end.

    Args:
        workers: number of processes on this computer; default one per core.
        scheduler: address of a Dask scheduler, ``tcp://host:8786``, whose workers run the chunks
            instead.
        progress: called with the number of runs that are done and of all.

    Raises:
        StudyError: the first runs all failed by the same error, a worker ended, or the scheduler is
            not there or has another version.
        OutputError: rows cannot be written.
    """
    runs_per_design = plan.study.seeds * len(plan.scenarios)
    finished = folder.done()
    total = len(space) * runs_per_design
    chunks = [
        (k, designs) for k, designs in enumerate(space.chunks(runs_per_design)) if k not in finished
    ]
    done = total - sum(len(designs) for _, designs in chunks) * runs_per_design
    if progress is not None:
        progress(done, total)
    if not chunks:
        return
    count = (os.cpu_count() or 1) if workers is None else workers
    held: list[tuple[int, Rows]] | None = [] if done == 0 and plan.study.fill != "grid" else None
    for number, rows in (
        _by_dask(plan, chunks, scheduler) if scheduler else _by_processes(plan, chunks, count)
    ):
        if held is not None:
            # an error of all first runs ends the study before the others begin; no row is written
            held.append((number, rows))
            problems = [str(text) for _, part in held for text in part["problem"]]
            if set(problems) == {problems[0]} and problems[0]:
                if len(problems) >= min(FIRST_RUNS, total):
                    raise StudyError(
                        f"the first {len(problems)} runs failed alike, so the study stops: "
                        f"{problems[0]}; mend that, and "
                        "start it again"
                    )
                continue
            for each in held:
                folder.write(*each)
            held = None
        else:
            folder.write(number, rows)
        done += len(rows["design"])
        if progress is not None:
            progress(done, total)


def _by_processes(plan: Plan, chunks: Sequence[Chunk], workers: int) -> Iterator[tuple[int, Rows]]:
    if workers == 1:
        yield from ((number, run_chunk(plan, designs)) for number, designs in chunks)
        return
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _begin, (plan,))
    try:
        waiting = iter(chunks)
        running: dict[Future[Rows], int] = {}
        while True:
            while len(running) < 2 * workers and (chunk := next(waiting, None)) is not None:
                running[pool.submit(_work, chunk[1])] = chunk[0]
            if not running:
                break
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                yield running.pop(future), future.result()
    except BrokenProcessPool:
        raise StudyError(
            "a process of this study was ended from outside, for want of memory perhaps; the rows "
            "so far are kept: the "
            "same command goes on, with fewer --workers if memory was short"
        ) from None
    finally:
        for process in list(
            pool._processes.values()
        ):  # of this pool alone: the caller may have others
            process.terminate()
        pool.shutdown(wait=True, cancel_futures=True)


_PLAN: list[Plan] = []
"""The plan that a process of the pool works on."""


def _begin(plan: Plan) -> None:
    """Prepare a process of the pool: it ends when its parent has ended, and ignores SIGINT, which
    its parent handles.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _PLAN[:] = [plan]
    parent = os.getppid()

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _work(designs: tuple[int, ...]) -> Rows:
    return run_chunk(_PLAN[0], designs)


def _by_dask(plan: Plan, chunks: Sequence[Chunk], address: str) -> Iterator[tuple[int, Rows]]:
    tasks = {number: (plan, designs) for number, designs in chunks}
    yield from on_cluster(
        run_chunk, tasks, address, StudyError, "the rows so far are kept: the same command goes on"
    )
