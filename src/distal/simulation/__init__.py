"""Simulation: a rig, a scenario and a seed become a log with the truth beside the readings."""

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
