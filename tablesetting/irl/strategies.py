"""Which question to ask next: a score for each candidate, the highest is asked.

Letters: M samples of the posterior, G answers. P[m, g] is the chance of answer g under
sample m, p_g that by the whole posterior, and u[m, g] the chance of sample m after
answer g. x_m is the best decision by the reward R_m of sample m.
"""

from collections.abc import Callable

import numpy as np

from tablesetting.irl.arrays import Array, Indices
from tablesetting.irl.outlook import Answers, Outlook
from tablesetting.irl.risk import (
    RiskConfig,
    conditional_value_at_risk,
    value_at_risk,
    var_upper_bound,
)

_WEIGHT_TOLERANCE = 1e-12  # Of sums of weights, against rounding.

Strategy = Callable[[Outlook, RiskConfig, np.random.Generator], Array]
"""Maps the outlook of Q candidates to scores, shape (Q,); the highest is asked."""


def score_active_var(
    outlook: Outlook, risk: RiskConfig, rng: np.random.Generator
) -> Array:
    r"""Score candidates by the :math:`\alpha`-VaR of their loss.

    Source: the paper's Algorithm 1.

    Args:
        outlook: What the posterior says of Q candidates.
        risk: The quantile and the offset of its rank.
        rng: Not used.

    Returns:
        Value at risk, shape (Q,), in the unit of the loss.
    """
    return value_at_risk(outlook.losses, risk.alpha, rank_offset=risk.rank_offset)


def score_var_bound(
    outlook: Outlook, risk: RiskConfig, rng: np.random.Generator
) -> Array:
    r"""Score candidates by a :math:`(1 - \delta)`-confident bound on their VaR.

    With too few effective samples there is no finite bound; the largest loss stands in
    for it, so that candidates can still be ordered.

    Source: Brown & Niekum 2018.

    Args:
        outlook: What the posterior says of Q candidates.
        risk: The quantile and the probability that the bound may miss it.
        rng: Not used.

    Returns:
        Bounds, shape (Q,), in the unit of the loss.
    """
    losses = outlook.losses
    bounds = var_upper_bound(losses, risk.alpha, risk.delta, ess=outlook.ess)
    return np.where(np.isinf(bounds), losses.max(axis=-1), bounds)


def score_cvar(outlook: Outlook, risk: RiskConfig, rng: np.random.Generator) -> Array:
    r"""Score candidates by the mean of the worst :math:`1 - \alpha` of their losses.

    Source: Rockafellar & Uryasev 2000.

    Args:
        outlook: What the posterior says of Q candidates.
        risk: The quantile.
        rng: Not used.

    Returns:
        Conditional value at risk, shape (Q,), in the unit of the loss.
    """
    return conditional_value_at_risk(outlook.losses, risk.alpha)


def score_random(outlook: Outlook, risk: RiskConfig, rng: np.random.Generator) -> Array:
    """Score candidates at random: the baseline.

    Args:
        outlook: Tells the number of candidates, Q.
        risk: Not used.
        rng: Draws the scores.

    Returns:
        Scores, shape (Q,), in [0, 1).
    """
    return rng.random(outlook.num_queries)


def score_entropy(
    outlook: Outlook, risk: RiskConfig, rng: np.random.Generator
) -> Array:
    r"""Score candidates by how widely the samples' best decisions spread.

    :math:`-\sum_k h_k \log h_k`, with :math:`h_k` the fraction of the samples whose
    best decision falls in class k.

    Source: Lopes, Melo & Montesano 2009 (Active Sampling, carried to decisions).

    Args:
        outlook: What the posterior says of Q candidates.
        risk: Not used.
        rng: Not used.

    Returns:
        Entropies, shape (Q,), in nats, at least 0.
    """
    return _per_query(outlook, lambda query: _entropy(outlook.classes(query)))


def _entropy(classes: Indices) -> float:
    """Return the entropy of the histogram of classes, in nats."""
    counts = np.unique(classes, return_counts=True)[1]
    fractions = counts / counts.sum()
    return float(fractions @ np.log(1.0 / fractions))


