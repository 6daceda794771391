"""Do the fast tests see a mistake? `python -m benchmarks.mutants N SEED` makes N of them in the
adaptive filter and counts.

`--part learning` makes them in what learns from logs: `fitting`, `regression`, `homing`; `--part
all` in every package but drawings and the paper's.

Each mutant is one random change of one place (a sign, an operator, a constant, a bound of a slice,
swapped branches) in one module, in a copy of the project. The fast tests run there until one fails;
comparisons with stored estimates and golden files (marker `stored`) do not count. The exit code is
0 if at least 90 % were seen, else 1, and 2 if the unchanged copy fails.
"""

from __future__ import annotations

import argparse
import random
import signal
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from queue import SimpleQueue

from benchmarks.copies import BaselineError, Copy, Outcome, Processes
from benchmarks.mutations import Mutant, Position, mutant, positions

ROOT = Path(__file__).parents[1]
ESTIMATORS = "src/distal/estimators"

MODULES = {
    "filter": (
        f"{ESTIMATORS}/adaptive/**/*.py",
        f"{ESTIMATORS}/kinematic.py",
        f"{ESTIMATORS}/estimator_protocol.py",
        "src/distal/run/offline.py",
    ),
    "learning": tuple(
        f"src/distal/{folder}/*.py" for folder in ("fitting", "regression", "homing")
    ),
    "all": ("src/distal/**/*.py",),
}
"""The modules of each part; of these patterns, those count that match a file."""

NOT_ASKED = ("src/distal/paper", "src/distal/reports/rig_drawing.py")
"""Folders and modules in which no mistakes are made: pictures are looked at, and what the paper
says is no rule of the package.
"""

GOAL = 0.9
"""Least share of mutants that must be seen."""

PATIENCE = 4.0
"""A stage that takes this many times as long as with the unchanged copy, and five minutes, in which
kernels of the changed code are built, hangs.
"""


def modules(root: Path, part: str = "filter") -> list[Path]:
    """Return the modules of a part, as paths within the project.

    Args:
        root: folder of the project.
        part: a key of `MODULES`.
    """
    found = {path.relative_to(root) for pattern in MODULES[part] for path in root.glob(pattern)}
    return sorted(path for path in found if not path.as_posix().startswith(NOT_ASKED))


def drawn(root: Path, files: Sequence[Path], count: int, seed: int) -> list[Mutant]:
    """Return random mutants, each of another place, all places alike likely; the same for the same
    seed.

    Args:
        root: folder of the project.
        files: which modules, as paths within the project.
        count: how many; all places, if there are fewer.
        seed: of the choice.
    """
    sources = {file: (root / file).read_text(encoding="utf-8") for file in files}
    every: list[tuple[Path, Position]] = [
        (file, position) for file in files for position in positions(sources[file])
    ]
    choice = random.Random(seed)
    chosen = choice.sample(every, min(count, len(every)))
    return [
        mutant(file, sources[file], position, choice.choice(position.after))
        for file, position in chosen
    ]


def baseline(copies: Sequence[Copy], pool: ThreadPoolExecutor) -> list[float]:
    """Return the times of all stages with the unchanged copies [s].

    Args:
        copies: the stages are shared among them.
        pool: of threads.

    Raises:
        BaselineError: a test fails.
    """
    copies[0].check()
    # the first copy runs the filter's own tests, the last what remains
    shares = [[0, 1], [2]] if len(copies) > 1 else [[0, 1, 2]]

    def run(copy: Copy, stages: Sequence[int]) -> dict[int, Outcome]:
        return {stage: copy.test(stage, 1800.0) for stage in stages}

    outcomes: dict[int, Outcome] = {}
    for done in [pool.submit(run, copy, share) for copy, share in zip(copies, shares)]:
        outcomes |= done.result()
    for outcome in outcomes.values():
        if outcome.seen:
            raise BaselineError(f"the unchanged copy fails: {outcome.by}; mend that first")
    return [outcomes[stage].seconds for stage in sorted(outcomes)]


def judged(copy: Copy, each: Mutant, times: Sequence[float]) -> Outcome:
    """Return what the tests say of a mutant: stage after stage, until one sees it.

    Args:
        copy: of the project.
        each: the mutant.
        times: of the stages with the unchanged copy [s].
    """
    seconds = 0.0
    with copy.changed(each.file, each.text):
        for stage, usual in enumerate(times):
            outcome = copy.test(stage, PATIENCE * usual + 300.0)
            seconds += outcome.seconds
            if outcome.seen:
                return Outcome(True, outcome.by, seconds)
    return Outcome(False, "", seconds)


