"""Rigs drawn at random in all forms of export: C, the plant, an FMU; compiled with all warnings.

`python -m benchmarks.exports [--rigs N] [--first-seed N]`; half are shipped rigs with lines, values
and keys changed, as far as they are still accepted, the others are drawn. What is refused is
printed with its reason, what breaks with its seed.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import subprocess
import tempfile
import warnings
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from tests.export.helpers import replay_program
from tests.fuzzing.rigs import changed
from tests.support.drawn_rigs import drawn_rig
from tools.lab.plant_source import c_plant

from benchmarks.report import table
from benchmarks.strangers.random_rigs import random_case
from distal.errors import DistalError
from distal.export import export_c, export_fmu
from distal.rig import Rig, build_rig, load_rig

STRICT = ["-Wall", "-Wextra", "-Werror", "-fsyntax-only", "-fno-math-errno"]
NAMES = ("joint", "a", "x" * 60, "rig_2008", "int_", "filter")
FORMS = ("C", "plant", "FMU")


def drawn(seed: int, folder: Path) -> Rig | None:
    """Return a rig, or None where the changes have made it one that is not accepted."""
    if seed % 4 == 1:
        return build_rig(drawn_rig(seed, stops=seed % 8 == 1).raw, "drawn")
    if seed % 4 == 3:
        return random_case(seed).rig
    data, assignments = changed(seed)
    (folder / "rig.toml").write_bytes(data)
    try:
        return load_rig(folder / "rig.toml", assignments)
    except DistalError:
        return None


def compiled(commands: list[list[str]], folder: Path) -> str:
    """Return the first line that a compiler says, empty where it has nothing to say."""
    for command in commands:
        done = subprocess.run(
            command, cwd=folder, capture_output=True, text=True, check=False, errors="replace"
        )
        if done.returncode or done.stderr:
            said = done.stderr.splitlines() or [f"exit code {done.returncode}"]
            return (
                f"{command[0]}: {next((line for line in said if 'error' in line), said[0])[:200]}"
            )
    return ""


def form(which: str, rig: Rig, rng: random.Random, folder: Path) -> str:
    """Export a rig in one form and compile it; return what a compiler says."""
    name, single = rng.choice(NAMES), rng.random() < 0.5
    estimator = rng.choice(
        ["adaptive", "adaptive", "adaptive", "ekf", "ekf-2008", "inextensible", "elastic"]
    )
    compilers = [compiler for compiler in ("gcc", "clang") if shutil.which(compiler)]
    if which == "plant":
        for file, text in c_plant(rig, name).files.items():
            (folder / file).write_text(text)
        return compiled([[each, "-std=c99", *STRICT, f"{name}.c"] for each in compilers], folder)
    if which == "C":
        made = export_c(rig, folder, estimator, single=single, name=name)
        (folder / "replay.c").write_text(replay_program(made.estimator, name))
        sources = [f"{name}.c", "replay.c"]
        return compiled([[each, "-std=c99", *STRICT, *sources] for each in compilers], folder)
    from fmpy.validation import validate_fmu

    export_fmu(rig, folder / "rig.fmu", estimator, name)
    problems = validate_fmu(str(folder / "rig.fmu"))
    if problems:
        return f"fmpy: {problems[0]}"
    shutil.unpack_archive(folder / "rig.fmu", folder / "fmu", "zip")
    sources = [f"{name}.c", f"{name}_fmi3.c"]
    return compiled(
        [[each, "-std=c99", *STRICT, *sources] for each in compilers], folder / "fmu" / "sources"
    )


def attempt(seed: int) -> list[tuple[str, str, str]]:
    """Return form, outcome and reason of a seed's rig in each form; none where the rig is not
    accepted.
    """
    warnings.simplefilter("ignore")
    os.environ["DISTAL_COMPILE"] = "0"  # the FMU's binary would be compiled twice
    rng, found = random.Random(seed), list[tuple[str, str, str]]()
    with tempfile.TemporaryDirectory() as made:
        rig = drawn(seed, Path(made))
        for which in FORMS if rig is not None else ():
            folder = Path(made) / which
            folder.mkdir()
            try:
                assert rig is not None
                said = form(which, rig, rng, folder)
                found.append((which, "compiler" if said else "made", said))
            except DistalError as problem:
                found.append((which, "refused", str(problem)))
            except Exception as problem:
                found.append((which, "broken", f"{type(problem).__name__}: {problem}"[:300]))
    return found


def main() -> None:
    """Try, print and save."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--rigs", type=int, default=300)
    parser.add_argument("--first-seed", type=int, default=0)
    asked = parser.parse_args()
    counts, rigs, seed = {which: Counter[str]() for which in FORMS}, 0, asked.first_seed
    with ProcessPoolExecutor(2) as pool:
        while rigs < asked.rigs:
            seeds = range(seed, seed + 64)
            for each, found in zip(seeds, pool.map(attempt, seeds)):
                if not found or rigs >= asked.rigs:
                    continue
                rigs += 1
                for which, outcome, why in found:
                    counts[which][outcome] += 1
                    if outcome != "made":
                        print(f"{each} {which} {outcome}: {why}", flush=True)
            seed += 64
    columns = ["form", "made", "refused, with the reason", "a compiler or fmpy complains", "broken"]
    rows = [
        [which, *(str(own[k]) for k in ("made", "refused", "compiler", "broken"))]
        for which, own in counts.items()
    ]
    table("exports", f"{rigs} rigs drawn at random, in all forms", columns, rows)


if __name__ == "__main__":
    main()
