"""The adaptive filter against its naive twin, sample by sample: it follows
docs/reference/adaptive-equations.md.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from distal import Rig
from distal.estimators import Robustness
from tests.estimators.adaptive import rigs
from tests.estimators.adaptive.agreement import Floats, agree, course_of, filtered
from tests.estimators.adaptive.rigs import (
    capstan,
    capstan_log,
    slider_log,
    sliders,
    spoiled,
    with_gap,
)
from tests.estimators.adaptive.twin import Twin

NONE, DEFAULT = Robustness.none(), Robustness.usual(1)
EVERY = ("nothing",)  # leave out no sensor
NOMINAL = {"drives.1.nominal_force": {"value": 3.0, "std": 1.0}}
NO_FORCE, NO_POSITION = ("u2", "t1", "encoder"), ("x2", "t1", "encoder")
ERROR = {"drives.0.hysteresis.error": 4e-3, "drives.0.hysteresis.error_time": 0.1}
TORQUE_BIAS = {"sensors.motor_torque.bias": {"value": 0.01, "std": 0.01}}
ANGLE_BIAS = {
    "sensors.encoder.bias": {"value": 0.02, "std": 0.01, "drift": 0.02},
    "sensors.encoder.linearity": 0.01,
}
RADIUS = {
    "drives.0.radius": {"value": 5e-3, "std": 2e-4},
    "drives.0.damping": {"value": 2e-3, "std": 1e-3},
}
# the first is cut at exactly 4 stds
FRICTION = {"drives.0.friction.constant.std": 5e-3, "drives.0.friction.load.std": 0.02}
BOTH_PATHS = {f"tendons.{i}.path": {"friction": 0.5, "wrap": 2.0 + i} for i in (0, 1)}


def log_of(rig: Rig, **how: object) -> tuple[Floats, Floats]:
    made = capstan_log if rig.drives[0].kind == "capstan" else slider_log
    return made(rig, **how)


def spoiled_log(rig: Rig, size: float = 2.0) -> tuple[Floats, Floats]:
    """30 % missing, wild values, a lost drive, two gaps."""
    time, samples = log_of(rig)
    return with_gap(time), spoiled(samples, len(rig.sensors_of("position")), size=size)


# ---- (a) the textbook filter, one kind of state at a time, then all
# ----------------------------------------------------

TEXTBOOK = {
    "joints alone": (sliders(), ("undeclared, moves", "undeclared, sticks")),
    "slack tendons": (sliders({"tendons.0.pretension": 0.0, "tendons.1.pretension": 0.0}), ()),
    "external torque": (sliders(rigs.TORQUE), ()),
    "parameters": (sliders(rigs.PARAMETERS), ()),
    "insertions": (sliders(rigs.LINKAGE), ()),
    "factors": (sliders(rigs.FACTORS), ()),
    "what parameters share, and err by alone": (sliders(rigs.SHARED), ()),
    "known to a factor": (sliders(rigs.ROUGH), ()),
    "known to a factor, one drive": (capstan(rigs.ROUGH_CAPSTAN), ()),
    "a factor of one tendon": (
        sliders({"tendons.0.stiffness": {"value": 806.0, "std": 201.5}}),
        (),
    ),
    "linearity": (sliders(rigs.LINEARITY), ()),
    "beyond its travel": (sliders(rigs.LINEARITY, {"drives.0.stops": [0.0, 2e-3]}), ("at a stop",)),
    "stops of the joint": (
        sliders({"joints.0.stops": [-0.02, 0.02], "joints.0.stop_stiffness": 5.0}),
        ("deep in a stop",),
    ),
    "near stops": (sliders(rigs.NEAR_STOPS), ("at a stop",)),
    "linearity of a capstan": (
        capstan({"sensors.motor_angle.linearity": 0.01, "drives.0.nominal_force": 0.05}),
        (),
    ),
    "position": (sliders(rigs.STOPS, without=NO_POSITION), ("friction of a lost drive",)),
    "place and nominal force": (
        sliders(NOMINAL, without=("x2", *NO_FORCE)),
        ("friction of a lost drive",),
    ),
    "a command": (sliders({"sensors.x1.lag": 0.03}), ()),
    "nominal force": (sliders(NOMINAL, without=NO_FORCE), ()),
    "nominal force, declared friction": (
        sliders(rigs.DECLARED, NOMINAL, without=NO_FORCE),
        ("declared, slips",),
    ),
    "nominal force without a std": (sliders({"drives.1.nominal_force": 3.0}, without=NO_FORCE), ()),
    "friction": (
        sliders(rigs.DECLARED),
        ("sticks, beyond the limits", "declared, slips", "kept above the lowest"),
    ),
    "friction of a capstan": (capstan(FRICTION), ("declared, slips",)),
    "radius and damping of a capstan": (capstan(RADIUS), ()),
    "path": (
        sliders(rigs.PATH),
        ("sticks, beyond the limits", "sticks, within the limits", "declared, slips"),
    ),
    "paths of a capstan": (capstan(BOTH_PATHS), ("declared, slips",)),
    "transmitted": (capstan(rigs.HYSTERESIS), ("play held below", "play free", "play held above")),
    "transmission error": (
        capstan(rigs.HYSTERESIS, ERROR),
        ("play held below", "play free", "play held above"),
    ),
    "a play within the noise": (
        capstan(rigs.HYSTERESIS, {"sensors.motor_torque.noise": 0.05}),
        ("play free",),
    ),
    "transmitted with a bias": (
        capstan(rigs.HYSTERESIS, TORQUE_BIAS),
        ("play held below", "play held above"),
    ),
    "biases of forces and of a tension": (sliders(rigs.BIASES, without=("encoder",)), ()),
    "biases with a reference": (sliders(rigs.BIASES, without=EVERY), ()),
    "wandering bias of a reference": (capstan(ANGLE_BIAS), ()),
    "all of a capstan": (
        capstan(rigs.HYSTERESIS, ERROR, TORQUE_BIAS, ANGLE_BIAS, {"drives.0.radius.std": 2e-4}),
        (),
    ),
    "all of sliders": (
        sliders(
            rigs.TORQUE,
            rigs.PARAMETERS,
            rigs.FACTORS,
            rigs.LINEARITY,
            rigs.BIASES,
            rigs.DECLARED,
            rigs.PATH,
            without=EVERY,
        ),
        (),
    ),
}


@pytest.mark.parametrize("name", TEXTBOOK)
def test_textbook_filter(name: str) -> None:
    rig, needed = TEXTBOOK[name]
    twin = agree(rig, log_of(rig), NONE, *needed)
    assert twin.taken["wild force"] == twin.taken["wild displacement"] == 0


def test_what_the_textbook_cases_go_through() -> None:
    """Joints at their stops and tendons that go slack: else the cases above would not see them."""
    rig = TEXTBOOK["parameters"][0]
    _, course = filtered(rig, log_of(rig), NONE)
    assert rig.joints[0].stops is not None
    assert np.any(course.means[:, 0] < rig.joints[0].stops[0])
    rig = TEXTBOOK["slack tendons"][0]
    twin = Twin(rig, NONE)
    course_of(twin, log_of(rig))
    tension = twin.model.compared(twin.m, np.array([-1e-3, 1e-3]), np.zeros(2))["tension"][0]
    assert tension[0] == 0.0
    assert tension[1] > 0.0


def test_the_first_sample_takes_no_time_and_missing_first_values_are_found_later() -> None:
    rig = sliders(rigs.STOPS, rigs.FACTORS)
    time, samples = slider_log(rig)
    samples[:3, 0] = samples[:2, 2] = np.nan
    twin = agree(rig, (time, samples), NONE, "first missing")
    assert twin.model.substeps == 4
    rig = capstan(rigs.HYSTERESIS)
    time, samples = capstan_log(rig)
    samples[:3] = np.nan
    agree(rig, (time, samples), NONE, "first missing", "play without reading")


@pytest.mark.parametrize(
    ("rate", "inertia", "count"),
    [(190.0, 4e-4, 3), (410.0, 4e-4, 1), (100.0, 2.48e-6, 5), (100.0, 1.66e-8, 50)],
)
def test_how_many_substeps_an_interval_has(rate: float, inertia: float, count: int) -> None:
    """By the interval, by the joint's own frequency, and up to 50; a lighter joint rests
    (`test_settling`).

    2.5 ms and 0.6/ω are just not enough, or just enough, so that another limit would give another
      number.
    """
    values = {f"sensors.{name}.rate": rate for name in ("x1", "u1", "x2", "u2")}
    values |= {"joints.0.inertia": inertia, "tendons.0.damping": 1.0, "tendons.1.damping": 1.0}
    rig = sliders(values)
    time, samples = slider_log(rig, n=30)
    twin = agree(rig, (time[0] + (time - time[0]) * 100.0 / rate, samples), DEFAULT)
    assert twin.model.substeps == count


@pytest.mark.parametrize("name", ["all of sliders", "transmission error", "position"])
def test_gaps_and_missing_values_without_guards(name: str) -> None:
    rig, _ = TEXTBOOK[name]
    log = spoiled_log(rig, size=0.3)
    agree(
        rig,
        log,
        NONE,
        "bridge",
        "crossed",
        "missing displacement",
        "followed",
        "led on, briefly",
        "led on, for long",
    )


# ---- (b) the guards, one at a time
# -------------------------------------------------------------------------------------


def test_the_guards_have_the_numbers_of_the_paper() -> None:
    """The twin takes them from `Robustness`, so that they are compared with
    docs/reference/adaptive-equations.md here.
    """
    paper = Robustness(
        wild_displacement=6.0,  # (1)
        real_jump=0.1,  # (2)
        persistence=0.02,
        persistence_alone=0.05,
        bend_share=0.12,  # (6)
        follow_time=0.05,  # (12)
        wild_force=9.0,  # (23)
        sticking_time=0.5,  # δ
        turning_time=0.1,
        unknown_friction=0.7,  # the state "friction"
        unknown_friction_walk=0.6,
        declared_friction=0.1,
        parameter_walk=0.02,
        learning_time=0.3,  # (24)
        learning_time_guarded=0.03,
        creep_learning_time=10.0,
        unmodelled=1.0,
        moving_only=False,
        asks_positions=True,
    )
    assert paper == Robustness()
    nothing = {
        "bend_share": 0.0,
        "sticking_time": 0.0,
        "turning_time": 0.0,
    }
    nothing |= {
        "unknown_friction": 0.0,
        "parameter_walk": 0.0,
        "learning_time": 0.0,
        "learning_time_guarded": 0.0,
        "creep_learning_time": 0.0,
        "unmodelled": 0.0,
    }
    assert replace(paper, wild_displacement=np.inf, wild_force=np.inf, **nothing) == NONE
    assert (
        replace(paper, unknown_friction=0.0, moving_only=True, asks_positions=False)
        == Robustness.fitting()
    )


UNDECLARED = sliders(rigs.STOPS, rigs.FACTORS)
DECLARED = sliders(rigs.STOPS, rigs.FACTORS, rigs.DECLARED)
PLAY = capstan(rigs.HYSTERESIS, ERROR)
LOST = ("missing displacement", "led on, briefly", "led on, for long", "followed")
GUARDS = {
    "wild displacement": (
        UNDECLARED,
        {"wild_displacement": 6.0},
        ("wild displacement", "a shift that ended"),
    ),
    # so little doubt that the reading after a wild one would be wild again, were it not believed
    "a real jump": (
        UNDECLARED,
        {"wild_displacement": 6.0, "real_jump": 1e-3},
        ("a shift that ended",),
    ),
    "a zero that jumps": (
        UNDECLARED,
        {"wild_displacement": 6.0},
        ("a shift that ended",),
    ),
    "bend": (UNDECLARED, {"bend_share": 0.12}, ()),
    "follow time": (UNDECLARED, {"follow_time": 0.02}, LOST),
    "learning, friction declared": (DECLARED, {"learning_time": 0.3}, ()),
    "learning, friction not declared": (UNDECLARED, {"learning_time_guarded": 0.03}, ()),
    "wild force": (UNDECLARED, {"wild_force": 9.0}, ("wild force",)),
    "wild force, a considered state": (PLAY, {"wild_force": 4.0}, ("wild force",)),
    "sticking": (UNDECLARED, {"sticking_time": 0.5}, ("undeclared, sticks", "undeclared, moves")),
    "turning": (UNDECLARED, {"turning_time": 0.1}, ("undeclared, moves",)),
    "sticking, declared": (
        DECLARED,
        {"sticking_time": 0.5},
        ("sticks, within the limits", "declared, slips"),
    ),
    "turning, declared": (DECLARED, {"turning_time": 0.1}, ("declared, slips",)),
    "unknown friction": (UNDECLARED, {"unknown_friction": 0.7}, ("limit kept at zero",)),
    "what declares friction": (
        DECLARED,
        {"unknown_friction": 0.7, "declared_friction": 0.4},
        ("undeclared, moves",),
    ),
    "walk of parameters": (DECLARED, {"parameter_walk": 0.02}, ()),
    "unmodelled": (UNDECLARED, {"unmodelled": 1.0}, ()),
    "moving only": (DECLARED, {"moving_only": True}, ("does not clearly move", "declared, slips")),
    "moving only, sticking": (
        DECLARED,
        {"moving_only": True, "sticking_time": 0.5, "turning_time": 0.1},
        (),
    ),
}


@pytest.mark.parametrize("name", GUARDS)
def test_one_guard_at_a_time(name: str) -> None:
    rig, on, needed = GUARDS[name]
    log = spoiled_log(rig, size=2.0 if rig is not PLAY else 0.3)
    agree(rig, log, replace(NONE, **on), *needed)
    # a guard that changes nothing on this log would not be tested by it
    states = filtered(rig, log, NONE)[1], filtered(rig, log, replace(NONE, **on))[1]
    if states[0].means.shape == states[1].means.shape:
        identified = [np.nan_to_num(course.innovations) for course in states]
        assert (
            np.abs(states[0].means - states[1].means).max() > 1e-9
            or np.abs(identified[0] - identified[1]).max() > 1e-6
        )


def test_what_is_wild_at_rest() -> None:
    """Only the sensor's noise decides there: 6 √2 σ is 8.5 σ."""
    rig = sliders()
    time, samples = slider_log(rig, rest=30)
    samples[29:, :2] = samples[29, :2]
    for row, size in ((70, 9.5), (100, 8.0)):
        samples[row, 0] += size * rig.sensors_of("position")[0].noise
    twin = agree(rig, (time, samples), replace(NONE, wild_displacement=6.0))
    before = Twin(rig, replace(NONE, wild_displacement=6.0))
    before.run(time[:60], samples[:60])
    assert twin.taken["wild displacement"] - before.taken["wild displacement"] == 1


