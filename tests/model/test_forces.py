"""Virtual work, slack, friction limits and stops, against the paper's equations typed out."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from distal import Rig, load_rig
from distal.model import (
    Mechanism,
    restitution,
    soft_moments,
    stretched,
)
from distal.model.friction import Limit, capstan_limit, stribeck
from distal.rig import Linkage, Pulley
from distal.rig.components import Pinned
from tests.helpers import NaiveRig, finite_difference
from tests.model.helpers import At, look

ANGLE = st.floats(-1.2, 1.2)
POSITION = st.floats(-5e-3, 15e-3)


def forces(mechanism: Mechanism, q: ca.SX, v: ca.SX) -> list[ca.SX]:
    tensions = mechanism.tensions(q, v)
    limits = mechanism.friction_limits(q, v, tensions)
    force = -ca.mtimes(mechanism.length_jacobian(q).T, tensions)
    ups, downs = zip(*((limit.up, limit.down) for limit in limits))
    return [tensions, force, ca.vertcat(*ups), ca.vertcat(*downs)]


@pytest.fixture(scope="module")
def paper(paper_rig: Rig) -> At:
    return look(paper_rig, forces)


@given(ANGLE, POSITION, POSITION)
def test_forces_are_the_papers(paper: At, theta: float, x1: float, x2: float) -> None:
    """One length function gives (8) to (11), and T cos φ of (2) and (3), with the mends."""
    naive, at = NaiveRig(), (theta, x1, x2)
    expected = naive.tensions(*at), naive.tendon_forces(*at), naive.limits(*at)
    for found, known, exact in zip(paper(at), expected, (1e-10, 1e-11, 1e-12)):
        np.testing.assert_allclose(found, known, rtol=1e-9, atol=exact)


@pytest.mark.parametrize("name", ["paper-2008-printed", "pulley-antagonist", "capstan-joint"])
def test_virtual_work(name: str) -> None:
    """Force is minus the slope of the stored energy Σ ½ T²/k: nothing is gained round a closed
    path.
    """
    rig = load_rig(name)
    at = look(rig, forces)
    stiffness = np.array([tendon.stiffness.value for tendon in rig.tendons])

    def energy(q: np.ndarray) -> np.ndarray:
        return np.array([np.sum(at(q)[0] ** 2 / (2 * stiffness))])

    rng = np.random.default_rng(1)
    for _ in range(20):
        q = np.append(rng.uniform(-0.6, 0.6), rng.uniform(0.0, 8e-3, len(rig.drives)))
        expected = -finite_difference(energy, q, 1e-7).ravel()
        np.testing.assert_allclose(at(q)[1], expected, rtol=1e-5, atol=1e-6)


def test_damping_never_makes_a_tendon_push() -> None:
    at = look(load_rig("pulley-antagonist"), forces)
    taut, *_ = at([0, 2e-3, 2e-3], [0, 0.5, -0.5])
    assert taut == pytest.approx([806 * 2e-3 + 0.2 * 0.5, 806 * 2e-3 - 0.2 * 0.5])
    assert at([0, 2e-3, 1e-4], [0, 0, -5.0])[0][1] == 0.0
    # stretching fast but slack: nothing
    assert at([0, -1e-3, 2e-3], [0, 50.0, 0])[0][0] == 0.0


SHAPES = {
    "pinned": Pinned(kind="pinned", radius=9.53e-3, free_length=0.375),
    "pulley": Pulley(kind="pulley", radius=9.53e-3),
    "linkage": Linkage(kind="linkage", radius=9.53e-3),
}


@given(ANGLE, POSITION, st.sampled_from([1, -1]), st.sampled_from(["pinned", "pulley", "linkage"]))
def test_angle_at_is_the_inverse_of_elongation(
    theta: float, x: float, side: int, kind: str
) -> None:
    size = {
        "radius": 9.53e-3,
        "free_length": 0.375,
        "centre": 0.3,
        "slope": 0.2,
        "curvature": -0.1,
    }.__getitem__
    shape = SHAPES[kind]
    longer = float(ca.evalf(shape.elongation(size, side, [ca.DM(theta)], ca.DM(x))))
    assert float(ca.evalf(ca.SX(shape.angle_at(size, side, longer, ca.DM(x))))) == pytest.approx(
        theta, abs=1e-9
    )


def test_an_impossible_length_gives_the_nearest_angle() -> None:
    size = {"radius": 9.53e-3, "free_length": 0.375}.__getitem__
    far = float(ca.evalf(ca.SX(SHAPES["pinned"].angle_at(size, 1, 0.0, ca.DM(0.05)))))
    assert np.isfinite(far)
    assert np.rad2deg(far) == pytest.approx(90.0, abs=3.0)


def test_restitution_is_that_of_the_contact() -> None:
    """Against the contact's own equation of motion, m ẍ = −max(k x + c ẋ, 0), integrated."""
    from scipy.integrate import solve_ivp

    m, k, c = 1e-3, 1e5, 3.0
    event = lambda t, y: k * y[0] + c * y[1] if t > 1e-5 else 1.0  # noqa: E731
    event.terminal = True  # type: ignore[attr-defined]
    done = solve_ivp(
        lambda t, y: [y[1], -(k * y[0] + c * y[1]) / m],
        (0, 1e-2),
        [0.0, 1.0],
        events=event,
        rtol=1e-10,
        atol=1e-14,
    )
    assert float(restitution(ca.DM(k), ca.DM(c), ca.DM(m))) == pytest.approx(
        -done.y[1, -1], rel=1e-6
    )
    assert float(restitution(ca.DM(k), ca.DM(100.0), ca.DM(m))) == 0.0


