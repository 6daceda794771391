"""What drives chains in tests."""

from __future__ import annotations

from distal.simulation import Scenario, build_scenario


def flexed(duration: float, amplitude: float) -> Scenario:
    """Return what turns the flexor of the underactuated finger to and fro [s], [rad]."""
    angle = {"mean": 0.6, "amplitude": amplitude, "frequency": 0.5}
    servo = {"angle": angle, "stiffness": 5.0, "damping": 0.05}
    drives = {"flexor": {"servo": servo}}
    return build_scenario({"rig": "finger-underactuated", "duration": duration, "drives": drives})
