"""A rig from a MuJoCo model turns, weighs and pulls as MuJoCo says."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from distal import Rig, estimate, load_rig, read_log
from distal.errors import RigError
from distal.model import Mechanism
from distal.rig import (
    Imported,
    Joint,
    build_rig,
    from_mujoco,
    parse_toml,
)
from distal.rig.mjcf.bodies import _fitted, _roll_pitch_yaw, carried_by, fit_excursion, parent_of
from distal.rig.mjcf.importer import _as_spring
from tests.rig.mjcf.models import FINGER, written_as_mjcf

mujoco = pytest.importorskip("mujoco")

CHAINS = ("finger-2n", "finger-n-plus-1", "finger-underactuated", "wrist-instrument")


def model_of(text: str) -> object:
    return mujoco.MjModel.from_xml_string(text)


@pytest.fixture(scope="module")
def imported() -> Imported:
    return from_mujoco(model_of(FINGER))


@pytest.fixture(scope="module")
def rig(imported: Imported) -> Rig:
    return imported.rig


def test_joints_that_driven_tendons_turn_are_kept(imported: Imported, rig: Rig) -> None:
    assert [joint.name for joint in rig.joints] == ["mcp", "pip", "dip"]
    assert [tendon.name for tendon in rig.tendons] == ["extensor", "flexor"]
    assert any("thumb: held" in note for note in imported.notes)
    assert any("turn_thumb" in note for note in imported.notes)


def test_the_file_is_the_rig_and_says_what_is_guessed(imported: Imported) -> None:
    assert build_rig(parse_toml(imported.text, "file", RigError), "file") == imported.rig
    for line in imported.text.splitlines():
        if line.startswith(("stiffness", "pretension", "nominal_force", "mass")):
            assert "# not in the model" in line
    assert "series stiffness" in imported.missing


def test_moment_arms_on_poses_that_the_fit_has_not_seen(rig: Rig) -> None:
    model = model_of(FINGER)
    data, random = mujoco.MjData(model), np.random.default_rng(11)
    joints = [model.joint(name).id for name in ("mcp", "pip")]
    off, size = [], []
    for _ in range(300):
        angles = {name: random.uniform(*model.joint(name).range) for name in ("mcp", "pip")}
        for tendon in rig.tendons:
            arms = [tendon.arms(angles)[name] for name in angles]
            step = 1e-6
            for k, j in enumerate(joints):
                ends = []
                for sign in (-1, 1):
                    data.qpos[:] = 0
                    data.qpos[joints] = list(angles.values())
                    data.qpos[j] += sign * step
                    mujoco.mj_forward(model, data)
                    ends.append(float(data.ten_length[model.tendon(tendon.name).id]))
                desired = -(ends[1] - ends[0]) / (2 * step)
                off.append(arms[k] - desired)
                size.append(abs(desired))
    assert np.sqrt(np.mean(np.square(off))) < 0.01 * max(size)


def test_a_fixed_tendon_is_pulleys(rig: Rig) -> None:
    flexor = rig.tendons[1]
    assert flexor.arms() == pytest.approx({"mcp": 8e-3, "pip": 6e-3}, rel=1e-9)
    assert all(crossing.kind == "pulley" for crossing in flexor.crossings)


def test_a_path_that_touches_a_surface_at_some_angles_is_named(imported: Imported) -> None:
    named = [note for note in imported.notes if "extensor" in note]
    assert len(named) == 1
    assert "touches a surface at some angles only" in named[0]


def test_a_coupling_follows_the_joint_before_it(rig: Rig) -> None:
    """The model says pip = 1.25 dip; stops of dip bound pip."""
    pip, dip = rig.joints[1:]
    assert dip.coupled is not None
    assert (dip.coupled.joint, dip.coupled.ratio) == ("pip", pytest.approx(0.8))
    assert pip.stops == pytest.approx((0.0, 1.5))
    assert dip.stops is None


def test_a_coupling_with_an_offset_is_turned_round() -> None:
    """pip = 0.1 + 1.25 dip, so dip = 0.8 pip − 0.08, and dip's stop at 0.9 rad is pip's at
    1.225.
    """
    model = model_of(
        FINGER.replace("0 1.25 0 0 0", "0.1 1.25 0 0 0").replace(
            'range="-0.1 1.2"', 'range="-0.1 0.9"'
        )
    )
    pip, dip = from_mujoco(model).rig.joints[1:]
    assert dip.coupled is not None
    assert (dip.coupled.ratio, dip.coupled.offset) == (pytest.approx(0.8), pytest.approx(-0.08))
    assert pip.stops == pytest.approx((0.0, 1.225))


@pytest.mark.parametrize(
    "length", ["0.02", "0.05", "0.03 0.04"], ids=["pulls", "pushes", "does both"]
)
def test_springs_pull_as_in_the_model(length: str) -> None:
    """Its own one and the band, over the range of the joint; a band that is shorter than its rest
    length pushes.
    """
    model = model_of(FINGER.replace('springlength="0.02"', f'springlength="{length}"'))
    data, spring = mujoco.MjData(model), from_mujoco(model).rig.joints[1].spring
    assert spring is not None
    position, off, size = int(model.joint("pip").qposadr[0]), [], []
    for angle in np.linspace(0.0, 1.6, 9):
        data.qpos[:], data.qvel[:] = 0.0, 0.0
        data.qpos[position] = angle
        mujoco.mj_forward(model, data)
        x = angle - spring.rest_angle.value
        torque = -x * (
            spring.stiffness.value + x * (spring.quadratic.value + x * spring.cubic.value)
        )
        size.append(float(data.qfrc_spring[model.joint("pip").dofadr[0]]))
        off.append(torque - size[-1])
    assert np.abs(off).max() < 0.03 * np.abs(size).max()


@pytest.mark.parametrize("name", CHAINS)
def test_a_chain_written_as_a_model_comes_back(name: str) -> None:
    """Moment arms, and the torque that gravity and the links' motion need, are those of the
    chain.
    """
    chain = load_rig(name)
    back = from_mujoco(model_of(written_as_mjcf(chain))).rig
    assert [joint.name for joint in back.joints] == [joint.name for joint in chain.joints]
    for one, other in zip(back.tendons, chain.tendons):
        for joint, arm in other.arms().items():
            assert one.arms()[joint] == pytest.approx(arm, rel=1e-6)
    for one, other in zip(back.joints, chain.joints):
        assert one.stops == pytest.approx(other.stops)
        assert one.damping.value == pytest.approx(other.damping.value)
        assert (one.spring is None) == (other.spring is None)
        if one.spring is not None and other.spring is not None:
            assert one.spring.stiffness.value == pytest.approx(
                other.spring.stiffness.value, rel=1e-5
            )
            assert one.spring.rest_angle.value == pytest.approx(
                other.spring.rest_angle.value, rel=1e-4
            )


@pytest.mark.parametrize(
    "turned",
    ["0.8 0.2 0.5 0.1", "0.66446302 -0.24184476 0.66446302 0.24184476"],
    ids=["obliquely", "by 90°"],
)
def test_the_base_is_turned_as_in_the_model(turned: str) -> None:
    """Roll, pitch and yaw of the body that carries the first joint, also where pitch is 90° and
    roll is free.
    """
    model = model_of(FINGER.replace("0.8 0.2 0.5 0.1", turned))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    desired = data.xmat[model.body("proximal").id].reshape(3, 3)
    found = turn(*from_mujoco(model).rig.base.orientation)
    np.testing.assert_allclose(found, desired, atol=1e-6)


def turn(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Return R_z(yaw) R_y(pitch) R_x(roll)."""
    (sr, sp, sy), (cr, cp, cy) = np.sin([roll, pitch, yaw]), np.cos([roll, pitch, yaw])
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