def test_friction_may_grow_more_steeply_with_the_load(paper_rig: Rig) -> None:
    friction = {"joints.0.friction.exponent": 1.5, "joints.0.friction.reference": "12.9 N"}
    tensions, _, limits, _ = look(paper_rig.with_values(friction), forces)([0.3, 6e-3, 6e-3])
    load = 4.9 + tensions.sum()
    assert limits[0] == pytest.approx(0.5 * 3.18e-3 * 12.9 * (load / 12.9) ** 1.5)


def test_absent_features_cost_nothing(paper_rig: Rig) -> None:
    """A parameter that is zero for certain is a constant, not an input."""
    absent = ("damping", "slack", "quadratic", "extension", "exponent")
    names = Mechanism(paper_rig.with_values({"tendons.0.damping": 0.1})).parameters.names
    assert [n for n in names if n[:3] != "dri" and any(part in n for part in absent)] == [
        "joints.0.damping",
        "tendons.0.damping",
    ]


@given(st.floats(-3, 3), st.floats(0, 2), st.floats(1e-3, 2))
def test_soft_moments_are_those_of_a_normal_distribution(
    z: float, limit: float, std: float
) -> None:
    """Mean and variance against quadrature, the slope against a difference of means."""
    x = np.linspace(-10, 10, 40_001)
    weights = np.exp(-x * x / 2)
    weights /= weights.sum()
    values = np.maximum(z + std * x - limit, 0) + np.minimum(z + std * x + limit, 0)
    mean = float(np.sum(weights * values))
    moments = soft_moments(ca.DM(z), Limit(ca.DM(limit), ca.DM(limit)), ca.DM(std))
    assert float(moments.mean) == pytest.approx(mean, abs=1e-6)
    assert float(moments.slope) == pytest.approx(
        float(np.sum(weights * (np.abs(z + std * x) > limit))), abs=2e-3
    )
    rest = float(np.sum(weights * (values - mean) ** 2)) - (float(moments.slope) * std) ** 2
    assert float(moments.rest) == pytest.approx(max(rest, 0.0), abs=1e-5)


@given(st.floats(-4e-3, 12e-3), st.floats(1e-9, 800.0))
def test_stiffness_grows_with_tension(delta: float, a: float) -> None:
    """dT/dδ = k + a (T − T_pre) up to where the curve goes on straight, and T = k δ as a goes to
    0.
    """
    k, step = 2e4, 1e-7
    tension = ca.Function("T", [x := ca.SX.sym("x")], [k * stretched(x, ca.SX(a))])
    here, slope = (
        float(tension(delta)),
        float(tension(delta + step) - tension(delta - step)) / (2 * step),
    )
    assert slope == pytest.approx(min(k + a * here, k * np.exp(2.0)), rel=2e-4)
    if a < 1e-6:
        assert here == pytest.approx(k * delta, rel=1e-6, abs=1e-12)


@given(st.floats(-1.5, 1.5))
def test_the_arm_of_a_linkage_is_the_slope_of_its_excursion(theta: float) -> None:
    """r (1 + s u + c u²), and no excursion at θ = 0."""
    r, centre, slope, curvature = 5e-3, 0.4, 0.3, -0.2
    size = {"radius": r, "centre": centre, "slope": slope, "curvature": curvature}.__getitem__
    angle = ca.SX.sym("angle")
    drawn = -SHAPES["linkage"].elongation(size, 1, [angle], 0)
    function = ca.Function("e", [angle], [drawn, ca.jacobian(drawn, angle)])
    u = theta - centre
    assert float(function(theta)[1]) == pytest.approx(
        r * (1 + slope * u + curvature * u * u), rel=1e-9
    )
    assert float(function(0.0)[0]) == pytest.approx(0.0, abs=1e-15)


