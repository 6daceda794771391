"""A controller in the loop with a simulated rig and an estimator, and how well a joint keeps to its
reference.
"""

from distal.control.closed_loop import (
    COMMAND,
    ENCODER,
    PID,
    RATIO,
    ClosedLoop,
    ControlledPlant,
    Controller,
    SteppedPlant,
    Tracking,
    closed_loop,
    plot_control,
    run_controller,
    simulate,
    trackings_of,
)

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