def test_links_weigh_and_turn_as_in_mujoco() -> None:
    """Weight at rest and inertia matrix, with a tilted base; products of inertia are left out, here
    below 1 %.
    """
    model = model_of(FINGER)
    mechanism = Mechanism(from_mujoco(model, joints=["mcp", "pip"]).rig)
    q, still = ca.SX.sym("q", mechanism.n_bodies), ca.SX.zeros(mechanism.n_joints)
    assert mechanism.chain is not None
    numbers = [mechanism.chain.torques(q, 0 * q, still), mechanism.mass_matrix(q)]
    function = ca.Function("numbers", [q, mechanism.parameters.symbols], numbers)
    data, random = mujoco.MjData(model), np.random.default_rng(4)
    dofs = [int(model.joint(name).dofadr[0]) for name in ("mcp", "pip")]
    for _ in range(5):
        data.qpos[:] = 0.0
        data.qpos[dofs] = random.uniform(0.0, 1.0, 2)
        mujoco.mj_forward(model, data)
        whole = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, whole)
        at = np.append(data.qpos[dofs], np.zeros(mechanism.n_drives))
        weight, inertia = (np.array(part) for part in function(at, mechanism.parameters.values))
        np.testing.assert_allclose(weight.ravel(), data.qfrc_bias[dofs], rtol=2e-3, atol=1e-7)
        np.testing.assert_allclose(inertia, whole[np.ix_(dofs, dofs)], rtol=0.01)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "stem"),
    [
        ("finger-2n", "finger2N"),
        pytest.param("finger-n-plus-1", "finger_n1", marks=pytest.mark.more),
    ],
)
def test_the_same_estimates_by_an_imported_chain(data: Path, name: str, stem: str) -> None:
    """What a model holds is taken from it, all else from the shipped rig: angles within 0.02° of
    those of that rig.
    """
    chain = load_rig(name)
    back = from_mujoco(model_of(written_as_mjcf(chain))).rig.model_dump()
    raw = chain.model_dump()
    for mine, theirs in zip(raw["joints"], back["joints"]):
        mine |= {
            key: theirs[key]
            for key in ("axis", "offset", "link", "inertia", "damping", "spring", "stops")
        }
    for mine, theirs in zip(raw["tendons"], back["tendons"]):
        for crossing, other in zip(mine["crossings"], theirs["crossings"]):
            crossing["radius"]["value"] = other["radius"]["value"]
    raw["base"] = back["base"]
    log = read_log(
        data / "finger" / f"{stem}_servo.csv", chain, data / "finger" / f"{stem}_servo.truth.csv"
    )
    one, other = estimate(log, chain), estimate(log, build_rig(raw, name))
    assert np.rad2deg(np.abs(one.angles - other.angles).max()) < 0.02


