from itertools import islice, pairwise, takewhile

import numpy as np
import pytest

from tablesetting.irl.active import (
    STRATEGIES,
    RiskConfig,
    run_active,
    score_active_var,
)
from tablesetting.irl.posterior import Posterior

RISK = RiskConfig(alpha=0.9)


class Numbers:
    """Queries are numbers; the loss of asking q is q times a random sample."""

    def __init__(self):
        self.asked = []
        self.previous = []

    def infer(self, demos, previous, *, rng):
        self.previous.append(previous)
        weights = rng.random((20, 1))
        best = weights[0]
        return Posterior(weights, weights[:, 0], best, 0.5, ess=20.0, rhat=1.0)

    def propose_queries(self, demos, *, rng):
        return list(rng.random(5) / len(demos))

    def policy_losses(self, queries, posterior):
        return np.outer(queries, posterior.weights[:, 0])

    def demonstrate(self, query):
        self.asked.append(query)
        return f"answer to {query:.3f}"


def rounds(strategy, num_rounds, *, problem=None, seed=0):
    loop = run_active(
        problem or Numbers(),
        ["first"],
        STRATEGIES[strategy],
        RISK,
        rng=np.random.default_rng(seed),
    )
    return list(islice(loop, num_rounds))


@pytest.mark.parametrize("alpha", [0.0, 1.0, 95.0])
def test_alpha_without_meaning_is_refused(alpha):
    with pytest.raises(ValueError, match=rf"`alpha` must be in \(0, 1\); got {alpha}"):
        RiskConfig(alpha=alpha)


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_highest_score_is_asked_and_its_answer_learned(strategy):
    problem = Numbers()
    found = rounds(strategy, 6, problem=problem)
    for latest, following in pairwise(found):
        assert latest.scores[latest.query_index] == latest.scores.max()
        assert latest.query == latest.candidates[latest.query_index]
        assert following.demos == (*latest.demos, f"answer to {latest.query:.3f}")
    assert problem.asked == [latest.query for latest in found[:-1]]


def test_active_var_asks_the_candidate_with_the_largest_risk():
    for latest in rounds("active-var", 5):
        assert latest.query == max(latest.candidates)
        assert latest.var[latest.query_index] == latest.var_bound


def test_risk_is_measured_whatever_the_strategy():
    for latest in rounds("random", 5):
        losses = np.outer(latest.candidates, latest.posterior.weights[:, 0])
        expected = np.sort(losses, axis=1)[:, 17]  # The 18th of 20 samples.
        np.testing.assert_array_equal(latest.var, expected)
        assert latest.var_bound == expected.max()


def test_released_rank_reaches_the_scores():
    losses = np.arange(100.0)[None]
    rng = np.random.default_rng(0)
    assert score_active_var(losses, RiskConfig(), rng)[0] == 94.0
    assert score_active_var(losses, RiskConfig(rank_offset=1), rng)[0] == 95.0


def test_demonstrator_is_asked_only_when_the_next_round_is():
    problem = Numbers()
    loop = run_active(
        problem, ["first"], score_active_var, RISK, rng=np.random.default_rng(0)
    )
    next(loop)
    assert problem.asked == []
    next(loop)
    assert len(problem.asked) == 1


def test_every_round_builds_on_the_posterior_before():
    problem = Numbers()
    found = rounds("active-var", 4, problem=problem)
    assert problem.previous == [None, *(latest.posterior for latest in found[:-1])]


def test_strategies_are_paired():
    for active, random in zip(
        rounds("active-var", 4), rounds("random", 4), strict=True
    ):
        np.testing.assert_array_equal(
            active.posterior.weights, random.posterior.weights
        )
        assert active.candidates == random.candidates


def test_random_scores_change_from_round_to_round():
    scores = np.array([latest.scores for latest in rounds("random", 3)])
    assert len(np.unique(scores)) == scores.size


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_same_seed_asks_the_same_and_another_seed_differs(strategy):
    asked = [[r.query for r in rounds(strategy, 4, seed=seed)] for seed in (3, 3, 4)]
    assert asked[0] == asked[1] != asked[2]


def test_caller_stops_the_loop():
    problem = Numbers()
    loop = run_active(
        problem, ["first"], score_active_var, RISK, rng=np.random.default_rng(0)
    )
    risky = list(takewhile(lambda latest: latest.var_bound >= 0.2, loop))
    assert [len(latest.demos) for latest in risky] == list(range(1, len(risky) + 1))
    assert len(risky) == len(problem.asked) > 1


def test_times_are_measured():
    for latest in rounds("random", 2):
        assert latest.inference_seconds > 0.0
        assert latest.query_seconds > 0.0
