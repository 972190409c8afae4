import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse.csgraph import connected_components
from scipy.stats import chi2

from gridworld_bench import mdp as mdp_module
from gridworld_bench.driving import draw_states, drive, find_riskiest, try_out
from gridworld_bench.highway import (
    ACTIONS,
    DRIVERS,
    FEATURES,
    STAY,
    Highway,
    Situation,
    driver_weights,
    stationary_probabilities,
)
from gridworld_bench.mdp import optimal_values, solve
from gridworld_bench.posterior import CoordinateChain, infer
from gridworld_bench.road_picture import draw_road


@pytest.fixture(scope="module")
def highway():
    return Highway(6)


def test_cars_come_closer_and_come_back_at_the_far_end():
    road = Highway(3)
    state = road.state_of(Situation(2, ((1, 0), (3, 2))))
    reached = {
        road.situations[there]: chance
        for there, chance in zip(
            road.mdp.successors[state, ACTIONS.index("right")],
            road.mdp.probabilities[state, ACTIONS.index("right")],
            strict=True,
        )
        if chance > 0.0
    }
    assert reached == {
        Situation(3, ((3, 1),)): pytest.approx(0.7),
        Situation(3, ((1, 2), (3, 1))): pytest.approx(0.1),
        Situation(3, ((2, 2), (3, 1))): pytest.approx(0.1),
        Situation(3, ((3, 1), (3, 2))): pytest.approx(0.1),
    }


def test_the_sides_end_at_the_grass(highway):
    for agent, action in ((0, "left"), (4, "right")):
        state = highway.state_of(Situation(agent, ()))
        reached = highway.mdp.successors[state, ACTIONS.index(action)]
        assert {highway.situations[there].agent for there in reached} == {agent}


def test_rows_sum_to_one_and_every_state_can_be_reached(highway):
    mdp = highway.mdp
    np.testing.assert_allclose(mdp.probabilities.sum(axis=-1), 1.0, rtol=1e-12)
    graph = sum(
        mdp.transitions(np.full(mdp.num_states, action))
        for action in range(mdp.num_actions)
    )
    assert connected_components(graph, connection="strong")[0] == 1


def test_features_by_hand():
    road = Highway(5)

    def features_of(agent, *cars):
        row = road.mdp.features[road.state_of(Situation(agent, cars))]
        return {name for name, value in zip(FEATURES, row, strict=True) if value}

    assert features_of(0, (1, 0)) == {"grass"}
    assert features_of(1, (1, 0), (2, 0)) == {"left lane", "collision", "car beside"}
    assert features_of(2, (2, 3), (2, 2)) == {"middle lane", "car 2 ahead"}
    assert features_of(3, (3, 4), (2, 1)) == {"right lane"}
    assert features_of(3, (3, 3), (3, 4)) == {"right lane", "car 3 ahead"}
    assert road.mdp.discount == 0.9


def test_values_are_those_of_brute_force_on_a_tiny_road():
    mdp = Highway(2).mdp
    weights = driver_weights("safe")
    rewards, values = mdp.rewards(weights), np.zeros(mdp.num_states)
    for _ in range(400):
        for_each = [
            [
                sum(
                    chance * values[there]
                    for there, chance in zip(
                        mdp.successors[s, a], mdp.probabilities[s, a], strict=True
                    )
                )
                for a in range(3)
            ]
            for s in range(mdp.num_states)
        ]
        values = rewards + mdp.discount * np.max(for_each, axis=1)
    np.testing.assert_allclose(solve(mdp, rewards).values, values, atol=1e-9)


def test_values_by_sweeps_are_exact_enough(highway):
    mdp = highway.mdp
    assert len(mdp.compiled.starts) > 1
    for driver in DRIVERS:
        weights = driver_weights(driver)
        found = optimal_values(mdp, weights[None])[0]
        expected = solve(mdp, mdp.rewards(weights)).values
        np.testing.assert_allclose(found, expected, atol=1e-6)