def test_a_long_stick_tells_little() -> None:
    rig = sliders(rigs.FACTORS)
    log = slider_log(rig, rest=30)
    agree(rig, log, DEFAULT, "undeclared, sticks for long", "undeclared, moves")
    agree(rig, slider_log(rig, rest=0), DEFAULT, "undeclared, has not moved yet")


NOT_WILD = "no wild force"
"""Of a rig whose forces are so unsure that none is wild."""

WHOLE = {
    "undeclared": (
        UNDECLARED,
        ("at a stop", "undeclared, moves", "undeclared, sticks", "limit kept at zero"),
    ),
    "declared": (
        DECLARED,
        ("at a stop", "sticks, within the limits", "sticks, beyond the limits", "declared, slips"),
    ),
    "position": (
        sliders(rigs.STOPS, rigs.FACTORS, without=NO_POSITION),
        ("friction of a lost drive",),
    ),
    "nominal force": (sliders(rigs.FACTORS, NOMINAL, without=NO_FORCE), ("undeclared, moves",)),
    "all of sliders": (TEXTBOOK["all of sliders"][0], ("declared, slips",)),
    "torque on a capstan": (
        capstan(FRICTION, {"joints.0.external_torque.std": 0.05}),
        ("declared, slips", NOT_WILD),
    ),
    "hysteresis": (
        PLAY,
        ("play held below", "play free", "play held above", "play without reading"),
    ),
}


