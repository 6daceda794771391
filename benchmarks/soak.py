"""Ten million streamed samples: memory, rate, and the same numbers as offline.

`python -m benchmarks.soak [samples]`; the table is saved in out/bench.
"""

from __future__ import annotations

import json
import sys
import time

import numpy as np

from benchmarks.report import table
from distal import LiveEstimator, Monitor, load_scenario, make_estimator, scenario_rig, simulate
from distal.logs import MessageReader
from distal.rig import log_factor
from distal.run import samples_of

CHUNK = 100_000


def memory() -> float:
    """Return the resident memory of this process [MB]."""
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * 4096 / 1e6


def main() -> None:
    """Stream lines of JSON through reader, estimator and monitor; compare each chunk with the
    offline loop.
    """
    total = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000_000
    scenario = load_scenario("series-2")
    rig = scenario_rig(scenario)
    log = simulate(rig, scenario)
    live, offline = LiveEstimator(rig), make_estimator("adaptive", rig)
    monitor, reader = Monitor(live), MessageReader(rig, live.channels)
    sensors = {sensor.name: sensor for sensor in rig.sensors}
    sent = [sensors[channel] for channel in live.channels]
    columns = [rig.log.time.column, *(sensor.log_column for sensor in sent)]
    factors = np.array([sensor.sign * log_factor(sensor) for sensor in sent])
    # there and back, so that the motion goes on without a jump
    samples = samples_of(log, live.channels)
    samples = np.vstack([samples, samples[::-1]])
    belief, done, worst, words, memories = None, 0, 0.0, set[str](), []
    streaming, started = 0.0, time.perf_counter()
    while done < total:
        count = min(CHUNK, total - done)
        stamps = 0.01 * np.arange(done, done + count)
        block = samples[np.arange(done, done + count) % len(samples)]
        lines = [
            json.dumps(dict(zip(columns, (stamp, *row))))
            for stamp, row in zip(stamps.tolist(), (block / factors).tolist())
        ]
        angles = np.empty(count)
        start = time.perf_counter()
        for i, line in enumerate(lines):
            reading = monitor.take(*reader.json(line))
            angles[i] = reading.angle
            words.add(reading.health)
        streaming += time.perf_counter() - start
        # the same lines, offline: what a line holds is what both see
        times, values = np.empty(count), np.empty((count, len(live.channels)))
        for i, line in enumerate(lines):
            times[i], values[i] = reader.json(line)
        belief = belief if belief is not None else offline.initial(times[0], values[0])
        rows, _ = offline.checked_rows(belief, times, values)
        kernel_states, _ = offline.kernel.scan(belief.kernel_state, rows, offline.parameters)
        worst = max(worst, float(np.abs(kernel_states[:, 0] - angles).max()))
        belief = type(belief)(float(times[-1]), kernel_states[-1].copy(), belief.size, done + count)
        done += count
        del kernel_states, rows, lines
        memories.append(memory())
        if done % (10 * CHUNK) == 0:
            print(
                f"{done:,} samples, {time.perf_counter() - started:.0f} s, {memories[-1]:.0f} MB",
                flush=True,
            )
    first, last = memories[min(4, len(memories) - 1)], memories[-1]
    rows_ = [
        ["samples", f"{done:,}"],
        ["streamed per second", f"{done / streaming:,.0f}"],
        ["memory after 500,000 [MB]", f"{first:.1f}"],
        ["memory at the end [MB]", f"{last:.1f}"],
        ["largest difference to offline [rad]", f"{worst:.1e}"],
        ["health", ", ".join(sorted(words))],
    ]
    table("soak", "JSON lines through reader, estimator and monitor", ["", ""], rows_)


if __name__ == "__main__":
    main()
