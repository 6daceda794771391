from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from distal import Rig, load_rig, shipped_rigs
from distal.errors import DistalWarning, RigError
from distal.rig import edited_text, rig_text


def test_shipped_rigs_load() -> None:
    assert set(shipped_rigs()) == {
        "lab-bench",
        "template",
        "paper-2008-printed",
        "paper-2008",
        "paper-2008-soft",
        "paper-2008-observed",
        "pulley-antagonist",
        "capstan-joint",
        "da-vinci-grasper",
        "finger-2n",
        "finger-n-plus-1",
        "finger-underactuated",
        "hand",
        "wrist-instrument",
    }
    for name in shipped_rigs():
        assert isinstance(load_rig(name), Rig)


def test_paper_rig_has_the_values_of_table_1(paper_rig: Rig) -> None:
    joint, drive, tendon = paper_rig.joints[0], paper_rig.drives[0], paper_rig.tendons[0]
    assert joint.friction is not None
    values = [
        joint.inertia.value,
        drive.mass.value,
        tendon.stiffness.value,
        tendon.insertion.radius.value,
        tendon.insertion.free_length.value,
        joint.damping.value,
        joint.friction.radius.value,
        joint.friction.coefficient.value,
        joint.friction.preload.value,
        drive.damping.value,
        drive.friction.load.value,
        drive.stop_damping.value,
        drive.stop_stiffness.value,
    ]
    table = [4.239e-4, 1e-3, 806, 9.53e-3, 0.375, 8e-3, 3.18e-3, 0.5, 4.9, 0.01, 2e-3, 3.0, 1e5]
    assert values == pytest.approx(table, rel=1e-12)
    assert load_rig("paper-2008-soft").tendons[0].stiffness.value == pytest.approx(403)


def test_stds_of_the_paper_rig(paper_rig: Rig) -> None:
    friction = paper_rig.joints[0].friction
    assert friction is not None
    for part, share in (
        (friction.coefficient, 0.2),
        (friction.preload, 0.2),
        (paper_rig.tendons[0].stiffness, 0.1),
    ):
        assert part.total_std == pytest.approx(share * part.value)


def test_the_example_of_the_readme_shape(tmp_path: Path) -> None:
    """Bare numbers are SI, text has units, tables have std: the same rig three ways."""
    text = edited_text("paper-2008-printed")
    one = load_rig("paper-2008-printed")
    file = tmp_path / "rig.toml"
    file.write_text(
        text.replace('"9.53 mm"', "9.53e-3").replace('"375 mm"', "{ value = 0.375 }"),
        encoding="utf-8",
    )
    other = load_rig(file)
    assert one.model_dump()["tendons"][0]["insertion"]["radius"]["value"] == pytest.approx(9.53e-3)
    assert other.tendons[0].insertion == one.tendons[0].insertion.model_copy(
        update={"radius": other.tendons[0].insertion.radius}
    )


def test_dump_and_build_give_the_same_rig() -> None:
    for name in shipped_rigs():
        rig = load_rig(name)
        assert rig.with_values({}) == rig


def test_template_is_a_rig(tmp_path: Path) -> None:
    file = tmp_path / "new.toml"
    file.write_text(rig_text("template")[0], encoding="utf-8")
    assert load_rig(file).name == "My joint"
    # what the template only shows as a comment is right too
    shown = re.sub(
        r"(?m)^# (spring|gravity|stops|external_torque|damping|pretension) =",
        r"\1 =",
        rig_text("template")[0],
    )
    file.write_text(shown, encoding="utf-8")
    rig = load_rig(file)
    assert rig.joints[0].spring is not None
    assert rig.joints[0].gravity is not None


