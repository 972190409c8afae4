"""How far a set of Markov chains can be trusted."""

import numpy as np

from tablesetting.irl.arrays import Array


def split_rhat(chains: Array) -> float:
    r"""Compare the variance between half-chains with the variance within them.

    The potential scale reduction of Gelman et al., *Bayesian Data Analysis* (2013),
    section 11.4, the worst over the dimensions; 1 once the chains have mixed.

    Args:
        chains: States, shape (C, S, D) with at least 4 steps.

    Returns:
        The largest split R-hat; infinity where half-chains stand still apart.
    """
    halves = _split(chains)
    length = halves.shape[1]
    within = halves.var(axis=1, ddof=1).mean(axis=0)
    between = length * halves.mean(axis=1).var(axis=0, ddof=1)
    pooled = (length - 1) / length * within + between / length
    moving = within > 0.0
    if not moving.all() and (between[~moving] > 0.0).any():
        return float("inf")
    return float(np.sqrt(pooled[moving] / within[moving]).max(initial=1.0))


def effective_sample_size(chains: Array) -> float:
    """Estimate how many independent draws the worst dimension is worth.

    Autocorrelations are pooled over the half-chains and summed by Geyer's initial
    monotone sequence, as in Gelman et al. (2013), section 11.5.

    Args:
        chains: States, shape (C, S, D) with at least 4 steps.

    Returns:
        The smallest effective sample size over the dimensions, in [1, C S].
    """
    halves = _split(chains)
    num_halves, length, _ = halves.shape
    total = num_halves * length
    autocovariance = _autocovariance(halves).mean(axis=0)
    within = autocovariance[0] * length / (length - 1)
    between = halves.mean(axis=1).var(axis=0, ddof=1)
    pooled = autocovariance[0] + between
    if not (pooled > 0.0).all():
        return 1.0
    correlation = 1.0 - (within - autocovariance) / pooled
    return float(min(total / _autocorrelation_time(rho) for rho in correlation.T))


def _split(chains: Array) -> Array:
    """Cut every chain in two, shape (2C, S // 2, D)."""
    half = chains.shape[1] // 2
    return np.concatenate([chains[:, :half], chains[:, -half:]])


def _autocovariance(chains: Array) -> Array:
    """Return the biased autocovariance at each lag, shape (C, S, D)."""
    length = chains.shape[1]
    centered = chains - chains.mean(axis=1, keepdims=True)
    spectrum = np.fft.rfft(centered, n=2 * length, axis=1)
    power = np.fft.irfft(np.abs(spectrum) ** 2, n=2 * length, axis=1)
    return power[:, :length] / length


def _autocorrelation_time(correlation: Array) -> float:
    """Sum the correlations, shape (S,), over pairs of lags while these stay positive."""
    correlation = np.concatenate([[1.0], correlation[1:]])
    num_pairs = len(correlation) // 2
    pairs = correlation[: 2 * num_pairs].reshape(num_pairs, 2).sum(axis=1)
    negative = np.flatnonzero(pairs < 0.0)
    pairs = pairs[: negative[0]] if negative.size else pairs
    return max(1.0, float(2.0 * np.minimum.accumulate(pairs).sum() - 1.0))
