"""End stops that logs show, and goals that are reached again and again, which are none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.from_logs.logs import Floats, drafted

RATE = 200.0
ARM = 8e-3
STIFFNESS = 3e3
SPEED = 4.0


def pair(
    seed: int,
    goals: Floats,
    stop: float,
    noise: float,
    play: float = 0.0,
    bend: int = 31,
    soft: float = 0.0,
) -> dict[str, Floats]:
    """Return a log of a joint between two sliders with load cells: between `goals` [rad] the
    joint would move at `SPEED`, and a wall holds it at `stop`, while its drives go on. Sliders
    wander by `play` [m], corners of the motion are rounded over `bend` samples, and the wall gives
    way by up to `soft` [rad] for 20 ms.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 30.0, 1.0 / RATE)
    ends = np.cumsum(np.repeat(np.abs(np.diff(goals)) / SPEED, 2) + 0.0)
    ends[0::2] += 0.3 * np.arange(len(ends[0::2]))
    ends[1::2] = ends[0::2] + 0.3
    knots = np.concatenate([[0.0], np.sort(ends)])
    wished = np.interp(time, knots, np.repeat(goals, 2)[: len(knots)])
    smooth = np.hanning(bend) / np.sum(np.hanning(bend))
    wished = np.convolve(np.pad(wished, bend // 2, mode="edge"), smooth, mode="valid")
    angle = np.maximum(wished, stop)
    held = wished < stop
    for hit in np.flatnonzero(held[1:] & ~held[:-1]):
        given = angle[hit : hit + 5]
        given -= soft * rng.uniform(0.2, 1.0) * np.hanning(7)[1:-1][: len(given)]
    pressed = (angle - wished) * STIFFNESS * ARM
    level = 8.0 + 3.0 * np.sin(0.8 * time + seed)
    columns = {"time_s": time}
    for name, side, more in (("a", 1.0, 0.0), ("b", -1.0, pressed)):
        pull = level + more
        slider = side * (ARM * angle + play * np.sin(1.7 * time + seed)) + pull / STIFFNESS
        columns[f"x_{name}_mm"] = 1e3 * slider + rng.normal(0.0, 2e-3, len(time))
        columns[f"F_{name}_N"] = pull + rng.normal(0.0, 0.05, len(time))
    columns["joint_deg"] = np.rad2deg(angle) + rng.normal(0.0, noise, len(time))
    return columns


def targets(seed: int) -> Floats:
    """Return angles [rad] that a motion goes to in turn."""
    return np.random.default_rng(seed).uniform(-0.9, 0.6, 40)


def without_forces(log: dict[str, Floats]) -> dict[str, Floats]:
    return {name: of for name, of in log.items() if not name.startswith("F")}


def stops_found(logs: list[dict[str, Floats]], folder: Path) -> tuple[float, float] | None:
    """Return the stops of the joint [deg]; that its upper one is a guess is said."""
    found = drafted(logs, folder)
    stops = found.rig.joints[0].stops
    assert ("the upper stop of a joint" in found.guesses) == (stops is not None)
    return None if stops is None else (np.rad2deg(stops[0]), np.rad2deg(stops[1]))


@pytest.mark.parametrize(("noise", "forces"), [(0.005, True), (0.005, False), (0.02, False)])
def test_a_wall_that_stops_a_joint_is_found(tmp_path: Path, noise: float, forces: bool) -> None:
    logs = [pair(k, targets(k), -0.5, noise) for k in range(3)]
    stops = stops_found(logs if forces else [*map(without_forces, logs)], tmp_path)
    assert stops is not None
    assert stops[0] == pytest.approx(np.rad2deg(-0.5), abs=0.3)
    assert stops[1] > 90.0  # the logs show one stop only


def test_a_soft_wall_is_where_the_joint_rests_in_it(tmp_path: Path) -> None:
    logs = [without_forces(pair(k, targets(k), -0.5, 0.005, soft=0.02)) for k in range(3)]
    stops = stops_found(logs, tmp_path)
    assert stops is not None
    assert stops[0] == pytest.approx(np.rad2deg(-0.5), abs=0.05)


@pytest.mark.parametrize(("play", "bend"), [(0.0, 31), (0.0, 1), (3e-4, 31)])
def test_goals_that_are_reached_again_are_no_stops(tmp_path: Path, play: float, bend: int) -> None:
    """A motion between two goals turns back at one angle too, where its drives do. A controller
    that reads the joint's angle reaches it wherever its drives are then, but not sharply.
    """
    goals = np.tile([-0.5, 0.5, 0.1], 12)
    logs = [pair(k, goals, -9.0, 0.01, play, bend) for k in range(3)]
    assert stops_found(logs, tmp_path) is None


@pytest.mark.parametrize(("play", "bend"), [(0.0, 31), (1e-3, 1)])
def test_turning_back_anywhere_is_no_stop(tmp_path: Path, play: float, bend: int) -> None:
    """Nor where it turns sharply, wherever its drives are: two of ninety turning points are close
    by chance.
    """
    logs = [pair(k, targets(k), -9.0, 0.01, play, bend) for k in range(3)]
    assert stops_found(logs, tmp_path) is None


def test_a_slow_camera_shows_no_stops(tmp_path: Path) -> None:
    """Between two samples of it a joint may lose its speed in any way."""
    logs = [without_forces(pair(k, targets(k), -0.5, 0.005)) for k in range(3)]
    slow = [{name: of[::20] for name, of in log.items()} for log in logs]
    assert stops_found(slow, tmp_path) is None
