"""The inverse: least pulls against a linear programme, places against the model's balance."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import linprog

from distal import Rig, load_rig
from distal.errors import CommandError
from distal.inverse import Commands, Inverse
from distal.inverse.feedforward import least_pulls, solved
from distal.rig import number
from distal.study.design_space import draws_of
from tests.learned_maps import constant_map

TIME = np.arange(0.0, 8.0, 0.01)


def finger(inverse: Inverse, middle: float = 0.35, size: float = 0.25) -> Commands:
    """Return commands for slow sines of all joints that move by themselves."""
    rates = 1.5 + 0.3 * np.arange(len(inverse.joints))
    return inverse(TIME, middle + size * np.sin(np.outer(TIME, rates)))


@pytest.mark.parametrize("seed", range(30))
def test_the_least_pulls_are_those_of_a_linear_programme(seed: int) -> None:
    """Against SciPy's HiGHS, for n + 1 and 2 n tendons, whatever the size of the arms: a
    determinant is small without being zero.
    """
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 4))
    m = n + 1 if seed % 2 else 2 * n
    balance = rng.uniform(0.5, 2.0, m)  # pulls that turn no joint
    arms = rng.normal(size=(n, m)) * 1e-2
    arms -= np.outer(arms @ balance, balance) / (balance @ balance)
    torques, lowest = rng.normal(size=n) * 0.05, rng.uniform(0.5, 3.0, m)
    size = 10.0 ** -(seed % 3)
    pulls = np.array(
        ca.evalf(least_pulls(*map(ca.SX, (size * arms, size * torques, lowest)), [True] * m))
    ).ravel()
    known = linprog(
        np.ones(m), A_eq=arms, b_eq=torques, bounds=[(low, None) for low in lowest], method="highs"
    )
    assert known.success
    assert pulls.sum() == pytest.approx(known.fun, rel=1e-6)
    np.testing.assert_allclose(arms @ pulls, torques, atol=1e-12)
    assert np.all(pulls >= lowest - 1e-9)


def test_soft_joints_are_solved_and_a_singular_matrix_gives_zero() -> None:
    for matrix, expected in ((-1e-9 * np.eye(2), [-1e9, -2e9]), ([[1.0, 2.0], [2.0, 4.0]], [0, 0])):
        found = ca.evalf(solved(ca.SX(ca.DM(matrix)), ca.SX([1.0, 2.0])))
        assert np.array(found).ravel() == pytest.approx(expected)


@pytest.mark.parametrize(
    "name", ["paper-2008", "lab-bench", "finger-2n", "finger-n-plus-1", "wrist-instrument"]
)
def test_at_the_places_the_joints_lack_nothing(name: str) -> None:
    """Moving on, a joint's tendons pull what its motion and all of its friction need; and no tendon
    is too loose.
    """
    rig = load_rig(name)
    if name == "paper-2008":  # its sliders have little room, and commands end there
        rig = rig.with_values({f"drives.{i}.stops": [-0.05, 0.05] for i in range(2)})
    inverse = Inverse(rig, least_tension="2 N", compiled=False)
    commands = finger(inverse)
    model, mechanism = inverse.model, inverse.model.mechanism
    p, nj = mechanism.parameters.values, mechanism.n_joints
    q = ca.SX.sym("q", mechanism.n_bodies)
    forces = mechanism.pulls(q, ca.SX.zeros(mechanism.n_bodies)).forces
    pulled = ca.Function("pulled", [q, mechanism.parameters.symbols], [forces[:nj]])
    speeds = np.gradient(commands.angles, TIME, axis=0)
    accelerations = np.gradient(speeds, TIME, axis=0)
    moving = np.flatnonzero(np.all(np.abs(speeds) > 0.1, axis=1) & (TIME > 0.5))
    assert len(moving) > 50
    for k in moving[::20]:
        angles, positions = commands.angles[k], commands.positions[k]
        needed, limits = model.needed(
            angles, speeds[k], accelerations[k], positions, np.sign(speeds[k]), np.zeros(nj), p
        )
        made = np.array(pulled(np.concatenate([angles, positions]), p)).ravel()
        size = float(np.array(limits).max())
        np.testing.assert_allclose(made, np.array(needed).ravel(), atol=2e-3 * size + 1e-7)
    if all(model.one_sided):
        assert commands.tensions.min() >= 2.0 - 1e-6
    assert commands.notes == ()


def test_the_least_tension_is_kept_by_tendons_that_are_softer_than_the_file_says() -> None:
    """Exactly known tendons hold what is asked for; those that are known to 10 % hold 1.96 × 10 %
    more in the model.
    """
    for std, most in ((0.0, 1.0), (0.1, 1.0 + 1.96 * 0.1)):
        known = {"value": 2500.0, "std": 2500.0 * std}
        rig = load_rig("finger-2n").with_values({f"tendons.{i}.stiffness": known for i in range(4)})
        commands = finger(Inverse(rig, least_tension="2 N", compiled=False))
        pulls = commands.tensions.min(axis=1)  # at the drives; sliders rub, tendons do not
        np.testing.assert_allclose(pulls[50:], 2.0 * most, rtol=1e-3)


@pytest.mark.parametrize("desired", [30.0, 60.0, -60.0])
def test_a_joint_whose_drives_end_rests_where_friction_holds_it(desired: float) -> None:
    """|r(θ, s)| ≤ l at the places that are sent, on the way that the joint came."""
    inverse = Inverse(load_rig("paper-2008"), compiled=False)
    time = np.linspace(0.0, 2.0, 100)
    way = 0.5 - 0.5 * np.cos(np.pi * time / 2.0)
    commands = inverse(time, np.deg2rad(desired) * way[:, None])
    model = inverse.model
    free, positions = ca.SX.sym("free", model.nf), ca.SX.sym("positions", model.nd)
    still = ca.SX.zeros(model.nf)
    p = model.mechanism.parameters
    look = ca.Function("look", [free, positions, p.symbols], model.lacking(free, positions, still))
    lacks, friction = look(commands.angles[-1], commands.positions[-1], p.values)
    assert abs(float(lacks)) <= 1.001 * float(friction)
    reached = np.rad2deg(commands.angles[:, 0]) * np.sign(desired)
    assert 15.0 < reached[-1] < abs(desired)
    assert (np.diff(reached) > -0.5).all()
    assert "cannot do what is wanted" in " ".join(commands.notes)
    assert "would have to go beyond its range" in " ".join(commands.notes)
    low, high = np.array([drive.stops for drive in inverse.rig.drives]).T
    assert np.all((commands.positions >= low) & (commands.positions <= high))


def test_what_a_map_adds_is_taken_off_what_is_wanted() -> None:
    """A map that adds 0.02 rad: the commands are those of a rig without it for angles that are so
    much smaller.
    """
    rig = load_rig("capstan-joint")
    learned = constant_map("jaw", ("motor_angle", "motor_torque"), 0.02, 0.01)
    plain, mapped = (Inverse(one, compiled=False) for one in (rig, rig.with_map(filter=[learned])))
    desired = 0.3 + 0.1 * np.sin(TIME)
    with_map, without = mapped(TIME, desired), plain(TIME, desired - 0.02)
    late = TIME > 1.0
    np.testing.assert_allclose(with_map.positions[late], without.positions[late], atol=1e-6)
    np.testing.assert_allclose(with_map.angles[late], without.angles[late] + 0.02, atol=1e-6)
    extra = with_map.stds[late] ** 2 - without.stds[late] ** 2
    np.testing.assert_allclose(extra, 0.01**2, rtol=1e-3)


def test_fewer_drives_than_joints_go_to_the_nearest_and_say_so() -> None:
    inverse = Inverse("finger-underactuated", compiled=False)
    commands = finger(inverse)
    assert any("follow their springs" in note for note in commands.notes)
    away = np.sqrt(np.mean((commands.angles - commands.desired) ** 2))
    assert away < np.std(commands.desired)


def test_what_cannot_be_reached_is_said() -> None:
    inverse = Inverse(load_rig("finger-2n"), compiled=False)
    beyond = finger(inverse, middle=1.5, size=0.5)
    assert any("beyond its stops" in note for note in beyond.notes)
    limited = finger(Inverse(load_rig("finger-2n", ["drives.mcp_f.limit=0.5"]), compiled=False))
    assert any("its limit is 0.5 N" in note for note in limited.notes)


def test_commands_are_written_by_the_rigs_own_columns(tmp_path: Path) -> None:
    commands = finger(Inverse("lab-bench", compiled=False))
    columns = commands.columns()
    counts = columns["motor_counts"]
    np.testing.assert_allclose(
        counts, commands.positions[:, 0] * 30 * 2000 / (2 * np.pi), rtol=1e-9
    )
    assert {"time_ms", "current_mA", "theta [rad]", "theta_std [rad]"} <= set(columns)
    commands.write(tmp_path / "commands.csv")
    assert (tmp_path / "commands.csv").read_text().startswith("time_ms,")


@pytest.mark.parametrize(
    ("time", "angles", "word"),
    [
        (TIME, {"mcp": TIME}, "mcp, pip"),
        (TIME, [[0.0] * 3] * len(TIME), "2 angles"),
        (TIME, [[np.nan] * 2] * len(TIME), "finite"),
        (TIME, [[60.0] * 2] * len(TIME), "mcp is wanted at 60 rad at 0 s; .* turns beyond 50"),
        (TIME[::-1], [[0.0] * 2] * len(TIME), "rise"),
        ([0.0], [[0.0] * 2], "two stamps"),
    ],
)
def test_wrong_wishes_are_refused(time: object, angles: object, word: str) -> None:
    with pytest.raises(CommandError, match=word):
        Inverse("finger-2n", compiled=False)(time, angles)  # type: ignore[arg-type]


def test_friction_is_made_up_for_in_the_direction_of_motion() -> None:
    """Up and down through one angle the motor is 2 (l + b ω)/(2 k r²) r/R apart: l = μ r_a Σ T of
    both cables.
    """
    angles = 0.3 * (1 - np.abs(TIME / 4.0 - 1.0))
    commands = Inverse("lab-bench", compiled=False)(TIME, angles[:, None])
    up, down = 200, 600
    assert angles[up] == pytest.approx(angles[down])
    limit, softness = 0.15 * 2e-3 * commands.tensions[up].sum(), 1 / (2 * 20e3 * 8e-3**2)
    apart = float(commands.positions[up, 0] - commands.positions[down, 0])
    assert apart == pytest.approx(2 * (limit + 1e-3 * 0.075) * softness * 8e-3 / 5e-3, rel=1e-3)


def test_the_band_is_what_the_numbers_stds_move_the_joint_by() -> None:
    """By differences: a rig with one number off needs other places, and by dθ/ds the joint would be
    off by as much.

    At the start friction holds the joint anywhere within ± l of its balance: a third of (l/K)²
    more.
    """
    # pre-tension that is hardly known would hide all else
    tight = [f'tendons.{name}.pretension.std="0 N"' for name in ("flexor", "extensor")]
    rig, time = load_rig("lab-bench", tight), TIME[:200]
    draws, angles, share = draws_of(rig), (0.1 + 0.2 * time)[:, None], 0.1

    def positions(of: Rig, further: float = 0.0) -> np.ndarray:
        return Inverse(of, compiled=False)(time, angles + further).positions[[0, 150], 0]

    commands, right = Inverse(rig, compiled=False)(time, angles), positions(rig)
    slope = (positions(rig, 1e-3) - right) / 1e-3
    off = np.zeros(2)
    for draw in draws:
        paths = [p for p in draw.paths if not p.startswith("sensors") and ".initial" not in p]
        known = {path: number(rig, path).value for path in paths}
        values = {
            path: value + share * draw.std * (value if draw.common else 1.0)
            for path, value in known.items()
        }
        off += ((positions(rig.with_values(values)) - right) / slope / share) ** 2
    limit, stiffness = 0.15 * 2e-3 * commands.tensions[0].sum(), 2 * 20e3 * 8e-3**2
    off[0] += (limit / stiffness) ** 2 / 3
    np.testing.assert_allclose(commands.stds[[0, 150], 0], np.sqrt(off), rtol=0.03)
