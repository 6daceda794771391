"""How accurate and how honest: plants × scenarios × estimators × seeds, in parallel, as tables and
a picture.

`make accuracy`; `python -m benchmarks.accuracy --seeds 5` is quicker. Errors are of the joint
angle, pooled over seeds.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.progress import track
from tests.support.cases import (
    HARD,
    INTO_STOPS,
    MID_RANGE,
    PLANTS,
    SCENARIOS,
    WITHIN,
    hand_log,
    hand_rig,
    paper_log,
    paper_rig,
    spoiled,
)
from tests.support.lower_bound import lower_bound

import distal
from benchmarks.report import FOLDER, table
from benchmarks.rivals import IteratedFilter
from benchmarks.shell import Found, estimate
from distal import ESTIMATORS, Estimate, Log, Rig, load_rig, read_log
from distal.confidence import BAND
from distal.errors import DivergedError

ABLE = tuple(name for name in ESTIMATORS if name != "regression")
"""`regression` is left out: these rigs have no `[map]`, since no log of these plants comes before
the one that is judged.
"""

COMPARED = (*ABLE, "iterated")


@dataclass(frozen=True)
class Score:
    """What one estimator made of one log: sum of squared errors, samples, samples inside the band,
    half-width, NEES.
    """

    case: str
    plant: str
    estimator: str
    seed: int
    rms: float
    inside: float
    half: float
    nees: float
    bound: float


def found_by(name: str, log: Log, rig: Rig) -> Estimate | Found:
    """Return what the command finds with an estimator of that name, or what the rival does."""
    if name == "iterated":
        return distal.estimate(log, rig, IteratedFilter(rig))
    return estimate(log, rig, name)


def score(
    log: Log,
    rig: Rig,
    estimator: str,
    labels: tuple[str, str, str],
    seed: int,
    bound: float = np.nan,
) -> Score:
    """Return the score of an estimator on a log; a run that it refuses counts as an error of
    90°.
    """
    try:
        result = found_by(estimator, log, rig)
    except DivergedError:
        return Score(*labels, seed, 90.0, 0.0, np.nan, np.nan, bound)
    error, std = result.errors(), np.maximum(result.theta_std, 1e-9)
    nees = float(np.mean((error / std) ** 2))
    half = float(np.rad2deg(BAND * np.median(std)))
    return Score(
        *labels,
        seed,
        float(np.rad2deg(result.rms_error())),
        result.inside_band(),
        half,
        nees,
        bound,
    )


def run(job: tuple[str, str, int]) -> list[Score]:
    """Simulate one log and run every estimator on it."""
    kind, plant, seed = job
    if kind == "hand":
        log = hand_log(seed)
        return [score(log, hand_rig(plant), "adaptive", (kind, plant, "adaptive"), seed)]
    log, rig = paper_log(kind, plant, seed), paper_rig(plant)
    bound = np.nan
    if plant == "no linearity error":
        bound = float(np.rad2deg(lower_bound(rig, log)))
    scores = [score(log, rig, name, (kind, plant, name), seed, bound) for name in COMPARED]
    if plant in WITHIN:
        scores.append(
            score(
                spoiled(log, seed),
                rig,
                "adaptive",
                (kind, plant, "adaptive, spoiled log"),
                seed,
            )
        )
    return scores


def pooled(scores: Iterable[Score]) -> tuple[str, ...]:
    """Return RMS pooled and of the worst seed, share inside the band, median half-width, NEES,
    ratio to the bound.
    """
    held = list(scores)
    rms = float(np.sqrt(np.mean([one.rms**2 for one in held])))
    half = float(np.nanmedian([one.half for one in held]))
    bound = (
        float(np.sqrt(np.nanmean([one.bound**2 for one in held])))
        if np.isfinite(held[0].bound)
        else np.nan
    )
    return (
        f"{rms:.2f}",
        f"{max(one.rms for one in held):.2f}",
        f"{100 * np.mean([one.inside for one in held]):.0f} %",
        f"±{half:.2f}",
        f"{half / rms:.1f}",
        f"{np.nanmean([one.nees for one in held]):.1f}",
        f"{rms / bound:.2f}" if np.isfinite(bound) else "–",
    )


COLUMNS = [
    "RMS [°]",
    "worst seed [°]",
    "inside 95 % band",
    "half-width [°]",
    "half-width / RMS",
    "NEES",
    "RMS / bound",
]


def main() -> None:
    """Run, print and save."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    arguments = parser.parse_args()
    seeds = range(arguments.seeds)
    started = time.perf_counter()
    jobs = [(kind, plant, seed) for kind in SCENARIOS for plant in PLANTS for seed in seeds]
    jobs += [("hand", friction, seed) for friction in ("given", "unknown") for seed in seeds]
    scores: list[Score] = []
    with ProcessPoolExecutor(arguments.processes) as pool:
        for part in track(
            pool.map(run, jobs, chunksize=4),
            total=len(jobs),
            description="simulating and estimating",
        ):
            scores.extend(part)
    goals(scores)
    rivals(scores)
    picture(scores)
    recorded()
    print(f"{len(jobs)} logs, {len(scores)} estimates in {time.perf_counter() - started:.0f} s")


