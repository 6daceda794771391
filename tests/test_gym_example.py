"""The Gymnasium environment: its interface, its draws, and what an action does."""

from __future__ import annotations

import re
from typing import Any

import gymnasium
import numpy as np
import pytest
from examples.gym.tendon_env import LARGEST_EFFORT, TendonEnv
from gymnasium.utils.env_checker import check_env

from distal import load_scenario
from distal.errors import ControlError
from distal.simulation import Scenario


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return load_scenario("control-paper").model_copy(update={"duration": 1.0})


@pytest.fixture(scope="module")
def env(scenario: Scenario) -> TendonEnv:
    return TendonEnv(scenario)


@pytest.mark.filterwarnings(
    "ignore:.*WARN"
)  # gymnasium advises bounds and ranges that sensors do not have
def test_gymnasium_finds_nothing_wrong(scenario: Scenario) -> None:
    check_env(TendonEnv(scenario), skip_render_check=True)


def test_an_episode(scenario: Scenario) -> None:
    """A hundred periods, then it is over."""
    env, rewards, done = TendonEnv(scenario), [], False
    env.reset(seed=1)
    while not done:
        _, reward, ended, done, info = env.step(np.array([0.3, 0.2], dtype=np.float32))
        assert not ended
        rewards.append(reward)
    assert len(rewards) == 100
    assert info["health"] == "untested"
    assert rewards[-1] == pytest.approx(-abs(np.asarray(info["angles"])[0]))
    with pytest.raises(ControlError, match="over; call reset"):
        env.step(np.zeros(2, dtype=np.float32))


def test_an_episode_depends_on_its_seed_and_not_on_what_was_before(
    scenario: Scenario, env: TendonEnv
) -> None:
    """Kernel and filter are kept from reset to reset; an environment made anew gives the same
    numbers.
    """

    def episode(of: TendonEnv, seed: int = 7) -> list[np.ndarray]:
        return [of.reset(seed=seed)[0], *(of.step(np.array([0.3, 0.2]))[0] for _ in range(30))]

    env.reset(seed=3)
    for _ in range(40):
        env.step(np.array([0.9, 0.0]))
    found = episode(env)
    np.testing.assert_array_equal(found, episode(TendonEnv(scenario)))
    assert not np.array_equal(found, episode(env, seed=8))


def test_an_action_is_a_share_of_a_drives_limit(scenario: Scenario) -> None:
    env = TendonEnv(scenario, drawn=False)
    assert env.action_space.low.tolist() == [0.0, 0.0]
    env.reset(seed=0)
    for _ in range(60):
        observation, *_ = env.step(np.array([0.2, 0.1], dtype=np.float32))
    forces = [k for k, sensor in enumerate(env._rig.sensors) if sensor.measures == "force"]
    assert observation[forces] == pytest.approx(
        [0.2 * LARGEST_EFFORT, 0.1 * LARGEST_EFFORT], abs=1.0
    )


def test_an_action_outside_of_the_space_is_clipped_to_it(env: TendonEnv) -> None:
    def after(action: list[float]) -> np.ndarray:
        env.reset(seed=5)
        return np.array([env.step(np.array(action))[0] for _ in range(20)])

    np.testing.assert_array_equal(after([2.0, 4.0]), after([1.0, 1.0]))
    np.testing.assert_array_equal(after([0.5, -3.0]), after([0.5, 0.0]))


@pytest.mark.parametrize("action", [0.5, [0.5], [0.5, 0.2, 0.1], [0.5, np.nan], [np.inf, 0.0]])
def test_an_action_that_is_none_is_refused(env: TendonEnv, action: Any) -> None:
    env.reset(seed=1)
    said = re.escape(f"a finite number for each of left, right; {action} came")
    with pytest.raises(ControlError, match=said):
        env.step(action)


def test_a_step_before_the_reset_says_so(scenario: Scenario) -> None:
    with pytest.raises(gymnasium.error.ResetNeeded, match="call reset before the first step"):
        TendonEnv(scenario).step(np.array([0.1, 0.1], dtype=np.float32))


def test_a_scenario_without_a_reference_is_refused() -> None:
    with pytest.raises(ControlError, match=r"TendonEnv: the scenario has no \[control\]"):
        TendonEnv("series-1")
