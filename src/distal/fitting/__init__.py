"""Learning from logs: a rig's parameters, the sensors' noise and correction maps, and what the logs
can identify.

In: logs and a rig whose values and stds are priors; out: a `Fit` with a rig, standard errors, and
scores on logs that were left out. It minimises −ln p = ½ Σ (ν²/S + ln S) − ln prior.

    import distal

    scenario = distal.load_scenario("template")
    rig = distal.scenario_rig(scenario)
    logs = [distal.simulate(rig, scenario, seed) for seed in (1, 2, 3)]
    print(distal.fit(logs, rig).rig.name)
"""

from distal.fitting.candidates import AS_GIVEN, WRITTEN, Compared
from distal.fitting.fit import Fit, fit, learn
from distal.fitting.learned_maps import SETTLING, MapFit, Score
from distal.fitting.parameters_and_priors import FittedParameter, Options
from distal.regression import groups_of

__all__ = [
    "AS_GIVEN",
    "SETTLING",
    "WRITTEN",
    "Compared",
    "Fit",
    "FittedParameter",
    "MapFit",
    "Options",
    "Score",
    "fit",
    "groups_of",
    "learn",
]
