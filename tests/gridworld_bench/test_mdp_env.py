import warnings

import numpy as np
import pytest
from worlds import KINDS, small_world

from gridworld_bench.mdp import solve

gym = pytest.importorskip("gymnasium")

from gymnasium.utils.env_checker import check_env  # noqa: E402

from gridworld_bench.envs import MdpEnv  # noqa: E402


@pytest.mark.parametrize("kind", KINDS)
def test_gymnasium_finds_nothing_to_complain_of(kind):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(MdpEnv(*small_world(kind)), skip_render_check=True)


@pytest.mark.parametrize("kind", KINDS)
def test_the_table_has_the_values_of_the_world(kind):
    mdp, weights = small_world(kind)
    table = MdpEnv(mdp, weights).P
    values = np.zeros(mdp.num_states)
    for _ in range(600):
        values = np.array(
            [
                max(
                    sum(
                        chance * (reward + (not is_end) * mdp.discount * values[there])
                        for chance, there, reward, is_end in outcomes
                    )
                    for outcomes in table[state].values()
                )
                for state in range(mdp.num_states)
            ]
        )
    expected = solve(mdp, mdp.rewards(weights)).values
    is_going = ~mdp.is_terminal
    np.testing.assert_allclose(values[is_going], expected[is_going], atol=1e-9)


def test_an_episode_ends_where_the_world_does():
    mdp, weights = small_world("ends")
    env = MdpEnv(mdp, weights)
    assert env.reset(seed=0)[0] in (0, 1, 8)
    env._state = 2
    state, reward, is_end, is_cut, _ = env.step(3)
    rewards = mdp.rewards(weights)
    assert (state, is_end, is_cut) == (3, True, False)
    assert reward == pytest.approx(rewards[2] + 0.95 * rewards[3])
