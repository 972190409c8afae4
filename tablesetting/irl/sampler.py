"""Metropolis-Hastings on the L1 unit sphere, several chains in lockstep."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tablesetting.irl.arrays import Array, normalize_l1

LogLikelihood = Callable[[Array], Array]
"""Maps weights, shape (C, D), to their log likelihoods, shape (C,)."""


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


def run_chains(
    log_likelihood: LogLikelihood,
    start: Array,
    config: McmcConfig,
    *,
    rng: np.random.Generator,
) -> Chains:
    r"""Sample weights in proportion to their likelihood under a uniform prior.

    A proposal is :math:`w' = (w + \delta) / r` with :math:`r = \|w + \delta\|_1` and
    :math:`\delta = L\xi`, :math:`\xi \sim N(0, I)`. Its reverse has
    :math:`\delta' = -\delta / r`, and the map of :math:`(w, \delta)` onto
    :math:`(w', \delta')` has the Jacobian :math:`r^{-2D}`, so that the uniform prior
    asks for :math:`-2D \log r - \tfrac12 \|\xi\|^2 (r^{-2} - 1)` in the acceptance.

    Args:
        log_likelihood: Log likelihood of a batch of weights.
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
    weights, log_post = start, log_likelihood(start)
    scale = _ProposalScale(config, num_chains, dim)
    for step in range(config.num_steps):
        noise = rng.standard_normal((num_chains, dim))
        moved = weights + scale.apply(noise)
        norm = np.abs(moved).sum(axis=1)
        proposal = moved / norm[:, None]
        proposed_log_post = log_likelihood(proposal)
        log_ratio = proposed_log_post - log_post
        if config.is_prior_uniform:
            log_ratio += _log_density_ratio(noise, norm)
        is_accepted = np.log(rng.random(num_chains)) < log_ratio
        weights = np.where(is_accepted[:, None], proposal, weights)
        log_post = np.where(is_accepted, proposed_log_post, log_post)
        states[step], log_posts[step], accepted[step] = weights, log_post, is_accepted
        if step < config.burn_in:
            scale.adapt(step, log_ratio, states)
    best = np.unravel_index(log_posts.argmax(), log_posts.shape)
    kept = slice(config.burn_in, None)
    return Chains(
        weights=states[kept].swapaxes(0, 1),
        log_posts=log_posts[kept].T,
        best_weights=states[best],
        acceptance_rate=float(accepted[kept].mean()),
    )


def _log_density_ratio(noise: Array, norm: Array) -> Array:
    """Return the log Hastings ratio of a renormalised proposal, shape (C,)."""
    dim = noise.shape[1]
    squared = np.square(noise).sum(axis=1)
    return -2 * dim * np.log(norm) - 0.5 * squared * (norm**-2 - 1.0)


class _ProposalScale:
    """Shape and size of the proposals, adapted during burn-in, frozen afterwards.

    The shape follows the covariance of what the chains have visited (Haario, Saksman
    and Tamminen 2001), the size of each chain its acceptance (Robbins and Monro).
    """

    _INTERVAL = 250  # Steps between two looks at the covariance.

    def __init__(self, config: McmcConfig, num_chains: int, dim: int):
        self._target = config.target_acceptance
        # The size needs the last quarter to settle on the final shape.
        self._last_reshape = 3 * config.burn_in // 4
        self._factor: Array = np.eye(dim)
        self._log_step = np.full(num_chains, np.log(config.step_std))
        self._reshaped_at = -1

    def apply(self, noise: Array) -> Array:
        """Turn standard normal noise, shape (C, D), into steps."""
        return np.exp(self._log_step)[:, None] * (noise @ self._factor.T)

    def adapt(self, step: int, log_ratio: Array, states: Array) -> None:
        """Learn from one step; `states` holds all up to it, shape (S, C, D)."""
        if self._target is None:
            return
        gain = (step - self._reshaped_at) ** -0.6
        probability = np.exp(np.minimum(log_ratio, 0.0))
        self._log_step += gain * (probability - self._target)
        is_due = step % self._INTERVAL == self._INTERVAL - 1
        if is_due and step < self._last_reshape:
            self._reshape(states[(step + 1) // 2 : step + 1])
            self._reshaped_at = step

    def _reshape(self, recent: Array) -> None:
        """Take the covariance of the recent states, shape (S, C, D), as shape."""
        dim = recent.shape[-1]
        covariance = np.cov(recent.reshape(-1, dim), rowvar=False)
        covariance += 1e-6 * np.eye(dim)
        self._factor = np.linalg.cholesky(covariance).astype(np.float64)
        self._log_step[:] = np.log(2.38 / np.sqrt(dim))
