"""Run an estimator over a log, over many logs or over a stream; smooth an estimate; judge the
health of a stream.

In: a log or samples one by one; out: an `Estimate`, or a `Reading` with a word on its health. Live
and offline step the same kernel and give the same numbers.

    import numpy as np
    import distal

    scenario = distal.load_scenario("template")
    rig = distal.scenario_rig(scenario)
    log = distal.simulate(rig, scenario, seed=1)
    monitor = distal.Monitor(distal.LiveEstimator(rig))
    sample = np.array([log.channels[name][0] for name in monitor.channels])
    print(monitor.take(0.0, sample))
"""

from distal.run.health import HEALTH, Monitor, Reading, log_health
from distal.run.live_estimator import JointContact, LiveEstimator, LogUnits
from distal.run.offline import estimate, estimate_batch, samples_of, smooth, with_channel

__all__ = [
    "HEALTH",
    "JointContact",
    "LiveEstimator",
    "LogUnits",
    "Monitor",
    "Reading",
    "estimate",
    "estimate_batch",
    "log_health",
    "samples_of",
    "smooth",
    "with_channel",
]
