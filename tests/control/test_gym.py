"""The Gymnasium environment: its interface, its draws, and what an action does."""

from __future__ import annotations

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from distal import load_scenario
from distal.errors import ControlError
from distal.gym import LARGEST, TendonEnv
from distal.simulation import Scenario


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return load_scenario("control-paper").model_copy(update={"duration": 1.0})


@pytest.mark.filterwarnings("ignore:.*WARN")  # gymnasium advises bounds and ranges that sensors do not have
def test_gymnasium_finds_nothing_wrong(scenario: Scenario) -> None:
    check_env(TendonEnv(scenario), skip_render_check=True)


def test_an_episode(scenario: Scenario) -> None:
    """A hundred periods; the same seed gives the same plant and noise, another one does not."""
    env = TendonEnv(scenario)
    ends, first = [], []
    for seed in (1, 1, 2):
        observation, _ = env.reset(seed=seed)
        first.append(observation)
        rewards, done = [], False
        while not done:
            observation, reward, ended, done, info = env.step(np.array([0.3, 0.2], dtype=np.float32))
            assert not ended
            rewards.append(reward)
        assert len(rewards) == 100
        ends.append(observation)
    np.testing.assert_array_equal(ends[0], ends[1])
    assert not np.array_equal(ends[0], ends[2])
    assert info["health"] == "ok"
    # four readings, an angle with its std, and the reference, which is 0 in the first second
    assert first[0].shape == (7,)
    assert first[0][6] == 0.0
    assert rewards[-1] == pytest.approx(-abs(np.asarray(info["angles"])[0]))


def test_an_action_is_a_share_of_a_drives_limit(scenario: Scenario) -> None:
    env = TendonEnv(scenario, drawn=False)
    assert env.action_space.low.tolist() == [0.0, 0.0]
    env.reset(seed=0)
    for _ in range(60):
        observation, *_ = env.step(np.array([0.2, 0.1], dtype=np.float32))
    forces = [k for k, sensor in enumerate(env._rig.sensors) if sensor.measures == "force"]
    assert observation[forces] == pytest.approx([0.2 * LARGEST, 0.1 * LARGEST], abs=1.0)


def test_a_scenario_without_a_reference_is_refused() -> None:
    with pytest.raises(ControlError, match=r"TendonEnv: the scenario has no \[control\]"):
        TendonEnv("series-1")