@given(st.floats(0, 50), st.floats(0, 0.5), st.floats(0, 6))
def test_friction_along_a_path_is_the_capstan_equation(
    tension: float, mu: float, wrap: float
) -> None:
    """The drive feels T e^{μβ} when it draws the tendon in, T e^{−μβ} when it lets it out."""
    limit = capstan_limit(ca.DM(tension), mu * wrap)
    assert tension + float(limit.up) == pytest.approx(tension * np.exp(mu * wrap))
    assert tension - float(limit.down) == pytest.approx(tension * np.exp(-mu * wrap))


def test_stiction_fades_with_speed() -> None:
    assert float(stribeck(ca.DM(0.0), 0.4, 0.1)) == pytest.approx(1.4)
    assert float(stribeck(ca.DM(0.1), 0.4, 0.1)) == pytest.approx(1 + 0.4 / np.e)
    assert float(stribeck(ca.DM(-5.0), 0.4, 0.1)) == pytest.approx(1.0)


def test_a_capstan_draws_in_one_tendon_and_lets_out_the_other() -> None:
    """δ1 = Rs − rθ + p, δ2 = −Rs + rθ + p with pre-tension k p. Friction along the paths at + is
    R (T₁ (e^{μβ} − 1) + T₂ (1 − e^{−μβ})), at − the other way round.
    """
    path = {f"tendons.{i}.path": {"friction": 0.1, "wrap": 3.0} for i in (0, 1)}
    none = {"load": {"value": 0.0, "std": 0.0}, "constant": 0.01}
    rig = load_rig("capstan-joint").with_values({**path, "drives.0.friction": none})
    tensions, _, (_, up), (_, down) = look(rig, forces)([0.1, 0.2])
    wound = 2.3e4 * (5e-3 * 0.2 - 8e-3 * 0.1)
    assert tensions == pytest.approx([20 + wound, 20 - wound])
    drawn, let_out = 5e-3 * np.expm1(0.3), -5e-3 * np.expm1(-0.3)
    assert up == pytest.approx(0.01 + drawn * tensions[0] + let_out * tensions[1])
    assert down == pytest.approx(0.01 + drawn * tensions[1] + let_out * tensions[0])


def test_the_play_of_a_transmission_grows_with_load_and_angle() -> None:
    """h = (c + l R Σ T)(1 + s θ), never below 0; a drive's stretch is that of its tendons as its
    own turn, φ − r θ/R.
    """
    play = {"constant": 0.02, "load": 0.05, "slope": {"value": -0.4, "std": 0.1}}
    rig = load_rig("capstan-joint").with_values({"drives.0.hysteresis": play})
    for theta, phi, pulls in ((0.0, 0.0, (0, 0)), (0.5, 0.3, (10, 4)), (3.0, 0.1, (5, 5))):
        at = look(rig, lambda m, q, v: [m.hysteresis_limit(0, q, ca.DM(pulls)), m.stretch(0, q)])  # noqa: B023
        limit, stretch = at([theta, phi])
        assert limit == pytest.approx(max((0.02 + 0.05 * 5e-3 * sum(pulls)) * (1 - 0.4 * theta), 0))
        assert stretch == pytest.approx(phi - 8e-3 * theta / 5e-3, abs=1e-9)


def test_the_slope_of_a_joints_springs_is_their_stiffness() -> None:
    """−dτ/dθ by finite differences, of a polynomial spring; gravity is not in it."""
    spring = {"stiffness": 0.02, "quadratic": 0.01, "cubic": 0.03, "rest_angle": 0.1}
    gravity = {"mass": 0.05, "distance": 0.02, "hanging_angle": 0.3}
    values = {"joints.0.spring": spring, "joints.0.gravity": gravity}
    rig = load_rig("pulley-antagonist").with_values(values)
    at = look(rig, lambda m, q, v: [m.passive_springs(q), m.passive_forces(q)])
    for theta in (-0.6, 0.0, 0.1, 0.8):
        (torque, stiffness), whole = at([theta])
        away = theta - 0.1
        assert torque == pytest.approx(-(0.02 * away + 0.01 * away**2 + 0.03 * away**3), abs=1e-12)
        slope = finite_difference(lambda angle: at(angle)[0][:1], np.array([theta]))
        assert stiffness == pytest.approx(-slope[0, 0], rel=1e-6)
        weight = 0.05 * 9.80665 * 0.02 * np.sin(theta - 0.3)
        assert whole == pytest.approx([torque - weight, 0.0, 0.0], abs=1e-12)
