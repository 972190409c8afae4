import math
from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tablesetting.irl.arrays import Array
from tablesetting.irl.outlook import Answers
from tablesetting.irl.risk import (
    RiskConfig,
    conditional_value_at_risk,
    value_at_risk,
    var_upper_bound,
)
from tablesetting.irl.strategies import STRATEGIES

MEDIAN = RiskConfig(alpha=0.5)
SURE = np.eye(3)  # Three samples, each sure of an answer of its own.
VAGUE = np.full((3, 4), 0.25)  # Three samples that know nothing of four answers.
SIMPLE = np.array([[0.5, 0.5], [0.25, 0.75]])

seeds = st.integers(0, 2**32 - 1)


@dataclass
class FakeOutlook:
    """Says what it was told to, one entry per query, of the first few samples only."""

    losses: Array = field(default_factory=lambda: np.zeros((1, 2)))
    ess: float = 1000.0
    likelihoods: list = field(default_factory=list)
    decisions: list = field(default_factory=list)
    gaps: list = field(default_factory=list)
    rewards: list = field(default_factory=list)
    best_means: list = field(default_factory=list)
    deployed_losses: Array = field(default_factory=lambda: np.zeros((1, 2)))
    deployed_distances: Array = field(default_factory=lambda: np.zeros((2, 2)))
    drawn: bool = False

    @property
    def num_queries(self):
        told = [self.likelihoods, self.decisions, self.gaps, self.rewards]
        return max(len(self.losses), *(len(entries) for entries in told))

    def answers(self, query):
        chances = np.asarray(self.likelihoods[query], dtype=float)
        num_answers = chances.shape[1]
        uniform = np.full(num_answers, 1.0 / num_answers)
        return Answers(chances, uniform if self.drawn else chances.mean(axis=0))

    def classes(self, query):
        return np.asarray(self.decisions[query])

    def distances(self, query):
        return np.asarray(self.gaps[query], dtype=float)

    def values(self, query):
        return np.asarray(self.rewards[query], dtype=float)

    def best_mean_value(self, query):
        return self.best_means[query]


def score(strategy, outlook, risk=MEDIAN, *, seed=0):
    return STRATEGIES[strategy](outlook, risk, np.random.default_rng(seed))


def random_outlook(seed, *, num_queries=3, num_samples=5, num_answers=7):
    """Make up an outlook in which the decisions are points on a line."""
    rng = np.random.default_rng(seed)
    chances = rng.dirichlet(np.full(num_answers, 0.3), (num_queries, num_samples))
    decisions = rng.random((num_queries, num_samples))
    deployed = rng.random((6, num_samples))
    return FakeOutlook(
        losses=rng.random((num_queries, num_samples)),
        likelihoods=list(chances),
        decisions=list(rng.integers(0, 3, (num_queries, num_samples))),
        gaps=[np.abs(xs[:, None] - xs) for xs in decisions],
        rewards=list(rng.normal(size=(num_queries, num_samples, num_samples))),
        best_means=list(rng.random(num_queries)),
        deployed_losses=rng.random((4, num_samples)),
        deployed_distances=np.abs(deployed[:, :, None] - deployed[:, None]).mean(0),
    )


def rearranged(outlook, order):
    """Return what the same samples say in another order."""
    square = np.ix_(order, order)
    return FakeOutlook(
        losses=outlook.losses[:, order],
        ess=outlook.ess,
        likelihoods=[chances[order] for chances in outlook.likelihoods],
        decisions=[classes[order] for classes in outlook.decisions],
        gaps=[gaps[square] for gaps in outlook.gaps],
        rewards=[rewards[square] for rewards in outlook.rewards],
        best_means=outlook.best_means,
        deployed_losses=outlook.deployed_losses[:, order],
        deployed_distances=outlook.deployed_distances[square],
    )


def entropy(chances):
    positive = chances[chances > 0.0]
    return -np.sum(positive * np.log(positive))


def plain_quantile(losses, weights, alpha):
    """Return the smallest loss that samples of weight alpha do not exceed."""
    covering = [x for x in losses if weights[losses <= x].sum() >= alpha - 1e-12]
    return min(covering)


