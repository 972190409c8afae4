"""Measures of a loss over posterior samples, once for the whole project."""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import bdtrc

from tablesetting.irl.arrays import Array, row_blocks

_ROUNDING = 1e-12  # Of probabilities and values, relative; far above float64's own.
_TAIL_ROUNDING = 1e-9  # Of binomial tails, relative.


@dataclass(frozen=True)
class RiskConfig:
    """Which quantile of the loss is the risk."""

    alpha: float = 0.95
    """Quantile of the worst case, in (0, 1)."""
    delta: float = 0.05
    """Probability that the bound may miss the quantile by Monte Carlo error, in (0, 1).
    """
    rank_offset: int = 0
    """Added to the rank of the order statistic; 1 in the authors' released code."""

    def __post_init__(self) -> None:
        _check_probability("alpha", self.alpha)
        _check_probability("delta", self.delta)


def value_at_risk(losses: Array, alpha: float, *, rank_offset: int = 0) -> Array:
    r"""Estimate the :math:`\alpha`-VaR of a loss from posterior samples.

    The estimate is the :math:`\lceil \alpha N \rceil`-th smallest loss: the smallest
    sample that at least a fraction :math:`\alpha` of all samples do not exceed. The
    authors' released code takes the next larger one, `rank_offset=1`.

    Args:
        losses: Policy loss under each sampled reward, shape (..., N).
        alpha: Quantile of the worst case, in (0, 1); the paper uses 0.95.
        rank_offset: Added to the rank of the order statistic.

    Returns:
        The alpha-quantile over the last axis, shape (...,), in the unit of `losses`.

    Raises:
        ValueError: If alpha is outside (0, 1) or there are no samples.
    """
    _check_probability("alpha", alpha)
    num_samples = _count_samples(losses)
    # Rounding: 0.55 * 100 is a little over 55 in floating point.
    rank = math.ceil(round(alpha * num_samples, 9)) + rank_offset
    return _order_statistic(losses, min(max(rank, 1), num_samples))


def conditional_value_at_risk(losses: Array, alpha: float) -> Array:
    r"""Estimate the :math:`\alpha`-CVaR of a loss: the mean beyond its VaR.

    The mean of the worst :math:`(1 - \alpha) N` losses, of which the last may count by
    a fraction,

    .. math:: \nu_\alpha + \frac{1}{(1 - \alpha) N} \sum_n \max(z_n - \nu_\alpha, 0),

    with losses :math:`z_n` and :math:`\nu_\alpha` their VaR.

    Source: Rockafellar & Uryasev, "Optimization of conditional value-at-risk" (2000),
    and 2002 for distributions with atoms, as samples are.

    Args:
        losses: Policy loss under each sampled reward, shape (..., N).
        alpha: Quantile of the worst case, in (0, 1).

    Returns:
        At least the VaR, shape (...,), in the unit of `losses`.

    Raises:
        ValueError: If alpha is outside (0, 1) or there are no samples.
    """
    var = value_at_risk(losses, alpha)
    num_samples = losses.shape[-1]
    rows, levels = losses.reshape(-1, num_samples), var.reshape(-1, 1)
    excess = np.empty(len(rows))
    for block in row_blocks(len(rows), num_samples):
        excess[block] = np.maximum(rows[block] - levels[block], 0.0).sum(axis=-1)
    return var + excess.reshape(var.shape) / ((1.0 - alpha) * num_samples)


