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
from tests.estimators.adaptive.agreement import Floats, agree, difference, filtered
from tests.estimators.adaptive.rigs import (
    capstan,
    capstan_log,
    slider_log,
    sliders,
    spoiled,
    with_gap,
)

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
# the first is cut at exactly 4 stds
FRICTION = {"drives.0.friction.constant.std": 5e-3, "drives.0.friction.load.std": 0.02}
DAMPED = {"drives.0.damping": {"value": 2e-3, "std": 1e-3}}
BOTH_PATHS = {f"tendons.{i}.path": {"friction": 0.5, "wrap": 2.0 + i} for i in (0, 1)}

UNDECLARED = sliders(rigs.STOPS, rigs.FACTORS)
LOST = ("missing displacement", "led on, briefly", "led on, for long", "followed")


def log_of(rig: Rig, **how: object) -> tuple[Floats, Floats]:
    made = capstan_log if rig.drives[0].kind == "capstan" else slider_log
    return made(rig, **how)


def spoiled_log(rig: Rig, size: float = 2.0) -> tuple[Floats, Floats]:
    """30 % missing, wild values, a lost drive, two gaps."""
    time, samples = log_of(rig)
    return with_gap(time), spoiled(samples, len(rig.sensors_of("position")), size=size)


# ---- (a) the textbook filter, one kind of state at a time, then all
# ----------------------------------------------------

CUT = ("play held below", "play free", "play held above")
STICKS = ("sticks, beyond the limits", "declared, slips")


def linkage(name: str) -> Rig:
    """Of a linkage's shape each number has a sign: it isn't cut at zero, (†)."""
    shape = {"kind": "linkage", "radius": 9.53e-3, name: {"value": -0.05, "std": 0.1}}
    return sliders({"tendons.0.insertion": shape})


def reordered(rig: Rig) -> Rig:
    return rig.model_copy(update={"sensors": rig.sensors[::-1]})


TEXTBOOK = {
    "joints alone": sliders(),
    "sensors in another order": reordered(sliders({"sensors.x1.linearity": 1e-4})),
    "slack tendons": sliders({"tendons.*.pretension": 0.0}),
    "parameters": sliders(rigs.PARAMETERS),
    "insertions": sliders(rigs.LINKAGE),
    **{f"{name} of a linkage": linkage(name) for name in ("slope", "curvature", "centre")},
    # they act through the responses of a kick in (9), and through nothing else
    "inertia": sliders({"joints.0.inertia": {"value": 4.2e-4, "std": 4.2e-5}}),
    "damping": sliders({"joints.0.damping": {"value": 8e-3, "std": 8e-4}}),
    "what parameters share, and err by alone": sliders(rigs.SHARED),
    "known to a factor": sliders(rigs.ROUGH),
    "known to a factor, one drive": capstan(rigs.ROUGH_CAPSTAN),
    "a factor of one tendon": sliders({"tendons.0.stiffness": {"value": 806.0, "std": 201.5}}),
    "linearity": sliders(rigs.LINEARITY),
    "beyond its travel": sliders(rigs.LINEARITY, {"drives.0.stops": [0.0, 2e-3]}),
    "stops of the joint": sliders(
        {"joints.0.stops": [-0.02, 0.02], "joints.0.stop_stiffness": 5.0}
    ),
    "near stops": sliders(rigs.NEAR_STOPS),
    "linearity of a capstan": capstan(
        {"sensors.motor_angle.linearity": 0.01, "drives.0.nominal_force": 0.05}
    ),
    "position": sliders(rigs.STOPS, without=NO_POSITION),
    "place and nominal force": sliders(NOMINAL, without=("x2", *NO_FORCE)),
    "a command": sliders({"sensors.x1.lag": 0.03}),
    "nominal force, declared friction": sliders(rigs.DECLARED, NOMINAL, without=NO_FORCE),
    "nominal force without a std": sliders({"drives.1.nominal_force": 3.0}, without=NO_FORCE),
    "friction": sliders(rigs.DECLARED),
    "friction of a capstan": capstan(FRICTION),
    "path": sliders(rigs.PATH),
    "paths of a capstan": capstan(BOTH_PATHS),
    "transmission error": capstan(rigs.HYSTERESIS, ERROR),
    # what is passed on is compared with the tendons' pull, in which there is no damping
    "transmitted, a damped drive": capstan(rigs.HYSTERESIS, DAMPED),
    "a play within the noise": capstan(rigs.HYSTERESIS, {"sensors.motor_torque.noise": 0.05}),
    "transmitted with a bias": capstan(rigs.HYSTERESIS, TORQUE_BIAS),
    "biases of forces and of a tension": sliders(rigs.BIASES, without=("encoder",)),
    "biases with a reference": sliders(rigs.BIASES, without=EVERY),
    "all of a capstan": capstan(
        rigs.HYSTERESIS, ERROR, TORQUE_BIAS, ANGLE_BIAS, {"drives.0.radius.std": 2e-4}
    ),
    "all of sliders": sliders(
        rigs.TORQUE,
        rigs.PARAMETERS,
        rigs.FACTORS,
        rigs.LINEARITY,
        rigs.BIASES,
        rigs.DECLARED,
        rigs.PATH,
        without=EVERY,
    ),
}

