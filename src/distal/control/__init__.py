"""A controller in the loop with a simulated rig and an estimator, and how well a joint keeps to its
reference.
"""

from distal.control.closed_loop import (
    COMMAND,
    ENCODER,
    RATIO,
    ClosedLoop,
    Controller,
    closed_loop,
    run_controller,
    simulate,
)
from distal.control.controlled_plant import ControlledPlant, SteppedPlant
from distal.control.controllers import PID
from distal.control.tracking import Tracking, plot_control, trackings_of

__all__ = [
    "COMMAND",
    "ENCODER",
    "PID",
    "RATIO",
    "ClosedLoop",
    "ControlledPlant",
    "Controller",
    "SteppedPlant",
    "Tracking",
    "closed_loop",
    "plot_control",
    "run_controller",
    "simulate",
    "trackings_of",
]
