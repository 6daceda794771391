"""The Gymnasium environment: its interface, its draws, and what an action does."""

from __future__ import annotations

from time import perf_counter
from typing import Any

import gymnasium
import numpy as np
import pytest
from examples.gym.tendon_env import LARGEST_EFFORT, TendonEnv
from gymnasium.utils.env_checker import check_env
from pettingzoo import ParallelEnv
from pettingzoo.test import parallel_api_test, parallel_seed_test

from distal import load_rig, load_scenario
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


class Alone(ParallelEnv[str, Any, Any]):
    """The environment as PettingZoo's with one agent, for its checks, which share no code with
    gymnasium's.
    """

    metadata = {"name": "tendon"}  # noqa: RUF012
    possible_agents = ["one"]  # noqa: RUF012

    def __init__(self, env: TendonEnv) -> None:
        self.env, self.agents, self.render_mode = env, [], None

    def observation_space(self, agent: str) -> Any:
        return self.env.observation_space

    def action_space(self, agent: str) -> Any:
        return self.env.action_space

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        self.agents = ["one"]
        return tuple({"one": part} for part in self.env.reset(seed=seed, options=options))

    def step(self, actions: Any) -> Any:
        identified = self.env.step(actions["one"])
        if identified[2] or identified[3]:
            self.agents = []
        return tuple({"one": part} for part in identified)


def test_pettingzoo_finds_nothing_wrong(scenario: Scenario) -> None:
    parallel_api_test(Alone(TendonEnv(scenario)), num_cycles=150)
    parallel_seed_test(lambda: Alone(TendonEnv(scenario)), num_cycles=30)


def test_it_takes_another_rig(scenario: Scenario) -> None:
    env = TendonEnv(scenario, rig="paper-2008-soft")
    assert env._rig == load_rig("paper-2008-soft")
    env.reset(seed=3)
    assert env.observation_space.contains(env.step(env.action_space.sample())[0])


def test_names_of_what_is_observed_and_acted(scenario: Scenario, env: TendonEnv) -> None:
    observation, info = env.reset(seed=1)
    assert info == {
        "observed": ("x1", "u1", "x2", "u2", "theta", "theta_std", "wanted_link"),
        "acted": ("left", "right"),
    }
    assert (info["observed"], info["acted"]) == (env.observed, env.acted)
    identified = dict(zip(env.observed, observation))
    assert identified["wanted_link"] == 0.0
    assert identified["theta_std"] == np.float32(env._monitor._live.angle_stds[0])
    for name in env.observed[:4]:  # what the plant's sensors have read
        assert identified[name] == np.float32(env._plant.log().channels[name][0])


def test_an_episode(scenario: Scenario) -> None:
    """A hundred periods; the same seed gives the same plant and noise, another one does not."""
    env = TendonEnv(scenario)
    ends, first = [], []
    for seed in (1, 1, 2):
        observation, _ = env.reset(seed=seed)
        first.append(observation)
        rewards, done = [], False
        while not done:
            observation, reward, ended, done, info = env.step(
                np.array([0.3, 0.2], dtype=np.float32)
            )
            assert not ended
            rewards.append(reward)
        assert len(rewards) == 100
        ends.append(observation)
    np.testing.assert_array_equal(ends[0], ends[1])
    assert not np.array_equal(ends[0], ends[2])
    assert info["health"] == "untested"
    # four readings, an angle with its std, and the reference, which is 0 in the first second
    assert first[0].shape == (7,)
    assert first[0][6] == 0.0
    assert rewards[-1] == pytest.approx(-abs(np.asarray(info["angles"])[0]))
    with pytest.raises(ControlError, match="over; call reset"):
        env.step(np.zeros(2, dtype=np.float32))


def test_an_episode_depends_on_its_seed_and_not_on_what_was_before(
    scenario: Scenario, env: TendonEnv
) -> None:
    """Kernel and filter are kept from reset to reset; an environment made anew gives the same
    numbers.
    """

    def episode(of: TendonEnv) -> list[np.ndarray]:
        return [of.reset(seed=7)[0], *(of.step(np.array([0.3, 0.2]))[0] for _ in range(30))]

    env.reset(seed=3)
    for _ in range(40):
        env.step(np.array([0.9, 0.0]))
    np.testing.assert_array_equal(episode(env), episode(TendonEnv(scenario)))


def test_a_reset_compiles_nothing(env: TendonEnv, monkeypatch: pytest.MonkeyPatch) -> None:
    env.reset(seed=0)

    def refused(*_: object) -> None:
        raise AssertionError("a reset builds no kernel")

    monkeypatch.setattr("distal.kernels.kernel.Kernel.__init__", refused)
    times = []
    for seed in range(5):
        begun = perf_counter()
        env.reset(seed=seed)
        times.append(perf_counter() - begun)
    assert (
        min(times) < 0.05
    )  # some 10 ms, of which other work on the machine may make more; it was 80 to 150


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


@pytest.mark.parametrize(
    ("action", "said"),
    [
        (0.5, r"a finite number for each of left, right; 0.5 came"),
        ([0.5], r"each of left, right; \[0.5\] came"),
        ([0.5, 0.2, 0.1], r"each of left, right; \[0.5, 0.2, 0.1\] came"),
        ([0.5, np.nan], r"each of left, right; \[0.5, nan\] came"),
        ([np.inf, 0.0], r"each of left, right; \[inf, 0.0\] came"),
    ],
)
def test_an_action_that_is_none_is_refused(env: TendonEnv, action: Any, said: str) -> None:
    env.reset(seed=1)
    with pytest.raises(ControlError, match=said):
        env.step(action)


def test_a_step_before_the_reset_says_so(scenario: Scenario) -> None:
    with pytest.raises(gymnasium.error.ResetNeeded, match="call reset before the first step"):
        TendonEnv(scenario).step(np.array([0.1, 0.1], dtype=np.float32))


def test_a_scenario_without_a_reference_is_refused() -> None:
    with pytest.raises(ControlError, match=r"TendonEnv: the scenario has no \[control\]"):
        TendonEnv("series-1")
