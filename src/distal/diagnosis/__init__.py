"""Diagnosis of an estimate: what was tested, what disagrees, and what no sensor in the log can
test.

In: an estimate, its log and rig; out: findings, each with its evidence. A cause c is judged by
Rao's score, (Σ s_c)²/I_cc, from one pass of the filter.

    import distal

    scenario = distal.load_scenario("template")
    rig = distal.scenario_rig(scenario)
    log = distal.simulate(rig, scenario, seed=1)
    print(distal.diagnose(distal.estimate(log, rig), log, rig))
"""

from distal.diagnosis.causes import Finding, Kind
from distal.diagnosis.diagnose import diagnose, why_diverged
from distal.diagnosis.innovation_tests import Diagnosis, diagnose_estimate

__all__ = [
    "Diagnosis",
    "Finding",
    "Kind",
    "diagnose",
    "diagnose_estimate",
    "why_diverged",
]
