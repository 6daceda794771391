"""Rigs drawn at random (`tests.support.drawn_rigs`), fitted to three logs with a temporary
encoder, judged on three others without.

Each plant (`drawn_plants` there) has numbers drawn from its rig's own stds; half of the plants have
no inertia. Judged are the fitted numbers beside the true ones, what of all that the logs tell is
found, and the angle on logs that no fit has seen: two of the same kind of motion, one of a wider
and faster one, marked "outside".

`python -m benchmarks.strangers.drawn --rigs 40 --first-seed 0 --stops` prints a line for each rig
as it is done, then a summary.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tests.support.drawn_logs import FITTED, logs_of
from tests.support.drawn_plants import (
    CLEAR,
)
from tests.support.drawn_rigs import Raw, drawn_rig, settled, units

from benchmarks.report import table
from benchmarks.shell import estimate
from distal import DistalError, Log, Rig, fit
from distal.confidence import BAND
from distal.rig import build_rig

Floats = NDArray[np.float64]

RIGS = 40
"""How many rigs."""
ESTIMATORS = ("plant known", "adaptive", "regression")
"""The default one as it is given the plant's numbers; the default one, and the obvious one, with
the fitted rig.
"""
LOST = 90.0
"""The error of what is refused [deg]."""


def judged(log: Log, rig: Rig, estimator: str) -> Raw:
    """Return what an estimator makes of a log, all joints together [deg]."""
    said = {"log": log.source, "estimator": estimator, "outside": "outside" in log.source}
    try:
        # interpreted kernels give the same numbers, and a rig is used three times
        found = estimate(log, rig, estimator, compiled=False)
    except DistalError as problem:
        return {**said, "rms": LOST, "inside": 0.0, "half": 0.0, "refused": str(problem)}
    errors, stds = found.angles - np.column_stack(list(log.truth.values())), found.angle_stds
    rms, half = np.rad2deg(np.sqrt(np.mean(errors**2))), np.rad2deg(BAND * np.mean(stds))
    return {
        **said,
        "rms": float(rms),
        "inside": float(np.mean(np.abs(errors) <= BAND * stds)),
        "half": float(half),
    }


def run_rig(seed: int, stops: bool = False) -> Raw:
    """Return all that is reported of the rig of a seed."""
    began, rig = time.process_time(), drawn_rig(seed, stops)
    logs, left = logs_of(rig, seed)
    said: Raw = {
        "seed": seed,
        "kind": rig.kind,
        "joints": len(rig.reach),
        "inert": rig.inert,
        "stops": stops,
    }
    said |= {"simulated_s": time.process_time() - began, "numbers": len(left), "left": left}
    described, known = (
        build_rig(rig.raw, f"drawn {seed}"),
        build_rig(settled(rig.raw, rig.truth), "plant known"),
    )
    fit_to, others = logs[:FITTED], logs[FITTED:]
    said["judged"] = [
        judged(log, known, "adaptive") | {"estimator": ESTIMATORS[0]} for log in others
    ]
    began, clock = time.process_time(), time.perf_counter()
    found: Any = None
    try:
        found = fit(fit_to, described)
    except Exception as problem:  # one that ends with an error is an outcome too
        said["refused"] = f"{type(problem).__name__}: {problem}"
    said |= {"fit_s": time.process_time() - began, "clock_s": time.perf_counter() - clock}
    parts = (
        [part for part in found.fitted if part.value != part.start and not part.noise]
        if found
        else []
    )
    seen = {path for part in parts for path in part.paths}
    tell = {first: paths for first, paths in units(rig.raw).items() if left[first] < CLEAR}
    said["told"], said["tellable"] = (
        [first for first in tell if seen & set(tell[first])],
        list(tell),
    )
    said["values"] = [
        {
            "path": path,
            "true": rig.truth[path],
            "value": float(part.value),
            "error": float(part.error),
        }
        for part in parts
        for path in [path for path in part.paths if path in rig.truth][:1]
    ]
    if found:
        said |= {"converged": bool(found.converged), "doubts": list(getattr(found, "doubts", ()))}
    lost = {"rms": LOST, "inside": 0.0, "half": 0.0}
    for name in ESTIMATORS[1:]:
        for log in others:
            about = {"log": log.source, "estimator": name, "outside": "outside" in log.source}
            said["judged"].append(judged(log, found.rig, name) if found else about | lost)
    return said


def quiet(seed: int, stops: bool) -> Raw:
    """Return what is reported of a rig, without the warnings of its fit."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return run_rig(seed, stops)