def test_scripted_drivers_drive_as_they_are_called(highway):
    mdp = highway.mdp
    spent = {
        name: stationary_probabilities(mdp, highway.driver_policy(name))
        for name in DRIVERS
    }
    assert spent["safe"] @ highway.is_collision < 1e-9
    assert spent["safe"] @ highway.is_on_grass < 1e-9
    assert spent["reckless"] @ highway.is_collision > 0.03
    in_right_lane = mdp.features[:, FEATURES.index("right lane")]
    assert spent["right-lane"] @ in_right_lane > spent["safe"] @ in_right_lane


def test_a_simulated_record_agrees_with_the_stationary_probabilities(highway):
    policy = highway.driver_policy("reckless")
    spent = stationary_probabilities(highway.mdp, policy)
    record = try_out(highway, policy, 5000, rng=np.random.default_rng(0))
    expected = 5000 * spent @ highway.is_collision
    assert record.off_road == 0
    assert abs(record.collisions - expected) < 4.0 * np.sqrt(expected)


def test_more_of_the_drive_makes_the_robot_safer():
    road = Highway(6)
    driven = drive(road, "safe", 40, rng=np.random.default_rng(3))
    rates = []
    for num in (2, 40):
        posterior = infer(
            road.mdp,
            [driven.first(num).evidence],
            CoordinateChain(num_samples=300),
            rng=np.random.default_rng(0),
        )
        own = solve(road.mdp, road.mdp.rewards(posterior.map_weights)).policy
        rates.append(stationary_probabilities(road.mdp, own) @ road.is_collision)
    assert rates[1] <= rates[0]


@pytest.mark.parametrize("driver", DRIVERS)
def test_a_scripted_drive_does_in_each_situation_what_the_driver_does(highway, driver):
    policy, mdp = highway.driver_policy(driver), highway.mdp
    for seed in range(8):
        driven = drive(highway, driver, 9, rng=np.random.default_rng(seed))
        states, actions = np.array(driven.states), np.array(driven.actions)
        assert (actions == policy[states]).all()
        start = highway.situations[states[0]]
        assert not start.is_on_grass
        assert not start.is_collision
        for state, action, there in zip(states, actions, states[1:], strict=False):
            is_there = mdp.successors[state, action] == there
            assert mdp.probabilities[state, action][is_there].sum() > 0.0


def test_a_policy_that_goes_to_and_fro_spends_half_of_the_time_on_each_side(highway):
    agents = np.array([each.agent for each in highway.situations])
    spent = stationary_probabilities(highway.mdp, np.where(agents > 1, 0, 2))
    sides = [spent[agents == side].sum() for side in (1, 2)]
    assert sides == pytest.approx([0.5, 0.5], abs=1e-6)


def test_a_chain_by_sweeps_accepts_what_one_by_linear_systems_does(monkeypatch):
    kept = []
    for most_dense in (0, 10_000):
        monkeypatch.setattr(mdp_module, "_MOST_DENSE", most_dense)
        road = Highway(2)
        assert (len(road.mdp.compiled.starts) > 1) == (most_dense == 0)
        driven = drive(road, "safe", 12, rng=np.random.default_rng(5))
        posterior = infer(
            road.mdp,
            [driven.evidence],
            CoordinateChain(num_samples=300),
            rng=np.random.default_rng(0),
        )
        kept.append(posterior)
    np.testing.assert_array_equal(kept[0].weights, kept[1].weights)
    np.testing.assert_allclose(kept[0].log_posts, kept[1].log_posts, atol=1e-5)


def test_leaving_the_road_is_counted_as_that(highway):
    left = np.full(highway.mdp.num_states, ACTIONS.index("left"))
    record = try_out(highway, left, 10, rng=np.random.default_rng(0))
    assert record.off_road == 9  # The first step leads into the left lane.
    assert record.collisions <= 1


def test_states_are_drawn_once(highway):
    mdp = highway.mdp
    drawn = draw_states(mdp, 10**6, rng=np.random.default_rng(0))
    assert sorted(drawn) == list(range(mdp.num_states))


