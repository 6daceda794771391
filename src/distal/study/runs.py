"""The runs of a study: rigs as built are simulated and estimated, those of one structure side by side in vector lanes."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from fnmatch import fnmatch
from threading import Lock
from typing import TypeVar

import numpy as np

from distal.arrays import Floats
from distal.control import ClosedLoop, closed_loop
from distal.errors import DistalError
from distal.estimators import DEFAULT, Estimator, KernelEstimator, make_estimator
from distal.kernels import Kernel, lanes_here
from distal.logs import Log
from distal.model import Mechanism
from distal.results import BAND, Estimate
from distal.rig import Rig, named
from distal.run.batch import run_all
from distal.run.offline import Run, prepared, runner_for
from distal.simulation import Scenario
from distal.simulation.inputs import BodyInputs, body_inputs, initial_angles
from distal.simulation.plant import Motion, equilibrium, resting_force, run_plants
from distal.simulation.simulate import Prepared, sampled, timing
from distal.study.description import Plan
from distal.study.kernels import Kernels
from distal.study.plants import Draw, built_values, draws_of, scores
from distal.study.space import ESTIMATOR, FEEDBACK, Design, Space, rig_of, space_of
from distal.threads import one_blas_thread

Item = TypeVar("Item")
Cell = float | str | bool | None
Rows = dict[str, list[Cell]]

MEASURES = ("rms_deg", "worst_deg", "within", "inside", "half_band_deg")
"""What is measured of a run: RMS and largest error [°], shares of the time within the limit and inside the 95 % band, and
the mean half-width of that band [°]."""

STEPS = 4
"""Sub-steps of a plant are a multiple of this: stiffer designs then share few kernels."""

NOMINAL = -1
"""The seed of a plant that is as the rig says."""

BUILT = "built: "
"""Columns of what a rig as built is off by, in standard deviations, begin with it."""


@dataclass(frozen=True)
class Task:
    """One run of a study.

    Args:
        index: of the design.
        design: what varies in it.
        seed: which rig as built; `NOMINAL` for the rig as described.
        scenario: its index.
    """

    index: int
    design: Design
    seed: int
    scenario: int


_KERNELS = Kernels()
_SPACES: dict[str, Space] = {}
_TURNS = Lock()  # threads of a process take turns: they share the kernels


def run_chunk(plan: Plan, designs: Sequence[int]) -> Rows:
    """Return the rows of some designs: one for each design, rig as built and scenario; an error of a run is a row."""
    with _TURNS, one_blas_thread():
        return _rows(plan, designs)


def _rows(plan: Plan, designs: Sequence[int]) -> Rows:
    begun, study, digest = time.perf_counter(), plan.study, plan.digest
    space = _SPACES[digest] = _SPACES.get(digest) or space_of(plan)
    every = range(len(plan.scenarios))
    tasks = [Task(i, space.design(i), seed, s) for i in designs for seed in range(study.seeds) for s in every]
    rows: Rows = {}
    for task, outcome in zip(tasks, run_tasks(plan, tasks, space)):
        for name, value in _row(plan, task, outcome).items():
            rows.setdefault(name, []).append(value)
    rows["seconds"] = [(time.perf_counter() - begun) / len(tasks)] * len(tasks)
    return rows


def _row(plan: Plan, task: Task, outcome: Estimate | ClosedLoop | DistalError) -> dict[str, Cell]:
    asked, name = plan.study.requirement, plan.study.scenarios[task.scenario]
    measured: dict[str, Cell] = dict.fromkeys(MEASURES, float("nan"))
    problem, met = "", False
    if isinstance(outcome, DistalError) or (isinstance(outcome, Estimate) and outcome.truths is None):
        problem = str(outcome)
    else:
        errors, wrong, half = _errors(outcome, plan.joint, asked.joint)
        within = float(np.mean(errors <= asked.within))
        rms, worst, width = (float(np.rad2deg(one)) for one in (np.sqrt(np.mean(errors**2)), errors.max(), half.mean()))
        measured = dict(zip(MEASURES, (rms, worst, within, float(np.mean(wrong <= half)), width)))
        met = within >= asked.time
    built: dict[str, Cell] = {
        f"{BUILT}{name}": score for name, score in scores(draws_of(plan.rig), _seeds(plan, task)).items()
    }
    keys: dict[str, Cell] = {"design": float(task.index), "seed": float(task.seed), "scenario": name}
    values: dict[str, Cell] = {
        path: value if isinstance(value, str) else float(value) for path, value in task.design.items()
    }
    is_asked = not asked.scenarios or name in asked.scenarios
    return {**keys, **values, **built, **measured, "met": met if is_asked else None, "problem": problem}


def _errors(outcome: Estimate | ClosedLoop, j: int, name: str) -> tuple[Floats, Floats, Floats]:
    """Return how far a joint is from what is asked of it, how wrong its estimate is, and half of its band [rad].

    An estimate is asked for the true angle; in a closed loop the true angle is asked for the reference.
    """
    if isinstance(outcome, Estimate):
        assert outcome.truths is not None
        wrong = np.abs(outcome.angles[:, j] - outcome.truths[:, j])
        return wrong, wrong, BAND * outcome.angle_stds[:, j]
    wrong = np.abs(outcome.estimates[:, j] - outcome.angles[:, j])
    away = np.abs(outcome.angles[:, j] - outcome.references[name]) if name in outcome.references else wrong
    return away, wrong, BAND * outcome.stds[:, j]


def _seeds(plan: Plan, task: Task) -> tuple[int, int, int]:
    return plan.study.draw, task.index, task.seed


def run_tasks(
    plan: Plan, tasks: Sequence[Task], space: Space | None = None, homing: float | None = None
) -> list[Estimate | ClosedLoop | DistalError]:
    """Return the estimates or closed loops of some runs, or why there is none, in their order.

    Args:
        space: all designs, the first of which in each structure has the constants of its filters' kernel; None for any.
        homing: for how long the true angle is used [s], or None.
    """
    outcomes: dict[int, Estimate | ClosedLoop | DistalError] = {}
    rigs = [plan.rig.with_values({**one.set, **plan.study.set}) if one.set else plan.rig for one in plan.scenarios]
    ready: dict[tuple[int, int], _Ready | DistalError] = {}
    plants = dict[tuple[int, int, str], list[tuple[int, Prepared]]]()
    for k, task in enumerate(tasks):
        key = task.index, task.scenario
        if key not in ready:
            ready[key] = _ready(plan, rigs[task.scenario], task, space)
        own = ready[key]
        if isinstance(own, DistalError):
            outcomes[k] = own
            continue
        if plan.scenarios[task.scenario].control is not None:
            outcomes[k] = _closed(plan, own, task)
            continue
        try:
            built = own.built(plan.scenarios[task.scenario], _seeds(plan, task))
        except DistalError as problem:
            outcomes[k] = problem
        else:
            plants.setdefault((id(own.kernel), len(built.inputs.effort), repr(built.dt)), []).append((k, built))
    runs, homed = dict[int, list[tuple[int, Run]]](), dict[int, Estimator]()
    for k, log in _logs(plan, tasks, ready, plants):
        own = ready[tasks[k].index, tasks[k].scenario]
        assert isinstance(own, _Ready)
        try:
            if isinstance(log, DistalError):
                raise log
            runner = own.runner
            if homing is not None:
                runner = homed[id(own)] = homed.get(id(own)) or runner_for(log, own.rig, runner.name, True, homing)
            run = prepared(log, runner, homing)
        except DistalError as problem:
            outcomes[k] = problem
        else:
            runner = run.runner
            shared = runner.kernel if isinstance(runner, KernelEstimator) and runner.has_kernel else runner
            runs.setdefault(id(shared), []).append((k, run))
    for alike in runs.values():
        for group in _groups(alike):
            outcomes.update(zip((k for k, _ in group), run_all([run for _, run in group])))
    return [outcomes[k] for k in range(len(tasks))]


def _closed(plan: Plan, own: _Ready, task: Task) -> ClosedLoop | DistalError:
    """Return the closed loop of a rig as built, or why there is none."""
    scenario, seed = plan.scenarios[task.scenario], _seeds(plan, task)
    plant, feedback = {**own.drawn(seed), **own.fixed}, task.design.get(FEEDBACK)
    try:
        built = scenario.model_copy(update={"plant": plant})
        return closed_loop(
            own.rig, built, _sensor_seed(plan, task), feedback=None if feedback is None else str(feedback)
        )
    except DistalError as problem:
        return problem


def _sensor_seed(plan: Plan, task: Task) -> int:
    words = np.random.SeedSequence([*map(abs, _seeds(plan, task)), task.scenario, 1]).generate_state(1)
    return int(words[0])


def _groups(items: Sequence[Item]) -> Iterator[Sequence[Item]]:
    return (items[at : at + lanes_here()] for at in range(0, len(items), lanes_here()))


@dataclass(frozen=True)
class _Ready:
    """A design in a scenario, ready for the rigs as built of it.

    Args:
        rig: as filters know it.
        draws: what is drawn of it.
        fixed: what the scenario says of the plant, where nothing is drawn.
        mechanism: of the same structure.
        kernel: of the plant.
        inputs: what acts.
        timing: interval [s] and sub-steps.
        runner: the estimator.
    """

    rig: Rig
    draws: tuple[Draw, ...]
    fixed: dict[str, object]
    mechanism: Mechanism
    kernel: Kernel
    inputs: BodyInputs
    timing: tuple[float, int]
    runner: Estimator

    def drawn(self, seed: tuple[int, ...]) -> dict[str, float]:
        """Return path → value of one rig as built."""
        nominal = seed[-1] == NOMINAL
        score = dict.fromkeys((one.name for one in self.draws), 0.0) if nominal else scores(self.draws, seed)
        return built_values(self.rig, self.draws, score)

    def built(self, scenario: Scenario, seed: tuple[int, ...]) -> Prepared:
        """Return the scenario on one rig as built."""
        plant = Mechanism(self.rig.with_values({**self.drawn(seed), **self.fixed}), remembers=True)
        start = equilibrium(plant, initial_angles(scenario, plant), self.inputs, resting_force(self.mechanism))
        return Prepared(self.rig, scenario, plant, self.inputs, start, *self.timing)


def _ready(plan: Plan, rig: Rig, task: Task, space: Space | None) -> _Ready | DistalError:
    scenario = plan.scenarios[task.scenario]
    try:
        own = rig_of(rig, task.design)
        draws = draws_of(own)
        drawn = {named(own, path) for draw in draws for path in draw.paths}
        given = scenario.plant.items()
        fixed = {path: value for path, value in given if not any(fnmatch(one, named(own, path)) for one in drawn)}
        plant = Mechanism(own.with_values(fixed) if fixed else own, remembers=True)
        dt, steps, needed = timing(plant, scenario)
        count = -(-needed // STEPS) * STEPS
        mechanism, kernel = _KERNELS.plant(plant, count)
        inputs = body_inputs(scenario, mechanism, dt * np.arange(steps, dtype=np.float64))
        name = str(task.design.get(ESTIMATOR, plan.study.estimator))
        if name != DEFAULT:
            runner: Estimator = make_estimator(name, own, compiled=False)
        else:
            family = f"{plan.digest} {task.scenario}" if space is not None else ""
            runner = _KERNELS.filter(own, family, _rigs(rig, space or ()))
    except DistalError as problem:
        return problem
    return _Ready(own, draws, fixed, mechanism, kernel, inputs, (dt, count), runner)


def _rigs(rig: Rig, designs: Iterable[Design]) -> Iterator[Rig]:
    """Yield the rigs of designs, but those that are wrong."""
    for design in designs:
        with suppress(DistalError):
            yield rig_of(rig, design)


def _logs(
    plan: Plan,
    tasks: Sequence[Task],
    ready: Mapping[tuple[int, int], _Ready | DistalError],
    plants: Mapping[tuple[int, int, str], list[tuple[int, Prepared]]],
) -> Iterator[tuple[int, Log | DistalError]]:
    """Yield the index of each run with its log; plants of one structure move side by side."""
    for alike in plants.values():
        for group in _groups(alike):
            own = ready[tasks[group[0][0]].index, tasks[group[0][0]].scenario]
            assert isinstance(own, _Ready)
            for (k, built), motion in zip(group, _motions(own, [built for _, built in group])):
                if isinstance(motion, DistalError):
                    yield k, motion
                    continue
                yield k, sampled(built, motion, _sensor_seed(plan, tasks[k]))


def _motions(own: _Ready, built: Sequence[Prepared]) -> Iterable[Motion | DistalError]:
    runs = [(one.inputs, one.start) for one in built]
    numbers = [one.plant.parameters.values for one in built]
    try:
        return run_plants(own.mechanism, runs, own.timing[0], own.kernel, numbers)
    except DistalError as problem:
        if len(built) == 1:
            return [problem]
        return [motion for one in built for motion in _motions(own, [one])]