BRANCHES: dict[str, tuple[str, ...]] = {
    "joints alone": ("undeclared, moves", "undeclared, sticks"),
    "slack tendons": ("slack",),
    "parameters": ("in a stop",),
    "beyond its travel": ("at a stop",),
    "stops of the joint": ("deep in a stop",),
    "near stops": ("at a stop",),
    "position": ("friction of a lost drive",),
    "place and nominal force": ("friction of a lost drive",),
    "nominal force, declared friction": ("declared, slips",),
    "friction": (*STICKS, "kept above the lowest"),
    "friction of a capstan": ("declared, slips",),
    "path": (*STICKS, "sticks, within the limits"),
    "paths of a capstan": ("declared, slips",),
    "transmission error": CUT,
    "a play within the noise": ("play free",),
    "transmitted with a bias": (CUT[0], CUT[2]),
}
"""What a log must go through, else its case would not see it."""


@pytest.mark.parametrize("name", TEXTBOOK)
def test_textbook_filter(name: str) -> None:
    rig = TEXTBOOK[name]
    twin = agree(rig, log_of(rig), NONE, *BRANCHES.get(name, ()))
    assert twin.taken["wild force"] == twin.taken["wild displacement"] == 0


def test_the_first_sample_takes_no_time_and_missing_first_values_are_found_later() -> None:
    for rig, needed in (
        (UNDECLARED, ()),
        (TEXTBOOK["transmission error"], ("play without reading",)),
    ):
        time, samples = log_of(rig)
        samples[:3, 0] = samples[:2, 1:3] = np.nan
        agree(rig, (time, samples), NONE, "first missing", *needed)


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
    values = {"joints.0.inertia": inertia, "tendons.*.damping": 1.0}
    rig = sliders(values).with_values({"sensors.*.rate": rate})
    time, samples = slider_log(rig, n=30)
    twin = agree(rig, (time[0] + (time - time[0]) * 100.0 / rate, samples), DEFAULT)
    assert twin.model.substeps == count


@pytest.mark.parametrize("name", ["all of sliders", "transmission error", "position"])
def test_gaps_and_missing_values_without_guards(name: str) -> None:
    rig = TEXTBOOK[name]
    agree(rig, spoiled_log(rig, size=0.3), NONE, "bridge", "crossed", *LOST)


# ---- (b) the guards
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
    none = (
        "bend_share",
        "sticking_time",
        "turning_time",
        "unknown_friction",
        "parameter_walk",
        "learning_time",
        "learning_time_guarded",
        "creep_learning_time",
        "unmodelled",
    )
    nothing = dict.fromkeys(none, 0.0)
    assert replace(paper, wild_displacement=np.inf, wild_force=np.inf, **nothing) == NONE
    assert (
        replace(paper, unknown_friction=0.0, moving_only=True, asks_positions=False)
        == Robustness.fitting()
    )


DECLARED = sliders(rigs.STOPS, rigs.FACTORS, rigs.DECLARED)
PLAY = capstan(rigs.HYSTERESIS, ERROR)
GUARDS = {
    # so little doubt that the reading after a wild one would be wild again, were it not believed
    "a real jump": (
        UNDECLARED,
        {"wild_displacement": 6.0, "real_jump": 1e-3},
        ("a shift that ended", "wild displacement"),
    ),
    "wild force, a considered state": (PLAY, {"wild_force": 4.0}, ("wild force",)),
    "what declares friction": (
        DECLARED,
        {"unknown_friction": 0.7, "declared_friction": 0.4},
        ("undeclared, moves",),
    ),
}
"""With other numbers than all have together; see `WHOLE`."""


