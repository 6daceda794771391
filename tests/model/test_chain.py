"""Joints that carry one another: dynamics against other packages, one joint as a chain of one,
couplings, crossings.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np
import pytest

import distal.model.mechanism
from distal import estimate, load_rig, simulate
from distal.errors import RigError, ScenarioError
from distal.model import Mechanism, interval_step, joint_frequency
from distal.rig import Rig, build_rig
from distal.rig.components import Polynomial
from distal.simulation import build_scenario
from tests.helpers import finite_difference
from tests.model.helpers import At, look

FINGER = "finger-n-plus-1"


def bodies(mechanism: Mechanism) -> tuple[ca.SX, ca.SX]:
    return ca.SX.sym("q", mechanism.n_bodies), ca.SX.sym("v", mechanism.n_bodies)


def changed(
    name: str,
    *,
    joints: dict[str, Any] | None = None,
    tendons: dict[str, Any] | None = None,
    **more: Any,
) -> Rig:
    """Return a shipped rig with the same keys changed in all joints and all tendons."""
    raw = load_rig(name).model_dump()
    for joint in raw["joints"]:
        joint.update(joints or {})
    for tendon in raw["tendons"]:
        tendon.update(tendons or {})
    return build_rig({**raw, **more}, "changed")


def spatial_rig() -> Rig:
    """Return a chain with three axes in space, links that are no rods, and a base that is
    turned.
    """
    raw = load_rig("wrist-instrument").model_dump()
    rng = np.random.default_rng(4)
    for joint, axis in zip(raw["joints"], ("y", (0.6, 0.0, 0.8), "-z")):
        joint["axis"], joint["offset"] = axis, tuple(rng.uniform(-0.03, 0.03, 3))
        joint["link"] = {
            "mass": rng.uniform(0.01, 0.05),
            "centre": tuple(rng.uniform(-0.02, 0.02, 3)),
            "inertia": tuple(rng.uniform(2e-6, 3e-6, 3)),
        }
    raw["base"] = {"gravity": (0.0, 0.0, -9.80665), "orientation": (0.0, 0.0, 0.0)}
    return build_rig(raw, "spatial")


def urdf(rig: Rig) -> str:
    """Return the rig's links as a URDF."""
    parts = ["<robot name='chain'><link name='base'/>"]
    before = "base"
    for joint in rig.joints:
        link = joint.link
        assert link is not None
        ixx, iyy, izz = link.inertia
        parameters = [
            " ".join(map(repr, vector)) for vector in (link.centre, joint.offset, joint.axis)
        ]
        parts.append(
            f"<link name='{joint.name}_link'><inertial><origin xyz='{parameters[0]}' rpy='0 0 0'/>"
            f"<mass value='{link.mass.value!r}'/>"
            f"<inertia ixx='{ixx!r}' iyy='{iyy!r}' izz='{izz!r}' ixy='0' ixz='0' "
            "iyz='0'/></inertial></link>"
            f"<joint name='{joint.name}' type='revolute'><parent link='{before}'/><child "
            f"link='{joint.name}_link'/>"
            f"<origin xyz='{parameters[1]}' rpy='0 0 0'/><axis xyz='{parameters[2]}'/>"
            "<limit lower='-9' upper='9' effort='9' velocity='9'/></joint>"
        )
        before = f"{joint.name}_link"
    return "".join(parts) + "</robot>"