@pytest.mark.parametrize("name", ["alpha", "delta"])
@pytest.mark.parametrize("value", [0.0, 1.0, 95.0, math.nan])
def test_risk_without_meaning_is_refused(name, value):
    with pytest.raises(ValueError, match=rf"`{name}` must be in \(0, 1\); got {value}"):
        RiskConfig(**{name: value})


def test_strategies_are_offered_under_these_names():
    assert list(STRATEGIES) == [
        "active-var",
        "var-bound",
        "cvar",
        "random",
        "entropy",
        "information-gain",
        "volume-removal",
        "max-regret",
        "disagreement",
        "bayes-regret",
        "placement-equivalence",
        "var-reduction",
    ]


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_every_candidate_gets_a_finite_score(strategy):
    scores = score(strategy, random_outlook(0, num_queries=4))
    assert scores.shape == (4,)
    assert scores.dtype == float
    assert np.isfinite(scores).all()


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_equal_candidates_tie_except_by_chance(strategy):
    twins = random_outlook(1, num_queries=1)
    twins.losses = np.repeat(twins.losses, 2, axis=0)
    for entries in (twins.likelihoods, twins.decisions, twins.gaps, twins.rewards):
        entries.append(entries[0])
    twins.best_means.append(twins.best_means[0])
    first, second = score(strategy, twins)
    assert (first == second) == (strategy != "random")


@pytest.mark.parametrize("strategy", STRATEGIES)
@given(seed=seeds, order=st.permutations(range(5)))
def test_order_of_the_samples_does_not_matter(strategy, seed, order):
    outlook = random_outlook(seed)
    np.testing.assert_allclose(
        score(strategy, rearranged(outlook, order)),
        score(strategy, outlook),
        atol=1e-12,
    )


@given(seeds, st.permutations(range(7)))
def test_order_of_the_answers_does_not_matter(seed, order):
    outlook, other = random_outlook(seed), random_outlook(seed)
    other.likelihoods = [chances[:, order] for chances in outlook.likelihoods]
    for strategy in (
        "information-gain",
        "volume-removal",
        "placement-equivalence",
        "var-reduction",
    ):
        np.testing.assert_allclose(
            score(strategy, other), score(strategy, outlook), atol=1e-12
        )


# The losses of the robot's guess.


def test_active_var_is_the_quantile_of_the_loss_and_minds_the_rank():
    outlook = FakeOutlook(losses=np.array([[4.0, 1.0, 3.0, 2.0], [0.0, 0.0, 9.0, 9.0]]))
    assert score("active-var", outlook).tolist() == [2.0, 0.0]
    released = RiskConfig(alpha=0.5, rank_offset=1)
    assert score("active-var", outlook, released).tolist() == [3.0, 9.0]


def test_var_bound_is_that_of_the_effective_samples():
    losses = np.random.default_rng(0).random((3, 400))
    risk = RiskConfig(alpha=0.9, delta=0.1)
    for ess in (100.0, 400.0):
        expected = var_upper_bound(losses, 0.9, 0.1, ess=ess)
        found = score("var-bound", FakeOutlook(losses=losses, ess=ess), risk)
        np.testing.assert_array_equal(found, expected)
        assert np.all(expected > value_at_risk(losses, 0.9))
        assert np.all(expected < losses.max(axis=1))


def test_var_bound_is_the_largest_loss_where_samples_are_too_few():
    outlook = FakeOutlook(losses=np.array([[1.0, 5.0], [7.0, 2.0]]), ess=2.0)
    assert np.isinf(var_upper_bound(outlook.losses, 0.95, 0.05, ess=2.0)).all()
    assert score("var-bound", outlook, RiskConfig()).tolist() == [5.0, 7.0]


def test_cvar_is_the_mean_of_the_worst_half():
    outlook = FakeOutlook(losses=np.array([[4.0, 1.0, 3.0, 2.0], [0.0, 0.0, 9.0, 8.0]]))
    np.testing.assert_allclose(score("cvar", outlook), [3.5, 8.5])
    expected = conditional_value_at_risk(outlook.losses, 0.9)
    np.testing.assert_array_equal(
        score("cvar", outlook, RiskConfig(alpha=0.9)), expected
    )


