"""The folder of a study's rows, and the runs that fill it, by processes of this computer.

The folder holds a small Parquet file for each chunk, written whole when the chunk ends.
"""

from __future__ import annotations

import io
import json
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from distal.errors import StudyError
from distal.logs import write_whole
from distal.results import make_folder
from distal.study.description import Plan
from distal.study.design_space import Space
from distal.study.runs import Rows, run_chunk
from distal.version import __version__

if TYPE_CHECKING:
    import pyarrow

Columns = dict[str, NDArray[np.generic]]
Progress = Callable[[int, int], None]
Chunk = tuple[int, tuple[int, ...]]

LABEL = "study.json"
"""Name of the file that says to which study a folder belongs."""


@dataclass(frozen=True)
class Folder:
    """The folder of a study's rows and its answer."""

    path: Path

    @property
    def chunks(self) -> dict[int, Path]:
        """Number of each chunk whose rows are in the folder → their file."""
        return {
            int(file.stem): file for file in sorted((self.path / "rows").glob("[0-9]*.parquet"))
        }

    def write(self, chunk: int, rows: Rows) -> None:
        """Write the rows of a chunk."""
        import pyarrow as pa

        path = self.path / "rows" / f"{chunk:06d}.parquet"
        write_whole(path, _bytes(pa.Table.from_pydict(rows)))

    def gather(self) -> Columns:
        """Write the rows of all chunks into one file, ``rows.parquet``, sorted by design, seed and
        scenario, and return them, column → values.
        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        table = pa.concat_tables(map(pq.read_table, self.chunks.values()))
        order = [(name, "ascending") for name in ("design", "seed", "scenario")]
        table = table.sort_by(order)
        write_whole(self.path / "rows.parquet", _bytes(table))
        return {name: table[name].to_numpy() for name in table.column_names}


def _bytes(table: pyarrow.Table) -> bytes:
    import pyarrow.parquet as pq

    buffer = io.BytesIO()
    pq.write_table(table, buffer)
    return buffer.getvalue()


def open_folder(plan: Plan, path: str | Path) -> Folder:
    """Return a study's folder, which is made if it does not exist; the rows of this study that it
    holds are kept.

    Raises:
        StudyError: the folder is of another study or another version of distal, or pyarrow is not
            installed.
        OutputError: the folder cannot be made or written.
    """
    try:
        import pyarrow  # noqa: F401
    except ImportError:
        raise StudyError("the rows of a study need pyarrow; pip install '.[parquet]'") from None
    folder = make_folder(Path(path) / "rows").parent
    label = folder / LABEL
    names = {
        "digest": plan.digest,
        "version": __version__,
        "name": plan.study.name,
        "rig": plan.rig.name,
    }
    if not label.exists():
        write_whole(label, json.dumps(names, indent=2, ensure_ascii=False) + "\n")
        return Folder(folder)
    elsewhere = "give another folder with --out"
    try:
        begun = names | json.loads(label.read_text(encoding="utf-8"))
    except (OSError, ValueError, TypeError):
        raise StudyError(f"{label}: cannot be read; {elsewhere}, or remove this one") from None
    if begun["digest"] != plan.digest:
        raise StudyError(f"{folder}: holds another study's rows; {elsewhere}, or remove it")
    if begun["version"] != __version__:
        raise StudyError(
            f"{folder}: was begun with distal {begun['version']}, this is {__version__}; "
            f"{elsewhere}"
        )
    return Folder(folder)


def run_study(
    plan: Plan,
    space: Space,
    folder: Folder,
    workers: int | None = None,
    progress: Progress | None = None,
) -> None:
    """Run those chunks of a study whose rows its folder lacks; rows are written as chunks end.

    Args:
        workers: number of processes on this computer; default one per core.
        progress: called with the number of runs that are done and of all.

    Raises:
        StudyError: all runs of the first chunk failed by the same error, or a worker ended.
        OutputError: rows cannot be written.
    """
    runs_per_design = plan.study.seeds * len(plan.scenarios)
    finished = folder.chunks
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
    is_first = done == 0
    for number, rows in _by_processes(plan, chunks, count):
        problem, *others = set(map(str, rows["problem"]))
        if is_first and problem and not others:
            raise StudyError(
                f"the first {len(rows['problem'])} runs failed alike, so the study stops: "
                f"{problem}; mend that, and start it again"
            )
        is_first = False
        folder.write(number, rows)
        done += len(rows["design"])
        if progress is not None:
            progress(done, total)


def _by_processes(plan: Plan, chunks: Sequence[Chunk], workers: int) -> Iterator[tuple[int, Rows]]:
    if workers == 1:
        yield from ((number, run_chunk(plan, designs)) for number, designs in chunks)
        return
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _begin)
    try:
        running = {pool.submit(run_chunk, plan, designs): number for number, designs in chunks}
        for future in as_completed(running):
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


def _begin() -> None:
    """Prepare a process of the pool: it ignores SIGINT, which its parent handles, and ends when its
    parent has ended.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
