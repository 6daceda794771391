"""Simulation: a rig, a scenario and a seed become a log with the truth beside the readings."""

from distal.simulation.drifting_plant import Piece, simulate_pieces
from distal.simulation.scenario import (
    Change,
    Control,
    DriveInput,
    JointControl,
    JointInput,
    Rezero,
    Scenario,
    TurningHand,
    build_scenario,
    load_scenario,
    scenario_rig,
    scenario_text,
    shipped_scenarios,
)
from distal.simulation.signals import Signal
from distal.simulation.simulate import simulate_plant
from distal.simulation.simulate_batch import simulate_batch

__all__ = [
    "Change",
    "Control",
    "DriveInput",
    "JointControl",
    "JointInput",
    "Piece",
    "Rezero",
    "Scenario",
    "Signal",
    "TurningHand",
    "build_scenario",
    "load_scenario",
    "scenario_rig",
    "scenario_text",
    "shipped_scenarios",
    "simulate_batch",
    "simulate_pieces",
    "simulate_plant",
]