def changed(old: str, new: str) -> object:
    assert old in FINGER
    return model_of(FINGER.replace(old, new))


def test_a_muscle_is_named() -> None:
    model = changed(
        '<motor name="pull flexor" tendon="flexor" gear="-1"/>',
        '<muscle name="brachialis" tendon="flexor"/>',
    )
    with pytest.raises(RigError, match="actuator 'brachialis' is a muscle"):
        from_mujoco(model)


def test_a_base_that_floats_is_named_unless_the_chain_is_asked_for() -> None:
    model = changed('<geom size="0.01"/>', '<geom size="0.01"/><freejoint name="root"/>')
    with pytest.raises(RigError, match="the base floats: joint 'root' is free; with --chain"):
        from_mujoco(model)
    assert len(from_mujoco(model, chain="proximal").rig.joints) == 3


def test_a_joint_that_slides_is_named() -> None:
    model = changed('<joint name="pip"', '<joint type="slide" name="pip"')
    with pytest.raises(RigError, match="moves joint 'pip', which slides; distal's joints turn"):
        from_mujoco(model)


def test_a_model_without_driven_tendons_is_named() -> None:
    with pytest.raises(
        RigError, match="no actuator pulls a tendon: the model has 3, and its 1 actuators are on"
    ):
        from_mujoco(
            changed(
                '<position name="pull extensor" tendon="extensor" kp="100"/>\n    '
                '<motor name="pull flexor" tendon="flexor" gear="-1"/>',
                "",
            )
        )
    with pytest.raises(RigError, match="the model has no tendon"):
        from_mujoco(
            model_of(
                "<mujoco><worldbody><body><joint/><geom size='1'/></body></worldbody></mujoco>"
            )
        )


