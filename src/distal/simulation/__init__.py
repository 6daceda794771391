"""Simulation: a rig, a scenario and a seed become a log with the truth beside the readings.

In: a rig as it is believed, a scenario that says what is different in the plant and what the drives
do, a seed; out: a `Log`. The plant takes sub-steps of the same model that filters use.

    import distal

    scenario = distal.load_scenario("template")
    log = distal.simulate(distal.scenario_rig(scenario), scenario, seed=1)
    print(len(log), list(log.truth))
"""

from distal.simulation.scenario import (
    Control,
    JointControl,
    Scenario,
    build_scenario,
    load_scenario,
    scenario_rig,
    scenario_text,
    shipped_scenarios,
)
from distal.simulation.simulate import rig_beside, rig_of_logs, simulate_plant, text_beside

__all__ = [
    "Control",
    "JointControl",
    "Scenario",
    "build_scenario",
    "load_scenario",
    "rig_beside",
    "rig_of_logs",
    "scenario_rig",
    "scenario_text",
    "shipped_scenarios",
    "simulate_plant",
    "text_beside",
]
