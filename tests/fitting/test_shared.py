"""What parameters of one make err by together, in a fit."""

from __future__ import annotations

import pytest

from distal import Rig, load_rig
from distal.errors import FitError
from distal.fitting.parameters_and_priors import FittedParameter, Options, assignments, choose

SPOOL = {"name": "spool", "std": 0.1}
PATHS = ("tendons.0.stiffness", "tendons.1.stiffness")


def rig_with(**stiffness: object) -> Rig:
    return load_rig("pulley-antagonist").with_values(
        {f"tendons.{key[1:]}.stiffness": x for key, x in stiffness.items()}
    )


def found(paths: tuple[str, ...], values: tuple[float, ...], error: float) -> FittedParameter:
    return FittedParameter("it", paths, "N/m", 800.0, 80.0, values[0], error, False, values)


def varied(rig: Rig) -> dict[str, tuple[tuple[str, ...], float]]:
    free = choose(rig, rig.sensors_of("angle"), Options(noise=False))
    return {part.name: (part.paths, part.std) for part in free if "stiffness" in part.name}


def test_what_errs_together_is_varied_by_one_factor() -> None:
    rig = rig_with(_0={"value": 800.0, "shared": SPOOL}, _1={"value": 500.0, "shared": SPOOL})
    assert varied(rig) == {"stiffness of all tendons": (PATHS, pytest.approx(80.0))}


def test_what_also_errs_alone_is_varied_alone_with_both_spreads() -> None:
    rig = rig_with(
        _0={"value": 800.0, "std": 60.0, "shared": SPOOL}, _1={"value": 500.0, "shared": SPOOL}
    )
    assert varied(rig) == {
        "stiffness of tendon right": (PATHS[1:], pytest.approx(50.0)),
        "stiffness of tendon left": (PATHS[:1], pytest.approx(100.0)),
    }


@pytest.mark.parametrize(
    ("desired", "name", "paths"),
    [
        ("tendons.left.stiffness", "stiffness of tendon left", PATHS[:1]),
        ("tendons.1.stiffness", "stiffness of tendon right", PATHS[1:]),
        ("tendons.*.stiffness", "stiffness of all tendons", PATHS),
    ],
)
def test_what_is_asked_for_is_named_by_parts(
    desired: str, name: str, paths: tuple[str, ...]
) -> None:
    rig = load_rig("pulley-antagonist")
    for asked, per_log in (((desired,), ()), (("joints.link.friction.coefficient",), (desired,))):
        free = choose(
            rig, rig.sensors_of("angle"), Options(free=asked, per_log=per_log, noise=False)
        )
        assert [part.paths for part in free if part.name == name] == [paths]
    with pytest.raises(
        FitError, match=r"--free 'tendons\.middle\.stiffness': there is no 'middle'"
    ):
        choose(rig, (), Options(free=("tendons.middle.stiffness",), noise=False))
    with pytest.raises(FitError, match="--per-log 'tendons"):
        choose(rig, (), Options(per_log=("tendons.middle.stiffness",), noise=False))
    with pytest.raises(FitError, match=f"is asked for twice, by '{name}' and '{name}'"):
        choose(rig, (), Options(free=(desired,), per_log=(desired,), noise=False))


def test_equal_stds_alone_share_nothing() -> None:
    alike = {"value": 800.0, "std": 80.0}
    assert set(varied(rig_with(_0=alike, _1=alike))) == {
        "stiffness of tendon left",
        "stiffness of tendon right",
    }


def test_a_file_keeps_what_is_shared_where_all_were_varied_as_one() -> None:
    rig = rig_with(_0={"value": 800.0, "shared": SPOOL}, _1={"value": 500.0, "shared": SPOOL})
    after = rig.with_values(assignments([found(PATHS, (720.0, 450.0), 36.0)], rig))
    assert after.sharing() == {"spool": dict.fromkeys(PATHS, pytest.approx(0.05))}
    assert [tendon.stiffness.value for tendon in after.tendons] == [720.0, 450.0]


def test_a_file_says_what_is_left_alone_where_one_of_them_was_varied() -> None:
    rig = rig_with(_0={"value": 800.0, "shared": SPOOL}, _1={"value": 500.0, "shared": SPOOL})
    after = rig.with_values(assignments([found(PATHS[:1], (720.0,), 36.0)], rig))
    assert after.sharing() == {"spool": {PATHS[1]: 0.1}}
    assert after.tendons[0].stiffness.std == pytest.approx(36.0)


def test_a_file_drops_what_is_shared_where_each_was_varied_alone() -> None:
    rig = rig_with(
        _0={"value": 800.0, "std": 60.0, "shared": SPOOL},
        _1={"value": 500.0, "std": 9.0, "shared": SPOOL},
    )
    parts = [found(PATHS[:1], (720.0,), 36.0), found(PATHS[1:], (450.0,), 20.0)]
    after = rig.with_values(assignments(parts, rig))
    assert after.sharing() == {}
    assert [tendon.stiffness.std for tendon in after.tendons] == [36.0, 20.0]
