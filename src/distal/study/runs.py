"""The runs of a study, by processes of this computer: rigs as built are simulated and estimated,
those of one structure side by side in vector lanes, and their rows fill a folder.

The folder holds a small Parquet file for each chunk, written whole when the chunk ends.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from fnmatch import fnmatch
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from distal.arrays import Floats
from distal.confidence import BAND
from distal.control import ClosedLoop, closed_loop
from distal.errors import DistalError, StudyError
from distal.estimators import DEFAULT, KernelEstimator, make_estimator
from distal.homing import Run
from distal.kernels import Kernel, lanes_here
from distal.logs import write_whole
from distal.machine_limits import one_blas_thread
from distal.model import Mechanism
from distal.results import Estimate, make_folder
from distal.rig import Rig, named
from distal.run.offline import prepared, run_all
from distal.simulation.plant import equilibrium, initial_angles, plant_kernel
from distal.simulation.simulate import Prepared, motions_of, prepare, sampled
from distal.study.design_space import (
    ESTIMATOR,
    FEEDBACK,
    Design,
    Draw,
    Plan,
    Space,
    built_values,
    draws_of,
    rig_of,
    scores,
    space_of,
)
from distal.version import __version__

Lane = TypeVar("Lane")
Cell = float | str | bool
Rows = dict[str, list[Cell]]
Outcome = Estimate | ClosedLoop | DistalError

MEASURES = ("rms_deg", "worst_deg", "within", "inside", "half_band_deg")
"""What is measured of a run: RMS and largest error [°], shares of the time within the limit and
inside the 95 % band, and the mean half-width of that band [°]. In a closed loop the error is the
true angle's distance from its reference; the band is always judged by the estimate.
"""

BUILT = "built: "
"""Beginning of the names of columns that hold the draws of a rig as built, in standard
deviations.
"""


@dataclass(frozen=True)
class Task:
    """One run of a study.

    Args:
        index: of the design.
        design: path → value [SI].
        seed: number of the rig as built.
        scenario: index of the scenario.
    """

    index: int
    design: Design
    seed: int
    scenario: int


_SPACES: dict[str, Space] = {}


def run_chunk(plan: Plan, designs: Sequence[int]) -> Rows:
    """Return the rows of some designs, given by their indices: one row for each design, rig as
    built and scenario. A run that fails has a row too, with its error as ``problem``.
    """
    with one_blas_thread():
        begun = time.perf_counter()
        digest = plan.digest
        space = _SPACES[digest] = _SPACES.get(digest) or space_of(plan)
        seeds = range(plan.study.seeds)
        scenarios = range(len(plan.scenarios))
        tasks = [
            Task(i, space.design(i), seed, s) for i in designs for seed in seeds for s in scenarios
        ]
        rows: Rows = {}
        for task, outcome in zip(tasks, run_tasks(plan, tasks)):
            for column, cell in _row(plan, task, outcome).items():
                rows.setdefault(column, []).append(cell)
        rows["seconds"] = [(time.perf_counter() - begun) / len(tasks)] * len(tasks)
        return rows


def _row(plan: Plan, task: Task, outcome: Outcome) -> dict[str, Cell]:
    asked = plan.study.requirement
    row: dict[str, Cell] = {"design": task.index, "seed": task.seed}
    row["scenario"] = plan.study.scenarios[task.scenario]
    row |= {
        path: setting if isinstance(setting, str) else float(setting)
        for path, setting in task.design.items()
    }
    row |= {
        f"{BUILT}{draw}": score
        for draw, score in scores(draws_of(plan.rig), _seeds(plan, task)).items()
    }
    if isinstance(outcome, DistalError):
        failed = dict.fromkeys(MEASURES, float("nan"))
        return row | failed | {"met": False, "problem": str(outcome)}
    if isinstance(outcome, ClosedLoop):
        curves = outcome.angles, outcome.estimates, outcome.stds
    else:
        assert outcome.truths is not None  # of a simulated log
        curves = outcome.truths, outcome.angles, outcome.angle_stds
    joint = plan.rig.joint_names.index(asked.joint)
    truth, estimate, std = (curve[:, joint] for curve in curves)
    errors = wrong = np.abs(estimate - truth)
    if isinstance(outcome, ClosedLoop) and asked.joint in outcome.references:
        # in a closed loop the requirement is on the true angle: it is to follow the reference
        errors = np.abs(truth - outcome.references[asked.joint])
    within = float(np.mean(errors <= asked.within))
    half = BAND * std
    inside = float(np.mean(wrong <= half))
    sizes = [np.sqrt(np.mean(errors**2)), errors.max(), half.mean()]
    rms, worst, width = np.rad2deg(sizes).tolist()
    row |= zip(MEASURES, (rms, worst, within, inside, width))
    return row | {"met": within >= asked.time, "problem": ""}


def _seeds(plan: Plan, task: Task) -> tuple[int, int, int]:
    return plan.study.draw, task.index, task.seed


def run_tasks(plan: Plan, tasks: Sequence[Task]) -> list[Outcome]:
    """Return the estimate or closed loop of each task, or the error that ended it, in the order of
    the tasks.
    """
    outcomes: dict[int, Outcome] = {}
    rigs = [plan.rig.with_values(s.set | plan.study.set) for s in plan.scenarios]
    setups = dict[tuple[int, int], _Setup]()
    plants = dict[tuple[int, int, str], list[tuple[int, _Setup, Prepared]]]()
    for k, task in enumerate(tasks):
        key = task.index, task.scenario
        try:
            if key not in setups:
                setups[key] = _setup_of(plan, rigs[task.scenario], task)
            setup = setups[key]
            if setup.nominal.scenario.control is not None:
                outcomes[k] = _closed(plan, setup, task)
                continue
            built = setup.built(_seeds(plan, task))
        except DistalError as problem:
            outcomes[k] = problem
        else:
            structure = id(setup.kernel), len(built.rows), repr(built.dt)
            plants.setdefault(structure, []).append((k, setup, built))
    runs = dict[int, list[tuple[int, Run]]]()
    for group in _groups(plants.values()):
        motions = _motions([built for _, _, built in group])
        for (k, setup, built), motion in zip(group, motions):
            try:
                if isinstance(motion, DistalError):
                    raise motion
                log = sampled(built, motion, _sensor_seed(plan, tasks[k]))
                run = prepared(log, setup.estimator)
            except DistalError as problem:
                outcomes[k] = problem
            else:
                estimator = run.estimator
                shared = estimator.kernel if estimator.has_kernel else estimator
                runs.setdefault(id(shared), []).append((k, run))
    for alike in _groups(runs.values()):
        outcomes.update(zip((k for k, _ in alike), run_all([run for _, run in alike])))
    return [outcomes[k] for k in range(len(tasks))]


def _closed(plan: Plan, setup: _Setup, task: Task) -> ClosedLoop:
    """Return the closed loop of a rig as built."""
    feedback = str(task.design[FEEDBACK]) if FEEDBACK in task.design else None
    of = setup.nominal
    scenario = of.scenario.model_copy(update={"plant": setup.drawn(_seeds(plan, task))})
    return closed_loop(of.rig, scenario, _sensor_seed(plan, task), feedback=feedback)


def _sensor_seed(plan: Plan, task: Task) -> int:
    sequence = np.random.SeedSequence([*_seeds(plan, task), task.scenario, 1])
    return int(sequence.generate_state(1)[0])


def _groups(alike: Iterable[Sequence[Lane]]) -> Iterator[Sequence[Lane]]:
    """Yield what runs side by side, of several sequences of what may."""
    for every in alike:
        yield from (every[at : at + lanes_here()] for at in range(0, len(every), lanes_here()))


@dataclass(frozen=True)
class _Setup:
    """A design in a scenario, prepared for all rigs as built of it.

    Args:
        nominal: the design as it is described; its scenario says of the plant what is not drawn.
    """

    nominal: Prepared
    draws: tuple[Draw, ...]
    kernel: Kernel
    estimator: KernelEstimator

    def drawn(self, seed: tuple[int, ...]) -> dict[str, object]:
        """Return path → value of the plant of one rig as built."""
        built = built_values(self.nominal.rig, self.draws, scores(self.draws, seed))
        return built | self.nominal.scenario.plant

    def built(self, seed: tuple[int, ...]) -> Prepared:
        """Return the scenario on one rig as built."""
        of = self.nominal
        plant = Mechanism(of.rig.with_values(self.drawn(seed)), remembers=True)
        start = equilibrium(plant, initial_angles(of.scenario, plant), of.rows)
        return replace(of, plant=plant, start=start)


def _setup_of(plan: Plan, scenario_rig: Rig, task: Task) -> _Setup:
    scenario = plan.scenarios[task.scenario]
    rig = rig_of(scenario_rig, task.design)
    draws = draws_of(rig)
    drawn = {named(rig, path) for draw in draws for path in draw.paths}
    fixed = {
        path: setting
        for path, setting in scenario.plant.items()
        if not any(fnmatch(name, named(rig, path)) for name in drawn)
    }
    nominal = prepare(rig, scenario.model_copy(update={"plant": fixed}))
    # a power of two, so that designs of different stiffness share few kernels
    nominal = replace(nominal, count=1 << (nominal.count - 1).bit_length())
    name = str(task.design.get(ESTIMATOR, plan.study.estimator))
    # of the filter alone the kernel is compiled: it is the slow one
    estimator = make_estimator(name, rig, compiled=name == DEFAULT)
    return _Setup(nominal, draws, plant_kernel(nominal.plant, nominal.count), estimator)


def _motions(group: Sequence[Prepared]) -> Sequence[Floats | DistalError]:
    try:
        return motions_of(group)
    except DistalError as problem:
        if len(group) == 1:
            return [problem]
        return [motion for built in group for motion in _motions([built])]


Columns = dict[str, NDArray[np.generic]]

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
        import pyarrow.parquet as pq

        path = self.path / "rows" / f"{chunk:06d}.parquet"
        table = pa.Table.from_pydict(rows)
        write_whole(path, lambda file: pq.write_table(table, file))

    def gather(self) -> Columns:
        """Write the rows of all chunks into one file, ``rows.parquet``, sorted by design, seed and
        scenario, and return them, column → values.
        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        table = pa.concat_tables(map(pq.read_table, self.chunks.values()))
        table = table.sort_by([(key, "ascending") for key in ("design", "seed", "scenario")])
        write_whole(self.path / "rows.parquet", lambda file: pq.write_table(table, file))
        return {name: table[name].to_numpy() for name in table.column_names}


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
    progress: Callable[[int, int], None] | None = None,
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


def _by_processes(
    plan: Plan, chunks: Sequence[tuple[int, Sequence[int]]], workers: int
) -> Iterator[tuple[int, Rows]]:
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
