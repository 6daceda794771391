"""Springs that are not linear, and tendons that are slack at home: against energies, and an
integration of their own.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from distal import Rig, load_rig, simulate
from distal.errors import RigError
from distal.model import Mechanism
from distal.simulation import build_scenario

EXTENSION = {
    "stiffness": 300.0,
    "free_length": 0.014,
    "radius": 0.009,
    "distance": 0.026,
    "line_angle": -0.9,
    "preload": 0.4,
}


def torque(rig: Rig, angle: float) -> float:
    mechanism = Mechanism(rig)
    q = ca.SX.sym("q", mechanism.n_bodies)
    function = ca.Function("t", [q, mechanism.parameters.symbols], [mechanism.passive_forces(q)[0]])
    return float(function([angle, *[0.0] * mechanism.n_drives], mechanism.parameters.values))


def tensions(rig: Rig, angle: float, positions: list[float]) -> np.ndarray:
    mechanism = Mechanism(rig)
    q, v = ca.SX.sym("q", mechanism.n_bodies), ca.SX.zeros(mechanism.n_bodies)
    function = ca.Function("T", [q, mechanism.parameters.symbols], [mechanism.tensions(q, v)])
    return np.array(function([angle, *positions], mechanism.parameters.values)).ravel()


def energy(spring: dict[str, float], angle: float) -> float:
    """½ k (L − L₀)² + preload (L − L₀), where the spring pulls."""
    ends = spring["radius"] * np.exp(1j * (angle - spring["line_angle"])), spring["distance"]
    opened = abs(ends[0] - ends[1]) - spring["free_length"]
    least = -spring["preload"] / spring["stiffness"]  # where it goes slack
    opened = max(opened, least)
    return 0.5 * spring["stiffness"] * opened**2 + spring["preload"] * opened


@given(st.floats(-2.5, 2.5), st.sampled_from([0.01, 0.02, 0.03]))
def test_an_extension_spring_pulls_down_its_energy(angle: float, free: float) -> None:
    spring = {**EXTENSION, "free_length": free}
    rig = load_rig("pulley-antagonist").with_values({"joints.0.extension_spring": spring})
    step = 1e-5
    slope = (energy(spring, angle + step) - energy(spring, angle - step)) / (2 * step)
    assert torque(rig, angle) == pytest.approx(-slope, abs=2e-6)


def test_where_its_ends_are_in_line_it_does_not_turn() -> None:
    rig = load_rig("pulley-antagonist").with_values({"joints.0.extension_spring": EXTENSION})
    assert torque(rig, -0.9) == 0.0
    assert torque(rig, -0.8) < 0.0 < torque(rig, -1.0)
    same = {**EXTENSION, "radius": 0.026, "free_length": 1e-3}
    assert (
        torque(rig.with_values({"joints.0.extension_spring": same}), -0.9) == 0.0
    )  # the ends meet


def test_a_polynomial_spring() -> None:
    spring = {"stiffness": 0.2, "rest_angle": 0.3, "quadratic": -0.07, "cubic": 0.5}
    rig = load_rig("pulley-antagonist").with_values({"joints.0.spring": spring})
    for angle in (-1.0, 0.3, 0.9):
        x = angle - 0.3
        assert torque(rig, angle) == pytest.approx(-(0.2 * x - 0.07 * x**2 + 0.5 * x**3), abs=1e-15)


def test_a_slack_tendon_pulls_from_its_slack_on() -> None:
    rig = load_rig("pulley-antagonist").with_values({"tendons.0.slack": "0.4 mm"})
    k = rig.tendons[0].stiffness.value
    np.testing.assert_allclose(
        tensions(rig, 0.0, [0.39e-3, 1e-3]), [0.0, rig.tendons[1].stiffness.value * 1e-3]
    )
    np.testing.assert_allclose(tensions(rig, 0.0, [1.4e-3, 0.0]), [k * 1e-3, 0.0], atol=1e-12)
    with pytest.raises(
        RigError, match=r"tendons\.left: slack: a tendon is slack at home, or pulled"
    ):
        rig.with_values({"tendons.0.pretension": 2.0})


def test_a_rig_without_them_has_none_of_their_numbers() -> None:
    names = Mechanism(load_rig("capstan-joint")).parameters.names
    assert not any("slack" in name or "quadratic" in name or "extension" in name for name in names)


def test_a_simulation_is_that_of_a_solver_of_its_own() -> None:
    """A frictionless joint, a spring between two points, one tendon that is slack at home and
    pulled by weights.
    """
    rig = load_rig("pulley-antagonist").with_values(
        {
            "joints.0.friction.coefficient": {"value": 0.0, "std": 0.0},
            "joints.0.damping": 4e-3,
            "joints.0.spring": {"stiffness": 0.02, "cubic": 0.05},
            "joints.0.extension_spring": EXTENSION,
            "tendons.0.slack": "0.7 mm",
            "drives.0.friction": {"constant": 0.0, "load": {"value": 0.0, "std": 0.0}},
            "drives.1.friction": {"constant": 0.0, "load": {"value": 0.0, "std": 0.0}},
            **{
                f"drives.{i}.{name}": value
                for i in (0, 1)
                for name, value in (("mass", 0.02), ("damping", 4.0))
            },
            "stepping.largest_step": 2e-5,
        }
    )
    pull = {"force": {"points": [[0.0, 1.5], [0.5, 4.5], [1.2, 2.0]], "interpolation": "hold"}}
    drives = {"left": pull, "right": {"force": "1 N"}}
    scenario = build_scenario(
        {"rig": "pulley-antagonist", "duration": 2.0, "drives": drives}, "peer"
    )
    log = simulate(rig, scenario, 0)
    radius, k = (
        rig.tendons[0].insertion.radius.value,
        [tendon.stiffness.value for tendon in rig.tendons],
    )
    inertia = rig.joints[0].inertia.value

    def rates(t: float, y: np.ndarray) -> list[float]:
        theta, omega, x, v, z, w = y
        left = k[0] * max(x - radius * theta - 0.7e-3, 0.0)
        right = k[1] * max(z + radius * theta, 0.0)
        ends = EXTENSION["radius"] * np.exp(1j * (theta + 0.9)), EXTENSION["distance"]
        length = abs(ends[0] - ends[1])
        force = max(0.4 + 300.0 * (length - 0.014), 0.0)
        arm = EXTENSION["radius"] * EXTENSION["distance"] * np.sin(theta + 0.9) / length
        total = (
            radius * (left - right) - force * arm - 0.02 * theta - 0.05 * theta**3 - 4e-3 * omega
        )
        load = 1.5 if t < 0.5 else 4.5 if t < 1.2 else 2.0
        return [
            omega,
            total / inertia,
            v,
            (load - left - 4 * v) / 0.02,
            w,
            (1.0 - right - 4 * w) / 0.02,
        ]

    first = [log.truth[name][0] for name in ("theta", "position_left", "position_right")]
    start = [first[0], 0.0, first[1], 0.0, first[2], 0.0]
    peer = solve_ivp(
        rates,
        (0.0, float(log.time[-1])),
        start,
        "DOP853",
        log.time,
        rtol=1e-9,
        atol=1e-12,
        max_step=1e-3,
    )
    assert np.ptp(peer.y[0]) > np.deg2rad(10)
    np.testing.assert_allclose(log.truth["theta"], peer.y[0], atol=np.deg2rad(0.05))
