"""Metropolis-Hastings on the L1 unit sphere with adapted Gaussian proposals."""

import math
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from tablesetting.irl.arrays import Array
from tablesetting.irl.sampler import (
    LogDensity,
    LogNormal,
    McmcConfig,
    SpherePrior,
    Walk,
)


@dataclass(frozen=True)
class Proposals:
    """The random numbers of S steps of C chains.

    Attributes:
        steps: Added to the state, whose weights are then renormalised, shape
            (S, C, D + E).
        squared_noise: Squared norm of the standard normal noise that made each step of
            the weights, shape (S, C).
        log_uniforms: Logarithms of uniform numbers, shape (S, C).
        is_prior_uniform: Whether the acceptance accounts for the renormalising.
        power: Power of the likelihood.
    """

    steps: Array
    squared_noise: Array
    log_uniforms: Array
    is_prior_uniform: bool
    power: float = 1.0


@runtime_checkable
class Walker(Protocol):
    """A log likelihood that takes the steps itself, faster than `walk` does."""

    def walk(self, start: Array, log_likelihoods: Array, proposals: Proposals) -> Walk:
        """Do what the function `walk` does."""
        ...


def walk(
    log_likelihood: LogDensity,
    start: Array,
    log_likelihoods: Array,
    proposals: Proposals,
    scale_prior: LogNormal | None = None,
) -> Walk:
    r"""Take Metropolis-Hastings steps on the L1 sphere, all chains in lockstep.

    A proposal is :math:`w' = (w + \delta) / r` with :math:`r = \|w + \delta\|_1` and
    :math:`\delta = L\xi`, :math:`\xi \sim N(0, I)`. Its reverse has
    :math:`\delta' = -\delta / r`, and the map of :math:`(w, \delta)` onto
    :math:`(w', \delta')` has the Jacobian :math:`r^{-2D}`, so that the uniform prior
    asks for :math:`-2D \log r - \tfrac12 \|\xi\|^2 (r^{-2} - 1)` in the acceptance.

    Args:
        log_likelihood: Log likelihood of a batch of states.
        start: State of each chain, shape (C, D + E), its weights of unit L1 norm.
        log_likelihoods: Their log likelihoods, shape (C,).
        proposals: Random numbers of the steps.
        scale_prior: Prior of the number whose logarithm follows the weights in a state;
            None where nothing does.

    Returns:
        The states after each step.
    """
    dim = start.shape[1] - (scale_prior is not None)
    states, log_ratios = np.empty_like(proposals.steps), []
    state, here, visited = start, log_likelihoods, []
    for step, noise in enumerate(proposals.steps):
        proposal = state + noise
        norm = np.abs(proposal[:, :dim]).sum(axis=1)
        proposal[:, :dim] /= norm[:, None]
        there = log_likelihood(proposal)
        log_ratio = proposals.power * (there - here)
        if scale_prior is not None:
            log_ratio += scale_prior.log_density(proposal[:, dim])
            log_ratio -= scale_prior.log_density(state[:, dim])
        if proposals.is_prior_uniform:
            log_ratio -= 2 * dim * np.log(norm)
            log_ratio -= 0.5 * proposals.squared_noise[step] * (norm**-2 - 1.0)
        is_accepted = proposals.log_uniforms[step] < log_ratio
        state = np.where(is_accepted[:, None], proposal, state)
        here = np.where(is_accepted, there, here)
        states[step] = state
        visited.append(here)
        log_ratios.append(log_ratio)
    return Walk(states, np.array(visited), np.array(log_ratios))


class RandomWalk:
    """A random walk whose steps take the shape of what the chains visit.

    Implements `irl.sampler.Mover` for any log likelihood; a `Walker` is faster.
    """

    _INTERVAL = 250  # Steps between two looks at the covariance.

    def __init__(
        self,
        log_likelihood: LogDensity,
        dim: int,
        config: McmcConfig,
        scale_prior: LogNormal | None = None,
    ):
        self.log_likelihood = log_likelihood
        self.prior = SpherePrior(dim, scale_prior)
        self._config = config
        # The size needs the last quarter to settle on the final shape.
        self._last_reshape = 3 * config.burn_in // 4
        self._factor: Array = np.eye(dim + (scale_prior is not None))
        self._annealed: Array | None = None  # Covariance of the particles.
        self._log_step = math.log(config.step_std)
        self._visited: list[Array] = []  # Since the burn-in began.
        self._num_looks = 0  # At the acceptance, since the shape last changed.

    def take_steps(
        self,
        start: Array,
        log_likelihoods: Array,
        num_steps: int,
        power: float,
        *,
        rng: np.random.Generator,
    ) -> Walk:
        """Take steps from states of known likelihood, which a power flattens."""
        proposals = self._propose(len(start), num_steps, power, rng)
        if isinstance(self.log_likelihood, Walker):
            return self.log_likelihood.walk(start, log_likelihoods, proposals)
        scale_prior = self.prior.scale
        return walk(self.log_likelihood, start, log_likelihoods, proposals, scale_prior)

    def adapt(self, walked: Walk, *, is_annealing: bool) -> None:
        """Learn size and shape of the steps from the last block of them.

        The shape is the covariance of the particles while these are annealed, then that
        of what the chains visit (Haario, Saksman and Tamminen 2001); the size follows
        the acceptance (Robbins and Monro).
        """
        if self._config.target_acceptance is None:
            return
        self._num_looks += 1
        probability = np.exp(np.minimum(walked.log_ratios, 0.0)).mean()
        change = float(probability) - self._config.target_acceptance
        self._log_step += self._num_looks**-0.6 * change
        if is_annealing:
            self._annealed = np.cov(walked.states[-1], rowvar=False)
            self._reshape(self._annealed)
            return
        self._visited.append(walked.states)
        num_steps = sum(map(len, self._visited))
        if num_steps % self._INTERVAL == 0 and num_steps <= self._last_reshape:
            recent = np.concatenate(self._visited[len(self._visited) // 2 :])
            visited = np.cov(recent.reshape(-1, recent.shape[-1]), rowvar=False)
            if self._annealed is not None:
                # A few correlated states alone would be a noisy guide.
                visited = 0.5 * (visited + self._annealed)
            self._reshape(visited)
            self._num_looks = 0

    def _propose(
        self, num_chains: int, num_steps: int, power: float, rng: np.random.Generator
    ) -> Proposals:
        shape = (num_steps, num_chains)
        noise = rng.standard_normal((*shape, len(self._factor)))
        return Proposals(
            steps=math.exp(self._log_step) * (noise @ self._factor.T),
            squared_noise=np.square(noise[..., : self.prior.dim]).sum(axis=-1),
            log_uniforms=-rng.standard_exponential(shape),
            is_prior_uniform=self._config.is_prior_uniform,
            power=power,
        )

    def _reshape(self, covariance: Array) -> None:
        """Take a covariance, shape (D + E, D + E), as the shape of steps."""
        covariance = covariance.copy()
        # Only the steps of the weights are scaled back: no other may go with them.
        dim = self.prior.dim
        covariance[:dim, dim:] = covariance[dim:, :dim] = 0
        covariance += 1e-6 * np.eye(len(covariance))
        self._factor = np.linalg.cholesky(covariance).astype(np.float64)
        self._log_step = math.log(2.38 / math.sqrt(len(covariance)))