REFUSED = [
    ('drives.0.stops=["5 mm", "-5 mm"]', r"drives\.left\.stops: is the wrong way round"),
    ("drives.0.mass=-1", r"drives\.left\.mass: must be positive, -1 came"),
    ("tendons.0.stiffness=-806", r"tendons\.left\.stiffness: must be positive, -806 came"),
    ("tendons.0.stiffness=0", r"must be positive"),
    ('joints.0.friction.coefficient="0,5"', r"decimal comma"),
    (
        'joints.0.inertia="1 kg"',
        r"joints\.link\.inertia: unit 'kg' has the wrong dimension; a unit like 'kg m\^2'",
    ),
    ("joints.0.frction.coefficient=0.4", r"unknown key 'frction'; did you mean 'friction'\?"),
    (
        "drives.0.mas=1",
        r"unknown key 'mas'; did you mean 'mass'\? \(known: backlash, damping, friction",
    ),
    ('drives.0.kind="motor"', r"drives\.left\.kind: must be 'slider', 'capstan', 'motor' came"),
    (
        'tendons.0.insertion.kind="glued"',
        r"tendons\.left\.insertion\.kind: must be 'pinned', 'pulley'",
    ),
    ("tendons.0.side=2", r"tendons\.left\.side: must be 1 or -1, 2 came"),
    (
        'tendons.0.drive="lft"',
        r"tendons\.left\.drive: no drive is called 'lft'; did you mean 'left'\?",
    ),
    (
        'sensors.0.measures="torque"',
        r"sensors\.x1\.of: no joint is called 'left', it is one of the drives: measures must be 'position' or 'force'; the",
    ),
    ('tendons.0.joint="elbow"', r"no joint is called 'elbow'"),
    ('sensors.0.of="middle"', r"sensors\.x1\.of: no drive is called 'middle'"),
    ('sensors.0.unit="N"', r"sensors\.x1\.unit: unit 'N' has the wrong dimension"),
    ('sensors.0.noise="1 N"', r"sensors\.x1\.noise: unit 'N' has the wrong dimension"),
    (
        'sensors.0.measures="speed"',
        r"must be 'position', 'force', 'tension', 'angle' or 'torque'",
    ),
    (
        'sensors.0.measures="command"',
        r"measures = 'command' needs lag, the time constant of the drive's servo",
    ),
    ("sensors.u1.lag=0.1", r"sensors.*lag: is of a drive that follows a command"),
    ('sensors.1.name="x1"', r"sensors: the name 'x1' stands more than once"),
    ('sensors.1.column="x1"', r"the log column 'x1' stands more than once"),
    ("joints.0.friction.exponent=0.5", r"exponent: must be from 1 to inf, 0.5 came"),
    (
        "joints.0.friction.coefficient={ value = 1, std = 0.1, drift = -1 }",
        r"drift must not be negative, -1 came",
    ),
    ("joints.0.damping={ value = 1, std = 0, drift = 0.1 }", r"drift needs a std"),
    (
        "joints.0.damping.shared={ name = 'a' }",
        r"joints.link.damping.shared.std: is missing",
    ),
    (
        "joints.0.damping.shared={ name = 'a', std = '110 %' }",
        r"shared.std: .* less than or equal to 1, 1.1 came",
    ),
    ("joints.0.damping.shared=3", r"joints.link.damping.shared: must be a table, 3 came"),
    ("joints.0.damping.shared={ name = '', std = 0.1 }", r"joints.link.damping.shared.name"),
    ("joints.0.initial={ value = 0.1, shared = { name = 'a', std = 0.1 } }", r"has no shared"),
    ("tendons.0.damping={ value = 0, shared = { name = 'a', std = 0.1 } }", r"no share of it"),
    (
        "tendons.0.stiffness.shared.std=0.2",
        r"tendons.right.stiffness.shared: .* is the same share .* 0.1 came here and 0.2 at tendons.left",
    ),
    ("joints.0.initial={ value = 1, std = 1, drift = 1 }", r"has no drift"),
    (
        "joints.0.friction.coefficient={ value = 1, sd = 2 }",
        r"unknown key 'sd'; did you mean 'std'\?",
    ),
    ("drives.0.damping={ std = 2 }", r"has no 'value'"),
    ("joints.0.friction.coefficient={ value = 1, std = -2 }", r"std must not be negative"),
    ("tendons=[]", r"tendons: at least one is needed"),
    ("sensors=3", r"sensors: must be a list, 3 came"),
    ("tendons.7.side=1", r"'tendons' has no '7' \(known: left, right\)"),
    ("tendons.upper.side=1", r"'tendons' has no 'upper'"),
    ("drives.0.mass.value.x=1", r"is not a quantity"),
    ("novalue", r"write path=value"),
    ("name=", r"write path=value"),
    ("drives.0.mass=[1", r"is not TOML"),
]


@pytest.mark.parametrize(("assignment", "said"), REFUSED)
def test_wrong_values_are_refused_by_name(assignment: str, said: str) -> None:
    with pytest.raises(RigError, match=said) as caught:
        load_rig("paper-2008-printed", [assignment])
    assert "\n" not in str(caught.value)


def test_a_joint_that_no_tendon_crosses_is_refused_by_name(tmp_path: Path) -> None:
    text = edited_text("paper-2008-printed").replace(
        "[[drives]]", '[[joints]]\nname = "tip"\ninertia = 1e-4\n\n[[drives]]', 1
    )
    file = tmp_path / "chain.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(RigError, match="no tendon crosses 'tip', so nothing tells where it is"):
        load_rig(file)


def test_an_idle_drive_is_refused(tmp_path: Path) -> None:
    text = edited_text("paper-2008-printed").replace('drive = "right"', 'drive = "left"')
    file = tmp_path / "idle.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(RigError, match="'right' pulls no tendon"):
        load_rig(file)