def score_information_gain(
    outlook: Outlook, risk: RiskConfig, rng: np.random.Generator
) -> Array:
    r"""Score candidates by what an answer would tell of the reward (BALD).

    :math:`\sum_g p_g \sum_m u_{mg} \log(M u_{mg})`: the mutual information of answer
    and sample. Over all the answers that there are it is
    :math:`H(\bar P) - \frac{1}{M} \sum_m H(P_m)`.

    Source: Houlsby et al. 2011; Biyik et al. 2019.

    Args:
        outlook: What the posterior says of Q candidates.
        risk: Not used.
        rng: Not used.

    Returns:
        Information, shape (Q,), in nats, in [0, log M].
    """
    return _per_query(outlook, lambda query: _information(outlook.answers(query)))


def _information(answers: Answers) -> float:
    """Return the mutual information of answer and sample, in nats."""
    weights = _responsibilities(answers.likelihoods)
    ratios = len(weights) * weights
    logs = np.log(ratios, out=np.zeros_like(ratios), where=ratios > 0.0)
    return float(answers.probabilities @ (weights * logs).sum(axis=0))


def score_volume_removal(
    outlook: Outlook, risk: RiskConfig, rng: np.random.Generator
) -> Array:
    r"""Score candidates by how much of the posterior an answer would rule out.

    :math:`1 - \sum_g p_g \bar P_g`, with :math:`\bar P_g = \frac{1}{M} \sum_m P_{mg}`.
    An answer that is mere noise rules out as much as one that tells something: a
    negative control.

    Source: Sadigh et al. 2017.

    Args:
        outlook: What the posterior says of Q candidates.
        risk: Not used.
        rng: Not used.

    Returns:
        Volume removed, shape (Q,); below 1.
    """
    return _per_query(outlook, lambda query: _removed_volume(outlook.answers(query)))


def _removed_volume(answers: Answers) -> float:
    """Return the part of the posterior that an answer rules out on average."""
    return 1.0 - float(answers.probabilities @ answers.likelihoods.mean(axis=0))


def score_max_regret(
    outlook: Outlook, risk: RiskConfig, rng: np.random.Generator
) -> Array:
    r"""Score candidates by the largest mutual regret of two samples.

    :math:`\max_{i,j} \rho(i, j) + \rho(j, i)`, with
    :math:`\rho(i, j) = R_i(x_i) - R_i(x_j)`.

    Source: Wilde, Kulić & Smith 2020.

    Args:
        outlook: What the posterior says of Q candidates.
        risk: Not used.
        rng: Not used.

    Returns:
        Regrets, shape (Q,), in the unit of the reward.
    """
    return _per_query(outlook, lambda query: _largest_regret(outlook.values(query)))


def _largest_regret(values: Array) -> float:
    """Return the largest sum of the regrets that two samples have of each other."""
    regrets = np.diagonal(values)[:, None] - values
    return float((regrets + regrets.T).max())


def score_disagreement(
    outlook: Outlook, risk: RiskConfig, rng: np.random.Generator
) -> Array:
    r"""Score candidates by how far apart the best decisions of two samples can be.

    :math:`\max_{i,j} \lVert x_i - x_j \rVert`, in the loss of the domain.

    Source: Katz et al. 2019.

    Args:
        outlook: What the posterior says of Q candidates.
        risk: Not used.
        rng: Not used.

    Returns:
        Largest distances, shape (Q,), in the unit of the loss.
    """
    return _per_query(outlook, lambda query: outlook.distances(query).max())


def score_bayes_regret(
    outlook: Outlook, risk: RiskConfig, rng: np.random.Generator
) -> Array:
    r"""Score candidates by the worth of knowing the reward: perfect information.

    :math:`\frac{1}{M} \sum_m R_m(x_m) - \max_x \frac{1}{M} \sum_m R_m(x)`.

    Source: after Kleine Buening et al. 2024.

    Args:
        outlook: What the posterior says of Q candidates.
        risk: Not used.
        rng: Not used.

    Returns:
        Regrets, shape (Q,), in the unit of the reward.
    """

    def regret(query: int) -> float:
        informed = np.diagonal(outlook.values(query)).mean()
        return float(informed) - outlook.best_mean_value(query)

    return _per_query(outlook, regret)