def within(said: Raw) -> list[bool]:
    """Return for each number that a fit identifies whether the plant's is within two standard
    errors.
    """
    return [abs(one["value"] - one["true"]) <= 2.0 * one["error"] for one in said["values"]]


def of(said: Raw, estimator: str, key: str, outside: bool) -> list[float]:
    """Return a number of an estimator on the logs of a rig, those of the wider motion or the
    others.
    """
    return [
        one[key]
        for one in said["judged"]
        if one["estimator"] == estimator and one["outside"] == outside
    ]


def line(said: Raw) -> str:
    """Return what is reported of a rig in a line."""
    parts = [f"{said['seed']:4d} {said['kind']:19s} {'with' if said['inert'] else 'no  '} inertia"]
    parts.append(
        "REFUSED      "
        if "refused" in said
        else "converged    "
        if said["converged"]
        else "NOT converged"
    )
    parts.append(
        f"{said['fit_s']:6.1f} s  within 2: {sum(within(said)):2d}/{len(said['values']):2d}"
    )
    parts.append(f"told {len(said['told']):2d}/{len(said['tellable']):2d}  RMS")
    for outside in (False, True):
        parts.append("outside" if outside else "motion")
        for estimator in ESTIMATORS:
            rms, inside = (np.mean(of(said, estimator, key, outside)) for key in ("rms", "inside"))
            parts.append(f"{estimator} {rms:.2f}° ({100 * inside:.0f} %)")
    return "  ".join(parts)


def summary(records: Sequence[Raw]) -> list[list[str]]:
    """Return rows for all rigs and their kinds: of sizes median and worst decile, of shares mean
    and worst decile.
    """
    groups: dict[str, Callable[[Raw], bool]] = {
        "all": lambda one: True,
        "no inertia": lambda one: not one["inert"],
        "inertia": lambda one: bool(one["inert"]),
        "one joint": lambda one: one["joints"] == 1,
        "several": lambda one: one["joints"] > 1,
    }
    measures: list[tuple[str, Callable[[Raw], Sequence[float]]]] = [
        ("converged [%]", lambda one: [one.get("converged", False)]),
        ("numbers within 2 errors [%]", within),
        (
            "told, of what the logs tell [%]",
            lambda one: [path in one["told"] for path in one["tellable"]],
        ),
        ("processor time of the fit [s]", lambda one: [one["fit_s"]]),
    ]
    for estimator in ESTIMATORS:
        for outside, where in ((False, "motion"), (True, "outside")):
            for key, unit in (("rms", "°"), ("inside", "%"), ("half", "°")):
                each = partial(of, estimator=estimator, key=key, outside=outside)
                measures.append((f"{estimator}, {where}: {key} [{unit}]", each))
    rows = [["rigs", *(str(sum(map(chosen, records))) for chosen in groups.values())]]
    for name, each in measures:
        cells = []
        for chosen in groups.values():
            values = [
                float(np.mean(each(one))) for one in records if chosen(one) and len(each(one))
            ]
            if "[%]" in name:
                cells.append(
                    f"{100 * np.mean(values):.0f}, {100 * np.quantile(values, 0.1):.0f}"
                    if values
                    else "–"
                )
            else:
                cells.append(
                    f"{np.median(values):.3g}, {np.quantile(values, 0.9):.3g}" if values else "–"
                )
        rows.append([name, *cells])
    return [["median or mean, worst decile of rigs", *groups], *rows]


def main() -> None:
    """Run, print and store."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.strangers.drawn", description=__doc__
    )
    parser.add_argument("--rigs", type=int, default=RIGS)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument(
        "--stops",
        action="store_true",
        help="calibration rests in hard stops for a third of its time",
    )
    parser.add_argument("--processes", type=int, default=1)
    asked = parser.parse_args()
    seeds = range(asked.first_seed, asked.first_seed + asked.rigs)
    work, records = partial(quiet, stops=asked.stops), list[Raw]()
    with ProcessPoolExecutor(asked.processes) as pool:
        for said in map(work, seeds) if asked.processes == 1 else pool.map(work, seeds):
            records.append(said)
            print(line(said), flush=True)
    columns, *rows = summary(records)
    table("strangers-drawn-rigs", f"{len(records)} rigs drawn at random", columns, rows)


if __name__ == "__main__":
    main()