def test_without_actuators_all_tendons_but_springs_have_drives() -> None:
    start, end = FINGER.index("<actuator>"), FINGER.index("</actuator>") + len("</actuator>")
    found = from_mujoco(model_of(FINGER[:start] + FINGER[end:]))
    assert [drive.name for drive in found.rig.drives] == ["extensor", "flexor"]
    assert any("no actuator" in note for note in found.notes)


def test_a_name_that_is_not_there() -> None:
    with pytest.raises(RigError, match="no body is called 'proximl'; did you mean 'proximal'"):
        from_mujoco(model_of(FINGER), chain="proximl")
    with pytest.raises(RigError, match="no joint that turns is called 'pipp'; did you mean 'pip'"):
        from_mujoco(model_of(FINGER), joints=["pipp"])


def test_millimetres_are_seen_and_taken() -> None:
    """Lengths a thousand times, moments of inertia, damping, stiffness and friction a million times
    as large.
    """
    chain = load_rig("finger-2n")
    metres = from_mujoco(model_of(written_as_mjcf(chain))).rig
    spec = mujoco.MjSpec.from_string(written_as_mjcf(chain))
    for body in spec.bodies[1:]:
        body.pos, body.ipos, body.inertia = 1e3 * body.pos, 1e3 * body.ipos, 1e6 * body.inertia
    for joint in spec.joints:
        joint.armature, joint.frictionloss = 1e6 * joint.armature, 1e6 * joint.frictionloss
        joint.damping = 1e6 * np.asarray(joint.damping)
    text = spec.to_xml()
    for tendon in chain.tendons:
        for arm in tendon.arms().values():
            text = text.replace(f'coef="{-arm:g}"', f'coef="{-1e3 * arm:g}"')
    with pytest.raises(
        RigError, match="has a moment arm of 8 m at 'mcp': if the model is in millimetres"
    ):
        from_mujoco(model_of(text))
    found = from_mujoco(model_of(text), length_unit=1e-3).rig
    for one, other in zip(found.joints, metres.joints):
        assert one.inertia.value == pytest.approx(other.inertia.value, rel=1e-4)
        assert one.damping.value == pytest.approx(other.damping.value, rel=1e-4)
        assert one.offset == pytest.approx(other.offset, rel=1e-5)
        assert rubbing(one) == pytest.approx(rubbing(other), rel=1e-4)
        assert one.link is not None
        assert other.link is not None
        assert one.link.inertia == pytest.approx(other.link.inertia, rel=1e-4)
        assert one.link.centre == pytest.approx(other.link.centre, rel=1e-4)
        assert one.link.mass.value == pytest.approx(other.link.mass.value, rel=1e-4)
    assert found.tendons[0].arms() == pytest.approx(metres.tendons[0].arms(), rel=1e-4)


def test_friction_of_a_tendon_is_that_of_its_drive_in_the_models_unit_of_force() -> None:
    """With lengths in millimetres, kg mm/s² is a thousandth of a newton."""
    model = model_of(
        FINGER.replace('<fixed name="flexor">', '<fixed name="flexor" frictionloss="300">')
    )
    for length_unit, desired in ((1.0, 300.0), (1e-3, 0.3)):
        extensor, flexor = from_mujoco(model, length_unit=length_unit).rig.drives
        assert flexor.friction is not None
        assert extensor.friction is not None
        assert flexor.friction.constant.value == pytest.approx(desired)
        assert extensor.friction.constant.value == 0.0


def rubbing(joint: Joint) -> float:
    """Return the friction of an axle without any tension [N m]."""
    assert joint.friction is not None
    return (
        joint.friction.coefficient.value
        * joint.friction.radius.value
        * joint.friction.preload.value
    )