def score_placement_equivalence(
    outlook: Outlook, risk: RiskConfig, rng: np.random.Generator
) -> Array:
    r"""Score candidates by how alike the samples that remain would decide.

    :math:`-\sum_g p_g u_g^\top A u_g`, with :math:`A_{ij}` the loss between the
    decisions of samples i and j, on average over situations of the deployment.

    Source: after Ellis et al. 2024.

    Args:
        outlook: What the posterior says of Q candidates.
        risk: Not used.
        rng: Not used.

    Returns:
        Negative distances after an answer, shape (Q,), in the unit of the loss.
    """
    distances = outlook.deployed_distances

    def remaining_distance(query: int) -> float:
        answers = outlook.answers(query)
        weights = _responsibilities(answers.likelihoods)
        means = np.einsum("mg,mg->g", weights, distances @ weights)
        return float(answers.probabilities @ means)

    return -_per_query(outlook, remaining_distance)


def score_var_reduction(
    outlook: Outlook, risk: RiskConfig, rng: np.random.Generator
) -> Array:
    r"""Score candidates by the largest VaR of the deployment after an answer.

    :math:`-\sum_g p_g \max_t \mathrm{VaR}_\alpha(L_t; u_g)`, the VaR of the loss in
    situation t with the samples weighted by :math:`u_g`: the smallest loss that
    samples of a weight of at least :math:`\alpha` do not exceed.

    Source: one step of look-ahead on the paper's own goal.

    Args:
        outlook: What the posterior says of Q candidates.
        risk: The quantile; the offset of its rank has no meaning with weights.
        rng: Not used.

    Returns:
        Negative values at risk after an answer, shape (Q,), in the unit of the loss.
    """
    losses = outlook.deployed_losses
    orders = np.argsort(losses, axis=-1)
    ranked = np.take_along_axis(losses, orders, axis=-1)

    def remaining_var(query: int) -> float:
        answers = outlook.answers(query)
        weights = _responsibilities(answers.likelihoods)
        worst = _largest_quantiles(ranked, orders, weights, risk.alpha)
        return float(answers.probabilities @ worst)

    return -_per_query(outlook, remaining_var)


def _largest_quantiles(
    ranked: Array, orders: Indices, weights: Array, alpha: float
) -> Array:
    """Find the largest of T weighted quantiles for each of G sets of weights.

    Goes down from the largest losses, all situations at once, and stops where samples
    of more than a weight of 1 - alpha have been passed everywhere: no need to see more.

    Args:
        ranked: Losses in ascending order, shape (T, M).
        orders: The samples that these are of, shape (T, M).
        weights: Weights of the samples, shape (M, G); every column sums to 1.
        alpha: Quantile, in (0, 1).

    Returns:
        Losses, shape (G,).
    """
    num_situations, num_samples = ranked.shape
    tails = np.zeros((num_situations, weights.shape[1]))
    ranks = np.full(tails.shape, num_samples - 1)
    for samples in orders.T[::-1]:
        tails += weights[samples]
        above = tails <= 1.0 - alpha + _WEIGHT_TOLERANCE
        if not above.any():
            break
        ranks -= above
    quantiles = np.take_along_axis(ranked, np.maximum(ranks, 0), axis=-1)
    return quantiles.max(axis=0)


def _responsibilities(likelihoods: Array) -> Array:
    r"""Return :math:`u_{mg} = P_{mg} / \sum_{m'} P_{m'g}`, shape (M, G).

    An answer that no sample can explain leaves all of them equally probable.
    """
    totals = likelihoods.sum(axis=0)
    uniform = np.full(likelihoods.shape, 1.0 / len(likelihoods))
    return np.divide(likelihoods, totals, out=uniform, where=totals > 0.0)


def _per_query(outlook: Outlook, score: Callable[[int], float]) -> Array:
    """Score every candidate by itself, shape (Q,)."""
    return np.array([score(query) for query in range(outlook.num_queries)], dtype=float)


STRATEGIES: dict[str, Strategy] = {
    "active-var": score_active_var,
    "var-bound": score_var_bound,
    "cvar": score_cvar,
    "random": score_random,
    "entropy": score_entropy,
    "information-gain": score_information_gain,
    "volume-removal": score_volume_removal,
    "max-regret": score_max_regret,
    "disagreement": score_disagreement,
    "bayes-regret": score_bayes_regret,
    "placement-equivalence": score_placement_equivalence,
    "var-reduction": score_var_reduction,
}
