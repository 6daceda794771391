"""What is allowed in a rig and yet probably a mistake."""

from __future__ import annotations

import pytest

from distal import load_rig, shipped_rigs
from distal.rig import doubts


def test_shipped_rigs_raise_no_doubt() -> None:
    assert {name: doubts(load_rig(name)) for name in shipped_rigs()} == {name: [] for name in shipped_rigs()}


@pytest.mark.parametrize(
    ("assignment", "said"),
    [
        ("tendons.right.side=1", "all tendons of 'link' have side = 1, and no spring turns it back"),
        (
            "tendons.left.insertion.radius=10",
            "insertion radius of tendon left is 10 m; between 0.0002 and 0.3 is usual",
        ),
        ("drives.left.mass=500", "mass of drive left is 500 kg"),
        (
            'tendons.left.stiffness={ value = "12 N/mm", std = 0.3 }',
            "stiffness of tendon left: a std of 0.3 is 2e-05 of its value: is its unit there?",
        ),
        ('tendons.left.stiffness="1 N/m"', "stiffness of tendon left is 1 N/m"),
        ('joints.link.inertia="20 kg m^2"', "inertia of joint link is 20 kg m^2"),
    ],
)
def test_doubts(assignment: str, said: str) -> None:
    found = doubts(load_rig("template", [assignment]))
    assert len(found) == 1
    assert found[0].startswith(said)


def test_a_spring_turns_a_joint_back() -> None:
    spring = "joints.link.spring={ stiffness = 0.05, rest_angle = 0 }"
    assert doubts(load_rig("template", ["tendons.right.side=1", spring])) == []


def test_a_list_whose_items_are_wrong_is_not_short_of_items() -> None:
    from distal.errors import RigError

    with pytest.raises(RigError) as caught:
        load_rig("template", ['joints.0.inertia="3 degg"'])
    assert "at least one" not in str(caught.value)
    with pytest.raises(RigError, match="joints: at least one is needed"):
        load_rig("template", ["joints=[]"])
