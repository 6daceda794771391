"""Chains in which something happens: a load is hung on and taken off, a place jumps and jumps back,
a place is silent.

`python -m benchmarks.events [--first-seed 800] [--seeds 10]`: logs of 20 s of
`tests/support/chain_plants`; an event is from 5 s to 7 s, and the rig file does not say that it may
occur. A cell: share of samples of all joints inside the band.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor

import numpy as np
from tests.support.chain_plants import EVERY, SHIPPED, STEP

from benchmarks.chain_logs import make_log
from benchmarks.report import table
from distal import Log, estimate, load_rig
from distal.confidence import BAND
from distal.estimators import channels_of
from distal.rig import Capstan

START, END, AFTER = 5.0, 7.0, 10.0
"""When an event begins and ends, and for how long after it the band is counted [s]."""

SAMPLES = round((END + AFTER + 3.0) / (STEP * EVERY))
JUMP = 3e-3
"""How far a place jumps, along the tendon [m]."""

EVENTS = ("none", "load", "jump", "lasting jump", "silent")


def plain(name: str, seed: int, load: bool) -> Log:
    """Return a log without an event of the sensors."""
    columns, truth = make_log(
        SHIPPED[name][0], "servo", seed, SAMPLES, (START, END) if load else None
    )
    channels = {sensor.name: columns[sensor.log_column] for sensor in load_rig(name).sensors}
    known = {key: values for key, values in truth.items() if key.startswith("theta")}
    return Log(columns["time"], channels, known, f"{name} {seed}", "the simulation")


def logs(name: str, seed: int) -> Iterator[tuple[str, Log]]:
    """Return a log for each event; one drawn place jumps or is silent."""
    rig, rng = load_rig(name), np.random.default_rng([seed, 2])
    log = plain(name, seed, load=False)
    positions = channels_of(rig, "adaptive").positions
    position = positions[int(rng.integers(len(positions)))]
    spools = {drive.name: drive.radius.value for drive in rig.drives if isinstance(drive, Capstan)}
    jump = rng.choice((-1.0, 1.0)) * JUMP / spools.get(position.of, 1.0)
    within = (log.time >= START) & (log.time < END)
    yield "none", log
    yield "load", plain(name, seed, load=True)
    for event, added in (
        ("jump", np.where(within, jump, 0.0)),
        ("lasting jump", np.where(log.time >= START, jump, 0.0)),
        ("silent", np.where(within, np.nan, 0.0)),
    ):
        channels = {**log.channels, position.name: log.channels[position.name] + added}
        yield event, Log(log.time, channels, log.truth, event, log.truth_source)


def scores(case: tuple[str, int]) -> dict[str, tuple[float, float, float, float]]:
    """Return of each event: inside while it lasts and after it, half-width after over before,
    median half-width [°].
    """
    name, seed = case
    rig, found = load_rig(name), {}
    for event, log in logs(name, seed):
        result = estimate(log, rig)
        assert result.truths is not None
        half, time = BAND * result.angle_stds, log.time
        inside = np.abs(result.angles - result.truths) <= half
        during, after = (time >= START) & (time < END), (time >= END) & (time < END + AFTER)
        before = half[(time >= START - 2.0) & (time < START)].mean()
        late = half[(time >= END + 5.0) & (time < END + 6.0)].mean()
        median = float(np.rad2deg(np.median(half[time > 0.5])))
        found[event] = (
            float(inside[during].mean()),
            float(inside[after].mean()),
            float(late / before),
            median,
        )
    return found


def main() -> None:
    """Print and save the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--first-seed", type=int, default=800)
    parser.add_argument("--seeds", type=int, default=10)
    options = parser.parse_args()
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    rows = []
    with ProcessPoolExecutor() as pool:
        for name in SHIPPED:
            found = list(pool.map(scores, [(name, seed) for seed in seeds]))
            for event in EVENTS:
                each = np.array([one[event] for one in found])
                during, after, ratio, half = each.mean(axis=0)
                both = (each[:, 0] * (END - START) + each[:, 1] * AFTER) / (END - START + AFTER)
                cells = (
                    f"{during:.0%}",
                    f"{after:.0%}",
                    f"{both.min():.0%}",
                    f"{ratio:.2f}",
                    f"{each[:, 2].max():.2f}",
                )
                rows.append([name, event, *cells, f"{half:.2f}"])
    columns = [
        "rig",
        "event",
        "inside during",
        "for 10 s after",
        "worst log",
        "half-width after/before",
        "worst",
        "median half-width [°]",
    ]
    table("events", "A chain in which something happens", columns, rows)


if __name__ == "__main__":
    main()
