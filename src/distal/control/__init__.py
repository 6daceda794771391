"""A controller in the loop with a simulated rig and an estimator, and how well a joint keeps to its
reference.

In: a rig and a control scenario; out: what the joint did, and its error to the reference, with an
encoder, the estimate or displacements fed back. A command acts one period after the sample that it
is computed from.

    import distal

    scenario = distal.load_scenario("control-paper")
    print(distal.closed_loop(distal.scenario_rig(scenario), scenario, seed=1))
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
