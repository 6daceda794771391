"""Sizes of causes by known angles: on logs that are typed out they are exact."""

from __future__ import annotations

import numpy as np
import pytest

from distal import Log, load_rig
from distal.arrays import Floats
from distal.diagnosis.causes import Cause, causes_of, sizes
from distal.estimators import AdaptiveFilter
from tests.helpers import changed

ARMS = np.array([[8e-3, 0.0], [-8e-3, 0.0], [7e-3, 6e-3], [-7e-3, -6e-3]])
"""Moment arms of finger-2n: tendons by joints [m]."""

DRIVES, STIFFNESS = ("mcp_f", "mcp_e", "pip_f", "pip_e"), 2500.0
TIME = np.arange(0.0, 12.0, 0.01)


@pytest.fixture(scope="module")
def finger() -> AdaptiveFilter:
    return AdaptiveFilter(load_rig("finger-2n"), compiled=False)


def angles_at(time: Floats) -> Floats:
    return np.column_stack([0.5 * np.sin(1.3 * time), 0.4 + 0.4 * np.sin(0.7 * time + 1)])


def log_of(arms: Floats = ARMS, stiffness: float = STIFFNESS, delay: float = 0.0) -> Log:
    """Return positions s = A θ + F/k of both joints in motion, the first drive's late."""

    def positions(at: Floats) -> tuple[Floats, Floats]:
        forces = np.column_stack([3 + np.sin(2.1 * at + k) for k in range(4)])
        soft = forces / np.array([stiffness, *[STIFFNESS] * 3])
        return forces, angles_at(at) @ arms.T + soft

    forces, placed = positions(TIME)
    placed[:, 0] = positions(TIME - delay)[1][:, 0]
    channels = {f"x_{name}": placed[:, k] for k, name in enumerate(DRIVES)}
    channels |= {f"F_{name}": forces[:, k] for k, name in enumerate(DRIVES)}
    return Log(TIME, channels)


def found(log: Log, estimator: AdaptiveFilter) -> dict[tuple[str, str], float]:
    sized = sizes(estimator, log, angles_at(log.time), causes_of(estimator, 0.01))
    return {(cause.kind, cause.subject): xs[0] for cause, xs in sized.items() if xs}


@pytest.mark.parametrize(
    ("factor", "shift", "cause", "size"),
    [
        *((factor, 0.0, "scale", 1.0 / factor - 1.0) for factor in (1.5, -1.0, 1000.0)),
        (1.0, 2e-3, "zero", -2e-3),
    ],
)
def test_the_scale_and_the_zero_of_a_position(
    finger: AdaptiveFilter, factor: float, shift: float, cause: str, size: float
) -> None:
    """The change that takes it off, exactly, also that of a sign or a unit."""
    log = log_of()
    sized = found(changed(log, x_mcp_f=factor * log.channels["x_mcp_f"] + shift), finger)
    assert sized[cause, "x_mcp_f"] == pytest.approx(size, abs=1e-6)
    assert sized[cause, "x_mcp_e"] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(("joint", "name", "factor"), [(0, "mcp", 1.5), (1, "pip", 0.5)])
def test_an_arm_at_each_joint(finger: AdaptiveFilter, joint: int, name: str, factor: float) -> None:
    arms = ARMS.copy()
    arms[2, joint] *= factor
    x = found(log_of(arms), finger)["arm", f"pip_f at {name}"]
    assert x == pytest.approx(factor - 1.0, abs=1e-6)


def test_a_stiffness(finger: AdaptiveFilter) -> None:
    sized = found(log_of(stiffness=0.5 * STIFFNESS), finger)
    assert sized["stiffness", "F_mcp_f"] == pytest.approx(-0.5, abs=1e-6)
    assert sized["scale", "F_mcp_f"] == pytest.approx(1.0, abs=1e-6)


def test_a_stiffness_whose_force_hardly_varies_is_sized_without_a_shift(
    finger: AdaptiveFilter,
) -> None:
    """F = 3 N all the time: a shift beside it would take it up."""
    steady = changed(log_of(), F_mcp_f=np.full(len(TIME), 3.0))
    placed = angles_at(TIME) @ ARMS[0] + 3.0 / (0.5 * STIFFNESS)
    causes = [each for each in causes_of(finger, 0.01) if each.kind == "stiffness"]
    sized = sizes(finger, changed(steady, x_mcp_f=placed), angles_at(TIME), causes)
    assert sized[causes[0]][-1] == pytest.approx(-0.5, abs=1e-6)


def test_a_delay_but_for_its_curvature(finger: AdaptiveFilter) -> None:
    """s(t − τ) is s − τ ds/dt to second order: ω τ/2 of it is 5 % at 2.1 rad/s."""
    x = found(log_of(delay=0.05), finger)["delay", "x_mcp_f"]
    assert x == pytest.approx(0.05, rel=0.05)


def test_friction_is_no_cause(finger: AdaptiveFilter) -> None:
    """A shift against the last motion, with the load, is taken up beside each cause."""
    log = log_of()
    way = np.sign(np.gradient(log.channels["x_mcp_f"]))
    soft = log.channels["F_mcp_f"] / STIFFNESS
    wrong = changed(log, x_mcp_f=log.channels["x_mcp_f"] + 0.2 * way * soft)
    # turning takes TURNS_BACK of the range, in which friction is between its limits
    assert found(wrong, finger)["scale", "x_mcp_f"] == pytest.approx(0.0, abs=0.03)


def test_pre_tension_is_no_zero(finger: AdaptiveFilter) -> None:
    """It is taken off, so that here, where there is none, it is missed."""
    rig = finger.rig.with_values({f"tendons.{k}.pretension": 5.0 for k in range(4)})
    tense = AdaptiveFilter(rig, compiled=False)
    zero = found(log_of(), tense)["zero", "x_mcp_f"]
    assert zero == pytest.approx(-5.0 / STIFFNESS, rel=1e-6)


def test_a_joint_without_a_known_angle_leaves_the_drives_of_others(finger: AdaptiveFilter) -> None:
    """Those of mcp pull at it alone; those of pip cross both joints."""
    truths = angles_at(TIME)
    truths[:, 1] = np.nan
    sized = sizes(finger, log_of(), truths, causes_of(finger, 0.01))
    assert {cause.subject for cause in sized if cause.kind == "zero"} == {"x_mcp_f", "x_mcp_e"}


def test_units_and_signs_are_tried_whatever_the_size() -> None:
    """Of a force in N m: a sign, millinewtons, and their inverse."""
    estimator = AdaptiveFilter(load_rig("lab-bench"), compiled=False)
    tried = {c.subject: c.tried for c in causes_of(estimator, 0.01) if c.kind == "scale"}
    assert tried["motor_torque"] == pytest.approx((-2.0, 999.0, -0.999))
    assert tried["motor_angle"][0] == -2.0


def test_the_distance_of_a_change_is_in_stds_of_the_rig() -> None:
    """A factor counts in logarithms, a sign as three stds, a zero in its own std."""
    arm = Cause("arm", "a at b", paths=("p",), std=0.1)
    zero = Cause("zero", "x", ("x",), std=2e-3, unit="m")
    force = Cause("scale", "F", ("F",), tried=(999.0,), unit="N")
    for cause, x, distance in (
        (arm, 0.21, 2.0),
        (arm, 1.0 / 1.21 - 1.0, 2.0),
        (arm, -2.0, 3.0),
        (zero, -6e-3, 3.0),
        (force, 999.0, 3.0),
    ):
        assert cause.distance(x) == pytest.approx(distance)
