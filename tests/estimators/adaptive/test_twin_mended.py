"""Where the filter of release 0.1 did not do what docs/reference/adaptive-equations.md says."""

from __future__ import annotations

import pytest

from distal.estimators import AdaptiveFilter
from tests.estimators.adaptive import rigs
from tests.estimators.adaptive.agreement import agree
from tests.estimators.adaptive.rigs import capstan, capstan_log, side_by_side, slider_log, sliders
from tests.estimators.adaptive.test_twin import NONE


@pytest.mark.parametrize("name", ["slope", "curvature", "centre"])
def test_a_parameter_that_may_be_negative_is_not_cut(name: str) -> None:
    """(†): a linkage's shape has a sign."""
    linkage = {"kind": "linkage", "radius": 9.53e-3, name: {"value": -0.05, "std": 0.1}}
    rig = sliders({"tendons.0.insertion": linkage})
    agree(rig, slider_log(rig), NONE)


@pytest.mark.parametrize("name", ["inertia", "damping"])
def test_inertia_and_damping_of_a_joint_are_learned(name: str) -> None:
    """∂ω⁺/∂p in (9): they act through the responses a and b of a kick, and through nothing else."""
    value = {"inertia": 4.2e-4, "damping": 8e-3}[name]
    rig = sliders({f"joints.0.{name}": {"value": value, "std": 0.1 * value}})
    agree(rig, slider_log(rig), NONE)


def test_uncertain_damping_of_a_drive_with_hysteresis() -> None:
    """What a transmission passes on is compared with the tendons' pull alone, in which there is no
    damping of the drive.
    """
    rig = capstan(rigs.HYSTERESIS, {"drives.0.damping": {"value": 2e-3, "std": 1e-3}})
    agree(rig, capstan_log(rig), NONE)


def test_factors_of_two_spools_have_names_of_their_own() -> None:
    rig = side_by_side(
        *(
            sliders(
                {f"tendons.{i}.stiffness": {"value": 806.0, "std": share * 806.0} for i in (0, 1)}
            )
            for share in (0.1, 0.2)
        )
    )
    names = AdaptiveFilter(rig, compiled=False).state_names
    assert len(set(names)) == len(names)
