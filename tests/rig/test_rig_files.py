from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from distal import Rig, load_rig, shipped_rigs
from distal.errors import DistalWarning, RigError
from distal.rig import edited_text, number


def test_shipped_rigs_load() -> None:
    assert len(shipped_rigs()) >= 14
    for name in shipped_rigs():
        rig = load_rig(name)
        assert isinstance(rig, Rig)
        assert rig.with_values({}) == rig


def test_paper_rig_has_the_values_of_table_1(paper_rig: Rig) -> None:
    joint, drive, tendon = paper_rig.joints[0], paper_rig.drives[0], paper_rig.tendons[0]
    friction = joint.friction
    assert friction is not None
    table = [
        (joint.inertia, 4.239e-4, 0.0),
        (drive.mass, 1e-3, 0.0),
        (tendon.stiffness, 806, 0.1),
        (tendon.insertion.radius, 9.53e-3, 0.0),
        (tendon.insertion.free_length, 0.375, 0.0),
        (joint.damping, 8e-3, 0.0),
        (friction.radius, 3.18e-3, 0.0),
        (friction.coefficient, 0.5, 0.2),
        (friction.preload, 4.9, 0.2),
        (drive.damping, 0.01, 0.0),
        (drive.friction.load, 2e-3, 0.2),
        (drive.stop_damping, 3.0, 0.0),
        (drive.stop_stiffness, 1e5, 0.0),
    ]
    for found, value, share in table:
        assert (found.value, found.total_std) == pytest.approx((value, share * value), rel=1e-12)
    assert load_rig("paper-2008-soft").tendons[0].stiffness.value == pytest.approx(403)


@pytest.fixture
def read(tmp_path: Path) -> Callable[[str], Rig]:
    """Read a rig file."""

    def call(text: str) -> Rig:
        path = tmp_path / "rig.toml"
        path.write_text(text, encoding="utf-8")
        return load_rig(path)

    return call


PAPER = edited_text("paper-2008-printed")


def test_the_example_of_the_readme_shape(read) -> None:
    """Bare numbers are SI, text has units, tables have std: the same rig three ways."""
    text = PAPER.replace('"9.53 mm"', "9.53e-3").replace('"375 mm"', "{ value = 0.375 }")
    assert text != PAPER
    one, other = load_rig("paper-2008-printed"), read(text)
    assert other.tendons[0].insertion.radius.value == pytest.approx(9.53e-3)
    assert other.with_values({"name": one.name}) == one


def test_template_is_a_rig(read) -> None:
    text = edited_text("template")
    assert read(text).name == "My joint"
    # what the template only shows as a comment is right too
    keys = "spring|gravity|stops|external_torque|damping|pretension"
    rig = read(re.sub(rf"(?m)^# ({keys}) =", r"\1 =", text))
    assert rig.joints[0].spring is not None
    assert rig.joints[0].gravity is not None


REFUSED = [
    ('drives.0.stops=["5 mm", "-5 mm"]', r"drives\.left\.stops: is the wrong way round"),
    ("tendons.0.stiffness=-806", r"tendons\.left\.stiffness: must be positive, -806 came"),
    ('joints.0.friction.coefficient="0,5"', r"decimal comma"),
    (
        'joints.0.inertia="1 kg"',
        r"joints\.link\.inertia: unit 'kg' has the wrong dimension; a unit like 'kg m\^2'",
    ),
    ("joints.0.frction.coefficient=0.4", r"unknown key 'frction'; did you mean 'friction'\?"),
    ('drives.0.kind="motor"', r"drives\.left\.kind: must be 'slider', 'capstan', 'motor' came"),
    ("tendons.0.side=2", r"tendons\.left\.side: must be 1 or -1, 2 came"),
    (
        'tendons.0.drive="lft"',
        r"tendons\.left\.drive: no drive is called 'lft'; did you mean 'left'\?",
    ),
    (
        'sensors.0.measures="torque"',
        r"sensors\.x1\.of: no joint is called 'left', it is one of the drives: measures must be 'position' or 'force'; the",
    ),
    ('sensors.0.noise="1 N"', r"sensors\.x1\.noise: unit 'N' has the wrong dimension"),
    (
        'sensors.0.measures="speed"',
        r"must be 'position', 'force', 'tension', 'angle' or 'torque'",
    ),
    (
        'sensors.0.measures="command"',
        r"measures = 'command' needs lag, the time constant of the drive's servo",
    ),
    ("sensors.u1.lag=0.1", r"sensors\.u1\.lag: is of a drive that follows a command"),
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
    ("joints.0.initial={ value = 0.1, shared = { name = 'a', std = 0.1 } }", r"has no shared"),
    ("tendons.0.damping={ value = 0, shared = { name = 'a', std = 0.1 } }", r"no share of it"),
    (
        "tendons.0.stiffness.shared.std=0.2",
        r"tendons.right.stiffness.shared: .* is the same share .* 0.1 came here and 0.2 at tendons.left",
    ),
    ("joints.0.initial={ value = 1, std = 1, drift = 1 }", r"has no drift"),
    ("drives.0.damping={ std = 2 }", r"has no 'value'"),
    ("joints.0.friction.coefficient={ value = 1, std = -2 }", r"std must not be negative"),
    ("tendons=[]", r"tendons: at least one is needed"),
    ("sensors=3", r"sensors: must be a list, 3 came"),
    ("tendons.upper.side=1", r"'tendons' has no 'upper'"),
    ("drives.0.mass.value.x=1", r"is not a quantity"),
    ("novalue", r"write path=value"),
    ("drives.0.mass=[1", r"is not TOML"),
    (f"{'.'.join(['a'] * 2000)}=1", "unknown key 'a'"),
]