def test_cvar_tells_tails_apart_that_var_does_not():
    outlook = FakeOutlook(losses=np.array([[0.0, 1.0, 1.0, 2.0], [0.0, 1.0, 1.0, 9.0]]))
    assert np.ptp(score("active-var", outlook)) == 0.0
    assert np.argmax(score("cvar", outlook)) == 1


@given(seeds)
def test_random_scores_are_in_the_unit_interval_and_reproducible(seed):
    outlook = FakeOutlook(losses=np.zeros((20, 1)))
    scores = score("random", outlook, seed=seed)
    assert np.all((0.0 <= scores) & (scores < 1.0))
    assert len(np.unique(scores)) == 20
    np.testing.assert_array_equal(score("random", outlook, seed=seed), scores)
    assert not np.array_equal(score("random", outlook, seed=seed + 1), scores)


# The best decisions of the samples.


def test_entropy_of_decisions_by_hand():
    decisions = [[7, 7, 7, 7], [0, 5, 0, 5], [3, 2, 1, 0], [0, 0, 0, 9]]
    thirds = 0.75 * math.log(4 / 3) + 0.25 * math.log(4)
    np.testing.assert_allclose(
        score("entropy", FakeOutlook(decisions=decisions)),
        [0.0, math.log(2), math.log(4), thirds],
    )


@given(seeds)
def test_entropy_does_not_mind_how_classes_are_numbered(seed):
    classes = np.random.default_rng(seed).integers(0, 4, 30)
    renumbered = np.array([100, 3, 55, 0])[classes]
    first, second = score("entropy", FakeOutlook(decisions=[classes, renumbered]))
    assert first == pytest.approx(second, abs=1e-12)
    assert 0.0 <= first <= math.log(4) + 1e-12


def test_largest_regret_by_hand():
    # Sample 0 gives up 4 to do as sample 1 likes, which gives up 2 in return.
    rewards = [[[5.0, 1.0], [0.0, 2.0]], [[1.0, 1.0], [1.0, 1.0]]]
    assert score("max-regret", FakeOutlook(rewards=rewards)).tolist() == [6.0, 0.0]


@given(seeds)
def test_largest_regret_is_that_of_the_plain_loop(seed):
    outlook = random_outlook(seed, num_queries=1)
    values = outlook.values(0)
    pairs = [(i, j) for i in range(5) for j in range(5)]
    plain = max(
        values[i, i] - values[i, j] + values[j, j] - values[j, i] for i, j in pairs
    )
    np.testing.assert_allclose(score("max-regret", outlook), [plain], atol=1e-12)


def test_disagreement_is_the_largest_distance():
    gaps = [[[0.0, 0.3], [0.3, 0.0]], [[0.0, 0.9], [0.9, 0.0]]]
    assert score("disagreement", FakeOutlook(gaps=gaps)).tolist() == [0.3, 0.9]


def test_identical_samples_neither_disagree_nor_regret():
    same = FakeOutlook(
        losses=np.zeros((1, 4)),
        decisions=[[2, 2, 2, 2]],
        gaps=[np.zeros((4, 4))],
        rewards=[np.full((4, 4), 0.7)],
        best_means=[0.7],
    )
    for strategy in ("disagreement", "max-regret", "bayes-regret", "entropy"):
        np.testing.assert_allclose(score(strategy, same), [0.0], atol=1e-15)


def test_bayes_regret_is_what_perfect_information_is_worth():
    # Informed, the samples get 5 and 2; the best compromise gets 3 on average.
    outlook = FakeOutlook(rewards=[[[5.0, 1.0], [0.0, 2.0]]], best_means=[3.0])
    assert score("bayes-regret", outlook).tolist() == [0.5]


@given(seeds)
def test_bayes_regret_is_never_negative_over_a_grid_of_decisions(seed):
    rewards = np.random.default_rng(seed).normal(size=(6, 9))  # By sample and decision.
    values = rewards[:, rewards.argmax(axis=1)]
    outlook = FakeOutlook(rewards=[values], best_means=[rewards.mean(axis=0).max()])
    assert score("bayes-regret", outlook)[0] >= -1e-12


# What an answer would teach.


