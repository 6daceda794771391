"""Simulation: a rig, a scenario and a seed become a log with the truth beside the readings."""

from distal.simulation.drifting_plant import Piece, simulate_pieces
from distal.simulation.scenario import (
    Control,
    JointControl,
    Rezero,
    Scenario,
    build_scenario,
    load_scenario,
    scenario_rig,
    scenario_text,
    shipped_scenarios,
)
from distal.simulation.simulate import simulate_batch, simulate_plant

__all__ = [
    "Control",
    "JointControl",
    "Piece",
    "Rezero",
    "Scenario",
    "build_scenario",
    "load_scenario",
    "scenario_rig",
    "scenario_text",
    "shipped_scenarios",
    "simulate_batch",
    "simulate_pieces",
    "simulate_plant",
]