@pytest.mark.parametrize(
    "rig", [load_rig(FINGER), load_rig("wrist-instrument"), spatial_rig()], ids=lambda rig: rig.name
)
def test_inertia_and_bias_are_those_of_another_package(rig: Rig) -> None:
    """M(q), Coriolis and gravity against adam-robotics, to its rounding: its gravity is a
    float32.
    """
    adam = pytest.importorskip(
        "adam.numpy", reason="adam-robotics is not installed: pip install '.[test]'"
    )
    names, rng = [joint.name for joint in rig.joints], np.random.default_rng(0)
    theirs = adam.KinDynComputations(urdf(rig), names, gravity=np.array([0, 0, -9.80665, 0, 0, 0]))
    mechanism, n = Mechanism(rig), len(names)
    q, v = bodies(mechanism)
    assert mechanism.chain is not None
    parts = [mechanism.chain.mass_matrix(q), mechanism.chain.torques(q, v, ca.SX(n, 1))]
    ours = ca.Function("ours", [q, v, mechanism.parameters.symbols], parts)
    for _ in range(20):
        angles, speeds = rng.uniform(-1.5, 1.5, n), rng.normal(size=n) * 5
        rest = np.zeros(mechanism.n_drives)
        found = ours(np.append(angles, rest), np.append(speeds, rest), mechanism.parameters.values)
        matrix, bias = (np.array(part) for part in found)
        expected = np.asarray(theirs.mass_matrix(np.eye(4), angles))[6:, 6:]
        np.testing.assert_allclose(matrix, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
        bias_expected = np.asarray(
            theirs.bias_force(np.eye(4), angles, np.zeros(6), speeds)
        ).ravel()[6:]
        np.testing.assert_allclose(
            np.ravel(bias), bias_expected, rtol=0, atol=1e-12 * np.abs(bias_expected).max()
        )


def test_torques_are_inertia_times_acceleration_and_bias() -> None:
    rng = np.random.default_rng(1)
    for _ in range(10):
        a = ca.DM(rng.normal(size=3) * 100)
        torques, bias, inertia = look(
            spatial_rig(),
            lambda m, q, v: [
                m.chain.torques(q, v, a),  # noqa: B023
                m.chain.torques(q, v, ca.SX(3, 1)),
                ca.mtimes(m.chain.mass_matrix(q), a),  # noqa: B023
            ],
        )(rng.normal(size=6), rng.normal(size=6))
        assert np.abs(torques - bias - inertia).max() < 1e-15


def test_a_turned_base_turns_gravity() -> None:
    """Rolled by 90° about x, the finger's axes stand upright: gravity no longer bends it."""
    flat = load_rig(FINGER)
    turned = flat.with_values({"base.orientation": ["90 deg", "0 deg", "0 deg"]})
    loads = [
        look(rig, lambda m, q, v: [m.chain.torques(q, v, ca.SX.zeros(3))])([])[0]
        for rig in (flat, turned)
    ]
    # flexion turns down, so that gravity flexes: the torque that holds the finger is negative
    weight = 9.80665 * (0.015 * 0.0225 + 0.008 * 0.0575 + 0.005 * 0.08)
    assert loads[0][0] == pytest.approx(-weight, rel=1e-12)
    assert np.abs(loads[1]).max() < 1e-15


@pytest.mark.slow
def test_a_free_chain_moves_as_in_another_simulator() -> None:
    """Three links swing freely for half a second in MuJoCo (RK4) and here: 0.02°, and its error
    falls with h².
    """
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install '.[test]'")
    bare = {"friction": None, "damping": 0.0, "stops": None}
    rig = changed(FINGER, joints=bare, tendons={"slack": 50.0})
    from distal.bridges.mujoco import to_mjcf

    model = mujoco.MjModel.from_xml_string(to_mjcf(rig))
    model.opt.timestep, model.opt.integrator = 5e-5, mujoco.mjtIntegrator.mjINT_RK4
    data = mujoco.MjData(model)
    start, speeds = np.array([0.3, 0.5, 0.2]), np.array([3.0, -6.0, 8.0])
    data.qpos[:3], data.qvel[:3] = start, speeds
    for _ in range(10_000):
        mujoco.mj_step(model, data)
    errors = []
    for count in (5, 10, 20):
        errors.append(np.abs(_swing(rig, start, speeds, count) - data.qpos[:3]).max())
    assert np.rad2deg(errors[-1]) < 0.02
    assert 3.5 < errors[0] / errors[1] < 4.5
    assert 3.5 < errors[1] / errors[2] < 4.5


def _swing(rig: Rig, start: Sequence[float], speeds: Sequence[float], count: int) -> np.ndarray:
    """Return the angles half a second later, with so many sub-steps in 10 ms."""
    mechanism = Mechanism(rig)
    n = mechanism.n_bodies
    step = interval_step(mechanism, count)
    q, v, still = np.zeros(n), np.zeros(n), np.zeros(n)
    q[:3], v[:3] = start, speeds
    for _ in range(50):
        q, v = (
            np.array(x).ravel()
            for x in step(q, v, still, still, np.zeros((n, 3)), 0.01, mechanism.parameters.values)
        )
    return q[:3]


def test_a_stuck_chain_does_not_creep() -> None:
    """Friction that holds its weight: not one joint moves in a second, whatever the step."""
    rig = changed(
        FINGER,
        joints={"friction": {"coefficient": 0.5, "radius": "3 mm", "preload": "20 N"}},
        tendons={"slack": 1.0},
    )
    mechanism = Mechanism(rig)
    n = mechanism.n_bodies
    start, still = np.array([0.3, 0.5, 0.2, 0, 0, 0, 0]), np.zeros(n)
    for count in (1, 7):
        step, q, v = interval_step(mechanism, count), start, still
        for _ in range(100):
            q, v = step(q, v, still, still, np.zeros((n, 3)), 0.01, mechanism.parameters.values)
        assert np.array_equal(np.array(q).ravel()[:3], start[:3])


def pendulum(chain: bool, **more: Any) -> Rig:
    """Return a joint with a link below the horizontal, lumped or as a chain of one."""
    raw = load_rig("pulley-antagonist").model_dump()
    mass, distance, own, armature = 0.05, 0.02, 3e-5, 4e-4
    joint = raw["joints"][0]
    joint.update(stops=(-0.3, 0.25), **more)
    if chain:
        joint.update(
            inertia=armature,
            link={"mass": mass, "centre": (distance, 0.0, 0.0), "inertia": (1e-3, own, 2e-3)},
        )
    else:
        joint.update(inertia=armature + own + mass * distance**2)
        joint.update(gravity={"mass": mass, "distance": distance, "hanging_angle": np.pi / 2})
    return build_rig(raw, "pendulum")


SWING = {
    "rig": "pulley-antagonist",
    "duration": "4 s",
    "drives": {
        "left": {"force": {"mean": "4 N", "amplitude": "3 N", "frequency": "0.7 Hz"}},
        "right": {"force": "4 N"},
    },
    "joints": {"link": {"torque": {"mean": 0.0, "amplitude": "0.03 N m", "frequency": "2 Hz"}}},
}


@pytest.mark.parametrize(
    ("touched", "fewest"),
    [
        (0.05, 1),
        (0.0, 2),
        pytest.param(0.0, 1, marks=pytest.mark.more),
        pytest.param(0.05, 2, marks=pytest.mark.more),
    ],
)
def test_one_joint_as_a_chain_of_one_gives_the_same_numbers(
    touched: float, fewest: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Motion with stops, adaptive with and without an external torque: 1e-10; also moved as a
    chain is moved.
    """
    monkeypatch.setattr(distal.model.mechanism, "SMALLEST_CHAIN", fewest)
    more = {"external_torque": {"std": touched}}
    lumped, chain = pendulum(False, **more), pendulum(True, **more)
    logs = [simulate(rig, build_scenario(SWING), seed=1) for rig in (lumped, chain)]
    assert np.ptp(logs[0].truth["theta"]) > 0.3
    np.testing.assert_allclose(logs[0].truth["theta"], logs[1].truth["theta"], rtol=0, atol=1e-10)
    for name in ("adaptive", "elastic"):
        one, other = (estimate(logs[0], rig, name) for rig in (lumped, chain))
        np.testing.assert_allclose(one.means, other.means, rtol=0, atol=1e-10)
        np.testing.assert_allclose(one.stds[:, 0], other.stds[:, 0], rtol=0, atol=1e-10)


def coupled(ratio: float) -> Rig:
    """Return a finger whose last joint follows the one before it."""
    raw = load_rig(FINGER).model_dump()
    raw["joints"][2].update(
        coupled={"joint": "pip", "ratio": ratio, "offset": 0.1}, stops=None, initial=0.0
    )
    return build_rig(raw, "coupled")


def test_a_coupled_joint_follows_and_loads_the_other() -> None:
    """Two lumped joints, θ₂ = c θ₁: inertia J₁ + c² J₂, damping b₁ + c² b₂, as one joint with
    these.
    """
    raw = load_rig("pulley-antagonist").model_dump()
    raw["joints"][0].update(friction=None)
    alone = {**raw["joints"][0]}
    follower = {
        **alone,
        "name": "tip",
        "coupled": {"joint": "link", "ratio": 0.8},
        "initial": 0.0,
        "inertia": 2e-4,
        "damping": 3e-3,
    }
    both = build_rig({**raw, "joints": [alone, follower]}, "coupled")
    alone.update(
        inertia=alone["inertia"]["value"] + 0.64 * 2e-4,
        damping=alone["damping"]["value"] + 0.64 * 3e-3,
    )
    one = build_rig({**raw, "joints": [alone]}, "one")
    forces = {"rig": "pulley-antagonist", "duration": "3 s", "drives": SWING["drives"]}
    logs = [simulate(rig, build_scenario(forces), seed=0) for rig in (both, one)]
    assert np.ptp(logs[1].truth["theta"]) > 0.2
    # the damping of the pair is taken as that of one joint: the order of the step is the same, its
    # constant is not
    np.testing.assert_allclose(logs[0].truth["theta_link"], logs[1].truth["theta"], atol=2e-5)
    np.testing.assert_allclose(
        logs[0].truth["theta_tip"], 0.8 * logs[0].truth["theta_link"], atol=1e-15
    )


def test_a_coupled_joint_is_estimated_with_the_other() -> None:
    rig = coupled(0.8)
    drives = {
        name: {"servo": {"position": "0 mm", "stiffness": 3000.0}} for name in ("t2", "t3", "t4")
    }
    swing = {"mean": "2 mm", "amplitude": "2 mm", "frequency": "1 Hz"}
    drives["t1"] = {"servo": {"position": swing, "stiffness": 3000.0}}
    log = simulate(
        rig, build_scenario({"rig": FINGER, "duration": "1.5 s", "drives": drives}), seed=2
    )
    for name in ("adaptive", "elastic"):
        result = estimate(log, rig, name)
        np.testing.assert_allclose(result.angles[:, 2], 0.8 * result.angles[:, 1] + 0.1, atol=1e-9)
        np.testing.assert_allclose(
            result.angle_stds[:, 2], 0.8 * result.angle_stds[:, 1], rtol=1e-6
        )
        assert result.joint_names == ("mcp", "pip", "dip")


def polynomial(
    terms: list[dict[str, Any]],
    bounds: list[tuple[float, float]],
    joints: Sequence[str] = ("mcp", "pip"),
) -> dict[str, Any]:
    return {"kind": "polynomial", "joints": list(joints), "terms": terms, "range": bounds}


def lengths(rig: Rig) -> At:
    return look(rig, lambda m, q, v: [m.elongations(q), m.length_jacobian(q)[2, :]])


def with_crossings(crossings: list[dict[str, Any]]) -> Rig:
    raw = load_rig("finger-2n").model_dump()
    raw["tendons"][2]["crossings"] = crossings
    return build_rig(raw, "crossed")


def test_a_polynomial_goes_on_straight_outside_its_range() -> None:
    """Inside Σ c θ₁^a θ₂^b; beyond, the arm at the end of its range (the other angle in the middle
    of its own); no step.
    """
    terms = [{"powers": [1, 0], "coefficient": 8e-3}, {"powers": [2, 1], "coefficient": 1e-3}]
    rig = with_crossings([polynomial(terms, [(-0.5, 1.0), (-0.5, 1.5)])])
    at = lengths(rig)
    inside, slopes = at([0.4, 0.6])
    assert inside[2] == pytest.approx(-(8e-3 * 0.4 + 1e-3 * 0.4**2 * 0.6), rel=1e-12)
    np.testing.assert_allclose(slopes[:2], [-(8e-3 + 2e-3 * 0.4 * 0.6), -1e-3 * 0.4**2], rtol=1e-12)
    (edge, _), (beyond, outside) = at([1.0, 0.6]), at([3.0, 0.6])
    arm = 8e-3 + 2e-3 * 1.0 * 0.5
    np.testing.assert_allclose(outside[:2], [-arm, -1e-3], rtol=1e-12)
    assert beyond[2] - edge[2] == pytest.approx(-2.0 * arm, rel=1e-9)
    assert rig.tendons[2].arms({"mcp": 0.4, "pip": 0.6}) == pytest.approx(
        {"mcp": 8e-3 + 2e-3 * 0.24, "pip": 1.6e-4}
    )


def test_a_tendon_may_end_at_a_pin_after_a_pulley() -> None:
    """ℓ = sqrt(r² (1 − cos θ₂)² + (l + x − r₁ θ₁ − r sin θ₂)²) − l."""
    crossings = [
        {"joint": "mcp", "kind": "pulley", "radius": "7 mm", "side": 1},
        {"joint": "pip", "kind": "pinned", "radius": "6 mm", "free_length": "80 mm", "side": 1},
    ]
    at = lengths(with_crossings(crossings))
    one, two = 0.5, 0.9
    along = 0.08 - 7e-3 * one - 6e-3 * np.sin(two)
    assert at([one, two])[0][2] == pytest.approx(
        np.hypot(6e-3 * (1 - np.cos(two)), along) - 0.08, rel=1e-12
    )


def test_the_frequency_of_a_chain_is_that_of_its_eigenvalues() -> None:
    rig = load_rig(FINGER)
    mechanism = Mechanism(rig)
    q, _ = bodies(mechanism)
    matrix = ca.Function("M", [q, mechanism.parameters.symbols], [mechanism.mass_matrix(q)])
    arms = np.array([[8, 7, 6], [7.5, -6.5, -5.5], [-8, 7, 0], [-7.5, -7, 0]]) * 1e-3
    stiffness = 1e4 * arms.T @ arms
    most = 0.0
    for angles in ((0, 0, 0), (20, 25, 15), (-20, -5, -5), (90, 100, 80)):
        at = np.append(np.deg2rad(angles), np.zeros(4))
        inertia = np.array(matrix(at, mechanism.parameters.values))
        most = max(
            most, float(np.sqrt(np.linalg.eigvals(np.linalg.solve(inertia, stiffness)).real.max()))
        )
    assert joint_frequency(mechanism) == pytest.approx(most, rel=1e-9)


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        ("joints.1.parent", "dip", "no joint before it is called 'dip'"),
        ("joints.1.axis", "w", 'must be "x", "y", "z"'),
        ("joints.1.axis", [0, 0, 0], "must point somewhere"),
        ("joints.1.offset", [1.0, 2.0], "three numbers"),
        ("joints.0.name", "base", "what the first joint sits on"),
        (
            "joints.1.gravity",
            {"mass": 0.1, "distance": 0.1},
            "the link's mass and centre say it already",
        ),
        (
            "joints.2.coupled",
            {"joint": "pop", "ratio": 1.0},
            "no free joint before it is called 'pop'; did you mean 'pip'",
        ),
        ("joints.2.coupled", {"joint": "pip", "ratio": 0.0}, "must not be zero"),
        (
            "joints.2.coupled",
            {"joint": "pip", "ratio": 0.8},
            "stops: is not supported on a coupled joint; give it to 'pip'",
        ),
        ("joints.2.backlash", {"width": "1 deg"}, "is not supported on a chain"),
        ("tendons.0.joint", "mcp", "is the short form of one crossing"),
        ("tendons.0.crossings", [], "is missing (or give 'crossings'"),
        ("tendons.0.crossings.0.joint", "mpc", "no joint is called 'mpc'; did you mean 'mcp'"),
        (
            "tendons.0.crossings",
            [polynomial([{"powers": [1], "coefficient": 1.0}], [(0, 1)] * 2)],
            "one for each of 2 joints",
        ),
        (
            "tendons.0.crossings",
            [polynomial([{"powers": [1, 1], "coefficient": 1.0}], [(0, 1)])],
            "range: one for each of 2 joints is needed, 1 came",
        ),
        (
            "tendons.0.crossings",
            [polynomial([{"powers": [1, 0], "coefficient": 1.0}], [(0, 1)] * 2)],
            "'pip' has no term with a power of it",
        ),
    ],
)
def test_what_a_chain_cannot_be_is_said(path: str, value: object, said: str) -> None:
    with pytest.raises(RigError) as problem:
        load_rig(FINGER).with_values({path: value})
    assert said in str(problem.value)


def test_a_coupled_joint_starts_where_the_other_says() -> None:
    rig, still = coupled(0.8), {"rig": FINGER, "duration": "0.1 s", "initial": {"pip": "30 deg"}}
    truth = simulate(rig, build_scenario(still)).truth
    assert truth["theta_dip"][0] == pytest.approx(0.8 * np.deg2rad(30) + 0.1, rel=1e-12)
    with pytest.raises(
        ScenarioError, match=r"initial\.dip: it follows 'pip'; give the angle of that joint"
    ):
        simulate(rig, build_scenario({**still, "initial": {"dip": "30 deg"}}))


def test_the_arms_of_a_polynomial_are_the_slopes_of_its_length() -> None:
    """Within its range, and beyond it for each joint whose neighbours are in the middle of theirs;
    one joint is enough. A constant term, as published lengths have one, changes nothing.
    """
    powers, sizes = ([1, 0], [2, 1], [0, 3], [0, 0]), (5e-3, 2e-3, 1e-3, 0.05)
    terms: list[dict[str, Any]] = [
        {"powers": power, "coefficient": size} for power, size in zip(powers, sizes)
    ]
    raw = {**polynomial(terms, [(-0.4, 1.0), (-0.2, 1.2)]), "scale": 1.3}
    shape = Polynomial.model_validate(raw)
    parameters = {f"terms.{k}.coefficient": term["coefficient"] for k, term in enumerate(terms)} | {
        "scale": 1.3
    }

    def length(angles: np.ndarray) -> np.ndarray:
        found = shape.elongation(
            lambda name: ca.SX(parameters[name]),
            1,
            [ca.SX(a) for a in angles.tolist()],
            ca.SX(0.01),
        )
        return np.array([float(ca.Function("l", [], [found])()["o0"])])

    assert length(np.zeros(2))[0] == pytest.approx(0.01)
    for angles in ((0.0, 0.0), (0.7, 0.3), (-0.3, 1.1), (1.5, 0.5), (0.3, -0.6), (0.3, 1.9)):
        slopes = -finite_difference(length, np.array(angles))[0]
        at = np.array(angles)
        outside = (at < [-0.4, -0.2]) | (at > [1.0, 1.2])
        arms = np.array(list(shape.arms(dict(zip(("mcp", "pip"), angles))).values()))
        # beyond an end the others' arms are those at the end
        np.testing.assert_allclose(
            arms[outside | ~outside.any()], slopes[outside | ~outside.any()], rtol=1e-6, atol=1e-12
        )
    expected = 1.3 * (5e-3 + 2 * 2e-3 * 0.7 * 0.3), 1.3 * (2e-3 * 0.49 + 3e-3 * 0.09)
    assert tuple(shape.arms({"mcp": 0.7, "pip": 0.3}).values()) == pytest.approx(expected)
    one = polynomial([{"powers": [1], "coefficient": 5e-3}], [(-1.0, 1.0)], ["mcp"])
    assert Polynomial.model_validate(one).arms({}) == {"mcp": 5e-3}
    for empty in ({"joints": []}, {"terms": []}, {"range": []}):
        with pytest.raises(ValueError, match="at least 1 item"):
            Polynomial.model_validate({**one, **empty})
    with pytest.raises(ValueError, match="greater than or equal to 0"):
        Polynomial.model_validate(
            {**one, "terms": [{"powers": [-1], "coefficient": 1e-3}, *one["terms"]]}
        )
    highest = {"powers": [9], "coefficient": 1e-3}
    assert Polynomial.model_validate({**one, "terms": [highest]}).arms({"mcp": 1.0})[
        "mcp"
    ] == pytest.approx(9e-3)