@pytest.mark.parametrize("name", GUARDS)
def test_one_guard_with_another_number(name: str) -> None:
    rig, on, needed = GUARDS[name]
    log = spoiled_log(rig, size=2.0 if rig is not PLAY else 0.3)
    agree(rig, log, replace(NONE, **on), *needed)
    # a guard that changes nothing on this log would not be tested by it
    off, guarded = (filtered(rig, log, guards)[1] for guards in (NONE, replace(NONE, **on)))
    if off.means.shape == guarded.means.shape:
        assert difference(off, guarded) > 1e-6


def test_what_is_wild_at_rest() -> None:
    """Only the sensor's noise decides there: 6 √2 σ is 8.5 σ."""
    rig = sliders()
    time, samples = slider_log(rig, rest=30)
    samples[29:, :2] = samples[29, :2]
    for row, size in ((70, 9.5), (100, 8.0)):
        samples[row, 0] += size * rig.sensors_of("position")[0].noise
    guards = replace(NONE, wild_displacement=6.0)
    wild = [
        agree(rig, (time[:n], samples[:n]), guards).taken["wild displacement"] for n in (60, 120)
    ]
    assert wild[1] - wild[0] == 1


def test_a_long_stick_tells_little() -> None:
    rig = sliders(rigs.FACTORS)
    log = slider_log(rig, rest=30)
    agree(rig, log, DEFAULT, "undeclared, sticks for long", "undeclared, moves")
    agree(rig, slider_log(rig, rest=0), DEFAULT, "undeclared, has not moved yet")


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
    "all of sliders": (TEXTBOOK["all of sliders"], ("declared, slips",)),
    "torque on a capstan": (
        capstan(FRICTION, {"joints.0.external_torque.std": 0.05}),
        ("declared, slips",),
    ),
    "hysteresis": (
        PLAY,
        (*CUT, "play without reading"),
    ),
}


@pytest.mark.parametrize("guards", [DEFAULT, Robustness.fitting()], ids=["default", "fitting"])
@pytest.mark.parametrize("name", WHOLE)
def test_all_guards_on_a_spoiled_log(name: str, guards: Robustness) -> None:
    rig, needed = WHOLE[name]
    log = spoiled_log(rig, size=0.3 if rig is PLAY else 2.0)
    # without unknown friction no limit falls below zero; a torque leaves no force wild
    left_out = {"limit kept at zero" if guards.moving_only else ""}
    left_out |= {"wild force"} if name == "torque on a capstan" else set()
    every = {*LOST, "wild displacement", "wild force", "bridge", "crossed", *needed}
    agree(rig, log, guards, *every - left_out)


def _random_rig(rng: np.random.Generator) -> Rig:
    """Return sliders with what decides on states drawn at random: friction, its stds, nominal
    forces, resolutions.
    """
    choices = {
        "drives.{}.friction.constant": ((0.0, 0.05, 0.09), (0.0, 0.01, 0.05)),
        "drives.{}.friction.load": ((0.0, 0.01, 0.03), (0.0, 5e-3, 0.05)),
        "joints.0.friction.coefficient": ((0.3,), (0.14, 0.16)),  # in doubt above a half
        "drives.{}.nominal_force": ((-5.0, 0.0, 0.5, 3.0), (0.0, 0.2, 1.0)),
        "tendons.{}.path.friction": ((0.03,), (0.0, 0.02)),
        "tendons.{}.pretension": ((0.0, 0.5, 5.0), (0.0,)),
    }
    changes: dict[str, object] = {}
    for i in (0, 1):
        for path, (values, stds) in choices.items():
            if rng.random() < 0.4:
                drawn = {"value": rng.choice(values), "std": rng.choice(stds)}
                changes[path.format(i)] = drawn
        if f"tendons.{i}.path.friction" in changes:
            changes[f"tendons.{i}.path.wrap"] = rng.choice([1.0, 3.0])
        changes[f"sensors.x{i + 1}.linearity"] = rng.choice([0.0, 1e-4])
        changes[f"sensors.u{i + 1}.resolution"] = rng.choice([0.0, 0.5])
    ways = [
        ("t1", "encoder"),
        NO_FORCE,
        NO_POSITION,
        ("u1", "u2", "encoder"),
        ("x2", *NO_FORCE),
    ]
    return sliders(changes, without=ways[rng.integers(len(ways))])


@pytest.mark.parametrize("seed", range(8))
def test_which_states_a_rig_has(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for guards in (NONE, DEFAULT):
        rig = _random_rig(rng)
        agree(rig, slider_log(rig, n=20), guards)
