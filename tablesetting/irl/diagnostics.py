"""How far a set of Markov chains can be trusted.

The diagnostics of Vehtari, Gelman, Simpson, Carpenter and Bürkner, "Rank-normalization,
folding, and localization: an improved R-hat" (*Bayesian Analysis* 16, 2021), which asks
for an R-hat below 1.01 and a bulk and a tail ESS above 100 for each chain.
"""

import numpy as np
from scipy.special import ndtri

from tablesetting.irl.arrays import Array, Booleans, Indices


def rank_normalized_rhat(chains: Array) -> float:
    r"""Compare half-chains by the ranks of their draws: in place, and in spread.

    The larger of two split R-hats: of the rank-normalised draws, and of the
    rank-normalised distances :math:`|x - \mathrm{median}|`, "folded". The second sees
    chains of one mean but different variances; neither needs moments to exist.

    Args:
        chains: States, shape (C, S, D) with at least 4 steps.

    Returns:
        The largest over the dimensions, 1 once the chains have mixed; infinity where
        half-chains stand still apart.
    """
    halves = _split(chains)
    folded = np.abs(halves - np.median(halves, axis=(0, 1)))
    return _rhat(rank_normalize(np.concatenate([halves, folded], axis=2)))


def bulk_ess(chains: Array) -> float:
    """Estimate what the draws are worth for the mean or the median.

    Args:
        chains: States, shape (C, S, D) with at least 4 steps.

    Returns:
        The smallest effective sample size of the rank-normalised draws over the
        dimensions, in [1, C S]; 1 where nothing moves.
    """
    return _ess(rank_normalize(_split(chains)))


def tail_ess(chains: Array) -> float:
    r"""Estimate what the draws are worth for the 5 % and the 95 % quantile.

    The effective sample size of the indicators :math:`x \le q`, or of :math:`x < q`
    where no draw lies above the quantile, as where one value is taken very often.

    Args:
        chains: States, shape (C, S, D) with at least 4 steps.

    Returns:
        The smallest over both quantiles and the dimensions, in [1, C S]; 1 where
        nothing moves.
    """
    quantiles = np.quantile(chains, [0.05, 0.95], axis=(0, 1), method="lower")
    indicators = [_is_below(chains, quantile) for quantile in quantiles]
    return effective_sample_size(np.concatenate(indicators, axis=2).astype(np.float64))


def effective_sample_size(chains: Array) -> float:
    """Estimate how many independent draws the worst dimension is worth for its mean.

    Autocorrelations are pooled over the half-chains and summed by Geyer's initial
    monotone sequence, as Vehtari et al. and Stan do it.

    Args:
        chains: States, shape (C, S, D) with at least 4 steps.

    Returns:
        The smallest effective sample size over the dimensions, in [1, C S]; 1 where
        nothing moves.
    """
    return _ess(_split(chains))


def rank_normalize(chains: Array) -> Array:
    r"""Give the draws of each dimension the quantiles of a normal distribution.

    Args:
        chains: States, shape (C, S, D).

    Returns:
        :math:`\Phi^{-1}((r - 3/8) / (n + 1/4))` of the ranks r among all n = C S draws,
        which equal draws share, shape (C, S, D).
    """
    draws = np.ascontiguousarray(chains.reshape(-1, chains.shape[2]).T)
    num_draws = draws.shape[1]
    # A shared rank is a multiple of 1/2, so few quantiles are needed.
    ranks = 1.0 + np.arange(2 * num_draws - 1) / 2.0
    quantiles = ndtri((ranks - 3.0 / 8.0) / (num_draws + 1.0 / 4.0))
    order = draws.argsort(axis=1)
    ends = _first_plus_last(np.take_along_axis(draws, order, axis=1))
    np.put_along_axis(draws, order, quantiles[ends], axis=1)
    return draws.T.reshape(chains.shape)


def _first_plus_last(ordered: Array) -> Indices:
    """Add the first and the last index of each value in sorted rows, shape (D, N)."""
    indices = np.arange(ordered.shape[1])
    changes = ordered[:, 1:] != ordered[:, :-1]
    first, last = np.zeros((2, *ordered.shape), dtype=np.intp)
    first[:, 1:] = np.where(changes, indices[1:], 0)
    last[:, -1] = indices[-1]
    last[:, :-1] = np.where(changes, indices[:-1], indices[-1])
    backwards = np.minimum.accumulate(last[:, ::-1], axis=1)
    return np.maximum.accumulate(first, axis=1) + backwards[:, ::-1]


def _is_below(chains: Array, quantile: Array) -> Booleans:
    """Tell draws below a quantile, shape (D,), of each dimension, shape (C, S, D)."""
    is_below = chains <= quantile
    return np.where(is_below.all(axis=(0, 1)), chains < quantile, is_below)


def _rhat(halves: Array) -> float:
    """Return the largest R-hat of the half-chains as they are."""
    length = halves.shape[1]
    # Offsets: zero without rounding where nothing moves.
    within = (halves - halves[:, :1]).var(axis=1, ddof=1).mean(axis=0)
    means = (halves - halves[:1, :1]).mean(axis=1)
    between = length * means.var(axis=0, ddof=1)
    pooled = (length - 1) / length * within + between / length
    moving = within > 0.0
    if (between[~moving] > 0.0).any():
        return float("inf")
    return float(np.sqrt(pooled[moving] / within[moving]).max(initial=1.0))


def _ess(halves: Array) -> float:
    """Return the smallest effective sample size of the half-chains as they are."""
    num_halves, length, _ = halves.shape
    total = num_halves * length
    halves = halves - halves[:1, :1]
    autocovariance = _autocovariance(halves)
    within = autocovariance[0] * length / (length - 1)
    pooled = autocovariance[0] + halves.mean(axis=1).var(axis=0, ddof=1)
    if not (pooled > 0.0).all():
        return 1.0
    correlation = 1.0 - (within - autocovariance) / pooled
    return float(min(total / _autocorrelation_time(rho) for rho in correlation.T))


def _split(chains: Array) -> Array:
    """Cut every chain in two, shape (2C, S // 2, D)."""
    half = chains.shape[1] // 2
    return np.concatenate([chains[:, :half], chains[:, -half:]])


def _autocovariance(chains: Array) -> Array:
    """Return the biased autocovariance, the mean over the chains, shape (S, D)."""
    length = chains.shape[1]
    centered = chains - chains.mean(axis=1, keepdims=True)
    spectrum = np.fft.rfft(centered, n=2 * length, axis=1)
    power = np.square(np.abs(spectrum)).mean(axis=0)
    return np.fft.irfft(power, n=2 * length, axis=0)[:length] / length


def _autocorrelation_time(correlation: Array) -> float:
    """Sum the correlations, shape (S,), over pairs of lags while these stay positive.

    The first of the next pair counts once if it is positive: chains whose correlations
    alternate would seem worse without.
    """
    correlation = np.concatenate([[1.0], correlation[1:]])
    num_pairs = len(correlation) // 2
    pairs = correlation[: 2 * num_pairs].reshape(num_pairs, 2).sum(axis=1)
    negative = np.flatnonzero(pairs < 0.0)
    end = int(negative[0]) if negative.size else num_pairs
    rest = max(0.0, float(correlation[2 * end])) if negative.size else 0.0
    total = float(np.minimum.accumulate(pairs[:end]).sum())
    return max(1.0, 2.0 * total - 1.0 + rest)
