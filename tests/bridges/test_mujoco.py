"""A rig as a MuJoCo model, and its tendons there: by MuJoCo's own numbers, by analytic cases, and
beside two other plants.
"""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from distal import Rig, load_rig, simulate
from distal.cli.app import app
from distal.errors import RigError
from distal.model import Mechanism
from distal.rig import angle_names, build_rig, from_mujoco, shipped_rigs
from distal.simulation import load_scenario

mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install '.[mujoco]'")

from distal.bridges.mujoco import Tendons, to_mjcf  # noqa: E402
from distal.rig.mjcf_bodies import stiffness_at_rest  # noqa: E402
from tests.support.mujoco_fingers import own_finger  # noqa: E402
from tests.support.mujoco_replay import Motion, replayed, rms, stranger  # noqa: E402

RADIUS, STIFFNESS, PRETENSION = 0.01, 2000.0, 3.0


def joint_between(**tendon: object) -> Rig:
    """Return a joint between two tendons of one capstan, with what is given of the first tendon."""
    pulley = {"kind": "pulley", "radius": RADIUS}
    common = {"joint": "j", "drive": "motor", "insertion": pulley, "stiffness": STIFFNESS}
    preload = 2.0
    friction = {"coefficient": 0.1, "radius": 2e-3, "preload": preload}
    return build_rig(
        {
            "name": "between",
            "joints": [{"name": "j", "inertia": 1e-5, "damping": 1e-3, "friction": friction}],
            "drives": [{"name": "motor", "kind": "capstan", "radius": 0.005, "inertia": 1e3}],
            "tendons": [
                {**common, "name": "up", "side": 1, "pretension": PRETENSION, **tendon},
                {**common, "name": "down", "side": -1, "pretension": PRETENSION},
            ],
        },
        "between",
    )


def call(*words: object) -> None:
    app([str(word) for word in words], standalone_mode=False)


def model_of(rig: Rig) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(to_mjcf(rig))
    return model, mujoco.MjData(model)


def pushed(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    torque: float,
    tendons: Tendons | None = None,
    duration: float = 1.0,
) -> float:
    """Return the angle of the first joint after a torque on its body about y."""
    data.xfrc_applied[model.jnt_bodyid[0], 4] = torque
    for _ in range(round(duration / model.opt.timestep)):
        if tendons is not None:
            tendons.apply(data)
        mujoco.mj_step(model, data)
    return float(data.qpos[0])


@pytest.mark.parametrize("name", shipped_rigs())
def test_a_rig_comes_back_from_its_model(name: str) -> None:
    rig = load_rig(name)
    imported = from_mujoco(model_of(rig)[0])
    assert imported.rig == rig.bare()
    assert not imported.missing


def test_a_choice_of_joints_is_read_from_the_model_itself() -> None:
    model, _ = model_of(load_rig("capstan-joint"))
    with pytest.raises(RigError, match="no actuator pulls a tendon"):
        from_mujoco(model, joints=["jaw"])


def test_links_move_as_those_of_the_rig() -> None:
    """The mass matrix and the gravity of distal's own chain, at random angles and orientations."""
    rig = load_rig("finger-2n").with_values({"base": {"orientation": [0.3, -0.7, 1.1]}})
    mechanism = Mechanism(rig)
    q = ca.SX.sym("q", mechanism.n_bodies)
    still = ca.SX.zeros(mechanism.n_joints)
    assert mechanism.chain is not None
    numbers = [mechanism.mass_matrix(q), mechanism.chain.torques(q, q * 0, still)]
    function = ca.Function("numbers", [q, mechanism.parameters.symbols], numbers)
    model, data = model_of(rig)
    data.qpos[:2] = (0.7, -0.4)
    mujoco.mj_forward(model, data)
    matrix = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, matrix)
    ours, gravity = function(data.qpos, mechanism.parameters.values)
    np.testing.assert_allclose(matrix[:2, :2], ours.full(), rtol=1e-5)
    np.testing.assert_allclose(data.qfrc_bias[:2], gravity.full()[:, 0], rtol=1e-5)


def test_stops_are_as_stiff_as_the_rig_says() -> None:
    values = {"joints.j.stops": [-0.5, 0.2], "joints.j.stop_stiffness": 40.0}
    rig = joint_between().with_values(values)
    model, data = model_of(rig)
    np.testing.assert_allclose(model.jnt_range[0], (-0.5, 0.2))
    at_rest = stiffness_at_rest(
        model, model.jnt_solref[0], model.jnt_solimp[0], float(model.dof_invweight0[0])
    )
    # MuJoCo's files have six digits
    assert at_rest == pytest.approx(40.0, rel=1e-4)
    model.dof_frictionloss[:] = 0.0
    # one tendon is slack there, the other pulls back with T_pre + k r θ
    held = 2.0 - PRETENSION * RADIUS + 40 * 0.2
    assert pushed(model, data, 2.0) == pytest.approx(held / (STIFFNESS * RADIUS**2 + 40), rel=1e-4)


