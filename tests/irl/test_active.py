from dataclasses import dataclass
from itertools import islice, pairwise, takewhile

import numpy as np
import pytest

from tablesetting.irl.active import learn_from, run_active
from tablesetting.irl.arrays import Array
from tablesetting.irl.outlook import Answers
from tablesetting.irl.posterior import Posterior
from tablesetting.irl.risk import RiskConfig
from tablesetting.irl.sampler import Diagnosis
from tablesetting.irl.strategies import STRATEGIES, score_active_var

RISK = RiskConfig(alpha=0.9)


@dataclass
class NumbersOutlook:
    """The loss of asking q is q times a sample; the answer is yes, or it is no."""

    queries: Array
    samples: Array
    ess: float = 20.0

    @property
    def num_queries(self):
        return len(self.queries)

    @property
    def losses(self):
        return np.outer(self.queries, self.samples)

    def answers(self, query):
        chances = self.queries[query] * self.samples
        likelihoods = np.stack([chances, 1.0 - chances], axis=1)
        return Answers(likelihoods, likelihoods.mean(axis=0))

    def classes(self, query):
        return (self.samples > self.queries[query]).astype(int)

    def distances(self, query):
        return self.queries[query] * np.abs(self.samples[:, None] - self.samples)

    def values(self, query):
        return -self.distances(query)

    def best_mean_value(self, query):
        return float(self.values(query).mean(axis=0).max())

    @property
    def deployed_losses(self):
        return self.losses

    @property
    def deployed_distances(self):
        return self.distances(0)


class Numbers:
    """Queries are numbers in [0, 1]."""

    num_draws_of_teacher = 0

    def __init__(self):
        self.asked = []
        self.previous = []
        self.outlooks = []
        self.drawn_by_teacher = []

    def infer(self, demos, previous, *, rng):
        self.previous.append(previous)
        weights = rng.random((20, 1))
        return Posterior(
            weights=weights,
            log_posts=weights[:, 0],
            scales=None,
            map_weights=weights[0],
            mean_weights=weights.mean(axis=0),
            guess="map",
            num_chains=1,
            acceptance_rate=0.5,
            diagnosis=Diagnosis(20.0, 20.0, 1.0),
            is_sound=True,
            log_evidence=0.0,
        )

    def propose_queries(self, demos, posterior, *, rng):
        return list(rng.random(5) / len(demos))

    def outlook(self, queries, posterior):
        outlook = NumbersOutlook(np.array(queries), posterior.weights[:, 0])
        self.outlooks.append(outlook)
        return outlook

    def demonstrate(self, query, *, rng):
        self.asked.append(query)
        self.drawn_by_teacher.append(rng.random(self.num_draws_of_teacher))
        return f"answer to {query:.3f}"


class Noisy(Numbers):
    """The demonstrator draws many random numbers for an answer."""

    num_draws_of_teacher = 100


def rounds(strategy, num_rounds, *, problem=None, seed=0, risk=RISK):
    loop = run_active(
        problem or Numbers(),
        ["first"],
        STRATEGIES[strategy] if isinstance(strategy, str) else strategy,
        risk,
        rng=np.random.default_rng(seed),
    )
    return list(islice(loop, num_rounds))


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


def test_released_rank_reaches_risk_and_scores():
    released = RiskConfig(alpha=0.9, rank_offset=1)
    for latest in rounds("active-var", 3, risk=released):
        expected = np.sort(latest.outlook.losses, axis=1)[:, 18]
        np.testing.assert_array_equal(latest.var, expected)
        np.testing.assert_array_equal(latest.scores, expected)


def test_strategy_is_given_the_outlook_of_the_candidates_and_the_risk():
    given = []

    def spy(outlook, risk, rng):
        given.append((outlook, risk))
        return np.zeros(outlook.num_queries)

    problem = Numbers()
    found = rounds(spy, 3, problem=problem)
    for latest, (outlook, risk), made in zip(
        found, given, problem.outlooks, strict=True
    ):
        assert outlook is latest.outlook is made
        assert risk is RISK
        np.testing.assert_array_equal(outlook.queries, latest.candidates)
        np.testing.assert_array_equal(outlook.samples, latest.posterior.weights[:, 0])


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


@pytest.mark.parametrize("first", [1, 4])
def test_recorded_answers_give_the_rounds_of_their_session_again(first):
    found = rounds("active-var", 5)
    again = learn_from(
        Numbers(),
        found[-1].demos,
        STRATEGIES["active-var"],
        RISK,
        first=first,
        rng=np.random.default_rng(0),
    )
    for one, other in zip(found[first - 1 :], again, strict=True):
        assert one.demos == other.demos
        assert one.candidates == other.candidates
        np.testing.assert_array_equal(one.posterior.weights, other.posterior.weights)
        np.testing.assert_array_equal(one.scores, other.scores)


def test_strategies_are_paired():
    for active, random in zip(
        rounds("active-var", 4), rounds("random", 4), strict=True
    ):
        np.testing.assert_array_equal(
            active.posterior.weights, random.posterior.weights
        )
        assert active.candidates == random.candidates


@pytest.mark.parametrize("strategy", ["active-var", "random"])
def test_what_the_demonstrator_draws_changes_nothing_else(strategy):
    for plain, noisy in zip(
        rounds(strategy, 4), rounds(strategy, 4, problem=Noisy()), strict=True
    ):
        np.testing.assert_array_equal(plain.posterior.weights, noisy.posterior.weights)
        assert plain.candidates == noisy.candidates
        np.testing.assert_array_equal(plain.scores, noisy.scores)


def test_demonstrator_draws_the_same_whatever_the_strategy_drew():
    problems = Noisy(), Noisy()
    rounds("active-var", 4, problem=problems[0])
    rounds("random", 4, problem=problems[1])
    drawn = [problem.drawn_by_teacher for problem in problems]
    np.testing.assert_array_equal(*drawn)


def test_demonstrator_has_random_numbers_of_its_own_in_every_round():
    problem = Noisy()
    found = rounds("random", 4, problem=problem)
    drawn = np.array(problem.drawn_by_teacher)
    scores = np.array([latest.scores for latest in found])
    assert len(np.unique(drawn)) == drawn.size == 300
    assert not np.intersect1d(drawn, scores).size


def test_how_much_the_demonstrator_drew_does_not_change_the_next_answer():
    problems = Noisy(), Noisy()
    problems[1].num_draws_of_teacher = 7
    for problem in problems:
        rounds("random", 4, problem=problem)
    many, few = (np.array(problem.drawn_by_teacher) for problem in problems)
    np.testing.assert_array_equal(many[:, :7], few)


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
