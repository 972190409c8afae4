"""Samples of the reward given the demonstrations."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from scipy.special import logsumexp

from tablesetting.irl.arrays import Array, Indices, normalize_l1
from tablesetting.irl.map_search import ConcaveLikelihood, Gradient, find_map
from tablesetting.irl.random_walk import RandomWalk
from tablesetting.irl.sampler import (
    Chains,
    Diagnosis,
    LogDensity,
    McmcConfig,
    Mover,
    WithPrior,
    run_chains,
)

Guess = Literal["map", "mean"]


@dataclass(frozen=True)
class Posterior:
    """Samples from P(R | D), one reward hypothesis per row.

    Attributes:
        weights: Reward weights, shape (N, D); every row has unit L1 norm. The rows of
            a chain follow each other.
        log_posts: Unnormalised log posterior of each row, shape (N,).
        scales: The demonstrator's rationality or noise in each row, shape (N,); None
            where it was fixed.
        map_weights: The most probable weights that were found, shape (D,).
        mean_weights: Mean over all that the chains visited, scaled to unit L1 norm,
            shape (D,).
        guess: What the robot acts on: the MAP or the mean weights.
        num_chains: Number of chains, which share the rows evenly; 1 for a mixture.
        acceptance_rate: Mean acceptance probability of the proposals, in [0, 1].
        diagnosis: How far the chains can be trusted.
        is_sound: Whether they got where they were to get before their steps were spent.
        log_evidence: Log mean likelihood of the demonstrations under the prior; NaN
            where it was not estimated.
        shares: Probability of each model of the demonstrator, where several were
            weighed, each as probable as the others before the demonstrations.
    """

    weights: Array
    log_posts: Array
    scales: Array | None
    map_weights: Array
    mean_weights: Array
    guess: Guess
    num_chains: int
    acceptance_rate: float
    diagnosis: Diagnosis
    is_sound: bool
    log_evidence: float
    shares: Mapping[str, float] = field(default_factory=dict)

    @property
    def ess(self) -> float:
        """The smaller of bulk and tail effective sample size, of the worst weight."""
        return min(self.diagnosis.bulk_ess, self.diagnosis.tail_ess)

    @property
    def kept_ess(self) -> float:
        r"""Independent draws that the rows are worth: :math:`N \tanh(\mathrm{ess} / N)`.

        Thinned to N states, chains lose some of their ESS. This is what autoregressive
        ones keep of it: for large N all, and never more than N.
        """
        num_rows = len(self.weights)
        return num_rows * math.tanh(self.ess / num_rows)

    @property
    def rhat(self) -> float:
        """Rank-normalised split R-hat of the worst weight."""
        return self.diagnosis.rhat

    @property
    def guessed_weights(self) -> Array:
        """The weights that the robot acts on, shape (D,)."""
        return self.map_weights if self.guess == "map" else self.mean_weights

    def likeliest_model(self, only: str) -> str:
        """Name the most probable model of the demonstrator, or the only one."""
        return max(self.shares, key=lambda name: self.shares[name], default=only)


@runtime_checkable
class OwnMover(Protocol):
    """A log likelihood that knows how to step towards its posterior."""

    def mover(self, config: McmcConfig) -> Mover:
        """Return what takes the steps."""
        ...


def infer_posterior(
    log_likelihood: LogDensity,
    dim: int,
    config: McmcConfig,
    *,
    previous_map: Array | None = None,
    log_prior: LogDensity | None = None,
    guess: Guess = "map",
    rng: np.random.Generator,
) -> Posterior:
    """Sample the posterior of the weights, under a uniform prior unless told.

    Args:
        log_likelihood: Log likelihood of a batch of weights; what it knows more of, such
            as how to step (`OwnMover`), is used.
        dim: Number of weights, D.
        config: Chains, steps and when to end.
        previous_map: MAP of the posterior before the last demonstration, shape (D,),
            where chains start in the paper's setting; None at the first.
        log_prior: Log density of the prior on the L1 sphere, of a batch of weights and
            but for a constant; uniform if None.
        guess: What the robot is to act on.
        rng: Source of the start and the proposals.

    Returns:
        The samples that are kept and the MAP.
    """
    mover: Mover = (
        log_likelihood.mover(config)
        if isinstance(log_likelihood, OwnMover)
        else RandomWalk(log_likelihood, dim, config)
    )
    if log_prior is not None:
        mover = WithPrior(mover, log_prior)
    start = None
    if config.starts_at_map:
        center = np.zeros(dim) if previous_map is None else previous_map
        noise = rng.standard_normal((config.num_chains, dim))
        start = normalize_l1(center + config.step_std * noise)
    chains = run_chains(mover, config, start=start, rng=rng)
    map_weights = chains.best_state[:dim]
    if guess == "map" and config.num_map_steps:
        others = chains.best_state[dim:]
        map_weights = find_map(
            _log_post_beside(mover, others),
            map_weights,
            config.num_map_steps,
            gradient=_gradient_beside(log_likelihood, others)
            if log_prior is None and isinstance(log_likelihood, ConcaveLikelihood)
            else None,
            rng=rng,
        )
    return _keep(chains, dim, config, map_weights, guess, log_prior is None)


def mix_posteriors(
    posteriors: Mapping[str, Posterior], shares: Mapping[str, float], guess_of: str
) -> Posterior:
    """Mix the posteriors under several models of the demonstrator.

    Each gives as many of its samples, evenly spread, as its model is probable.

    Args:
        posteriors: Posteriors of as many samples each, with fixed scales, by the name of
            the model.
        shares: Probability of each model; they add up to 1.
        guess_of: The model whose guess the robot acts on.

    Returns:
        The mixture. Its effective sample size is that of a mean over it, its R-hat the
        worst of a model that gives a sample.
    """
    best = posteriors[guess_of]
    chosen = _rows_of_each(shares, len(best.weights))
    evidence = np.array([posteriors[name].log_evidence for name in shares])
    used = [posteriors[name] for name in shares if len(chosen[name])]
    bulk, tail = (
        1.0
        / sum(shares[n] ** 2 / getattr(posteriors[n].diagnosis, kind) for n in shares)
        for kind in ("bulk_ess", "tail_ess")
    )
    return replace(
        best,
        weights=np.concatenate([posteriors[n].weights[chosen[n]] for n in shares]),
        log_posts=np.concatenate(
            [_log_mixed(posteriors[n], shares[n], chosen[n]) for n in shares]
        ),
        scales=None,
        num_chains=1,
        diagnosis=Diagnosis(bulk, tail, max(each.rhat for each in used)),
        is_sound=all(each.is_sound for each in used),
        log_evidence=float(logsumexp(evidence) - math.log(len(evidence))),
        shares=shares,
    )


def _log_mixed(posterior: Posterior, share: float, rows: Indices) -> Array:
    """Return log posteriors of rows of one model, on the scale of all models."""
    share = max(share, 1e-300)
    return posterior.log_posts[rows] - posterior.log_evidence + math.log(share)


def _rows_of_each(shares: Mapping[str, float], num_rows: int) -> dict[str, Indices]:
    """Choose evenly spread rows of each model in proportion to its share."""
    edges = np.round(num_rows * np.cumsum([0.0, *shares.values()])).astype(int)
    counts = dict(zip(shares, np.diff(edges), strict=True))
    return {
        name: ((np.arange(count) + 0.5) * num_rows / max(count, 1)).astype(int)
        for name, count in counts.items()
    }


def _log_post_beside(mover: Mover, others: Array) -> LogDensity:
    """Return the log posterior of weights beside given other parameters."""

    def log_post(weights: Array) -> Array:
        beside = np.broadcast_to(others, (len(weights), len(others)))
        states = np.hstack([weights, beside])
        return mover.log_likelihood(states) + mover.prior.log_density(states)

    return log_post


def _gradient_beside(log_likelihood: ConcaveLikelihood, others: Array) -> Gradient:
    """Return the gradient by the weights beside given other parameters."""
    return lambda weights: log_likelihood.concave_gradient(
        np.concatenate([weights, others])
    )


def _keep(
    chains: Chains,
    dim: int,
    config: McmcConfig,
    map_weights: Array,
    guess: Guess,
    is_evidence_known: bool,
) -> Posterior:
    """Thin the chains to the samples that are kept."""
    num_each = max(config.num_samples // config.num_chains, 1)
    stride = len(chains.states) // num_each
    chosen = slice(stride - 1, stride * num_each, stride)
    kept = chains.states[chosen].swapaxes(0, 1).reshape(-1, chains.states.shape[-1])
    return Posterior(
        weights=kept[:, :dim],
        log_posts=chains.log_posts[chosen].T.ravel(),
        scales=np.exp(kept[:, dim]) if kept.shape[1] > dim else None,
        map_weights=map_weights,
        mean_weights=normalize_l1(chains.states[..., :dim].mean(axis=(0, 1))),
        guess=guess,
        num_chains=config.num_chains,
        acceptance_rate=chains.acceptance_rate,
        diagnosis=chains.diagnosis,
        is_sound=chains.diagnosis.is_sound(config),
        log_evidence=chains.log_evidence if is_evidence_known else math.nan,
    )