@pytest.mark.parametrize("helped", [False, True])
def test_a_torque_turns_a_joint_against_its_tendons(helped: bool) -> None:
    """θ = τ/(2 k r²) while both are taut; while one is slack, θ = (τ/r − T_pre)/(k r)."""
    rig = joint_between().with_values({"joints.j.friction": None})
    model, data = model_of(rig)
    tendons = Tendons(model, rig) if helped else None
    taut = pushed(model, data, 0.05, tendons)
    assert taut == pytest.approx(0.05 / (2 * STIFFNESS * RADIUS**2), rel=1e-4)
    slack = pushed(model, data, 0.1, tendons)
    assert slack == pytest.approx((0.1 / RADIUS - PRETENSION) / (STIFFNESS * RADIUS), rel=1e-4)
    if tendons is not None:
        assert tendons.tensions == pytest.approx({"up": 0.0, "down": 0.1 / RADIUS}, rel=1e-4)


@pytest.mark.parametrize("helped", [False, True])
def test_a_slack_tendon_does_not_push(helped: bool) -> None:
    rig = joint_between(pretension=0.0, slack=1e-3)
    model, data = model_of(rig)
    if helped:
        Tendons(model, rig).apply(data)
    mujoco.mj_forward(model, data)
    down = -PRETENSION * RADIUS
    assert data.qfrc_passive[0] + data.qfrc_applied[0] == pytest.approx(down, rel=1e-5)


@pytest.mark.parametrize("share", [0.95, 1.05])
def test_friction_holds_a_joint_up_to_its_limit(share: float) -> None:
    """The limit μ r (T0 + Σ T) is 4 mN m at the drive's present place, not that of no tension."""
    rig = joint_between()
    model, data = model_of(rig)
    limit = 0.1 * 2e-3 * (2.0 + 2 * PRETENSION)
    turned = pushed(model, data, share * limit, Tendons(model, rig))
    if share < 1:
        # MuJoCo's hardest constraint creeps with (1 − d)/d of the torque in each step
        assert turned < 1.01e-4 * share * limit / 1e-5 * model.opt.timestep
    else:
        # it swings about the place where the tendons take the rest, and sticks
        rest = (share - 1) * limit / (2 * STIFFNESS * RADIUS**2)
        assert rest < turned < 2 * rest


def test_friction_that_depends_on_the_direction() -> None:
    """A sheath's friction at its drive: what is drawn in pulls T e^{μβ}, what is let out
    T e^{−μβ}.
    """
    path = {"friction": 0.5, "wrap": 1.0}
    rig = joint_between(path=path).with_values({"joints.j.friction": None})
    model, data = model_of(rig)
    Tendons(model, rig).apply(data)
    drawn, let_out = (0.005 * PRETENSION * abs(np.expm1(sign * 0.5)) for sign in (1, -1))
    limit, bias = model.dof_frictionloss[1], data.qfrc_applied[1]
    assert (limit - bias, limit + bias) == pytest.approx((drawn, let_out), rel=1e-6)


@pytest.mark.parametrize(
    ("name", "scenario", "most"), [("finger-2n", "finger", 0.02), ("template", "template", 0.005)]
)
def test_joints_go_as_in_our_plant(name: str, scenario: str, most: float) -> None:
    """Both solve the same equations, in other steps; the model alone is fifty times further off."""
    described = load_scenario(scenario)
    log = simulate(load_rig(name), described)
    rig = described.plant_rig(load_rig(name))
    columns = angle_names(rig.joint_names), [f"position_{drive}" for drive in rig.drive_names]
    truth = (np.column_stack([log.truth[column] for column in part]) for part in columns)
    motion = Motion(log.time, *truth)
    alone, helped = (
        rms(replayed(rig, motion, tendons) - motion.angles) for tendons in (False, True)
    )
    assert helped < most
    assert helped < 0.02 * alone


def test_joints_go_as_in_a_plant_of_other_code() -> None:
    """Slack tendons in sheaths with friction."""
    rig, motion = stranger(1, 3.0)
    alone, helped = (
        rms(replayed(rig, motion, tendons) - motion.angles) for tendons in (False, True)
    )
    assert helped < 0.5 * alone


def test_hysteresis_and_creep_are_remembered_until_a_reset() -> None:
    creep = {"share": 0.5, "time": 0.2, "settled": 0.0}
    rig = joint_between(creep=creep).with_values(
        {"drives.motor.hysteresis": {"constant": 2e-3}, "joints.j.friction": None}
    )
    model, data = model_of(rig)
    tendons = Tendons(model, rig)
    tendons.apply(data)
    first = tendons.tensions["up"]
    pushed(model, data, 0.0, tendons)
    # γ/(1 + γ) of the stretch has come, and the joint has given way to it
    assert tendons.tensions["up"] < 0.9 * first
    mujoco.mj_resetData(model, data)
    tendons.reset(data)
    tendons.apply(data)
    assert tendons.tensions["up"] == pytest.approx(first, rel=1e-3)