def test_the_riskiest_states_come_first():
    riskiest = find_riskiest(np.arange(20, 35), np.r_[0.2, 0.5, np.full(13, 0.1)])
    assert riskiest.states.tolist() == [21, 20, *range(22, 30)]
    assert riskiest.var.tolist() == [0.5, 0.2, *[0.1] * 8]


@given(st.integers(2, 8), st.data())
def test_situations_and_states_name_each_other(length, data):
    road = Highway(length)
    state = data.draw(st.integers(0, len(road.situations) - 1))
    assert road.state_of(road.situations[state]) == state


@pytest.mark.parametrize("situation", [Situation(5, ()), Situation(2, ((1, 6),))])
def test_what_is_not_on_the_road_is_refused(highway, situation):
    with pytest.raises(ValueError, match="not on a road"):
        highway.state_of(situation)


def test_a_road_of_one_step_is_refused():
    with pytest.raises(ValueError, match="at least 2"):
        Highway(1)


def test_the_environment_follows_the_table():
    gym = pytest.importorskip("gymnasium")
    from gymnasium.utils.env_checker import check_env

    from gridworld_bench.envs import HighwayEnv

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(HighwayEnv(3, render_mode="rgb_array"), skip_render_check=True)
    env = gym.make("gridworld_bench/Highway-v0", length=2, max_episode_steps=20_000)
    mdp, rng = env.unwrapped.mdp, np.random.default_rng(0)
    state, _ = env.reset(seed=0)
    counts = {}
    for action in rng.integers(3, size=10_000).tolist():
        there, *_ = env.step(action)
        seen = counts.setdefault((state, action), {})
        seen[there] = seen.get(there, 0) + 1
        state = there
    statistic, freedom = 0.0, 0
    for (state, action), seen in counts.items():
        total = sum(seen.values())
        chances = {}
        for there, chance in zip(
            mdp.successors[state, action], mdp.probabilities[state, action], strict=True
        ):
            chances[there] = chances.get(there, 0.0) + chance
        expected = {
            there: total * chance for there, chance in chances.items() if chance
        }
        assert set(seen) <= set(expected)
        if min(expected.values()) >= 5.0:
            freedom += len(expected) - 1
            statistic += sum(
                (seen.get(there, 0) - mean) ** 2 / mean
                for there, mean in expected.items()
            )
    assert freedom > 50
    assert chi2.sf(statistic, freedom) > 0.01


def test_the_environment_shows_the_road_move_and_lists_what_can_be():
    pytest.importorskip("gymnasium")
    from gridworld_bench.envs import HighwayEnv

    env = HighwayEnv(length=3, render_mode="rgb_array")
    env.reset(seed=0)
    state, *_ = env.step(STAY)
    expected = draw_road(env.highway.situations[state], 3, 1)
    np.testing.assert_array_equal(env.render(), expected)
    chances = [
        outcome[0]
        for actions in env.P.values()
        for outcomes in actions.values()
        for outcome in outcomes
    ]
    assert min(chances) > 0.0
    assert (
        draw_road(Situation(2, ()), 3, 0) != draw_road(Situation(2, ()), 3, 1)
    ).any()
    assert HighwayEnv(2, "reckless").P != HighwayEnv(2, "safe").P


@pytest.mark.parametrize(
    "option", [{"driver": "blind"}, {"render_mode": "smell"}, {"length": 1}]
)
def test_an_environment_of_what_there_is_not_is_refused(option):
    pytest.importorskip("gymnasium")
    from gridworld_bench.envs import HighwayEnv

    with pytest.raises(ValueError, match=next(iter(option))):
        HighwayEnv(**option)


def test_pictures_tell_situations_apart():
    pytest.importorskip("gymnasium")
    from gridworld_bench.envs import HighwayEnv

    env = HighwayEnv(2, render_mode="rgb_array")
    images = set()
    for state in range(env.mdp.num_states):
        env._state = state
        image = env.render()
        assert image.shape[2] == 3
        images.add(image.tobytes())
    assert len(images) == env.mdp.num_states