def test_what_is_no_model_is_one_line(tmp_path: Path) -> None:
    text = FINGER.replace("<worldbody>", '<asset><mesh name="m" file="m.stl"/></asset><worldbody>')
    path = tmp_path / "finger.xml"
    path.write_text(text.replace('<geom size="0.01"/>', '<geom type="mesh" mesh="m"/>'))
    with pytest.raises(RigError, match=r"finger\.xml: MuJoCo does not take it: .*m\.stl"):
        from_mujoco(path)
    path.write_text("<mujoco><worldbody><body></worldbody></mujoco>")
    with pytest.raises(RigError, match=r"finger\.xml: MuJoCo does not take it: XML"):
        from_mujoco(path)
    with pytest.raises(RigError, match="there is no such file"):
        from_mujoco(tmp_path / "none.xml")
    with pytest.raises(
        RigError, match=r"takes a mujoco\.MjModel or the path of its file, int came"
    ):
        from_mujoco(3)  # type: ignore[arg-type]


@pytest.mark.parametrize("pitch", [-90.0, -40.0, 0.0, 75.0, 90.0])
def test_roll_pitch_and_yaw_make_the_turn_again(pitch: float) -> None:
    """Upright, too, where roll and yaw turn about one axis."""
    for roll, yaw in ((0.0, 0.0), (0.4, -1.2), (-2.8, 2.0)):
        matrix = np.round(turn(roll, np.deg2rad(pitch), yaw), 15)  # upright, what is 0 is 0
        np.testing.assert_allclose(turn(*_roll_pitch_yaw(matrix)), matrix, atol=1e-9)


def test_a_torque_over_a_range_is_a_cubic_or_a_weak_spring_far_away() -> None:
    """−(k x + q x² + c x³) about its rest comes back; a constant pull is one that changes by 1 %
    over the range.
    """
    angles = np.linspace(-0.4, 1.1, 50)
    x = angles - 0.25
    found = _as_spring(angles, -(0.02 * x + 0.006 * x**2 + 0.03 * x**3))
    desired = {"stiffness": 0.02, "rest_angle": 0.25, "quadratic": 0.006, "cubic": 0.03}
    assert found == pytest.approx(desired, rel=1e-4)
    straight = _as_spring(angles, -0.02 * x)
    assert (straight["stiffness"], straight["rest_angle"]) == pytest.approx((0.02, 0.25), rel=1e-4)
    for pull in (0.3, -0.3):
        weak = _as_spring(angles, np.full(50, pull))
        torque = -weak["stiffness"] * (angles - weak["rest_angle"])
        assert torque[25] == pytest.approx(pull, rel=1e-3)
        assert np.ptp(torque) == pytest.approx(0.01 * abs(pull), rel=1e-6)


TREE = """<mujoco><worldbody>
  <body name="palm"><geom size="0.01"/>
    <body name="two"><geom size="0.01"/><joint name="a" axis="1 0 0"/><joint name="b" axis="0 1 0"/>
      <body name="first"><geom size="0.01"/><joint name="c"/>
        <body name="rigid"><geom size="0.01"/><body name="tip"><geom size="0.01"/><joint name="d"/></body></body></body>
      <body name="second"><geom size="0.01"/><joint name="e"/></body>
    </body>
    <body name="thumb"><geom size="0.01"/><joint name="f"/></body>
  </body>
</worldbody></mujoco>"""


def test_each_joint_sits_on_the_link_of_the_one_before_it_in_the_tree() -> None:
    """Of two in one body the second sits on the first; fingers beside each other sit on what
    carries both.
    """
    model = model_of(TREE)
    joints = list(range(6))

    def parents(kept: list[int]) -> dict[str, str]:
        carrier = carried_by(model, kept)
        found = {joint: parent_of(model, joint, kept, carrier) for joint in kept}
        return {
            "abcdef"[joint]: "abcdef"[parent] if parent >= 0 else ""
            for joint, parent in found.items()
        }

    assert parents(joints) == {"a": "", "b": "a", "c": "b", "d": "c", "e": "b", "f": ""}
    # one that is held is part of the link before it
    assert parents([0, 3, 4, 5]) == {"a": "", "d": "a", "e": "a", "f": ""}