def test_information_gain_by_hand():
    # Given the first answer 2:1 for sample 0, given the second 2:3.
    first = 2 / 3 * math.log(4 / 3) + 1 / 3 * math.log(2 / 3)
    second = 2 / 5 * math.log(4 / 5) + 3 / 5 * math.log(6 / 5)
    expected = 3 / 8 * first + 5 / 8 * second
    found = score("information-gain", FakeOutlook(likelihoods=[SIMPLE]))
    np.testing.assert_allclose(found, [expected])


def test_answers_that_samples_agree_on_tell_nothing_and_sure_ones_all():
    agreed = np.tile([1.0, 0.0, 0.0], (3, 1))
    outlook = FakeOutlook(likelihoods=[VAGUE, agreed, SURE])
    np.testing.assert_allclose(
        score("information-gain", outlook), [0.0, 0.0, math.log(3)], atol=1e-15
    )


@given(seeds, st.integers(1, 8), st.integers(1, 12))
def test_information_gain_is_the_entropy_that_noise_does_not_explain(seed, m, g):
    rng = np.random.default_rng(seed)
    chances = rng.dirichlet(np.full(g, 0.3), m)
    chances[:, rng.random(g) < 0.3] = 0.0
    if not chances.sum(axis=1).all():
        chances = np.ones((m, g))
    chances /= chances.sum(axis=1, keepdims=True)
    expected = entropy(chances.mean(axis=0)) - np.mean([entropy(p) for p in chances])
    found = score("information-gain", FakeOutlook(likelihoods=[chances]))
    np.testing.assert_allclose(found, [expected], atol=1e-12)
    assert -1e-12 <= found[0] <= math.log(m) + 1e-12


def test_information_gain_of_drawn_answers_approaches_that_of_all():
    rng = np.random.default_rng(0)
    chances = rng.dirichlet(np.full(20, 0.3), 6)
    drawn = rng.choice(20, size=20_000, p=chances.mean(axis=0))
    expected = score("information-gain", FakeOutlook(likelihoods=[chances]))
    found = score(
        "information-gain", FakeOutlook(likelihoods=[chances[:, drawn]], drawn=True)
    )
    np.testing.assert_allclose(found, expected, rtol=0.02)


@pytest.mark.parametrize(
    "strategy", ["information-gain", "placement-equivalence", "var-reduction"]
)
def test_scale_of_densities_does_not_matter(strategy):
    chances = np.random.default_rng(0).random((5, 8))
    outlook = random_outlook(0)
    outlook.losses, outlook.drawn = np.zeros((2, 5)), True
    outlook.likelihoods = [chances, 1e-6 * chances, chances * np.geomspace(1, 9, 8)]
    np.testing.assert_allclose(np.ptp(score(strategy, outlook)), 0.0, atol=1e-12)


def test_volume_removal_by_hand_and_how_noise_fools_it():
    outlook = FakeOutlook(likelihoods=[SIMPLE, VAGUE, SURE])
    expected = [1.0 - (3 / 8) ** 2 - (5 / 8) ** 2, 3 / 4, 2 / 3]
    np.testing.assert_allclose(score("volume-removal", outlook), expected)
    assert np.argmax(score("volume-removal", outlook)) == 1  # Nothing to learn there.
    assert np.argmax(score("information-gain", outlook)) == 2


def test_volume_removal_of_drawn_answers_by_hand():
    # Both were drawn, so that both count by a half however probable they are.
    outlook = FakeOutlook(likelihoods=[SIMPLE], drawn=True)
    expected = [1.0 - (3 / 8 + 5 / 8) / 2]
    np.testing.assert_allclose(score("volume-removal", outlook), expected)
    outlook.likelihoods = [SIMPLE[:, :1]]
    np.testing.assert_allclose(score("volume-removal", outlook), [1.0 - 3 / 8])


def test_placement_equivalence_by_hand():
    outlook = FakeOutlook(
        likelihoods=[SIMPLE], deployed_distances=np.array([[0.0, 1.0], [1.0, 0.0]])
    )
    expected = -(3 / 8 * 2 * (2 / 3 * 1 / 3) + 5 / 8 * 2 * (2 / 5 * 3 / 5))
    np.testing.assert_allclose(score("placement-equivalence", outlook), [expected])


