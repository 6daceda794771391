"""The rig's equations along known motion: against a textbook twin in NumPy, and numbers of plants
that share no code.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from distal import Log, Rig, load_rig
from distal.fitting import Options
from distal.fitting.candidates import parameters_without, terms_of, tried_parts, with_parts
from distal.fitting.inverse_dynamics import (
    INTERVAL,
    TURNING_SHARE,
    InverseProblem,
    inverse_problem,
)
from distal.fitting.parameter_search import (
    ParameterEstimates,
    by_equations,
    most_likely,
    problem_of,
)
from distal.rig import build_rig
from tests.diagnosis.test_known_motion import TIME, angles_at, log_of
from tests.helpers import finite_difference
from tests.support.foreign_plants import finger_log, finger_rig
from tests.support.hands_plants import ropes_log, ropes_rig

STIFFNESS, ARM, RADIUS, PRETENSION = 9000.0, 8e-3, 6e-3, 5.0
SPRING, REST, LINK, LOAD, CONSTANT = 0.3, -0.2, 4e-4, 0.1, 0.004
RATE = 100.0


def rig(**changed: object) -> Rig:
    raw = {
        "name": "one cable against a spring",
        "joints": [
            {
                "name": "j",
                "inertia": 1e-5,
                "damping": 0.0,
                "initial": {"value": 0.0, "std": 0.1},
                "friction": {
                    "coefficient": {"value": LINK, "std": 2e-4},
                    "radius": 1.0,
                    "preload": 1.0,
                },
                "spring": {"stiffness": {"value": SPRING, "std": 0.05}, "rest_angle": REST},
            }
        ],
        "drives": [
            {
                "name": "m",
                "kind": "capstan",
                "inertia": 1e-4,
                "radius": RADIUS,
                "friction": {
                    "constant": {"value": CONSTANT, "std": 0.002},
                    "load": {"value": LOAD, "std": 0.05},
                },
            }
        ],
        "tendons": [
            {
                "name": "t",
                "joint": "j",
                "drive": "m",
                "side": 1,
                "insertion": {"kind": "pulley", "radius": {"value": ARM, "std": 4e-4}},
                "stiffness": {"value": STIFFNESS, "std": 900.0},
                "pretension": PRETENSION,
            }
        ],
        "sensors": [
            {"name": "x", "measures": "position", "of": "m", "rate": RATE, "noise": 1e-4},
            {"name": "u", "measures": "force", "of": "m", "rate": RATE, "noise": 1e-3},
            {"name": "enc", "measures": "angle", "of": "j", "rate": RATE, "noise": 1e-3},
        ],
    }
    return build_rig(raw, "rig").with_values(changed) if changed else build_rig(raw, "rig")


def made(seconds: float = 20.0, seed: int = 0, stiffness: float = STIFFNESS) -> Log:
    """Return a log of the quasi-static joint: torques in balance but for friction, which rests
    inside its limits.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds * RATE)) / RATE
    drive = 1.0 + 0.5 * np.sin(0.9 * time + seed) + 0.25 * np.sin(2.3 * time)
    theta, force = np.empty(len(time)), np.empty(len(time))
    at, way = 0.0, 0.0
    for k, s in enumerate(drive):
        soft = stiffness * ARM**2 + SPRING
        middle = (ARM * (PRETENSION + stiffness * RADIUS * s) + SPRING * REST) / soft

        def limit(angle: float, s: float = s) -> float:
            return LINK * (1.0 + PRETENSION + stiffness * (RADIUS * s - ARM * angle))

        low, high = middle - limit(middle) / soft, middle + limit(middle) / soft
        at = min(max(at, low), high)
        way = np.clip(way + (s - drive[k - 1] if k else 0.0) / 2e-3, -1.0, 1.0)
        tension = PRETENSION + stiffness * (RADIUS * s - ARM * at)
        theta[k], force[k] = at, RADIUS * tension + way * (CONSTANT + LOAD * RADIUS * tension)
    channels = {
        "x": drive + 1e-5 * rng.normal(size=len(time)),
        "u": force + 1e-3 * rng.normal(size=len(time)),
    }
    return Log(time, channels, {"theta": theta + 1e-3 * rng.normal(size=len(time))}, f"seed {seed}")


def equations(log: Log, described: Rig) -> InverseProblem:
    found = inverse_problem(problem_of([log], described, Options()))
    assert found is not None
    return found


