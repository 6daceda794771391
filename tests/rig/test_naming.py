"""What numbers are called: by names of parts in paths, and in words."""

from __future__ import annotations

import pytest

from distal import load_rig, shipped_rigs
from distal.errors import RigError
from distal.rig import edited_text, in_words, named, number, set_value
from distal.rig.files import parse_toml
from distal.rig.rig import parameters_below


@pytest.mark.parametrize(
    ("path", "by_name", "words"),
    [
        (
            "joints.0.friction.coefficient",
            "joints.mcp.friction.coefficient",
            "friction coefficient of joint mcp",
        ),
        ("tendons.3.stiffness", "tendons.pip_e.stiffness", "stiffness of tendon pip_e"),
        (
            "tendons.2.crossings.1.radius",
            "tendons.pip_f.crossings.pip.radius",
            "radius of tendon pip_f at pip",
        ),
        ("drives.1.stop_stiffness", "drives.mcp_e.stop_stiffness", "stop stiffness of drive mcp_e"),
        ("sensors.x_mcp_f.noise", "sensors.x_mcp_f.noise", "noise of sensor x_mcp_f"),
        (
            "tendons.0.stiffness.factor",
            "tendons.mcp_f.stiffness.factor",
            "stiffness factor of tendon mcp_f",
        ),
        ("tendons.*.stiffness", "tendons.*.stiffness", "stiffness of all tendons"),
        (
            "tendons.*.crossings.*.radius",
            "tendons.*.crossings.*.radius",
            "radius of all tendons at all joints",
        ),
        ("tendons.9.stiffness", "tendons.9.stiffness", "stiffness of tendon 9"),
        ("rope.factor", "rope.factor", "rope.factor"),
    ],
)
def test_paths_and_words(path: str, by_name: str, words: str) -> None:
    rig = load_rig("finger-2n")
    assert named(rig, path) == by_name
    assert in_words(rig, path) == in_words(rig, by_name) == words


def test_numbers_of_several_parts_are_said_together() -> None:
    rig = load_rig("finger-2n")
    one, two, *others = (f"tendons.{i}.stiffness" for i in range(4))
    assert in_words(rig, one, two, *others) == "stiffness of all tendons"
    assert in_words(rig, one, two) == "stiffness of tendons mcp_f, mcp_e"
    both = "stiffness of tendon mcp_f; mass of drive mcp_f"
    assert in_words(rig, one, "drives.0.mass") == both


@pytest.mark.parametrize("name", shipped_rigs())
def test_every_parameter_is_reached_by_its_name_and_has_words_of_its_own(name: str) -> None:
    rig = load_rig(name)
    paths = [
        path
        for kind in ("joints", "drives", "tendons", "sensors")
        for i, part in enumerate(getattr(rig, kind))
        for path, _ in parameters_below(part, f"{kind}.{i}")
    ]
    assert [number(rig, named(rig, path)).path for path in paths] == paths
    assert len({in_words(rig, path) for path in paths}) == len(paths)


def test_a_raw_description_is_named_alike() -> None:
    raw = parse_toml(edited_text("finger-2n"), "finger-2n", RigError)
    assert named(raw, "tendons.2.crossings.1.radius") == "tendons.pip_f.crossings.pip.radius"
    set_value(raw, "tendons.pip_f.crossings.pip.radius", 0.001, RigError)
    assert raw["tendons"][2]["crossings"][1]["radius"]["value"] == 0.001
    with pytest.raises(
        RigError,
        match=r"'tendons.pip_f.crossings' has no 'dip'; did you mean 'pip'\? \(known: mcp, pip\)",
    ):
        set_value(raw, "tendons.pip_f.crossings.dip.radius", 0.001, RigError)


def test_two_crossings_of_one_joint_keep_their_indices() -> None:
    twice = {"tendons": [{"name": "loop", "crossings": [{"joint": "pip"}, {"joint": "pip"}]}]}
    assert named(twice, "tendons.0.crossings.1.radius") == "tendons.loop.crossings.1.radius"
    assert in_words(twice, "tendons.0.crossings.1.radius") == "radius of tendon loop at crossing 2"
