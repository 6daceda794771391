"""The time step: against a naive twin, SciPy's solvers, and what physics demands."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from distal import Rig
from distal.errors import RigError
from distal.model import (
    Kick,
    Mechanism,
    interval_step,
    kick_and_drift,
    kicked,
    loads_of,
    stiffest_frequency,
    substeps,
)
from distal.model.friction import Flight, bounce
from tests.helpers import NaiveRig, rms_degrees, without_stops
from tests.support.one_body import one_body

DT = 0.01


class Stepper:
    """The model's interval as a plain function of (q, v, effort)."""

    def __init__(
        self, rig: Rig, count: int | None = None, dt: float = DT, **options: object
    ) -> None:
        self.mechanism = Mechanism(rig)
        self.count = count or substeps(self.mechanism, dt)
        self.dt = dt
        self._function = interval_step(self.mechanism, self.count, **options)  # type: ignore[arg-type]

    def __call__(
        self, q: np.ndarray, v: np.ndarray, effort: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        n = self.mechanism.n_bodies
        out = self._function(
            q, v, effort, np.zeros(n), np.zeros((n, 3)), self.dt, self.mechanism.parameters.values
        )
        return out[0].full().ravel(), out[1].full().ravel()

    def run(self, efforts: np.ndarray, q: np.ndarray, v: np.ndarray | None = None) -> np.ndarray:
        v = np.zeros_like(q) if v is None else v
        rows = []
        for effort in efforts:
            q, v = self(q, v, effort)
            rows.append(np.concatenate([q, v]))
        return np.array(rows)


def load_steps(n: int = 300) -> np.ndarray:
    """Three seconds of pulls with steps, (n, 3)."""
    pulls = np.full((n, 3), 2.0)
    pulls[:, 0] = 0.0
    pulls[30:, 1] = 6.0
    pulls[110:, 1], pulls[110:, 2] = 2.0, 5.0
    pulls[190:, 1], pulls[190:, 2] = 4.0, 4.0
    pulls[230:, 1], pulls[230:, 2] = 7.0, 2.5
    return pulls


START = np.array([0.0, 2 / 806, 2 / 806])


def test_equals_the_naive_twin(paper_rig: Rig) -> None:
    """The same algorithm typed out in NumPy, over 1.5 s with stick, slip and ringing sliders."""
    stepper, naive = Stepper(without_stops(paper_rig), 15), NaiveRig()
    q, v = START, np.zeros(3)
    naive_q, naive_v = START, np.zeros(3)
    for effort in load_steps()[:150]:
        q, v = stepper(q, v, effort)
        naive_q, naive_v = naive.interval(naive_q, naive_v, effort, DT, 15)
    np.testing.assert_allclose(q, naive_q, rtol=1e-9, atol=1e-13)
    np.testing.assert_allclose(v, naive_v, rtol=1e-7, atol=1e-11)


@pytest.mark.parametrize("method", ["RK23", pytest.param("Radau", marks=pytest.mark.slow)])
def test_agrees_with_scipy_on_a_smoothed_twin(paper_rig: Rig, method: str) -> None:
    """RK23 as in the paper, and Radau, on sgn smoothed to tanh: 0.1° while the link turns by 20°.

    The bound is what the smoothing itself costs: at ε = 1e-3 the two differ by less than at 1e-2,
    see the last line.
    """
    naive, stepper = NaiveRig(), Stepper(without_stops(paper_rig), 60)
    effort, duration = np.array([0.0, 6.0, 2.0]), 0.18
    steps = round(duration / DT)
    exact = stepper.run(np.tile(effort, (steps, 1)), START)

    def error(epsilon: float) -> float:
        width = np.array([epsilon, epsilon * naive.r, epsilon * naive.r])
        times = DT * np.arange(1, steps + 1)
        done = solve_ivp(
            lambda t, y: naive.derivative(y, effort, width),
            (0, duration),
            np.concatenate([START, np.zeros(3)]),
            method=method,
            t_eval=times,
            rtol=1e-5,
            atol=1e-8,
        )
        return rms_degrees(done.y[0] - exact[:, 0])

    assert np.rad2deg(exact[-1, 0]) > 10.0
    fine = error(1e-2)
    assert fine < 0.1
    assert fine < error(1.0)


def test_a_stuck_link_does_not_creep(paper_rig: Rig) -> None:
    """60 s at 90 % of break-away: 0.000°."""
    stepper = Stepper(without_stops(paper_rig))
    q = START.copy()
    limit = NaiveRig().limits(*START)[0]
    efforts = np.tile([0.9 * limit, 2.0, 2.0], (6000, 1))
    efforts[:, 1:] = -NaiveRig().tendon_forces(*START)[1:]
    assert np.all(stepper.run(efforts, q)[:, 0] == 0.0)


def test_it_breaks_away_at_the_limit(paper_rig: Rig) -> None:
    stepper, limit = Stepper(without_stops(paper_rig)), NaiveRig().limits(*START)[0]
    pulls = -NaiveRig().tendon_forces(*START)[1:]
    assert stepper.run(np.tile([0.999 * limit, *pulls], (20, 1)), START)[-1, 0] == 0.0
    assert stepper.run(np.tile([1.001 * limit, *pulls], (20, 1)), START)[-1, 0] > 0.0


def test_a_stop_holds_and_lets_go(paper_rig: Rig) -> None:
    """Pressed by 4 N beyond what the tendon takes, the slider sits 40 µm inside the stop and leaves
    it when released.
    """
    rig = paper_rig.with_values(
        {"drives.0.friction.load": {"value": 0.0, "std": 0.0}, "drives.0.stops": [-2.5e-3, 3e-3]}
    )
    stepper = Stepper(rig)
    tension = 806 * 3e-3
    pressed = stepper.run(np.tile([0.0, tension + 4.0, 2.0], (60, 1)), START)
    # the tendon stretches by the stop's own deflection: 4 N over (k_s + k)
    assert pressed[-1, 1] - 3e-3 == pytest.approx(4.0 / (1e5 + 806), rel=0.05)
    assert abs(pressed[-1, 4]) < 1e-6
    released = stepper.run(np.tile([0.0, 2.0, 2.0], (100, 1)), pressed[-1, :3], pressed[-1, 3:])
    assert released[-1, 1] == pytest.approx(2.0 / 806, abs=2e-4)


def test_stops_that_are_reached_in_the_right_order_of_accuracy(paper_rig: Rig) -> None:
    """Through the stops with load steps, the default step is within 0.12° RMS of one 40 times
    finer; free, 0.02°.
    """
    for stops, bound in (([-2.5e-3, 7.5e-3], 0.12), ([-0.1, 0.1], 0.02)):
        rig = paper_rig.with_values({"drives.0.stops": stops, "drives.1.stops": stops})
        default = Stepper(rig).run(load_steps(), START)
        fine_stepper = Stepper(rig, 120, DT / 5)
        fine = fine_stepper.run(np.repeat(load_steps(), 5, axis=0), START)[4::5]
        assert rms_degrees(default[:, 0] - fine[:, 0]) < bound


def test_order_of_the_step_between_the_kinks(paper_rig: Rig) -> None:
    """Slipping, taut, away from stops the step is of second order: half the step, a quarter of the
    error.
    """
    frictionless = {
        f"drives.{i}.friction.load": {"value": 0.0, "std": 0.0} for i in range(2)
    }  # sliders turn back
    rig = without_stops(paper_rig).with_values(frictionless)
    start, effort = np.array([0.0, 5e-3, 2.5e-3]), np.array([0.0, 4.0, 2.0])
    moving = np.array([3.0, 0.02, -0.02])
    ends = {}
    for count in (16, 32, 64, 1024):
        stepper = Stepper(rig, count, 0.004)
        q, _ = stepper(start, moving, effort)
        ends[count] = q
    errors = [np.abs(ends[count] - ends[1024])[0] for count in (16, 32, 64)]
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.all(orders > 1.7)
    assert np.all(orders < 2.4)


def test_a_spring_swings_as_its_stiffness_and_inertia_say(paper_rig: Rig) -> None:
    bare = {"joints.0.friction": None, "joints.0.damping": 0.0, "joints.0.spring.stiffness": 0.5}
    slack = {f"tendons.{i}.slack": 1.0 for i in (0, 1)}
    rig = without_stops(paper_rig).with_values({**bare, **slack})
    motion = Stepper(rig, 15).run(np.zeros((50, 3)), np.array([0.1, 0.0, 0.0]))
    turned = np.sqrt(0.5 / NaiveRig().inertia) * DT * np.arange(1, 51)
    np.testing.assert_allclose(motion[:, 0], 0.1 * np.cos(turned), atol=1e-4)


def test_joint_stops_hold_the_link(paper_rig: Rig) -> None:
    rig = without_stops(paper_rig).with_values({"joints.0.stops": ["-10 deg", "10 deg"]})
    motion = Stepper(rig).run(load_steps(), START)
    # it flies in at up to 3 rad/s and the stop's own mode is 486 rad/s: 0.35° of penetration at the
    # most
    assert np.rad2deg(np.abs(motion[:, 0]).max()) < 10.35
    assert np.rad2deg(motion[100, 0]) == pytest.approx(10.0, abs=0.1)


def driven_substep(
    mechanism: Mechanism,
) -> Callable[[np.ndarray, np.ndarray, float], tuple[np.ndarray, np.ndarray]]:
    """Return one sub-step with the drives' motion prescribed, as filters take it: a kick of the
    joint, then a drift.
    """
    n, p = mechanism.n_bodies, mechanism.parameters
    q, v, h = ca.SX.sym("q", n), ca.SX.sym("v", n), ca.SX.sym("h")
    kick = Kick(q, v, ca.SX.zeros(n), h, h)
    joint = kicked(mechanism, kick, loads_of(mechanism, kick))
    moved = ca.vertcat(joint.q, q[1:] + h * v[1:])
    function = ca.Function("driven", [q, v, h, p.symbols], [moved, ca.vertcat(joint.v, v[1:])])

    def step(q: np.ndarray, v: np.ndarray, h: float) -> tuple[np.ndarray, np.ndarray]:
        q_next, v_next = function(q, v, h, p.values)
        return q_next.full().ravel(), v_next.full().ravel()

    return step


def test_displacements_as_inputs_give_the_same_link(paper_rig: Rig) -> None:
    """With the sliders' motion prescribed, the same expressions turn the link as the full model
    does.
    """
    rig = without_stops(paper_rig)
    full = Stepper(rig, 2, 1e-3)
    driven = driven_substep(full.mechanism)
    pulls = np.repeat(load_steps()[:150], 10, axis=0)
    motion = full.run(pulls, START)
    positions = np.vstack([START[1:], motion[:, 1:3]])
    speeds = np.diff(positions, axis=0) / 1e-3
    q, v = START.copy(), np.zeros(3)
    link = []
    for k in range(len(pulls)):
        q[1:], v[1:] = positions[k], speeds[k]
        for _ in range(2):
            q, v = driven(q, v, 0.5e-3)
        link.append(q[0])
        np.testing.assert_allclose(q[1:], positions[k + 1], atol=1e-12)
    assert np.rad2deg(np.ptp(motion[:, 0])) > 30.0
    # the straight lines between samples hide some ringing of the sliders, hence not to the last
    # digit
    assert rms_degrees(np.array(link) - motion[:, 0]) < 0.05


def test_substeps_follow_the_stiffest_mode(paper_rig: Rig) -> None:
    mechanism = Mechanism(paper_rig)
    assert stiffest_frequency(mechanism) == pytest.approx(898, abs=1)
    assert substeps(mechanism, 0.01) == 15
    assert substeps(Mechanism(paper_rig.with_values({"stepping.largest_step": "1 ms"})), 0.01) == 10
    with pytest.raises(RigError, match="too stiff for its lightest body"):
        substeps(Mechanism(paper_rig.with_values({"tendons.0.stiffness": 1e9})), 0.01)


def _parameters(*values: object) -> list[float]:
    return [
        float(value) for value in ca.Function("f", [], [ca.vertcat(*values)])()["o0"].full().ravel()
    ]  # type: ignore[arg-type]


def test_a_body_flies_off_a_stop_along_the_parabola_of_its_kick() -> None:
    """Hit time as a root of x + u τ + ½ A τ², A = (v⁺ − v)/t; it leaves with −e of its speed and
    falls on under A.

    The velocity given back is that at the end less the half kick that the next step adds: of it ½ A
    h is taken.
    """
    rng, e, h, flown = np.random.default_rng(4), 0.6, 1e-3, 0
    for _ in range(60):
        high = bool(rng.integers(2))
        side, length = (1.0 if high else -1.0), rng.uniform(0.4, 1.2) * h
        position, gap = (3e-3 if high else -2e-3), rng.uniform(0.1, 1.0) * 1e-3
        before, free = side * rng.uniform(0.2, 4.0, 2)
        x = position - side * gap
        a = (free - before) / length
        start = free - a * h / 2
        hits = [
            t.real
            for t in np.roots([a / 2, start, x - position])
            if abs(t.imag) < 1e-9 and 0 < t.real < h
        ]
        if not hits or side * (start + a * min(hits)) <= 0.0:
            continue
        hit = min(hits)
        left, away = h - hit, -e * (start + a * hit)
        end = position + away * left + a * left**2 / 2
        flies, after, bounced = _parameters(
            *bounce(e, ca.SX(high), ca.SX(position), Flight(free, x, before, length, h))
        )
        assert bool(flies) == (side * (end - position) < 0.0)
        assert bounced == pytest.approx(end, abs=1e-12)
        assert after == pytest.approx(away + a * left - a * h / 2, rel=1e-9, abs=1e-9)
        assert not _parameters(
            *bounce(0.0, ca.SX(high), ca.SX(position), Flight(free, x, before, length, h))
        )[0]
        flown += bool(flies)
    assert flown > 10


STOPS = {"joints.0.stops": [-0.2, 0.3], "drives.0.stops": [-2e-3, 3e-3]}


@pytest.mark.parametrize("last", [False, True])
def test_each_body_moves_as_if_it_were_alone(paper_rig: Rig, last: bool) -> None:
    """A link and two sliders at their stops, beyond them and between, in stick and slip: the kick
    of all bodies is the textbook's of each one.
    """
    mechanism, rng = Mechanism(paper_rig.with_values(STOPS)), np.random.default_rng(5)
    n, p = mechanism.n_bodies, mechanism.parameters
    symbols = [ca.SX.sym(name, size) for name, size in (("q", n), ("v", n), ("e", n), ("h", 1))]
    q, v, effort, h = symbols
    kick = Kick(q, v, effort, h, h)
    _, together = kick_and_drift(mechanism, kick, last)
    each = [one_body(mechanism, kick, body, last) for body in range(n)]
    alone = ca.vertcat(*(body.velocity for body in each))
    free = ca.vertcat(*(body.z for body in each))
    function = ca.Function("kick", [*symbols, p.symbols], [together, alone, free])
    stuck = moved = 0
    for _ in range(300):
        near = [rng.choice([-0.2, 0.3]), rng.choice([-2e-3, 3e-3]), 2e-3]
        at = near + rng.normal(size=n) * [1e-3, 1e-5, 1e-3]
        size = rng.choice([1e-3, 1.0])
        speeds = size * rng.normal(size=n) * [0.3, 0.03, 0.03]
        state = at, speeds, rng.normal(size=n) * [0.05, 5.0, 5.0]
        found, expected, pushed = (
            part.full().ravel() for part in function(*state, 10 ** rng.uniform(-5, -3), p.values)
        )
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)
        stuck += np.sum(found == 0.0)
        moved += np.sum(np.sign(found) != np.sign(pushed))
    assert stuck > 20
    assert moved > 20