def test_rows_are_those_of_a_textbook_twin() -> None:
    """Force less pull and friction, and the joint's balance, each over its effective standard
    deviation.
    """
    inertia, damping = 0.01, 0.02
    problem = equations(made(), rig(**{"joints.j.inertia": inertia, "joints.j.damping": damping}))
    known = problem.motions[0]
    found = problem.at(np.zeros(problem.size))[0]
    assert problem.measured == ("u", "j")
    turned, q, v, a, unsure = (known.rows[:, 1 + 2 * k : 3 + 2 * k] for k in range(5))
    read = known.rows[:, 11]
    # a cubic over 13 samples leaves 3 (3 m² + 3 m − 1) / ((2 m + 3) (2 m + 1) (2 m − 1)) of white
    # noise, m = 6
    left = 3.0 * (3 * 36 + 3 * 6 - 1) / (15.0 * 13.0 * 11.0)
    np.testing.assert_allclose(
        unsure[0], [left * problem.filter.references[0].noise ** 2, left * 1e-8], rtol=1e-6
    )

    def rows(theta: float, s: float, k: int, way: np.ndarray) -> np.ndarray:
        tension = max(PRETENSION + STIFFNESS * (RADIUS * s - ARM * theta), 0.0)
        force = read[k] - RADIUS * tension - way[1] * (CONSTANT + LOAD * RADIUS * tension)
        balance = (
            inertia * a[k, 0]
            + damping * v[k, 0]
            - tension * ARM
            + SPRING * (theta - REST)
            + way[0] * LINK * (1.0 + tension)
        )
        return np.array([force, -balance])

    direction, expected = np.zeros(2), np.empty((len(q), 2))
    for k in range(len(q)):
        direction = np.clip(direction + turned[k], -1.0, 1.0)

        def at(place: np.ndarray, k: int = k, way: np.ndarray = direction) -> np.ndarray:
            return rows(place[0], place[1], k, way)

        variances = np.array([1e-6, 0.0]) + finite_difference(at, q[k]) ** 2 @ unsure[k]
        expected[k] = at(q[k]) / np.sqrt(variances)
    there = known.compared
    np.testing.assert_allclose(found.values[there], expected[there], rtol=1e-4, atol=1e-6)
    assert np.isnan(found.values[~there]).all()
    assert (found.variances == 1.0).all()
    assert np.median(np.diff(known.time)) == pytest.approx(INTERVAL)
    spans = np.subtract(*np.percentile(q, (95, 5), axis=0))
    np.testing.assert_allclose(
        np.abs(turned[5]), np.abs(q[5] - q[4]) / (TURNING_SHARE * spans), rtol=0.05
    )


def test_a_plants_numbers_are_found_in_seconds() -> None:
    """Arm, stiffness, spring and drive friction of a plant that differs, within three of their
    standard errors and 5 %.
    """
    log = made(30.0, 1)
    start = rig(
        **{
            "tendons.t.insertion.radius": {"value": 8.4e-3, "std": 4e-4},
            "joints.j.spring.stiffness": {"value": 0.33, "std": 0.05},
            "drives.m.friction.load": {"value": 0.14, "std": 0.05},
        }
    )
    found = by_equations(problem_of([log], start, Options()), Options(), None)
    assert found is not None
    assert found.optimum.converged
    noise = next(p for p in found.fitted if p.noise and p.name.endswith("sensor u"))
    scale = found.problem.scales(found.problem.at(found.optimum.z))[0]
    assert noise.value == pytest.approx(1e-3 * np.sqrt(scale))
    assert 1e-3 < noise.value <= 1.01e-3 * np.sqrt(found.nis[0])
    for name, true in (
        ("insertion radius", ARM),
        ("spring stiffness", SPRING),
        ("friction load", LOAD),
    ):
        part = next(one for one in found.fitted if one.name.startswith(name))
        assert part.variance_reduction > 0.5, name
        assert part.value == pytest.approx(true, rel=0.05), name
        assert abs(part.value - true) < 3.0 * part.error, name


def test_what_is_not_read_cannot_be_asked() -> None:
    """A joint without a truth, or too few samples of it: the filter is asked then, and with a
    homing move too.
    """
    log, one = made(8.0), rig()
    options = Options(compiled=False)
    assert by_equations(problem_of([log], one, options), Options(homing=1.0), None) is None
    fast = replace(log, time=log.time / 50.0)  # 0.12 s are 600 of its 800 samples
    faster = rig(**{f"sensors.{k}.rate": 5000.0 for k in range(3)})
    blind = replace(log, truth={"theta": np.where(log.time < 0.5, log.truth["theta"], np.nan)})
    half = replace(log_of(), truth={"theta_mcp": angles_at(TIME)[:, 0]})
    for asked, described in ((fast, faster), (blind, one), (half, load_rig("finger-2n"))):
        assert inverse_problem(problem_of([asked], described, options), False) is None