def run(
    mutants: Sequence[Mutant], workers: int, root: Path = ROOT, part: str = "filter"
) -> list[Outcome]:
    """Return what the fast tests say of mutants; a line is printed for each. Nothing is left
    behind, whatever happens.

    Args:
        mutants: what is tried.
        workers: how many at once.
        root: folder of the project.
        part: whose stages of tests run.

    Raises:
        BaselineError: the unchanged copy does not pass.
    """
    processes, outcomes, started = Processes(), dict[int, Outcome](), time.monotonic()
    with (
        tempfile.TemporaryDirectory(prefix="mutants-", ignore_cleanup_errors=True) as name,
        ThreadPoolExecutor(workers) as pool,
    ):
        try:
            data = Path(name).resolve()
            copies = [Copy(root, data / f"copy{i}", processes, data, part) for i in range(workers)]
            times = baseline(copies, pool)
            said = ", ".join(f"{each:.0f}" for each in times)
            print(f"unchanged: all pass, {said} s by stage", flush=True)
            free: SimpleQueue[Copy] = SimpleQueue()
            for copy in copies:
                free.put(copy)

            def work(each: Mutant) -> Outcome:
                copy = free.get()
                try:
                    return judged(copy, each, times)
                finally:
                    free.put(copy)

            jobs = {pool.submit(work, each): i for i, each in enumerate(mutants)}
            for done in as_completed(jobs):
                i, outcome = jobs[done], done.result()
                outcomes[i] = outcome
                each = mutants[i]
                verdict = f"seen      by {outcome.by}" if outcome.seen else "SURVIVED"
                passed = time.monotonic() - started
                inside = each.file.is_relative_to(ESTIMATORS)
                where = str(each.file.relative_to(ESTIMATORS) if inside else each.file)
                head = (
                    f"[{len(outcomes)}/{len(mutants)}, {passed:.0f} s] {where}:{each.line} "
                    f"{each.kind}"
                )
                print(f"{head}: {verdict} ({outcome.seconds:.0f} s)", flush=True)
        except BaseException:
            processes.stop()
            pool.shutdown(wait=True, cancel_futures=True)
            raise
    return [outcomes[i] for i in range(len(mutants))]


def report(mutants: Sequence[Mutant], outcomes: Sequence[Outcome]) -> str:
    """Return the table by module, and the survivors.

    Args:
        mutants: what was tried.
        outcomes: of each.
    """
    lines = ["", f"{'module':50} {'mutants':>8} {'seen':>6}"]
    for file in sorted({each.file for each in mutants}):
        verdicts = [outcome.seen for each, outcome in zip(mutants, outcomes) if each.file == file]
        lines.append(f"{file.as_posix():50} {len(verdicts):8d} {sum(verdicts):6d}")
    seen = sum(outcome.seen for outcome in outcomes)
    lines.append(f"{'all':50} {len(mutants):8d} {seen:6d}  ({100 * seen / len(mutants):.0f} %)")
    survivors = [each for each, outcome in zip(mutants, outcomes) if not outcome.seen]
    if survivors:
        lines += ["", "survivors: test each that changes an estimate"]
    for each in sorted(survivors, key=lambda each: (each.file, each.line)):
        lines += [
            f"  {each.file.as_posix()}:{each.line} ({each.kind})",
            f"    - {each.before}",
            f"    + {each.after}",
        ]
    return "\n".join(lines)


def _interrupt(*_: object) -> None:
    raise KeyboardInterrupt


def main(arguments: Sequence[str] | None = None) -> int:
    """Run it and return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.mutants", description=__doc__)
    parser.add_argument("count", type=int, metavar="N", help="how many mutants")
    parser.add_argument("seed", type=int, metavar="SEED", help="of their choice")
    parser.add_argument("--workers", type=int, default=2, help="copies that are tested at once (2)")
    parser.add_argument(
        "--part", choices=sorted(MODULES), default="filter", help="where they are made (filter)"
    )
    parser.add_argument("--list", action="store_true", help="only print the mutants")
    given = parser.parse_args(arguments)
    if given.count < 1 or given.workers < 1:
        parser.error("N and --workers must be 1 or more")
    mutants = drawn(ROOT, modules(ROOT, given.part), given.count, given.seed)
    if given.list:
        for each in mutants:
            print(
                f"{each.file.as_posix()}:{each.line} ({each.kind})\n  - {each.before}\n  + "
                f"{each.after}"
            )
        return 0
    signal.signal(signal.SIGTERM, _interrupt)
    try:
        outcomes = run(mutants, given.workers, part=given.part)
    except BaselineError as problem:
        print(problem, file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("stopped; nothing is left behind", file=sys.stderr)
        return 130
    print(report(mutants, outcomes))
    return 0 if sum(outcome.seen for outcome in outcomes) >= GOAL * len(mutants) else 1


if __name__ == "__main__":
    sys.exit(main())
