"""What each rule of `adaptive` with a number chosen by hand is worth.

`python -m benchmarks.ablation [RULE …]` prints a row for each.

One rule is switched off at a time, on seven rigs whose plants share no code with `distal.model`,
two seeds each: logs as they come, with bursts and missing samples, and of chains with a load, a
zero that jumps, and a silent sensor. A rule that changes no log's error by `TOLD` is worth nothing.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from typing import Any

os.environ["DISTAL_COMPILE"] = "0"

import numpy as np
from tests.support.foreign_plants import finger_log, finger_rig, hand_log, hand_rig
from tests.support.hands_plants import bowden_log, bowden_rig, ropes_log, ropes_rig

from benchmarks import events
from benchmarks.report import table
from distal import DistalError, Log, Rig, estimate, load_rig

SEEDS = (31, 32)
DURATION = 12.0
TOLD = 0.01
"""Share of the RMS error, and of the samples inside the band, by which a rule is told from none."""

INF = float("inf")


def nothing(*arguments: Any) -> Any:
    """Return nothing found."""
    return {}


RULES: dict[str, tuple[str, str, Any]] = {
    "impossible positions": ("filter_context", "MOST_TRAVELS", 1e9),
    "joints settle": ("filter_context", "SETTLES", INF),
    "most sub-steps": ("filter_context", "MOST_JOINT_SUBSTEPS", 10**6),
    "power of a lost position": ("guard_settings", "STILL_LOST", 1),
    "wandering": ("filter_inputs", "WANDERING", INF),
    "pull's std at a jump": ("drive_tracking", "PULL_STD", 0.0),
    "slow, one threshold": ("update", "SLOW_UNKNOWN", 60.0),
    "slow, declared": ("update", "SLOW_DECLARED", 80.0),
    "nominal pull lasts": ("update", "NOMINAL_TIME", 0.0),
    "slack pairs, (26b)": ("prediction", "slack_pairs", nothing),
    "force's std in slack pairs": ("prediction", "SURE", 0.0),
    "a sensor off, unknown": ("guard_settings", "SHIFTED", 0.0),
    "a sensor off, felt": ("guard_settings", "SHIFTED_FELT", 0.0),
    "far from the logs": ("drive_tracking", "NEAR", INF),
    "zero: goes on": ("guard_settings", "GOES_ON", INF),
    "usual time": ("touch", "USUAL_TIME", INF),
    "evidence time": ("touch", "EVIDENCE_TIME", 1e-6),
    "still": ("touch", "STILL", 0.5),
    "clear torque lasts": ("touch", "LASTING_TIME", 1e-6),
    "closing": ("touch", "CLOSING_TIME", 1e-6),
    "lowest value": ("states", "SMALLEST_VALUE", 0.0),
    "lowest factor": ("states", "SMALLEST_FACTOR", 1e-6),
    "unseen friction": ("states", "UNSEEN", 0.0),
    "speed at first": ("states", "START_SPEED", 1e-3),
    "position walks": ("states", "POSITION_WALK", 0.0),
    "calm effort": ("states", "CALM", 1e-3),
    "bend": ("guard_settings.Robustness", "bend_share", 0.0),
    "parameters walk": ("guard_settings.Robustness", "parameter_walk", 0.0),
    "angles walk": ("guard_settings.Robustness", "angle_walk", 0.0),
    "forces beyond friction": ("guard_settings.Robustness", "beyond_time", 0.0),
    "references": ("guard_settings.Robustness", "reference_time", 0.0),
    "persistence alone": ("guard_settings.Robustness", "persistence_alone", 0.02),
    "declared friction": ("guard_settings.Robustness", "declared_friction", 0.0),
    "unknown friction walks": ("guard_settings.Robustness", "unknown_friction_walk", 0.0),
}
"""Rule → module of `distal.estimators.adaptive` (or its class), name, value without it."""


@dataclass(frozen=True)
class Case:
    """A log with its rig, and what it is called in the table."""

    name: str
    log: Log
    rig: Rig


def cases() -> Iterator[Case]:
    """Yield all logs of the panel."""
    singles: dict[str, tuple[Callable[[int], Log], Rig]] = {
        "Bowden": (lambda seed: bowden_log(seed, "ramps", DURATION), bowden_rig()),
        "Bowden, stops": (lambda seed: bowden_log(seed, "stops", DURATION), bowden_rig()),
        "ropes": (lambda seed: ropes_log(seed, "holds", DURATION), ropes_rig()),
        "foreign finger": (lambda seed: finger_log(seed, DURATION), finger_rig()),
        "foreign hand": (lambda seed: hand_log(seed, DURATION), hand_rig()),
    }
    for name, (log_of, rig) in singles.items():
        for seed in SEEDS:
            log = log_of(seed)
            yield Case(name, log, rig)
            yield Case(f"{name}, bad readings", spoilt(log, rig, seed), rig)
    for name in ("finger-2n", "finger-n-plus-1", "wrist-instrument"):
        for seed in SEEDS:
            for event, log in events.logs(name, seed):
                if event != "jump":
                    yield Case(f"{name}, {event}", first_seconds(log), load_rig(name))


def first_seconds(log: Log) -> Log:
    """Return the first `DURATION` of a log."""
    now = log.time - log.time[0] <= DURATION
    channels, truth = (
        {name: values[now] for name, values in columns.items()}
        for columns in (log.channels, log.truth)
    )
    return Log(log.time[now], channels, truth, log.source, log.truth_source)


def spoilt(log: Log, rig: Rig, seed: int) -> Log:
    """Return a log with bursts of wild positions, a tenth of all values missing, and a gap."""
    rng = np.random.default_rng([seed, 5])
    start = float(rng.uniform(3.0, 8.0))
    gap = (log.time > start) & (log.time <= start + 0.6)
    channels = {}
    for sensor in rig.sensors:
        if sensor.name not in log.channels:
            continue
        values = np.array(log.channels[sensor.name])
        if sensor.measures == "position":
            travel = float(np.nanmax(values) - np.nanmin(values))
            for at in np.flatnonzero(rng.random(len(values)) < 0.004):
                values[at : at + 4] += travel * np.exp(rng.uniform(-4, 4)) * rng.choice((-1, 1))
        channels[sensor.name] = np.where(gap | (rng.random(len(values)) < 0.1), np.nan, values)
    return Log(log.time, channels, dict(log.truth), log.source, log.truth_source)


CASES: list[Case] = []


def changed(rule: str) -> None:
    """Switch a rule off in this process."""
    where, name, value = RULES[rule]
    _, _, of = where.partition(".")
    if of == "Robustness":
        kind = import_module("distal.estimators.adaptive.guard_settings").Robustness
        usual = kind.usual.__func__

        def without(cls: Any, *arguments: Any) -> Any:
            from dataclasses import replace

            return replace(usual(cls, *arguments), **{name: value})

        kind.usual = classmethod(without)
        return
    found = import_module(f"distal.estimators.adaptive.{where}")
    assert hasattr(found, name), (where, name)
    setattr(found, name, value)


def scores(rule: str | None) -> list[tuple[float, float]]:
    """Return RMS error [°] and share inside of each log, with a rule switched off."""
    if rule is not None:
        changed(rule)
    found = []
    for case in CASES:
        try:
            made = estimate(case.log, case.rig)
        except DistalError:
            found.append((float("nan"), 0.0))
            continue
        found.append((float(np.rad2deg(made.rms_error())), made.inside_band()))
    return found


def row(rule: str, usual: np.ndarray, now: np.ndarray) -> list[str]:
    """Return the row of a rule: the logs on which it gains and costs most."""
    names = [case.name for case in CASES]
    rows = list(dict.fromkeys(names))
    pooled = {}
    for name in rows:
        own = [i for i, each in enumerate(names) if each == name]
        before, after = (np.sqrt(np.mean(part[own, 0] ** 2)) for part in (usual, now))
        shares = (100 * np.mean(part[own, 1]) for part in (usual, now))
        pooled[name] = (before, after, *shares)
    told = [
        n
        for n, (a, b, c, d) in pooled.items()
        if not (abs(b - a) <= TOLD * a and abs(d - c) <= 100 * TOLD)
    ]

    def text(name: str) -> str:
        before, after, inside, left = pooled[name]
        return f"{name}: {before:.3f}°, {inside:.0f} % → {after:.3f}°, {left:.0f} %"

    by_gain = sorted(rows, key=lambda n: -pooled[n][1] / pooled[n][0])
    overall = np.exp(np.mean([np.log(after / before) for before, after, *_ in pooled.values()]))
    inside = np.mean([left - inside for _, _, inside, left in pooled.values()])
    cells = [text(by_gain[0]), text(by_gain[-1])]
    return [rule, str(len(told)), f"{overall:.3f}", f"{inside:+.1f}", *cells]


def main() -> None:
    """Print the table, one row for each rule."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rules", nargs="*", help="only these")
    parser.add_argument("--workers", type=int, default=1)
    arguments = parser.parse_args()
    CASES.extend(cases())
    rules = arguments.rules or list(RULES)
    forked = multiprocessing.get_context("fork")
    with forked.Pool(arguments.workers, maxtasksperchild=1) as pool:
        found = pool.imap(scores, [None, *rules])
        usual = np.array(next(found))
        rows = []
        for rule, now in zip(rules, found):
            rows.append(row(rule, usual, np.array(now)))
            print(" | ".join(rows[-1]), file=sys.stderr, flush=True)
    columns = [
        "without",
        "logs that tell",
        "RMS, ×",
        "inside [%]",
        "gains most on",
        "costs most on",
    ]
    table("ablation", f"One rule switched off, {len(CASES)} logs", columns, rows)


if __name__ == "__main__":
    main()
