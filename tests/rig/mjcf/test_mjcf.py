"""A rig from a MuJoCo model turns, weighs and pulls as MuJoCo says."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from distal import Rig, load_rig
from distal.errors import RigError
from distal.model import Mechanism
from distal.rig import (
    Imported,
    build_rig,
    from_mujoco,
    parse_toml,
)
from distal.rig.mjcf_bodies import _as_spring, _fitted, fit_excursion, kept_at
from tests.helpers import finite_difference
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
    assert all(crossing.kind == "pulley" for crossing in rig.tendons[1].crossings)
    assert any("thumb: held" in note for note in imported.notes)
    assert any("turn_thumb" in note for note in imported.notes)


def test_the_file_is_the_rig_and_says_what_is_guessed(imported: Imported) -> None:
    assert build_rig(parse_toml(imported.text, "file", RigError), "file") == imported.rig
    for line in imported.text.splitlines():
        if line.startswith(("stiffness", "pretension", "nominal_force", "mass")):
            assert "# not in the model" in line
    assert "series stiffness" in imported.missing


def test_moment_arms_on_poses_that_the_fit_has_not_seen(rig: Rig) -> None:
    model, random = model_of(FINGER), np.random.default_rng(11)
    data = mujoco.MjData(model)
    joints = [model.joint(name).id for name in ("mcp", "pip")]
    tendons = [model.tendon(tendon.name).id for tendon in rig.tendons]

    def lengths(angles: np.ndarray) -> np.ndarray:
        data.qpos[joints] = angles
        mujoco.mj_forward(model, data)
        return data.ten_length[tendons].copy()

    off, desired = [], []
    for angles in random.uniform(*model.jnt_range[joints].T, (300, 2)):
        known = dict(zip(("mcp", "pip"), angles))
        desired.append(-finite_difference(lengths, angles))
        off.append([[tendon.arms(known)[name] for name in known] for tendon in rig.tendons])
    off = np.subtract(off, desired)
    assert np.sqrt(np.mean(np.square(off))) < 0.01 * np.abs(desired).max()


def test_a_path_that_touches_a_surface_at_some_angles_is_named(imported: Imported) -> None:
    (said,) = (note for note in imported.notes if "extensor" in note)
    assert "touches a surface at some angles only" in said


@pytest.mark.parametrize(
    ("offset", "high", "stop"), [(0.0, 1.2, 1.5), (0.1, 0.9, 1.225)], ids=["plain", "offset"]
)
def test_a_coupling_is_turned_round(offset: float, high: float, stop: float) -> None:
    """pip = 0.1 + 1.25 dip, so dip = 0.8 pip − 0.08, and dip's stop at 0.9 rad is pip's at
    1.225.
    """
    text = FINGER.replace("0 1.25 0 0 0", f"{offset} 1.25 0 0 0")
    pip, dip = from_mujoco(model_of(text.replace("-0.1 1.2", f"-0.1 {high}"))).rig.joints[1:]
    assert dip.coupled is not None
    assert dip.coupled.joint == "pip"
    assert (dip.coupled.ratio, dip.coupled.offset) == pytest.approx((0.8, -0.8 * offset))
    assert pip.stops == pytest.approx((0.0, stop))
    assert dip.stops is None


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
    factors = (spring.cubic.value, spring.quadratic.value, spring.stiffness.value, 0.0)
    dof, found, desired = int(model.joint("pip").dofadr[0]), [], []
    for angle in np.linspace(0.0, 1.6, 9):
        data.joint("pip").qpos = angle
        mujoco.mj_forward(model, data)
        desired.append(float(data.qfrc_spring[dof]))
        found.append(-np.polyval(factors, angle - spring.rest_angle.value))
    np.testing.assert_allclose(found, desired, atol=0.03 * np.abs(desired).max())


def numbers(part: object) -> list[float]:
    """Return all numbers of a part of a rig, in the order of its fields."""
    if isinstance(part, dict):
        part = list(part.values())
    if isinstance(part, list | tuple):
        return [number for member in part for number in numbers(member)]
    return [float(part)] if isinstance(part, float) else []


@pytest.mark.parametrize("name", CHAINS)
def test_a_chain_written_as_a_model_comes_back(name: str) -> None:
    chain = load_rig(name)
    back = from_mujoco(model_of(written_as_mjcf(chain))).rig
    assert back.joint_names == chain.joint_names
    for one, other in zip(back.tendons, chain.tendons):
        assert one.arms() == pytest.approx(other.arms(), rel=1e-6)
    for one, other in zip(back.joints, chain.joints):
        assert one.stops == pytest.approx(other.stops)
        assert one.damping.value == pytest.approx(other.damping.value)
        assert (one.spring is None) == (other.spring is None)
        if one.spring is not None and other.spring is not None:
            stiffness, rest = other.spring.stiffness.value, other.spring.rest_angle.value
            assert one.spring.stiffness.value == pytest.approx(stiffness, rel=1e-5)
            assert one.spring.rest_angle.value == pytest.approx(rest, rel=1e-4)


@pytest.mark.parametrize(
    "turned",
    [
        "0.8 0.2 0.5 0.1",
        "0.66446302 -0.24184476 0.66446302 0.24184476",
        "0.66446302 -0.24184476 -0.66446302 -0.24184476",
        "1 0 0 0",
    ],
    ids=["obliquely", "by 90°", "by −90°", "not at all"],
)
def test_the_base_is_turned_as_in_the_model(turned: str) -> None:
    """R_z(yaw) R_y(pitch) R_x(roll) of the body that carries the first joint, also where pitch is
    ± 90° and roll is free.
    """
    model = model_of(FINGER.replace("0.8 0.2 0.5 0.1", turned))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    found = Rotation.from_euler("xyz", from_mujoco(model).rig.base.orientation).as_matrix()
    np.testing.assert_allclose(found.ravel(), data.body("proximal").xmat, atol=1e-6)


def test_links_weigh_and_turn_as_in_mujoco() -> None:
    """Weight at rest and inertia matrix, with a tilted base; products of inertia are left out, here
    below 1 %.
    """
    model, random = model_of(FINGER), np.random.default_rng(4)
    mechanism = Mechanism(from_mujoco(model, joints=["mcp", "pip"]).rig)
    q, still = ca.SX.sym("q", mechanism.n_bodies), ca.SX.zeros(mechanism.n_joints)
    assert mechanism.chain is not None
    parts = [mechanism.chain.torques(q, 0 * q, still), mechanism.mass_matrix(q)]
    function = ca.Function("parts", [q, mechanism.parameters.symbols], parts)
    data, whole = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    dofs = [int(model.joint(name).dofadr[0]) for name in ("mcp", "pip")]
    for angles in random.uniform(0.0, 1.0, (5, 2)):
        data.qpos[dofs] = angles
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, whole)
        at = np.append(angles, np.zeros(mechanism.n_drives))
        weight, inertia = (part.full() for part in function(at, mechanism.parameters.values))
        np.testing.assert_allclose(weight.ravel(), data.qfrc_bias[dofs], rtol=2e-3, atol=1e-7)
        np.testing.assert_allclose(inertia, whole[np.ix_(dofs, dofs)], rtol=0.01)


PULLS_EXTENSOR = '<position name="pull extensor" tendon="extensor" kp="100"/>'
PULLS_FLEXOR = '<motor name="pull flexor" tendon="flexor" gear="-1"/>'
FLOATS = {'<geom size="0.01"/>': '<geom size="0.01"/><freejoint name="root"/>'}


@pytest.mark.parametrize(
    ("changes", "options", "said"),
    [
        (
            {PULLS_FLEXOR: '<muscle name="brachialis" tendon="flexor"/>'},
            {},
            "actuator 'brachialis' is a muscle",
        ),
        (FLOATS, {}, "the base floats: joint 'root' is free; with --chain"),
        (
            {'<joint name="pip"': '<joint type="slide" name="pip"'},
            {},
            "moves joint 'pip', which is no hinge but slide; distal's joints turn",
        ),
        (
            {PULLS_EXTENSOR: "", PULLS_FLEXOR: ""},
            {},
            "no actuator pulls a tendon: the model has 3, and its 1 actuators are on",
        ),
        ({}, {"chain": "proximl"}, "no body is called 'proximl'; did you mean 'proximal'"),
        ({}, {"joints": ["pipp"]}, "no joint that turns is called 'pipp'; did you mean 'pip'"),
    ],
)
def test_what_a_rig_cannot_have_is_named(
    changes: dict[str, str], options: dict[str, Any], said: str
) -> None:
    text = FINGER
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    with pytest.raises(RigError, match=said):
        from_mujoco(model_of(text), **options)


def test_a_base_that_floats_is_none_of_the_chain_that_is_asked_for() -> None:
    ((old, new),) = FLOATS.items()
    assert len(from_mujoco(model_of(FINGER.replace(old, new)), chain="proximal").rig.joints) == 3


def test_without_actuators_all_tendons_but_springs_have_drives() -> None:
    before, _, after = FINGER.partition("<actuator>")
    found = from_mujoco(model_of(before + after.partition("</actuator>")[2]))
    assert [drive.name for drive in found.rig.drives] == ["extensor", "flexor"]
    assert any("no actuator" in note for note in found.notes)


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
    assert found.tendons[0].arms() == pytest.approx(metres.tendons[0].arms(), rel=1e-4)
    for one, other in zip(found.joints, metres.joints):
        assert numbers(one.model_dump()) == pytest.approx(numbers(other.model_dump()), rel=1e-4)


def test_friction_of_a_tendon_is_that_of_its_drive_in_the_models_unit_of_force() -> None:
    """With lengths in millimetres, kg mm/s² is a thousandth of a newton."""
    model = model_of(FINGER.replace('name="flexor"', 'name="flexor" frictionloss="300"'))
    for length_unit, desired in ((1.0, 300.0), (1e-3, 0.3)):
        drives = from_mujoco(model, length_unit=length_unit).rig.drives
        found = [drive.friction.constant.value for drive in drives]  # type: ignore[union-attr]
        assert found == pytest.approx([0.0, desired])


def test_what_is_no_model_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "finger.xml"
    mesh = '<asset><mesh name="m" file="m.stl"/></asset>'
    for text, said in (
        (f"<mujoco>{mesh}</mujoco>", r"finger\.xml: MuJoCo does not take it: .*m\.stl"),
        ("<mujoco><worldbody></mujoco>", r"finger\.xml: MuJoCo does not take it: XML"),
        ("<mujoco/>", "the model has no tendon"),
    ):
        path.write_text(text)
        with pytest.raises(RigError, match=said):
            from_mujoco(path)
    with pytest.raises(RigError, match=r"none\.xml: MuJoCo does not take it"):
        from_mujoco(tmp_path / "none.xml")
    with pytest.raises(
        RigError, match=r"takes a mujoco\.MjModel or the path of its file, int came"
    ):
        from_mujoco(3)  # type: ignore[arg-type]


@pytest.mark.parametrize("pull", [0.3, -0.3])
def test_a_constant_pull_is_a_weak_spring_far_away(pull: float) -> None:
    """It changes by 1 % over the range."""
    angles = np.linspace(-0.4, 1.1, 50)
    weak, _ = _as_spring(angles, np.full(50, pull))
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
    carries both; one that is held is part of the link before it.
    """
    model = model_of(TREE)
    for kept, parents in (([0, 1, 2, 3, 4, 5], " abcb "), ([0, 3, 4, 5], " aa ")):
        above = [int(model.dof_parentid[model.jnt_dofadr[joint]]) for joint in kept]
        found = [kept_at(model, dof, kept) for dof in above]
        assert ["abcdef "[parent] for parent in found] == [*parents]


def test_what_a_polynomial_leaves_of_moment_arms_is_that_of_the_joint_it_fits_worst() -> None:
    """On the poses that are kept to judge by: RMS of each joint's arm, and what 92 % of the worst
    one's are within.
    """
    one, two = np.random.default_rng(1).uniform(-1.0, 1.0, (2, 400))
    arms = np.column_stack([np.full(400, 0.01), 0.02 + 0.002 * np.sin(40.0 * two)])
    lengths = 0.01 * one + 0.02 * two - 0.002 / 40.0 * np.cos(40.0 * two)
    found = _fitted(np.eye(2, dtype=int), np.column_stack([one, two]), lengths, arms)
    # a wave of a tenth over 200 poses: 0.4 %
    assert found.coefficients == pytest.approx([0.01, 0.02], rel=0.02)
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
    """Cost grows with the square of the terms; of degree 2 in 21 joints there would be 253."""
    (tendon,) = from_mujoco(chain_of(21)).rig.tendons
    assert len(tendon.joints) == 21
    assert {meeting.shape.kind for meeting in tendon.meetings} == {"pulley"}


def test_more_joints_than_a_rig_has_are_refused_before_the_work(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("distal.rig.mjcf_importer.fit_excursion", None)
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