def test_a_bounce_is_taken_only_where_a_stop_is_met(paper_rig: Rig) -> None:
    """With a coefficient of restitution a slider that stays off its stops moves as without; one
    that flies in comes back.
    """
    nothing = {
        f"drives.0.friction.{key}": {"value": 0.0, "std": 0.0} for key in ("load", "constant")
    }
    slack = {f"tendons.{i}.slack": 1.0 for i in (0, 1)}
    rig = paper_rig.with_values({**STOPS, **nothing, **slack, "drives.0.damping": 0.0})
    mechanism, h, half = Mechanism(rig), 1e-3, ca.DM([0, 0.5, 0])
    q, v = (ca.SX.sym(name, 3) for name in ("q", "v"))
    kick = Kick(q, v, ca.SX.zeros(3), ca.SX(h), ca.SX(h), rebound=ca.SX(half))
    p = mechanism.parameters
    function = ca.Function("kick", [q, v, p.symbols], [*kick_and_drift(mechanism, kick)])

    def slider(position: float, speed: float) -> list[float]:
        after = function([0.0, position, 0.0], [0.0, speed, 0.0], p.values)
        return [float(part[1]) for part in after]

    assert slider(0.0, 2.0) == pytest.approx([2e-3, 2.0])
    # after 0.5 ms at the stop 1 mm away, it goes back at half its speed for the other half
    assert slider(2e-3, 2.0) == pytest.approx([3e-3 - 0.5e-3, -1.0])
    assert slider(-1e-3, -2.0) == pytest.approx([-2e-3 + 0.5e-3, 1.0])