def goals(scores: list[Score]) -> None:
    """Print the cases that have a goal."""
    groups = {
        "mid-range, within ±20 % friction, ±10 % stiffness": (MID_RANGE, WITHIN),
        "driven into the stops, the same plants": (INTO_STOPS, WITHIN),
        "±30 % friction, observed, slider friction": (SCENARIOS, HARD),
        "model right, no linearity error, mid-range": (MID_RANGE, ("no linearity error",)),
        "hand, sheath friction given": (("hand",), ("given",)),
        "hand, sheath friction hardly known": (("hand",), ("unknown",)),
    }
    rows = []
    for label, (kinds, plants) in groups.items():
        chosen = [
            one
            for one in scores
            if one.case in kinds and one.plant in plants and one.estimator == "adaptive"
        ]
        rows.append([label, *pooled(chosen)])
        spoilt = [
            one
            for one in scores
            if one.case in kinds and one.plant in plants and "spoiled" in one.estimator
        ]
        if spoilt:
            rows.append([f"{label}; log spoiled", *pooled(spoilt)])
    table(
        "accuracy-goals",
        "`adaptive`, pooled over plants, scenarios and seeds",
        ["case", *COLUMNS],
        rows,
    )


def rivals(scores: list[Score]) -> None:
    """Print all estimators on the groups of plants."""
    rows = []
    groups = {
        "mid-range, within": (MID_RANGE, WITHIN),
        "into the stops, within": (INTO_STOPS, WITHIN),
        "mid-range, beyond": (MID_RANGE, HARD),
        "into the stops, beyond": (INTO_STOPS, HARD),
    }
    for label, (kinds, plants) in groups.items():
        for name in COMPARED:
            chosen = [
                one
                for one in scores
                if one.case in kinds and one.plant in plants and one.estimator == name
            ]
            rows.append([label, name, *pooled(chosen)])
    title = (
        "All estimators; within: ±20 % friction, ±10 % stiffness; beyond: ±30 % friction, "
        "observed, slider friction"
    )
    table("accuracy-rivals", title, ["plants", "estimator", *COLUMNS], rows)


def recorded() -> None:
    """Print the logs that another simulator made, where DISTAL_DATA says where they are."""
    folder = os.environ.get("DISTAL_DATA")
    if not folder:
        print("DISTAL_DATA is not set: the logs of another simulator are left out")
        return
    rows = []
    cases = {
        "MuJoCo servo": ("servo", load_rig("pulley-antagonist")),
        "MuJoCo hand, friction given": ("hand", hand_rig("given")),
        "MuJoCo hand, friction hardly known": ("hand", hand_rig("unknown")),
    }
    for label, (motion, rig) in cases.items():
        path = Path(folder) / "mujoco_rig" / f"mujoco_tension_{motion}.csv"
        log = read_log(path, rig, path.with_name(f"mujoco_tension_{motion}.truth.csv"))
        for name in COMPARED:
            rows.append(
                [
                    label,
                    name,
                    *pooled([score(log, rig, name, (label, "", name), 0)]),
                ]
            )
    table(
        "accuracy-mujoco", "Logs that another simulator made", ["log", "estimator", *COLUMNS], rows
    )


def picture(scores: list[Score]) -> None:
    """Draw RMS error of each estimator on each plant, mid-range, and the share inside the band."""
    from distal.results import COLOURS, figure, save_figure

    plants = [plant for plant in PLANTS if plant != "no linearity error"]
    with figure(1, 2, (7.2, 4.2), sharey=True, width_ratios=[1.3, 1]) as (drawn, axes):
        for i, name in enumerate(("adaptive", "ekf", "ekf-2008", "elastic")):
            chosen = [
                [s for s in scores if s.estimator == name and s.plant == p and s.case in MID_RANGE]
                for p in plants
            ]
            rms = [np.sqrt(np.mean([one.rms**2 for one in part])) for part in chosen]
            inside = [100 * np.mean([one.inside for one in part]) for part in chosen]
            style = {
                "color": COLOURS[i],
                "marker": "os^D"[i],
                "markersize": 5,
                "linestyle": "none",
                "label": name,
            }
            axes[0].plot(rms, range(len(plants)), **style)
            axes[1].plot(inside, range(len(plants)), **style)
        axes[0].set_xscale("log")
        axes[0].set_yticks(range(len(plants)), plants)
        axes[0].invert_yaxis()
        axes[0].set_xlabel("RMS error of θ, mid-range [°]")
        axes[1].axvspan(90, 99, color="0.9", zorder=0)
        axes[1].set_xlim(0, 103)
        axes[1].set_xlabel("truth inside the 95 % band [%]")
        drawn.legend(
            *axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=8
        )
    save_figure(drawn, FOLDER / "accuracy.svg")
    save_figure(drawn, FOLDER / "accuracy.png")


if __name__ == "__main__":
    main()