def test_placement_equivalence_is_full_only_after_answers_that_tell_all():
    gaps = np.array([[0.0, 3.0, 6.0], [3.0, 0.0, 9.0], [6.0, 9.0, 0.0]])
    outlook = FakeOutlook(likelihoods=[VAGUE, SURE], deployed_distances=gaps)
    np.testing.assert_allclose(
        score("placement-equivalence", outlook), [-gaps.mean(), 0.0]
    )


def test_only_differences_that_decide_matter_to_placement_equivalence():
    # Samples 0 and 1 decide alike, so that telling them apart is worth nothing.
    gaps = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [1.0, 1.0, 0.0]])
    idle, useful = [[1, 0], [0, 1], [0.5, 0.5]], [[1, 0], [1, 0], [0, 1]]
    outlook = FakeOutlook(likelihoods=[idle, useful], deployed_distances=gaps)
    np.testing.assert_allclose(
        score("placement-equivalence", outlook), [-gaps.mean(), 0.0], atol=1e-15
    )


def test_var_reduction_by_hand():
    # Given the first answer sample 0 weighs 2/3, given the second 2/5. The median of
    # the first situation is then 1 and 4, of the second 3 and 2.
    outlook = FakeOutlook(
        likelihoods=[SIMPLE], deployed_losses=np.array([[1.0, 4.0], [3.0, 2.0]])
    )
    np.testing.assert_allclose(
        score("var-reduction", outlook), [-(3 / 8 * 3.0 + 5 / 8 * 4.0)]
    )


def test_var_reduction_is_the_present_var_where_answers_tell_nothing():
    losses = np.random.default_rng(0).random((6, 100))
    outlook = FakeOutlook(likelihoods=[np.ones((100, 1))], deployed_losses=losses)
    for percent in range(1, 100):
        risk = RiskConfig(alpha=percent / 100)
        expected = -value_at_risk(losses, risk.alpha).max()
        np.testing.assert_allclose(
            score("var-reduction", outlook, risk), [expected], rtol=1e-12
        )


def test_var_reduction_is_the_mean_worst_loss_after_answers_that_tell_all():
    losses = np.array([[1.0, 0.0, 5.0], [2.0, 0.0, 0.0]])
    outlook = FakeOutlook(likelihoods=[SURE], deployed_losses=losses)
    np.testing.assert_allclose(
        score("var-reduction", outlook, RiskConfig()), [-(2.0 + 0.0 + 5.0) / 3]
    )


@given(seeds, st.sampled_from([0.05, 0.5, 0.9, 0.95, 0.999]), st.booleans())
def test_var_reduction_is_that_of_the_plain_loop(seed, alpha, tied):
    outlook = random_outlook(seed, num_queries=2)
    if tied:
        outlook.deployed_losses = outlook.deployed_losses.round(1)
    expected = []
    for chances in outlook.likelihoods:
        total = 0.0
        for g in np.flatnonzero(chances.sum(axis=0)):
            weights = chances[:, g] / chances[:, g].sum()
            worst = max(
                plain_quantile(row, weights, alpha) for row in outlook.deployed_losses
            )
            total -= chances[:, g].mean() * worst
        expected.append(total)
    found = score("var-reduction", outlook, RiskConfig(alpha=alpha))
    np.testing.assert_allclose(found, expected, atol=1e-12)


@pytest.mark.parametrize(
    "strategy",
    ["information-gain", "volume-removal", "placement-equivalence", "var-reduction"],
)
def test_answers_that_nobody_gives_do_not_count(strategy):
    outlook, padded = random_outlook(0), random_outlook(0)
    padded.likelihoods = [np.pad(p, ((0, 0), (2, 3))) for p in outlook.likelihoods]
    np.testing.assert_allclose(score(strategy, padded), score(strategy, outlook))


def test_drawn_answer_that_no_sample_explains_tells_nothing():
    outlook = FakeOutlook(likelihoods=[np.zeros((3, 2))], drawn=True)
    outlook.deployed_losses = np.array([[1.0, 2.0, 3.0]])
    outlook.deployed_distances = 1.0 - np.eye(3)
    np.testing.assert_allclose(score("information-gain", outlook), [0.0], atol=1e-15)
    np.testing.assert_allclose(score("placement-equivalence", outlook), [-2 / 3])
    np.testing.assert_allclose(score("var-reduction", outlook), [-2.0])