@pytest.mark.parametrize(("assignment", "said"), REFUSED)
def test_wrong_values_are_refused_by_name(assignment: str, said: str) -> None:
    with pytest.raises(RigError, match=said) as caught:
        load_rig("paper-2008-printed", [assignment])
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            "[[drives]]",
            '[[joints]]\nname = "tip"\ninertia = 1e-4\n\n[[drives]]',
            "no tendon crosses 'tip', so nothing tells where it is",
        ),
        ('drive = "right"', 'drive = "left"', "'right' pulls no tendon"),
        ("[log]", "log = = 3", r"not valid TOML.*line \d"),
        ("[log]", "\0", r"not valid TOML.*line \d"),
    ],
)
def test_wrong_files_are_refused_by_name(read, old: str, new: str, said: str) -> None:
    assert old in PAPER
    with pytest.raises(RigError, match=said):
        read(PAPER.replace(old, new, 1))


def test_unknown_rigs_and_unreadable_files(tmp_path: Path) -> None:
    with pytest.raises(RigError, match=r"unknown rig 'paper-208'; did you mean 'paper-2008'\?"):
        load_rig("paper-208")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    for name, said in (
        ("missing.toml", "cannot be read"),
        (".", "cannot be read"),
        ("binary.toml", "UTF-8"),
    ):
        with pytest.raises(RigError, match=said):
            load_rig(tmp_path / name)


def test_set_keeps_the_std_and_reads_names_and_indices(read) -> None:
    changes = [
        "joints.0.friction.coefficient=0.4",
        'drives.left.stops=["-5 mm","15 mm"]',
        "joints.link.external_torque.std=0.1 N m",  # a shell took the quotes
        "tendons.1.stiffness={ value = 700, std = 7 }",
        "drives.1.friction.load={ value = 0.05, std = 0.15 }",
        "sensors.u1.noise=0.1",
    ]
    rig, text = load_rig("paper-2008-printed", changes), edited_text("paper-2008-printed", changes)
    assert read(text) == rig
    assert "# J, an 84 g disk" in text
    friction = rig.joints[0].friction
    assert friction is not None
    assert (friction.coefficient.value, friction.coefficient.std) == (0.4, 0.1)
    assert rig.drives[0].stops == pytest.approx((-5e-3, 15e-3))
    assert rig.joints[0].external_torque.std == pytest.approx(0.1)
    assert (rig.tendons[1].stiffness.value, rig.tendons[1].stiffness.std) == (700, 7)
    assert rig.drives[1].friction.load.std == 0.15
    assert rig.sensors[1].noise == 0.1


def test_reference_load(paper_rig: Rig) -> None:
    assert paper_rig.reference_load(0) == pytest.approx(8.9)
    assert load_rig("paper-2008-observed").reference_load(0) == pytest.approx(15.2)
    unloaded = {"joints.0.friction.preload": 0, "drives.*.nominal_force": 0}
    with pytest.raises(RigError, match="needs a 'reference' load"):
        paper_rig.with_values({"joints.0.friction.exponent": 1.5, **unloaded})


NUMBERS = (
    "joints.0.inertia",
    "drives.0.mass",
    "tendons.0.stiffness",
    "drives.1.damping",
    "sensors.0.noise",
)


@given(st.dictionaries(st.sampled_from(NUMBERS), st.floats(1e-9, 1e9), min_size=1))
def test_any_positive_values_make_a_rig(values: dict[str, float]) -> None:
    rig = load_rig("paper-2008-printed").with_values(values)
    assert [number(rig, path).value for path in values] == [*values.values()]
    assert rig.with_values({}) == rig


@pytest.mark.parametrize(
    ("assignment", "said"),
    [
        (
            'tendons.*.stiffness="12 N/mm"',
            r"\[map\] was learned with other numbers than tendons\.\*\.stiffness.*or remove it$",
        ),
        (
            'joints.jaw.external_torque.std="0.05 N m"',
            r"or remove it; declare external_torque\.std in the rig file before the fit$",
        ),
    ],
)
def test_a_number_changed_by_hand_leaves_a_learned_correction_behind(
    assignment: str, said: str
) -> None:
    """A map beside a filter is what one set of numbers leaves; a sensor's column is none of them."""
    with pytest.warns(DistalWarning, match=said):
        load_rig("da-vinci-grasper", [assignment])
    load_rig("da-vinci-grasper", ['log.time.unit="ms"'])