def var_upper_bound(
    losses: Array, alpha: float, delta: float, *, ess: float | None = None
) -> Array:
    r"""Bound the :math:`\alpha`-VaR from above with confidence :math:`1 - \delta`.

    Of n draws, the k-th smallest is the bound, k by `upper_bound_rank`. That is exact
    for independent draws, n = N. Draws of Markov chains are worth fewer,
    :math:`n = \lfloor \min(\mathrm{ess}, N) \rfloor`, and the bound is the
    :math:`\lceil k N / n \rceil`-th smallest of all N: to scale the rank to the
    effective sample size is a heuristic.

    Source: Brown & Niekum, "Efficient probabilistic performance bounds for inverse
    reinforcement learning" (AAAI 2018); the rank from the binomial distribution itself
    as in David & Nagaraja, *Order Statistics* (2003), section 7.1.

    Args:
        losses: Policy loss under each sampled reward, shape (..., N).
        alpha: Quantile of the worst case, in (0, 1); the paper uses 0.95.
        delta: Probability that the bound may miss the quantile, in (0, 1).
        ess: Independent draws that the N are worth; None if they are independent.

    Returns:
        Upper bounds, shape (...,), in the unit of `losses`; infinity where n is below
        `min_ess`.

    Raises:
        ValueError: If alpha or delta is outside (0, 1), ess is not positive and finite,
            or there are no samples.
    """
    num_samples = _count_samples(losses)
    num_draws = num_samples if ess is None else _whole_draws(ess, num_samples)
    rank = upper_bound_rank(num_draws, alpha, delta)
    if rank is None:
        return np.full(losses.shape[:-1], np.inf)
    return _order_statistic(losses, -(-rank * num_samples // num_draws))


@lru_cache
def upper_bound_rank(num_draws: int, alpha: float, delta: float) -> int | None:
    r"""Find the order statistic that bounds a quantile from above.

    The smallest k with :math:`P(B \ge k) \le \delta`, B the number of the n draws below
    the quantile, binomial in n and :math:`\alpha`. Whatever the distribution, the k-th
    smallest of n independent draws is then at least the :math:`\alpha`-quantile with
    probability :math:`1 - \delta`, and with more where draws can be equal.

    Source: David & Nagaraja, *Order Statistics* (2003), section 7.1.

    Args:
        num_draws: Number of independent draws, n.
        alpha: Quantile, in (0, 1).
        delta: Probability that the bound may miss the quantile, in (0, 1).

    Returns:
        The rank k, from 1 to n; None if even the largest draw will not do, which is so
        below `min_ess` draws.

    Raises:
        ValueError: If alpha or delta is outside (0, 1).
    """
    if num_draws < min_ess(alpha, delta):
        return None
    # Rounding: where P(B >= k) is delta itself, k will do.
    tails = bdtrc(np.arange(num_draws - 1), num_draws, alpha)  # Of k = 1, ..., n - 1.
    return 1 + int(np.count_nonzero(tails > delta * (1.0 + _TAIL_ROUNDING)))


def min_ess(alpha: float, delta: float) -> int:
    r"""Count the independent draws that an upper bound of a quantile takes.

    All of n draws miss the :math:`\alpha`-quantile with probability :math:`\alpha^n`,
    so that their largest is a bound from :math:`n = \lceil \ln \delta / \ln \alpha
    \rceil` on: 59 for 0.95 and 0.05.

    Source: Wilks, "Determination of sample sizes for setting tolerance limits" (1941).

    Args:
        alpha: Quantile, in (0, 1).
        delta: Probability that the bound may miss the quantile, in (0, 1).

    Returns:
        The fewest draws, at least 1.

    Raises:
        ValueError: If alpha or delta is outside (0, 1).
    """
    _check_probability("alpha", alpha)
    _check_probability("delta", delta)
    # Rounding: ln 0.729 / ln 0.9 is a little over 3 in floating point.
    return max(math.ceil((math.log(delta) + _ROUNDING) / math.log(alpha)), 1)


def spend(delta: float, look: int) -> float:
    r"""Divide a probability of error among looks at growing data.

    Bounds that each miss with probability :math:`\delta / (j (j + 1))` at look j all
    hold at once with probability :math:`1 - \delta`, however many looks there are: the
    shares sum to :math:`\delta`.

    Source: the union bound.

    Args:
        delta: Probability that any of the bounds may miss, in (0, 1).
        look: The number of the look, j, from 1.

    Returns:
        The share of this look, in (0, delta / 2].

    Raises:
        ValueError: If delta is outside (0, 1) or look is below 1.
    """
    _check_probability("delta", delta)
    if look < 1:
        raise ValueError(f"`look` must be at least 1, the first look; got {look}")
    return delta / (look * (look + 1))


def expected_value_difference(optimal_values: Array, policy_values: Array) -> Array:
    r"""Return what a policy loses on the best one, :math:`V^* - V^\pi`.

    Source: the paper's equation of the Expected Value Difference, EVD.

    Args:
        optimal_values: Value of the best policy, any shape.
        policy_values: Value of the policy in question, the same shape.

    Returns:
        Losses, the same shape, in the unit of the values.
    """
    return optimal_values - policy_values


def normalized_evd(optimal_values: Array, policy_values: Array) -> Array:
    r"""Return what a policy loses as a part of the best value, :math:`1 - V^\pi / V^*`.

    Source: the paper's appendix B. A part of the best value means something only where
    that is positive; `random_normalized_evd` knows no such limit.

    Args:
        optimal_values: Value of the best policy, positive, any shape.
        policy_values: Value of the policy in question, the same shape.

    Returns:
        Losses, the same shape; 0 for the best policy, 1 for one that is worth nothing.

    Raises:
        ValueError: If the best value is not positive somewhere.
    """
    unfit = optimal_values[~(optimal_values > 0.0)]
    if unfit.size:
        raise ValueError(
            f"`optimal_values` must be positive; got {unfit[0]}. Use "
            "`random_normalized_evd`, which takes values of any sign"
        )
    return expected_value_difference(optimal_values, policy_values) / optimal_values


def random_normalized_evd(
    optimal_values: Array, policy_values: Array, random_values: Array
) -> Array:
    r"""Return a policy's loss relative to a random policy's.

    :math:`(V^* - V^\pi) / (V^* - V^{\mathrm{random}})`, which neither a shift nor a
    scale of the reward changes.

    Args:
        optimal_values: Value of the best policy, any shape.
        policy_values: Value of the policy in question, the same shape.
        random_values: Value of the policy that acts uniformly, the same shape.

    Returns:
        Losses, the same shape; 0 for the best policy, 1 for one no better than random,
        and 0 where even the random one loses nothing, as then no policy does.
    """
    losses = expected_value_difference(optimal_values, policy_values)
    stakes = expected_value_difference(optimal_values, random_values)
    is_at_stake = stakes > _ROUNDING * np.abs(optimal_values)
    return np.divide(losses, stakes, out=np.zeros(losses.shape), where=is_at_stake)


def _check_probability(name: str, value: float) -> None:
    """Refuse what lies outside (0, 1)."""
    if not 0.0 < value < 1.0:
        raise ValueError(f"`{name}` must be in (0, 1); got {value}")


def _count_samples(losses: Array) -> int:
    """Return the number of samples, N, at least 1."""
    num_samples = losses.shape[-1]
    if num_samples == 0:
        raise ValueError("`losses` holds no samples; draw at least one")
    return num_samples


def _whole_draws(ess: float, num_samples: int) -> int:
    """Return how many whole independent draws the samples are worth."""
    if not 0.0 < ess < math.inf:
        raise ValueError(
            f"`ess` must be positive and finite; got {ess}. "
            "Leave it out for independent draws"
        )
    return math.floor(min(ess, num_samples))


def _order_statistic(losses: Array, rank: int) -> Array:
    """Return the smallest loss but rank - 1 over the last axis, shape (...,)."""
    num_samples = losses.shape[-1]
    rows = losses.reshape(-1, num_samples)
    found = np.empty(len(rows))
    for block in row_blocks(len(rows), num_samples):
        found[block] = np.partition(rows[block], rank - 1, axis=-1)[:, rank - 1]
    return found.reshape(losses.shape[:-1])
