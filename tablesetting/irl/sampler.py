"""Metropolis-Hastings on the L1 unit sphere, several chains in lockstep."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Protocol, runtime_checkable

import numpy as np

from tablesetting.irl.arrays import Array, normalize_l1

LogLikelihood = Callable[[Array], Array]
"""Maps weights, shape (C, D), to their log likelihoods, shape (C,)."""

_BLOCK = 2500  # Steps taken at once,
_ADAPTATION_BLOCK = 10  # and while the proposal adapts.


@dataclass(frozen=True)
class McmcConfig:
    """How many chains there are, how long they run and how far each proposal steps."""

    num_chains: int = 4
    """Independent chains."""
    num_steps: int = 24000
    """Proposals drawn in each chain, kept or not."""
    burn_in: int = 6000
    """Steps dropped from the start of each chain; the proposal adapts in them alone."""
    thin: int = 180
    """Keep one step in this many."""
    step_std: float = 0.05
    """Standard deviation of the Gaussian proposal, before renormalising."""
    target_acceptance: float | None = 0.234
    """Acceptance rate that the burn-in adapts the proposal to; None leaves it fixed."""
    is_prior_uniform: bool = True
    """Whether the acceptance accounts for the renormalised proposal's density, which
    makes the prior exactly uniform on the L1 sphere. The paper's chain does not."""
    num_map_steps: int = 60
    """Steps that climb from the most probable sample to the MAP; the paper's best guess
    is that sample."""
    starts_at_map: bool = False
    """Whether chains start one proposal from the previous MAP, as the paper's does,
    rather than at draws from the prior."""

    def __post_init__(self) -> None:
        for name in ("num_chains", "thin"):
            if getattr(self, name) < 1:
                raise ValueError(
                    f"`{name}` must be at least 1; got {getattr(self, name)}"
                )
        if not 0 <= self.burn_in < self.num_steps:
            raise ValueError(
                f"`burn_in` must be in [0, num_steps); got burn_in={self.burn_in} "
                f"with num_steps={self.num_steps}"
            )
        if not self.step_std > 0.0:
            raise ValueError(f"`step_std` must be positive; got {self.step_std}")


@dataclass(frozen=True)
class Chains:
    """What the chains visited after their burn-in, one state per step.

    Attributes:
        weights: States, shape (C, S, D); every state has unit L1 norm.
        log_posts: Unnormalised log posterior of each state, shape (C, S).
        best_weights: Most probable state visited, burn-in included, shape (D,).
        acceptance_rate: Fraction of proposals accepted after the burn-in, in [0, 1].
    """

    weights: Array
    log_posts: Array
    best_weights: Array
    acceptance_rate: float


def sample_uniform_weights(num: int, dim: int, *, rng: np.random.Generator) -> Array:
    """Draw weights uniformly from the L1 unit sphere.

    The density of independent Laplace variables depends on their L1 norm alone, so
    their direction is uniform.

    Returns:
        Weights, shape (num, dim).
    """
    return normalize_l1(rng.laplace(size=(num, dim)))


@dataclass(frozen=True)
class Proposals:
    """The random numbers of S steps of C chains.

    Attributes:
        steps: Added to the state before renormalising, shape (S, C, D).
        squared_noise: Squared norm of the standard normal noise that made each step,
            shape (S, C).
        log_uniforms: Logarithms of uniform numbers, shape (S, C).
        is_prior_uniform: Whether the acceptance accounts for the renormalising.
    """

    steps: Array
    squared_noise: Array
    log_uniforms: Array
    is_prior_uniform: bool


@dataclass(frozen=True)
class Walk:
    """What came of the proposals.

    Attributes:
        weights: State after each step, shape (S, C, D).
        log_posts: Its unnormalised log posterior, shape (S, C).
        log_ratios: Log acceptance ratio of each proposal, shape (S, C).
    """

    weights: Array
    log_posts: Array
    log_ratios: Array


@runtime_checkable
class Walker(Protocol):
    """A log likelihood that takes the steps itself, faster than `walk` does."""

    def walk(self, start: Array, log_posts: Array, proposals: Proposals) -> Walk:
        """Do what the function `walk` does."""
        ...


def walk(
    log_likelihood: LogLikelihood, start: Array, log_posts: Array, proposals: Proposals
) -> Walk:
    r"""Take Metropolis-Hastings steps on the L1 sphere, all chains in lockstep.

    A proposal is :math:`w' = (w + \delta) / r` with :math:`r = \|w + \delta\|_1` and
    :math:`\delta = L\xi`, :math:`\xi \sim N(0, I)`. Its reverse has
    :math:`\delta' = -\delta / r`, and the map of :math:`(w, \delta)` onto
    :math:`(w', \delta')` has the Jacobian :math:`r^{-2D}`, so that the uniform prior
    asks for :math:`-2D \log r - \tfrac12 \|\xi\|^2 (r^{-2} - 1)` in the acceptance.

    Args:
        log_likelihood: Log likelihood of a batch of weights.
        start: State of each chain, shape (C, D), each of unit L1 norm.
        log_posts: Their unnormalised log posteriors, shape (C,).
        proposals: Random numbers of the steps.

    Returns:
        The states after each step.
    """
    states, log_ratios = np.empty_like(proposals.steps), []
    weights, log_post, all_log_posts = start, log_posts, []
    for step, noise in enumerate(proposals.steps):
        moved = weights + noise
        norm = np.abs(moved).sum(axis=1)
        proposal = moved / norm[:, None]
        proposed = log_likelihood(proposal)
        log_ratio = proposed - log_post
        if proposals.is_prior_uniform:
            log_ratio += _log_density_ratio(
                norm, proposals.squared_noise[step], proposal.shape[1]
            )
        is_accepted = proposals.log_uniforms[step] < log_ratio
        weights = np.where(is_accepted[:, None], proposal, weights)
        log_post = np.where(is_accepted, proposed, log_post)
        states[step] = weights
        all_log_posts.append(log_post)
        log_ratios.append(log_ratio)
    return Walk(states, np.array(all_log_posts), np.array(log_ratios))


