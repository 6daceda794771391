"""What is allowed in a rig and yet probably a mistake."""

from __future__ import annotations

import pytest

from distal import load_rig, shipped_rigs
from distal.errors import RigError
from distal.rig import doubts


@pytest.mark.parametrize("name", shipped_rigs())
def test_shipped_rigs_raise_no_doubt(name: str) -> None:
    assert not [*doubts(load_rig(name))]


@pytest.mark.parametrize(
    ("assignment", "said"),
    [
        (
            "tendons.right.side=1",
            "all tendons of 'link' have side = 1, and no spring turns it back",
        ),
        (
            "tendons.left.insertion.radius=10",
            "insertion radius of tendon left is 10 m; between 0.0002 and 0.3 is usual",
        ),
        ("drives.left.mass=500", "mass of drive left is 500 kg"),
        ('tendons.left.stiffness="1 N/m"', "stiffness of tendon left is 1 N/m"),
        ('joints.link.inertia="20 kg m^2"', "inertia of joint link is 20 kg m^2"),
    ],
)
def test_doubts(assignment: str, said: str) -> None:
    found = [*doubts(load_rig("template", [assignment]))]
    assert len(found) == 1
    assert found[0].startswith(said)


def test_a_spring_turns_a_joint_back() -> None:
    spring = "joints.link.spring={ stiffness = 0.05, rest_angle = 0 }"
    assert not [*doubts(load_rig("template", ["tendons.right.side=1", spring]))]


def test_a_list_whose_items_are_wrong_is_not_short_of_items() -> None:
    with pytest.raises(RigError, match=r"^(?!.*at least one)"):
        load_rig("template", ['joints.0.inertia="3 degg"'])


def test_a_tension_behind_the_friction_of_a_path_is_asked_about() -> None:
    """A load cell at the motor's end measures the drive's force; friction of a path lies between
    the two.
    """
    rig = load_rig("template")
    cell = {"name": "cell", "measures": "tension", "of": "left", "noise": "0.1 N"}
    known = rig.with_values({"sensors": [*(one.model_dump() for one in rig.sensors), cell]})
    assert not [*doubts(known)]
    path = {"friction": 0.1, "wrap": "90 deg"}
    (said,) = doubts(known.with_values({"tendons.left.path": path}))
    assert "cell measures the tension of tendon left behind the friction of its path" in said


def test_the_first_three_problems_are_said_and_the_others_counted() -> None:
    wrong = {f"drives.*.{name}": "3 degg" for name in ("mass", "damping", "stop_stiffness")}
    with pytest.raises(RigError, match=r"also .*also .*\(and 3 more problems\)$"):
        load_rig("template").with_values(wrong)
