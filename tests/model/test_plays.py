"""What moves inside a rig: backlash, cables in sheaths, creep; against closed forms and naive
twins.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.optimize import bisect

from distal import Rig, load_rig, simulate
from distal.errors import RigError
from distal.model import Mechanism, stiffest_frequency
from distal.model.tendon_tensions import Bounds, Sheath, _equal_tensions, balanced, gap
from distal.simulation import build_scenario
from tests.model.helpers import look
from tests.support.cable import Cable

K, MU, WRAP = 2000.0, 0.2, 1.8


def sheath(count: int, let_out: float = 1.0) -> Sheath:
    return Sheath(
        K, float(np.exp(MU * WRAP / count)), float(np.exp(MU * WRAP * let_out / count)), count
    )


def moved(
    cable: Sheath, points: list[float], drive: float, joint: float, times: int = 1
) -> list[float]:
    for _ in range(times):
        points = [float(point) for point in cable.settled(points, drive, joint)]
    return points


@pytest.mark.parametrize("count", [1, 2, 3, 4])
@pytest.mark.parametrize("let_out", [1.0, 0.6])
def test_a_cable_drawn_in_and_let_out(count: int, let_out: float) -> None:
    """T_drive = T e^{μβ} when all of it has slid towards the drive, T e^{−μβ λ} when it has slid
    back.
    """
    cable = sheath(count, let_out)
    points = cable.middle(0.0, 0.0)
    for drive in np.linspace(0.0, 4e-3, 60):
        points = moved(cable, points, drive, 0.0, 30)
    near, far = (float(t) for t in cable.tensions(points, 4e-3, 0.0))
    assert near / far == pytest.approx(np.exp(MU * WRAP), rel=1e-6)
    for drive in np.linspace(4e-3, 1e-3, 60):
        points = moved(cable, points, drive, 0.0, 30)
    near, far = (float(t) for t in cable.tensions(points, 1e-3, 0.0))
    assert near / far == pytest.approx(np.exp(-MU * WRAP * let_out), rel=1e-6)


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_without_friction_it_is_one_spring(count: int) -> None:
    cable = Sheath(K, 1.0, 1.0, count)
    points = moved(cable, [0.0] * count, 3e-3, 1e-3, 200)
    for tension in cable.tensions(points, 3e-3, 1e-3):
        assert float(tension) == pytest.approx(K * 2e-3, rel=1e-6)


def test_the_step_resolves_the_stretch_at_a_cables_end() -> None:
    """Between two samples the points of a sheath may hold, and its ends feel 2 N k: the mode is
    √(2N) as fast at least.
    """
    values = {"tendons.0.damping": 0.0, "tendons.1.damping": 0.0}
    rig = load_rig("pulley-antagonist").with_values(values)
    sheathed = rig.with_values(
        {f"tendons.{i}.path": {"friction": 0.1, "wrap": 1.0, "nodes": 4} for i in (0, 1)}
    )
    plain, held = (stiffest_frequency(Mechanism(each)) for each in (rig, sheathed))
    assert held == pytest.approx(np.sqrt(8.0) * plain, rel=1e-9)


def test_a_slack_cable_pulls_nothing() -> None:
    cable = sheath(2)
    points = moved(cable, cable.middle(0.0, 0.0), -1e-3, 1e-3, 20)
    assert [float(t) for t in cable.tensions(points, -1e-3, 1e-3)] == [0.0, 0.0]


@pytest.mark.parametrize("count", [1, 2, pytest.param(3, marks=pytest.mark.more)])
def test_a_cable_that_stiffens_is_one_spring_without_friction(count: int) -> None:
    """T = T_pre + k (e^{aδ} − 1)/a of the whole cable, whatever its stretches."""
    a, pretension, stretch = 300.0, 5.0, 3e-3
    cable = Sheath(K, 1.0, 1.0, count, a, pretension)
    whole = stretch + pretension / K
    points = moved(cable, cable.middle(0.0, 0.0), whole, 0.0, 100)
    for tension in cable.tensions(points, whole, 0.0):
        assert float(tension) == pytest.approx(pretension + K * np.expm1(a * stretch) / a, rel=1e-6)


@given(
    st.floats(-2e-3, 6e-3),
    st.floats(0.0, 500.0),
    st.floats(0.0, 10.0),
    st.sampled_from([0, 1, 2]),
    st.floats(1.0, 1.5),
)
def test_a_point_of_a_cable_that_stiffens_holds_up_to_the_capstan_equation(
    stretch: float, a: float, pretension: float, point: int, drawn: float
) -> None:
    """At its bounds T₁ = e T₂ and T₂ = e T₁, here by bisection."""
    cable = Sheath(K, drawn, drawn, 3, a, pretension)

    def lacks(m: float, near: float, far: float) -> float:
        before, after = cable.tension(point, stretch - m), cable.tension(point + 1, m)
        return near * float(before) - far * float(after)

    found = cable.bounds(point, stretch, 0.0)
    desired = sorted(
        bisect(lacks, -0.05, 0.05, args, xtol=1e-12) for args in ((1.0, drawn), (drawn, 1.0))
    )
    assert [float(found.low), float(found.high)] == pytest.approx(desired, abs=1e-8)


def sheathed(**values: object) -> Mechanism:
    """Return one joint between two cables in sheaths of two points, with more in its
    description.
    """
    ways = {f"tendons.{i}.path": {"friction": 0.15, "wrap": 1.0, "nodes": 2} for i in (0, 1)}
    none = {f"tendons.{i}.damping": 0.0 for i in (0, 1)}
    pulled = {f"tendons.{i}.pretension": 5.0 for i in (0, 1)}
    return Mechanism(
        load_rig("pulley-antagonist").with_values({**none, **pulled, **ways, **values}), (), True
    )


def rest_of(mechanism: Mechanism, ways: list[list[float]]) -> list[tuple[Any, Any, Any]]:
    """Return what is tied to the tendons, what is inside, and the pulls, as the bodies go from
    place to place.
    """
    q, p = ca.SX.sym("q", mechanism.n_bodies), mechanism.parameters.symbols
    position, pulls = (
        mechanism.internal_state(q),
        mechanism.pulls(q, ca.SX.zeros(mechanism.n_bodies)),
    )
    function = ca.Function(
        "position",
        [q, p],
        [position.q, ca.vertcat(*position.inside), pulls.joint, pulls.drive, pulls.forces],
    )
    still = Mechanism(mechanism.rig)
    start, own = still.internal_state(q).inside, still.parameters
    parameters = np.array(mechanism.parameters.values)
    at = [mechanism.parameters.names.index(name) for name in mechanism.plays]
    begin = ca.Function("begin", [q, own.symbols], [ca.vertcat(*start)])
    parameters[at] = np.array(begin(ways[0], own.values)).ravel()
    found = []
    for way in ways:
        tied, inside, *forces = (np.array(each).ravel() for each in function(way, parameters))
        parameters[at] = inside
        found.append((tied, inside, forces))
    return found


def test_the_pulley_of_a_loose_joint_rests_where_its_sheathed_cables_balance() -> None:
    """In its gap the cables turn it until they pull alike; at an end of the gap it takes the link
    along.
    """
    width = 0.05
    mechanism = sheathed(**{"joints.0.backlash.width": width})
    turns = [
        [angle, 0.0, 0.0]
        for angle in np.concatenate([np.linspace(0, 0.1, 41), np.linspace(0.1, -0.1, 81)])
    ]
    loose = 0
    for way, (tied, _, (joint, _, forces)) in zip(turns, rest_of(mechanism, turns)):
        away = tied[0] - way[0]
        assert abs(away) <= width / 2 + 1e-12
        if abs(away) < width / 2 - 1e-6:
            loose += 1
            assert abs(forces[0]) < 1e-6 * joint.max()
        else:
            assert forces[0] * away >= 0
    assert 5 < loose < len(turns) - 5


def test_the_far_side_of_a_loose_drive_is_held_by_its_sheathed_cable() -> None:
    """A cable under tension draws the far side to its end of the gap, as it does without a
    sheath.
    """
    loose = {"drives.0.backlash": {"width": 1e-3, "held": False}}
    ways = [
        [0.0, position, 0.0]
        for position in np.concatenate([np.linspace(0, 2e-3, 21), np.linspace(2e-3, 0, 21)])
    ]
    for way, (tied, inside, (_, drive, _)) in zip(ways, rest_of(sheathed(**loose), ways)):
        assert drive[0] > 0
        assert (
            inside[0]
            == pytest.approx(way[1] - 0.5e-3, abs=1e-9)
            == pytest.approx(tied[1], abs=1e-9)
        )


def test_a_damped_cable_in_its_sheath_pulls_more_at_both_ends_as_it_is_stretched() -> None:
    at = look(
        sheathed(**{"tendons.0.damping": 7.0}),
        lambda m, q, v: [m.pulls(q, v).joint, m.pulls(q, v).drive],
    )
    still, moving = (np.array(at([0.0, 1e-3], [0.0, speed])) for speed in (0.0, 0.2))
    assert moving[:, 0] - still[:, 0] == pytest.approx([1.4, 1.4])
    assert moving[:, 1] == pytest.approx(still[:, 1])


@pytest.mark.parametrize("count", [2, pytest.param(4, marks=pytest.mark.more)])
def test_its_sweeps_are_enough(count: int) -> None:
    """One call moves the points to within 5 % of a step of where many calls do, in a motion to and
    fro.
    """
    cable, time = sheath(count), np.arange(0.0, 6.0, 0.01)
    drive = 2e-3 + 1.2e-3 * np.sin(2 * np.pi * 0.4 * time)
    once = many = cable.middle(drive[0], 0.0)
    for position in drive[1:]:
        once, many = moved(cable, once, position, 0.0), moved(cable, many, position, 0.0, 60)
        assert np.allclose(once, many, atol=0.05 * np.abs(np.diff(drive)).max())


def test_two_points_stand_for_a_whole_cable() -> None:
    """Against a cable of 16 points: tensions within 5 % of their mean for two points, 10 % for one
    (RMS).
    """
    time = np.arange(0.0, 6.0, 0.005)
    drive = 1.2e-3 * (1 + 0.5 * np.sin(2 * np.pi * 0.3 * time + 1)) + 4.5e-3 * np.sin(
        2 * np.pi * 0.35 * time
    )
    joint = 4.5e-3 * np.sin(2 * np.pi * 0.35 * time - 0.05)
    fine = Cable(K, MU, WRAP)
    errors: dict[int, list[float]] = {1: [], 2: []}
    points = {count: sheath(count).middle(drive[0], joint[0]) for count in errors}
    desired = []
    for d, j in zip(drive, joint):
        fine.settle(d, j)
        desired.append(fine.tensions(d, j))
        for count, each in errors.items():
            points[count] = moved(sheath(count), points[count], d, j)
            each += [
                float(a) - b
                for a, b in zip(sheath(count).tensions(points[count], d, j), desired[-1])
            ]
    mean = float(np.mean(desired))
    for count, allowed in ((1, 0.1), (2, 0.05)):
        assert 0.0 < np.sqrt(np.mean(np.square(errors[count]))) < allowed * mean


@given(st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=30), st.floats(0.0, 0.5))
def test_a_gap_is_a_play(positions: list[float], width: float) -> None:
    far = naive = 0.0
    for position in positions:
        far = float(gap(position, width).hold(far))
        if naive < position - width / 2:
            naive = position - width / 2
        elif naive > position + width / 2:
            naive = position + width / 2
        assert far == pytest.approx(naive, abs=1e-12)


@given(st.floats(-2.0, 2.0), st.floats(0.0, 3.0), st.floats(0.1, 2.0))
def test_a_far_side_goes_where_friction_holds_it(
    start: float, friction: float, stiffness: float
) -> None:
    """A straight pull K p: it comes to rest at ±F/K, or stays, or meets an end."""
    bounds = Bounds(-1.0, 1.5)
    found = float(balanced(start, bounds, lambda p: (stiffness * p, stiffness), friction))
    begun, rest = min(max(start, -1.0), 1.5), friction / stiffness
    expected = begun if abs(begun) <= rest else float(np.sign(begun)) * rest
    assert found == pytest.approx(min(max(expected, -1.0), 1.5), abs=1e-6)


HELD = {"joints": {"link": {"hand": {"angle": 0.0, "stiffness": 5000.0}}}}


def run(
    rig: Rig, drives: dict[str, Any], duration: float, more: dict[str, Any] | None = None
) -> Any:
    raw = {
        "rig": rig.name,
        "duration": duration,
        "drives": drives,
        **(HELD if more is None else more),
    }
    return simulate(rig, build_scenario(raw, "plays"), 1)


def quiet(values: dict[str, Any]) -> Rig:
    none = {f"drives.{i}.friction.load": {"value": 0.0, "std": 0.0} for i in (0, 1)}
    return load_rig("pulley-antagonist").with_values({**none, **values})


STILL = {"position": 3e-3, "stiffness": 5e5, "damping": 50.0}
SETTLED = {"share": 0.5, "time": 1.5, "settled": {"value": 0.0, "std": 0.0}}


def test_a_tendon_held_at_its_ends_relaxes() -> None:
    """T = k (δ − c), ċ = (γ T/k − c)/τ: T falls from k δ to k δ/(1 + γ) with the time constant τ/(1
    + γ).
    """
    rig = quiet({"tendons.0.creep": SETTLED})
    log = run(rig, {"left": {"servo": STILL}, "right": {"force": 2.0}}, 5.0)
    tension, time = log.truth["tension_left"], log.time
    expected = tension[0] / 1.5 * (1 + 0.5 * np.exp(-time * 1.5 / 1.5))
    assert np.allclose(tension, expected, rtol=0.01)


def test_a_creep_that_is_faster_than_the_samples_is_a_softer_tendon() -> None:
    """With a time constant of a tenth of a millisecond T = k δ/(1 + γ), and nothing rings."""
    rig = quiet({"tendons.0.creep": {**SETTLED, "share": 2.0, "time": 1e-4}})
    log = run(rig, {"left": {"servo": STILL}, "right": {"force": 2.0}}, 1.0)
    tension = log.truth["tension_left"][50:]
    assert np.ptp(tension) < 1e-3 * tension.mean()
    assert tension.mean() == pytest.approx(806.0 * 3e-3 / 3.0, rel=0.02)


def test_a_rope_that_has_settled_stays() -> None:
    rig = quiet({"tendons.0.creep": {**SETTLED, "settled": {"value": 1.0, "std": 0.0}}})
    log = run(rig, {"left": {"force": 4.0}, "right": {"force": 4.0}}, 3.0)
    assert np.ptp(log.truth["position_left"]) < 2e-5


def test_backlash_of_a_drive() -> None:
    """The tendon's end stays while its drive crosses the gap: a plateau of the tension as it turns
    back.
    """
    width = 0.5e-3
    rig = quiet({"drives.0.backlash.width": width})
    swing = {
        "position": {"mean": 5e-3, "amplitude": 2e-3, "frequency": 0.5},
        "stiffness": 5e5,
        "damping": 50.0,
    }
    log = run(rig, {"left": {"servo": swing}, "right": {"force": 2.0}}, 4.0)
    position, tension = log.truth["position_left"], log.truth["tension_left"]
    far, naive = position[0], []
    for each in position:
        far = min(max(far, each - width / 2), each + width / 2)
        naive.append(806.0 * far)
    late = log.time > 1.0
    # the link is held by a spring of 5000 N m/rad, and the log's stamps are not the plant's
    assert np.abs(tension - naive)[late].max() < 0.02 * np.ptp(tension)


def torque_at(rig: Rig, angle: float, positions: list[float]) -> float:
    at = look(rig, lambda m, q, v: [m.pulls(q, v).forces])
    return float(at([angle, *positions])[0][0])


@given(st.floats(-0.2, 0.2))
def test_backlash_of_a_joint_is_a_dead_zone(angle: float) -> None:
    """Both tendons taut: τ = K (θ_eq − θ ∓ b/2) beyond the gap, nothing within; K = 2 k r²."""
    rig, width, radius = quiet({"joints.0.backlash.width": 0.05}), 0.05, 9.53e-3
    positions = [6e-3, 5e-3]
    stiffness, rest = 2 * 806.0 * radius**2, (positions[0] - positions[1]) / (2 * radius)
    away = rest - angle
    expected = stiffness * (max(away - width / 2, 0.0) + min(away + width / 2, 0.0))
    assert torque_at(rig, angle, positions) == pytest.approx(expected, abs=1e-7)


def test_the_slack_one_of_two_tendons_leaves_the_pulley_to_the_other() -> None:
    rig = quiet({"joints.0.backlash.width": 0.05})
    pull = 806.0 * (6e-3 - 9.53e-3 * (0.1 + 0.025)) * 9.53e-3
    assert torque_at(rig, 0.1, [6e-3, -5e-3]) == pytest.approx(pull, rel=1e-6)


def test_cogging_repeats_as_the_motor_turns() -> None:
    """Expected torque of a motor at rest: what its tendons pull less cogging."""
    cogging = {"periods": 7, "cosine": 0.003, "sine": -0.002}
    rig = load_rig("capstan-joint").with_values({"drives.0.cogging": cogging})
    at = look(rig, lambda m, q, v: [m.passive_forces(q)])
    for turned in (0.0, 0.3, 1.1):
        expected = 0.003 * np.cos(7 * turned) - 0.002 * np.sin(7 * turned)
        assert at([0.2, turned])[0][1] == pytest.approx(expected, abs=1e-12)


def test_nobody_who_forgets_is_in_the_middle() -> None:
    """Filters that remember nothing take a far side to be halfway, and a rope as far settled as it
    is said to be.
    """
    rig = quiet(
        {
            "drives.0.backlash.width": 1e-3,
            "tendons.1.creep": {**SETTLED, "settled": {"value": 1.0, "std": 0.0}},
        }
    )
    mechanism = Mechanism(rig)
    assert not mechanism.parameters.inside
    (tensions,) = look(mechanism, lambda m, q, v: [m.tensions(q, v)])([0.0, 4e-3, 3e-3])
    assert tensions == pytest.approx([806.0 * 4e-3, 806.0 * 3e-3 / 1.5], rel=1e-9)


def test_a_cable_of_too_many_points_is_refused() -> None:
    path = {"friction": 0.1, "wrap": 1.0, "nodes": 9}
    with pytest.raises(RigError, match=r"less than or equal to 4|at most 4"):
        load_rig("pulley-antagonist").with_values({"tendons.0.path": path})


@given(
    st.integers(1, 4),
    st.floats(5e3, 1e5),
    st.floats(1.0, 500.0),
    st.floats(2.0, 30.0),
    st.floats(0.01, 0.6),
    st.tuples(st.floats(-1.0, 4.0), st.floats(-1.0, 4.0)),
)
def test_slopes_of_a_point_of_a_stiffening_cable(
    count: int,
    stiffness: float,
    stiffening: float,
    pretension: float,
    grip: float,
    ends: tuple[float, float],
) -> None:
    """The derivatives of where T₁(l − m) = e T₂(m − r) by both ends, against differences."""
    cable = Sheath(stiffness, float(np.exp(grip)), 1.0, count, stiffening, pretension)
    before, after = ca.SX.sym("before"), ca.SX.sym("after")
    position = cable.bounds(0, before, after).high
    slopes = ca.jacobian(position, ca.vertcat(before, after))
    function = ca.Function("position", [before, after], [position, slopes])
    near, far = (end * pretension / stiffness for end in ends)
    derivatives = np.array(function(near, far)[1]).ravel()
    step = 1e-6 * pretension / stiffness
    # away from bends, where both sides of a difference are alike
    here, (up, down) = float(function(near, far)[0]), np.array([(step, 0.0), (0.0, step)])
    sides = [float(function(near + a, far + b)[0]) - here for a, b in (up, -up, down, -down)]
    assume(abs(sides[0] + sides[1]) + abs(sides[2] + sides[3]) < 1e-3 * step)
    differences = [(sides[0] - sides[1]) / (2 * step), (sides[2] - sides[3]) / (2 * step)]
    assert derivatives == pytest.approx(differences, abs=1e-4)


def test_a_search_for_equal_tensions_ends_within_its_steps() -> None:
    """Of 300 cables by lot, stretched far into where they stiffen: tensions balance where it ends,
    before the last step of Newton.
    """
    search, _ = _equal_tensions()
    rng = np.random.default_rng(0)
    lacking = []
    for _ in range(300):
        stiffness, stiffening = 10 ** rng.uniform(3, 5), 10 ** rng.uniform(2, 3)
        pretension, grip = rng.uniform(1, 30), float(np.exp(rng.uniform(0.01, 0.8)))
        before, after = rng.uniform(-2, 8, 2) * pretension / stiffness
        cable = Sheath(stiffness, grip, 1.0, 1, stiffening, pretension)
        rest = (1.0, grip, 0.5, 0.5, stiffness, stiffening, pretension)
        place = float(search(before, after, *rest)[0])
        m = ca.SX.sym("m")
        lacks = cable.tension(0, before - m) - grip * cable.tension(1, m - after)
        balance = ca.Function("balance", [m], [lacks, ca.jacobian(lacks, m)])
        lack, slope = (float(part) for part in balance(place))
        left = abs(lack / slope)
        lacking.append(left * stiffness / pretension)
    assert max(lacking) < 0.02  # with the second derivative of the wrong sign it is 0.5
    assert np.quantile(lacking, 0.95) < 1e-12