def run_chains(
    log_likelihood: LogLikelihood,
    start: Array,
    config: McmcConfig,
    *,
    rng: np.random.Generator,
) -> Chains:
    """Sample weights in proportion to their likelihood under a uniform prior.

    Args:
        log_likelihood: Log likelihood of a batch of weights; a `Walker` is faster.
        start: First state of each chain, shape (C, D), each of unit L1 norm.
        config: Length, step and adaptation of the chains.
        rng: Source of the proposals.

    Returns:
        The states after the burn-in.
    """
    num_chains, dim = start.shape
    states = np.empty((config.num_steps, num_chains, dim))
    log_posts = np.empty((config.num_steps, num_chains))
    accepted = np.empty((config.num_steps, num_chains), dtype=bool)
    take_steps = (
        log_likelihood.walk
        if isinstance(log_likelihood, Walker)
        else partial(walk, log_likelihood)
    )
    weights, log_post = start, log_likelihood(start)
    scale = _ProposalScale(config, num_chains, dim)
    for first, last in pairwise(_block_edges(config)):
        proposals = scale.propose(last - first, rng=rng)
        walked = take_steps(weights, log_post, proposals)
        block = slice(first, last)
        states[block], log_posts[block] = walked.weights, walked.log_posts
        accepted[block] = proposals.log_uniforms < walked.log_ratios
        weights, log_post = states[last - 1], log_posts[last - 1]
        if last <= config.burn_in:
            scale.adapt(walked.log_ratios, states[:last])
    best = np.unravel_index(log_posts.argmax(), log_posts.shape)
    kept = slice(config.burn_in, None)
    return Chains(
        weights=states[kept].swapaxes(0, 1),
        log_posts=log_posts[kept].T,
        best_weights=states[best],
        acceptance_rate=float(accepted[kept].mean()),
    )


def _block_edges(config: McmcConfig) -> list[int]:
    """Cut the steps into blocks with one proposal scale each: short while it adapts."""
    adapting = 0 if config.target_acceptance is None else config.burn_in
    burn_in = range(0, adapting, _ADAPTATION_BLOCK)
    return [*burn_in, *range(adapting, config.num_steps, _BLOCK), config.num_steps]


def _log_density_ratio(norm: Array, squared_noise: Array, dim: int) -> Array:
    """Return the log Hastings ratio of a renormalised proposal, shape (C,)."""
    return -2 * dim * np.log(norm) - 0.5 * squared_noise * (norm**-2 - 1.0)


class _ProposalScale:
    """Shape and size of the proposals, adapted during burn-in, frozen afterwards.

    The shape follows the covariance of what the chains have visited (Haario, Saksman
    and Tamminen 2001), the size of each chain its acceptance (Robbins and Monro).
    """

    _INTERVAL = 250  # Steps between two looks at the covariance.

    def __init__(self, config: McmcConfig, num_chains: int, dim: int):
        self._target = config.target_acceptance
        self._is_prior_uniform = config.is_prior_uniform
        # The size needs the last quarter to settle on the final shape.
        self._last_reshape = 3 * config.burn_in // 4
        self._factor: Array = np.eye(dim)
        self._log_step = np.full(num_chains, np.log(config.step_std))
        self._num_looks = 0  # At the acceptance, since the shape last changed.

    def propose(self, num_steps: int, *, rng: np.random.Generator) -> Proposals:
        """Draw the random numbers of a block of steps."""
        shape = (num_steps, len(self._log_step))
        noise = rng.standard_normal((*shape, len(self._factor)))
        return Proposals(
            steps=np.exp(self._log_step)[:, None] * (noise @ self._factor.T),
            squared_noise=np.square(noise).sum(axis=-1),
            log_uniforms=-rng.standard_exponential(shape),
            is_prior_uniform=self._is_prior_uniform,
        )

    def adapt(self, log_ratios: Array, states: Array) -> None:
        """Learn from a block of steps.

        Args:
            log_ratios: Log acceptance ratios in the block, shape (B, C).
            states: All states so far, shape (S, C, D).
        """
        if self._target is None:
            return
        self._num_looks += 1
        probability = np.exp(np.minimum(log_ratios, 0.0)).mean(axis=0)
        self._log_step += self._num_looks**-0.6 * (probability - self._target)
        num_steps = len(states)
        if num_steps % self._INTERVAL == 0 and num_steps <= self._last_reshape:
            self._reshape(states[num_steps // 2 :])
            self._num_looks = 0

    def _reshape(self, recent: Array) -> None:
        """Take the covariance of the recent states, shape (S, C, D), as shape."""
        dim = recent.shape[-1]
        covariance = np.cov(recent.reshape(-1, dim), rowvar=False)
        covariance += 1e-6 * np.eye(dim)
        self._factor = np.linalg.cholesky(covariance).astype(np.float64)
        self._log_step[:] = np.log(2.38 / np.sqrt(dim))