def test_what_a_polynomial_leaves_of_moment_arms_is_that_of_the_joint_it_fits_worst() -> None:
    """On the poses that are kept to judge by: RMS of each joint's arm, and what 92 % of the worst
    one's are within.
    """
    rng = np.random.default_rng(1)
    angles = rng.uniform(-1.0, 1.0, (400, 2))
    waves = 0.002 * np.sin(40.0 * angles[:, 1])
    arms = np.column_stack([np.full(400, 0.01), 0.02 + waves])
    lengths = 0.01 * angles[:, 0] + 0.02 * angles[:, 1] - 0.002 / 40.0 * np.cos(40.0 * angles[:, 1])
    found = _fitted(np.array([[1, 0], [0, 1]]), angles, lengths, arms)
    assert found.coefficients == pytest.approx(
        [0.01, 0.02], rel=0.02
    )  # a wave of a tenth over 200 poses: 0.4 %
    left = np.abs(arms[1::2] - found.coefficients) / np.abs(arms).max(axis=0)
    np.testing.assert_allclose(found.arm_rms, np.sqrt(np.mean(left**2, axis=0)))
    assert np.mean(left[:, 1] <= found.arm_most * (1 + 1e-9)) >= 0.91
    assert np.mean(left[:, 1] > found.arm_most * (1 - 1e-9)) >= 0.07
    assert found.arm_most > 5 * left[:, 0].max()


def chain_of(count: int) -> object:
    """Return a model of hinges in a row, with one tendon over all of them."""
    bodies, sites = "", '<site site="s0"/>'
    for k in range(count):
        bodies += (
            f'<body pos="{0.02 if k else 0} 0 0">'
            f'<joint name="j{k}" axis="0 1 0" range="-20 20" armature="1e-5"/>'
            '<geom type="capsule" fromto="0 0 0 0.02 0 0" size="0.004"/>'
            f'<site name="s{k + 1}" pos="0.01 0 0.005"/>'
        )
        sites += f'<site site="s{k + 1}"/>'
    return model_of(
        '<mujoco><compiler angle="degree" autolimits="true"/><worldbody>'
        f'<site name="s0" pos="-0.01 0 0.005"/>{bodies}{count * "</body>"}</worldbody>'
        f'<tendon><spatial name="t">{sites}</spatial></tendon>'
        '<actuator><motor tendon="t"/></actuator></mujoco>'
    )


def test_a_tendon_over_many_joints_has_a_polynomial_of_few_terms() -> None:
    """Cost grows with the square of the terms; of degree 3 in 30 joints there would be 5,455."""
    (tendon,) = from_mujoco(chain_of(30)).rig.tendons
    assert len(tendon.joints) == 30
    assert {meeting.shape.kind for meeting in tendon.meetings} == {"pulley"}


def test_more_joints_than_a_rig_has_are_refused_before_the_work(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("distal.rig.mjcf.importer.fit_excursion", None)
    with pytest.raises(RigError, match=r"turn 49 joints, up to 32 are supported; choose some"):
        from_mujoco(chain_of(49))


def test_a_polynomial_has_the_terms_that_it_needs_and_no_other() -> None:
    """Of the 19 terms of degree 3 in three joints, the five that made the lengths."""
    angles = np.random.default_rng(0).uniform(-1.0, 1.0, (900, 3))
    a, b, c = angles.T
    lengths = 0.01 * a + 0.006 * b - 0.008 * c + 0.004 * a * b - 0.003 * c**3
    arms = np.column_stack([0.01 + 0.004 * b, 0.006 + 0.004 * a, -0.008 - 0.009 * c**2])
    found = fit_excursion(angles, lengths, arms)
    assert found.powers.tolist() == [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [0, 0, 3]]
    np.testing.assert_allclose(found.coefficients, [0.01, 0.006, -0.008, 0.004, -0.003], rtol=1e-9)