def test_unknown_rigs_and_unreadable_files(tmp_path: Path) -> None:
    with pytest.raises(RigError, match=r"unknown rig 'paper-208'; did you mean 'paper-2008'\?"):
        load_rig("paper-208")
    with pytest.raises(RigError, match="cannot be read"):
        load_rig(tmp_path / "missing.toml")
    (tmp_path / "bad.toml").write_text('name = "a"\nlog = = 3\n', encoding="utf-8")
    with pytest.raises(RigError, match=r"not valid TOML.*line 2"):
        load_rig(tmp_path / "bad.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(RigError, match="UTF-8"):
        load_rig(tmp_path / "binary.toml")
    with pytest.raises(RigError, match="cannot be read"):
        load_rig(tmp_path)


def test_set_keeps_the_std_and_reads_names_and_indices() -> None:
    rig = load_rig(
        "paper-2008-printed",
        [
            "joints.0.friction.coefficient=0.4",
            'drives.left.stops=["-5 mm","15 mm"]',
            "joints.link.external_torque.std=0.1 N m",  # a shell took the quotes
            "tendons.1.stiffness={ value = 700, std = 7 }",
            "drives.1.friction.load={ value = 0.05, std = 0.15 }",
            "sensors.u1.noise=0.1",
        ],
    )
    friction = rig.joints[0].friction
    assert friction is not None
    assert (friction.coefficient.value, friction.coefficient.std) == (0.4, 0.1)
    assert rig.drives[0].stops == pytest.approx((-5e-3, 15e-3))
    assert rig.joints[0].external_torque.std == pytest.approx(0.1)
    assert (rig.tendons[1].stiffness.value, rig.tendons[1].stiffness.std) == (700, 7)
    assert rig.drives[1].friction.load.std == 0.15
    assert rig.sensors[1].noise == 0.1


def test_show_with_set_keeps_comments_and_loads(tmp_path: Path) -> None:
    text = edited_text(
        "paper-2008-printed", ["joints.0.friction.coefficient=0.4", "tendons.left.damping=0.1"]
    )
    assert "# J, an 84 g disk" in text
    file = tmp_path / "edited.toml"
    file.write_text(text, encoding="utf-8")
    expected = load_rig(
        "paper-2008-printed", ["joints.0.friction.coefficient=0.4", "tendons.left.damping=0.1"]
    )
    assert load_rig(file) == expected


def test_reference_load() -> None:
    assert load_rig("paper-2008-printed").reference_load(0) == pytest.approx(8.9)
    assert load_rig("paper-2008-observed").reference_load(0) == pytest.approx(15.2)
    with pytest.raises(RigError, match="needs a 'reference' load"):
        load_rig(
            "paper-2008-printed",
            [
                "joints.0.friction.exponent=1.5",
                "joints.0.friction.preload=0",
                "drives.0.nominal_force=0",
                "drives.1.nominal_force=0",
            ],
        )


@given(
    st.dictionaries(
        st.sampled_from(
            [
                "joints.0.inertia",
                "drives.0.mass",
                "tendons.0.stiffness",
                "drives.1.damping",
                "sensors.0.noise",
            ]
        ),
        st.floats(min_value=1e-9, max_value=1e9),
        min_size=1,
    )
)
def test_any_positive_values_make_a_rig(values: dict[str, float]) -> None:
    rig = load_rig("paper-2008-printed").with_values(values)
    dumped = rig.model_dump()
    for path, value in values.items():
        part: object = dumped
        for key in path.split("."):
            part = part[int(key)] if key.isdigit() else part[key]  # type: ignore[index]
        assert (part["value"] if isinstance(part, dict) else part) == value
    assert rig.with_values({}) == rig


def test_a_number_changed_by_hand_leaves_a_learned_correction_behind() -> None:
    """A map beside a filter is what one set of numbers leaves; a sensor's column is none of them."""
    with pytest.warns(
        DistalWarning,
        match=r"\[map\] was learned with other numbers than tendons\.\*\.stiffness",
    ):
        load_rig("da-vinci-grasper", ['tendons.*.stiffness="12 N/mm"'])
    load_rig("da-vinci-grasper", ['log.time.unit="ms"'])


def test_a_torque_declared_after_the_fit_is_said_to_belong_before_it() -> None:
    with pytest.warns(
        DistalWarning,
        match=r"fit again, or remove it; declare external_torque\.std in the rig file before the fit$",
    ):
        load_rig("da-vinci-grasper", ['joints.jaw.external_torque.std="0.05 N m"'])
    with pytest.warns(DistalWarning, match="or remove it$"):
        load_rig("da-vinci-grasper", ["joints.jaw.inertia=1e-5"])


def test_a_path_with_too_many_keys_is_refused() -> None:
    """A path of thousands of keys would end Python's stack."""
    with pytest.raises(RigError, match="has 2000 parts; no value of a rig has so many"):
        load_rig("paper-2008", [f"{'.'.join(['a'] * 2000)}=1"])