@pytest.mark.parametrize("guards", [DEFAULT, Robustness.fitting()], ids=["default", "fitting"])
@pytest.mark.parametrize("name", WHOLE)
def test_all_guards_on_a_spoiled_log(name: str, guards: Robustness) -> None:
    rig, needed = WHOLE[name]
    log = spoiled_log(rig, size=0.3 if rig is PLAY else 2.0)
    if guards.moving_only:
        needed = tuple(branch for branch in needed if branch != "limit kept at zero")
    wild = () if NOT_WILD in needed else ("wild force",)
    needed = tuple(branch for branch in needed if branch != NOT_WILD)
    agree(rig, log, guards, *LOST, "wild displacement", *wild, "bridge", "crossed", *needed)


def _random_rig(rng: np.random.Generator) -> Rig:
    """Return sliders with what decides on states drawn at random: friction, its stds, nominal
    forces, resolutions.
    """
    changes: dict[str, object] = {}
    for i in (0, 1):
        drive, tendon = f"drives.{i}", f"tendons.{i}"
        drawn = {
            f"{drive}.friction.constant": {
                "value": rng.choice([0.0, 0.05, 0.09]),
                "std": rng.choice([0.0, 0.01, 0.05]),
            },
            f"{drive}.friction.load": {
                "value": rng.choice([0.0, 0.01, 0.03]),
                "std": rng.choice([0.0, 5e-3, 0.05]),
            },
            f"{drive}.nominal_force": {
                "value": rng.choice([-5.0, 0.0, 0.5, 3.0]),
                "std": rng.choice([0.0, 0.2, 1.0]),
            },
            f"{tendon}.path": {
                "friction": {"value": 0.03, "std": rng.choice([0.0, 0.02])},
                "wrap": rng.choice([1.0, 3.0]),
            },
            f"{tendon}.pretension": rng.choice([0.0, 0.5, 5.0]),
            f"sensors.x{i + 1}.linearity": 1e-4,
        }
        changes |= {path: value for path, value in drawn.items() if rng.random() < 0.4}
        changes[f"sensors.u{i + 1}.resolution"] = rng.choice([0.0, 0.5])
    ways = [
        ("t1", "encoder"),
        NO_FORCE,
        NO_POSITION,
        ("u1", "u2", "encoder"),
        ("x2", "u2", "t1", "encoder"),
    ]
    return sliders(changes, without=ways[rng.integers(len(ways))])


@pytest.mark.parametrize("seed", range(8))
def test_which_states_a_rig_has(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for guards in (NONE, DEFAULT):
        rig = _random_rig(rng)
        agree(rig, slider_log(rig, n=20), guards)