def test_actuators_and_sensors_are_those_of_the_rig() -> None:
    servo = {"stiffness": 5.0}
    rig = load_rig("capstan-joint").with_values(
        {"drives.motor.servo": servo, "drives.motor.limit": 1.0}
    )
    model, data = model_of(rig)
    data.ctrl[:] = 0.3
    for _ in range(round(1.0 / model.opt.timestep)):
        mujoco.mj_step(model, data)
    mujoco.mj_forward(model, data)
    motor = float(data.sensor("motor_angle").data[0])
    assert motor == data.joint("drive_motor").qpos[0]
    # friction holds it a little before its goal
    assert 0.2 < motor < 0.3
    assert data.sensor("motor_torque").data[0] == pytest.approx(5.0 * (0.3 - motor), rel=0.05)
    assert data.sensor("encoder").data[0] == data.joint("jaw").qpos[0]
    np.testing.assert_allclose(model.actuator_forcerange[0], (-1.0, 1.0))


def test_a_coupled_joint_follows() -> None:
    rig = from_mujoco(mujoco.MjModel.from_xml_string(own_finger(1, True))).rig
    coupled = rig.joints[2].coupled
    assert coupled is not None
    model, data = model_of(rig)
    data.ctrl[0] = 3.0
    pushed(model, data, 0.0, Tendons(model, rig))
    _, leader, follower = data.qpos[:3]
    assert leader > 0.1
    assert follower == pytest.approx(coupled.ratio * leader + coupled.offset, abs=1e-3)


def test_into_a_model_that_is_there(tmp_path: Path) -> None:
    """Its bodies, geoms and coupling stay; its tendons and their motors become those of the rig."""
    path = tmp_path / "finger.xml"
    sensor = '<sensor><actuatorfrc actuator="pull deep"/><jointvel joint="pip"/></sensor></mujoco>'
    path.write_text(own_finger(1, True).replace("</mujoco>", sensor))
    before = mujoco.MjModel.from_xml_path(str(path))
    rig = from_mujoco(before).rig.with_values({"joints.mcp.damping": 3e-3})
    model = mujoco.MjModel.from_xml_string(to_mjcf(rig, path))
    assert (model.ngeom, model.nsite, model.neq) == (before.ngeom, before.nsite, before.neq)
    names = [model.joint(j).name for j in range(model.njnt)]
    assert names == ["mcp", "pip", "dip", "drive_deep", "drive_shallow", "drive_extensor"]
    assert [model.actuator(a).name for a in range(model.nu)] == rig.drive_names
    assert model.nsensor == len(rig.sensors) + 1
    np.testing.assert_allclose(model.body("middle").mass, before.body("middle").mass, rtol=1e-5)
    assert model.joint("mcp").damping[0] == pytest.approx(3e-3)
    assert model.joint("pip").range == pytest.approx(before.joint("pip").range)
    assert from_mujoco(model).rig == rig
    path.write_text(to_mjcf(rig, path))
    assert mujoco.MjModel.from_xml_path(str(path)).njnt == model.njnt


def test_degrees_of_a_model_stay_degrees(tmp_path: Path) -> None:
    path = tmp_path / "model.xml"
    path.write_text(
        '<mujoco><compiler angle="degree"/><worldbody><body><geom size="0.01"/>'
        '<joint name="j" axis="0 1 0" range="-10 10"/></body></worldbody></mujoco>'
    )
    rig = joint_between().with_values({"joints.j.stops": ["-60 deg", "30 deg"]})
    model = mujoco.MjModel.from_xml_string(to_mjcf(rig, path))
    np.testing.assert_allclose(np.rad2deg(model.joint("j").range), (-60, 30), rtol=1e-5)


def test_errors_name_what_is_missing(tmp_path: Path) -> None:
    path = tmp_path / "finger.xml"
    path.write_text(own_finger(1, False))
    with pytest.raises(RigError, match="'j'"):
        to_mjcf(joint_between(), path)
    with pytest.raises(RigError, match=r"none\.xml: MuJoCo does not take it"):
        to_mjcf(joint_between(), tmp_path / "none.xml")
    with pytest.raises(RigError, match=r"A \+ B >= C"):
        to_mjcf(load_rig("finger-2n").with_values({"joints.mcp.link.inertia": [0, 0, 1e-3]}))
    with pytest.raises(KeyError, match="Invalid name 'j'"):
        Tendons(model_of(load_rig("finger-2n"))[0], joint_between())


def test_commands_write_models_and_read_them(tmp_path: Path) -> None:
    """Drawn models differ by the rig's stds; each has its own rig in it."""
    out = tmp_path / "model.xml"
    rig = load_rig("capstan-joint")
    call("rig", "to-mjcf", "capstan-joint", "--out", out, "--draws", "2")
    drawn = [from_mujoco(tmp_path / f"model-{n}.xml").rig for n in (1, 2)]
    pretensions = {each.tendons[0].pretension.value for each in (rig, *drawn)}
    assert len(pretensions) == 3
    assert drawn[0].tendons[0].pretension.std == rig.tendons[0].pretension.std
    assert not out.exists()
    call("rig", "to-mjcf", "capstan-joint", "--out", out, "--set", "joints.jaw.damping=5e-3")
    call("rig", "from-mjcf", out, "--out", tmp_path / "back.toml")
    assert load_rig(tmp_path / "back.toml").joints[0].damping.value == 5e-3