@lru_cache
def ropes() -> tuple[list[Log], ParameterEstimates]:
    logs = [ropes_log(seed, "calibration", 20.0) for seed in (300, 301, 302)]
    found = by_equations(problem_of(logs, ropes_rig(), Options()), Options(), None)
    assert found is not None
    return logs, found


def test_what_moves_inside_is_stepped_along() -> None:
    """Creep of ropes: without it the equations lack more; of backlash see the next test but one."""
    logs, found = ropes()
    bare = ropes_rig().with_values({f"tendons.{i}.creep": None for i in (0, 1)})
    without = by_equations(problem_of(logs, bare, Options()), Options(), None)
    assert without is not None
    assert np.sum(np.log(without.nis)) > np.sum(np.log(found.nis)) + 0.5


def test_a_short_search_leaves_a_log_out() -> None:
    """The parameters without a log, beside those that a whole search of the others finds: a fifth
    of an error.
    """
    logs, found = ropes()
    quick, _ = parameters_without(found, logs, [0, 1, 1])
    whole = by_equations(problem_of(logs[1:], ropes_rig(), Options()), Options(), None)
    assert whole is not None
    away, came = (
        [abs(a.value - b.value) / b.error for a, b in zip(other, whole.fitted) if not b.noise]
        for other in (quick.fitted, found.fitted)
    )
    assert len(away) >= 8
    assert np.median(away) < 0.25
    assert np.median(away) <= np.median(came)


def test_another_start_ends_no_lower() -> None:
    """The equations' −ln p has one end, wherever the search begins within a prior std."""
    _, found = ropes()
    size = found.problem.size
    drawn = 0.3 * np.random.default_rng(4).normal(size=size)
    begin = np.clip(drawn, *found.problem.bounds.T)
    here = found.problem.derivatives(begin, np.zeros(size))
    assert here.cost == pytest.approx(found.problem.costs([begin])[0])
    again, other = most_likely(found.problem, begin)
    assert again.costs([found.optimum.z])[0] > other.cost - 0.5


def test_the_part_that_a_rig_lacks_is_named() -> None:
    """Ropes whose play the rig file does not say; with it nothing is named, and of a rig without
    noise nothing is tried.
    """
    logs, found = ropes()
    silent = ropes_rig().with_values({f"drives.{i}.backlash": None for i in (0, 1)})
    parameters = by_equations(problem_of(logs, silent, Options()), Options(), None)
    assert parameters is not None
    tried = tried_parts(logs, silent, Options(), parameters)
    part, _ = tried[0]
    assert part.name == "play between drives and tendons"
    assert set(part.values) == {f"drives.{name}.backlash.width" for name in ("flexor", "extensor")}
    # named are those that leave less than 85 % in the geometric mean of all rows, the least first,
    # and no others
    single = with_parts(terms_of(silent), logs, silent, Options(), parameters)
    left = {part.name: left_by(own) / left_by(parameters) for part, own in single}
    alone = [left[part.name] for part, _ in tried if part.name in left]
    assert alone == pytest.approx(sorted(share for share in left.values() if share < 0.85)[:2])
    assert sum(share >= 0.85 for share in left.values()) >= 2
    assert tried_parts(logs, ropes_rig(), Options(), found) == []
    quiet = replace(parameters, nis=tuple(0.5 for _ in parameters.nis))
    assert tried_parts(logs, silent, Options(), quiet) == []
    assert tried_parts(logs, silent, Options(free=("tendons.*.stiffness",)), parameters) == []


def left_by(parameters: ParameterEstimates) -> float:
    """Return the geometric mean of the rows' √(mean ν²/S), no row counting as less than its
    sensors' noise.
    """
    return float(
        np.prod([max(ratio, 1.0) for ratio in parameters.nis]) ** (0.5 / len(parameters.nis))
    )


def test_every_part_can_be_added_to_a_plain_rig() -> None:
    described = rig()
    names = [part.name for part in terms_of(described) if part.values]
    assert len(names) == 4
    for part in terms_of(described):
        assert described.with_values(part.values) != described


def test_a_foreign_finger_stays_near_its_priors() -> None:
    """Physics that the rig lacks does not drive its numbers to absurd values: no prior weighs
    nothing.
    """
    logs = [finger_log(seed, 10.0) for seed in (50, 51)]
    found = by_equations(problem_of(logs, finger_rig(), Options()), Options(), None)
    assert found is not None
    far = [abs(p.value - p.start) / p.prior_std for p in found.fitted if not p.noise]
    assert max(far) < 6.0
