"""Markov chains on the L1 unit sphere: annealed, adapted, run until they have mixed."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from tablesetting.irl.arrays import Array, Indices, normalize_l1
from tablesetting.irl.diagnostics import bulk_ess, rank_normalized_rhat, tail_ess

LogDensity = Callable[[Array], Array]
"""Maps states, shape (C, D), to the logarithms of a density, shape (C,)."""

_NO_START = (
    "the posterior is zero where chains would start, at draws from the uniform prior; "
    "give a prior that is positive on more of the sphere, or more `num_particles`"
)

_BLOCK = 2500  # Steps taken at once,
_ADAPTATION_BLOCK = 10  # and while the proposal adapts.
_WORTH = 0.7  # Of annealed particles after a rung, as a share of their number.
_LEAST_RISE = 1e-9  # Of the likelihood's power in a rung.
_FIRST_CHECK = 1000  # Steps after the burn-in,
_GROWTH = 1.4  # and how much longer the chains are at every further look.
_MOST_CHECKED = 500  # States of each chain that a look takes in, but for high targets.


@dataclass(frozen=True)
class McmcConfig:
    """How many chains there are, how long they run and how far each proposal steps."""

    num_chains: int = 4
    """Independent chains."""
    num_steps: int = 50_000
    """Most steps of each chain, its burn-in included."""
    burn_in: int = 1000
    """Steps dropped from the start of each chain; the proposal adapts in them and in
    the annealing alone."""
    num_particles: int = 128
    """Draws from the prior that are annealed into the first states of the chains, and
    give the evidence; 0 starts at draws from the prior."""
    steps_per_rung: int = 2
    """Steps of each particle for each rung of the annealing."""
    num_samples: int = 400
    """Samples kept, evenly spread over all chains."""
    target_ess: float | None = 400.0
    """Bulk and tail effective sample size that end the chains; None runs all steps."""
    max_rhat: float = 1.01
    """Rank-normalised R-hat that they must reach as well."""
    step_std: float = 0.05
    """Standard deviation of the first Gaussian proposals, before renormalising."""
    target_acceptance: float | None = 0.234
    """Acceptance rate that the burn-in adapts the proposal to; None leaves it fixed."""
    is_prior_uniform: bool = True
    """Whether the acceptance accounts for the renormalised proposal's density, which
    makes the prior exactly uniform on the L1 sphere. The paper's chain does not."""
    num_map_steps: int = 60
    """Most steps from the most probable sample to the MAP; the paper's best guess is
    that sample."""
    starts_at_map: bool = False
    """Whether chains start one proposal from the previous MAP, as the paper's does,
    rather than at draws from the prior."""

    def __post_init__(self) -> None:
        for name in ("num_chains", "num_samples", "steps_per_rung"):
            if getattr(self, name) < 1:
                raise ValueError(
                    f"`{name}` must be at least 1; got {getattr(self, name)}"
                )
        if self.num_particles != 0 and self.num_particles < self.num_chains:
            raise ValueError(
                f"`num_particles` must be 0 or at least the number of chains, "
                f"{self.num_chains}; got {self.num_particles}"
            )
        if not 0 <= self.burn_in < self.num_steps:
            raise ValueError(
                f"`burn_in` must be in [0, num_steps); got burn_in={self.burn_in} "
                f"with num_steps={self.num_steps}"
            )
        if self.num_samples > self.num_chains * (self.num_steps - self.burn_in):
            raise ValueError(
                f"`num_samples` must be at most {self.num_chains} chains of "
                f"{self.num_steps - self.burn_in} steps; got {self.num_samples}"
            )
        for name in ("step_std", "target_ess"):
            value = getattr(self, name)
            if value is not None and not value > 0.0:
                raise ValueError(f"`{name}` must be positive; got {value}")
        if not self.max_rhat > 1.0:
            raise ValueError(f"`max_rhat` must be over 1; got {self.max_rhat}")


@dataclass(frozen=True)
class LogNormal:
    """Prior of a positive number: its logarithm is normal, cut off at two spreads."""

    median: float
    """The median, which is as likely exceeded as not."""
    spread: float
    """Standard deviation of the logarithm, before it is cut off."""

    def __post_init__(self) -> None:
        for name in ("median", "spread"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise ValueError(
                    f"`{name}` must be positive; got {getattr(self, name)}"
                )

    def log_density(self, logarithms: Array) -> Array:
        """Evaluate the log density of logarithms but for a constant, same shape."""
        surprise = (logarithms - math.log(self.median)) / self.spread
        return np.where(np.abs(surprise) <= 2.0, -0.5 * surprise**2, -np.inf)

    def draw_log(self, shape: tuple[int, ...], *, rng: np.random.Generator) -> Array:
        """Draw logarithms."""
        noise = rng.standard_normal(shape)
        while (is_off := np.abs(noise) > 2.0).any():
            noise[is_off] = rng.standard_normal(int(is_off.sum()))
        return math.log(self.median) + self.spread * noise


@dataclass(frozen=True)
class SpherePrior:
    """Uniform prior of the weights on the L1 sphere, beside that of a scale."""

    dim: int
    """Number of weights, D."""
    scale: LogNormal | None = None
    """Prior of the scale whose logarithm follows the weights in a state, if any."""

    def draw(self, num: int, *, rng: np.random.Generator) -> Array:
        """Draw states, shape (num, D + E)."""
        weights = sample_uniform_weights(num, self.dim, rng=rng)
        if self.scale is None:
            return weights
        return np.hstack([weights, self.scale.draw_log((num, 1), rng=rng)])

    def log_density(self, states: Array) -> Array:
        """Evaluate the log density of states, shape (..., D + E), but for a constant."""
        if self.scale is None:
            return np.zeros(states.shape[:-1])
        return self.scale.log_density(states[..., self.dim])


@dataclass(frozen=True)
class Diagnosis:
    """How far the chains can be trusted.

    Attributes:
        bulk_ess: Effective sample size of the worst weight's middle.
        tail_ess: The same of its 5 and 95 % quantiles.
        rhat: Rank-normalised split R-hat of the worst weight.
    """

    bulk_ess: float
    tail_ess: float
    rhat: float

    @classmethod
    def of_chains(cls, states: Array, target_ess: float = 0.0) -> "Diagnosis":
        """Look at states of several chains, shape (S, C, D), enough to find a target."""
        if len(states) < 4:  # Too few to be halved.
            return cls(1.0, 1.0, math.inf)
        num_checked = max(_MOST_CHECKED, math.ceil(4.0 * target_ess / states.shape[1]))
        stride = -(-len(states) // num_checked)
        chains = states[::stride].swapaxes(0, 1)
        return cls(bulk_ess(chains), tail_ess(chains), rank_normalized_rhat(chains))

    def is_sound(self, config: McmcConfig) -> bool:
        """Tell whether the chains have got where they were to get."""
        least = config.target_ess or 4.0  # Chains that stand still have 1.
        return (
            min(self.bulk_ess, self.tail_ess) >= least and self.rhat <= config.max_rhat
        )


@dataclass(frozen=True)
class Chains:
    """What the chains visited after their burn-in, one state per step.

    Attributes:
        states: Weights of unit L1 norm, then further parameters, shape (S, C, D + E).
        log_posts: Unnormalised log posterior of each state, shape (S, C).
        best_state: Most probable state visited, burn-in included, shape (D + E,).
        acceptance_rate: Mean acceptance probability after the burn-in, in [0, 1].
        diagnosis: How far they can be trusted.
        log_evidence: Log mean likelihood under the prior, from the annealing; NaN
            without.
    """

    states: Array
    log_posts: Array
    best_state: Array
    acceptance_rate: float
    diagnosis: Diagnosis
    log_evidence: float


@dataclass(frozen=True)
class Walk:
    """What came of the proposals.

    Attributes:
        states: State after each step, shape (S, C, D + E).
        log_likelihoods: Its log likelihood, shape (S, C).
        log_ratios: Log acceptance ratio of each proposal, shape (S, C).
    """

    states: Array
    log_likelihoods: Array
    log_ratios: Array


class Mover(Protocol):
    """Takes the steps of several chains towards one posterior."""

    @property
    def prior(self) -> SpherePrior:
        """The prior of the states."""
        ...

    def log_likelihood(self, states: Array) -> Array:
        """Evaluate the log likelihood of states, shape (C, D + E), as shape (C,)."""
        ...

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
        ...

    def adapt(self, walked: Walk, *, is_annealing: bool) -> None:
        """Learn from the last block of steps, of particles or of chains burning in."""
        ...


def sample_uniform_weights(num: int, dim: int, *, rng: np.random.Generator) -> Array:
    """Draw weights uniformly from the L1 unit sphere.

    The density of independent Laplace variables depends on their L1 norm alone, so
    their direction is uniform.

    Returns:
        Weights, shape (num, dim).
    """
    return normalize_l1(rng.laplace(size=(num, dim)))


def run_chains(
    mover: Mover,
    config: McmcConfig,
    *,
    start: Array | None = None,
    rng: np.random.Generator,
) -> Chains:
    """Sample a posterior until the chains have mixed, or their steps are spent.

    Args:
        mover: The posterior, and how to step towards it.
        config: Chains, steps and when to end.
        start: First state of each chain, shape (C, D + E); draws from the prior if None.
        rng: Source of all randomness.

    Returns:
        The states after the burn-in.
    """
    log_evidence = math.nan
    if start is None and config.num_particles:
        start, log_evidence = _anneal(mover, config, rng=rng)
    elif start is None:
        start = mover.prior.draw(config.num_chains, rng=rng)
    trace = _Trace(mover, start)
    if not np.isfinite(trace.log_likelihoods).all():
        raise ValueError(_NO_START)
    for first in range(0, config.burn_in, _ADAPTATION_BLOCK):
        size = min(_ADAPTATION_BLOCK, config.burn_in - first)
        trace.extend(size, rng=rng, adapts=True)
    trace.forget()
    for num_steps in _looks(config):
        while (missing := num_steps - trace.num_steps) > 0:
            trace.extend(min(missing, _BLOCK), rng=rng)
        states = trace.states
        diagnosis = Diagnosis.of_chains(states, config.target_ess or 0.0)
        if config.target_ess is not None and diagnosis.is_sound(config):
            break
    return Chains(
        states=states,
        log_posts=trace.log_posts,
        best_state=trace.best_state,
        acceptance_rate=trace.acceptance_rate,
        diagnosis=diagnosis,
        log_evidence=log_evidence,
    )


def _looks(config: McmcConfig) -> Iterator[int]:
    """Yield after how many steps past the burn-in to look at the chains."""
    num_steps = config.num_steps - config.burn_in
    # Enough to thin from.
    look = max(_FIRST_CHECK, -(-config.num_samples // config.num_chains))
    while config.target_ess is not None and look < num_steps:
        yield look
        look = math.ceil(_GROWTH * look)
    yield num_steps


def _anneal(
    mover: Mover, config: McmcConfig, *, rng: np.random.Generator
) -> tuple[Array, float]:
    r"""Lead draws from the prior to the posterior; return first states and log evidence.

    Sequential Monte Carlo (Del Moral, Doucet and Jasra 2006): the power p of the
    likelihood L rises from 0 to 1 in rungs that leave the particles worth a fixed share
    of their number; they are drawn anew by :math:`L^{\Delta p}` and moved, which finds
    all modes of some mass that any of them was near. The evidence is the product of
    the means of :math:`L^{\Delta p}`.
    """
    states = mover.prior.draw(config.num_particles, rng=rng)
    log_likelihoods = mover.log_likelihood(states)
    if not np.isfinite(log_likelihoods).any():
        raise ValueError(_NO_START)
    power, log_evidence = 0.0, 0.0
    while power < 1.0:
        rise = _rise(log_likelihoods, 1.0 - power)
        power = min(power + rise, 1.0)
        peak = rise * log_likelihoods.max()
        shares = np.exp(rise * log_likelihoods - peak)
        log_evidence += peak + math.log(shares.mean())
        chosen = _resample(shares, len(shares), rng=rng)
        walked = mover.take_steps(
            states[chosen],
            log_likelihoods[chosen],
            config.steps_per_rung,
            power,
            rng=rng,
        )
        states, log_likelihoods = walked.states[-1], walked.log_likelihoods[-1]
        mover.adapt(walked, is_annealing=True)
    return rng.permutation(states)[: config.num_chains], log_evidence


def _rise(log_likelihoods: Array, most: float) -> float:
    """Find by how much to raise the power, so that particles keep most of their worth."""
    centered = log_likelihoods - log_likelihoods.max()

    def worth(rise: float) -> float:
        shares = np.exp(rise * centered)
        return float(shares.sum() ** 2 / (shares**2).sum() / len(shares))

    if worth(most) >= _WORTH:
        return most
    low, high = 0.0, most
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if worth(middle) >= _WORTH else (low, middle)
    return max(low, _LEAST_RISE)


def _resample(shares: Array, num: int, *, rng: np.random.Generator) -> Indices:
    """Draw indices in proportion to shares, systematically."""
    edges = np.cumsum(shares) / shares.sum()
    positions = (np.arange(num) + rng.random()) / num
    return np.minimum(np.searchsorted(edges, positions), len(shares) - 1)


class _Trace:
    """The states of all chains, as they grow."""

    def __init__(self, mover: Mover, start: Array):
        self._mover = mover
        self._current = start
        self.log_likelihoods = mover.log_likelihood(start)
        self._best_log_post = -math.inf
        self.best_state = start[0]
        self.forget()

    def forget(self) -> None:
        """Drop what was visited, but for the best of it."""
        self._walks: list[Walk] = []
        self._log_posts: list[Array] = []

    @property
    def num_steps(self) -> int:
        """Number of steps remembered, S."""
        return sum(len(walked.states) for walked in self._walks)

    @property
    def states(self) -> Array:
        """States remembered, shape (S, C, D + E)."""
        return np.concatenate([walked.states for walked in self._walks])

    @property
    def log_posts(self) -> Array:
        """Their unnormalised log posteriors, shape (S, C)."""
        return np.concatenate(self._log_posts)

    @property
    def acceptance_rate(self) -> float:
        """Mean acceptance probability of the steps remembered."""
        ratios = np.concatenate([walked.log_ratios for walked in self._walks])
        return float(np.exp(np.minimum(ratios, 0.0)).mean())

    def extend(
        self,
        num_steps: int,
        *,
        rng: np.random.Generator,
        adapts: bool = False,
    ) -> None:
        """Take steps."""
        walked = self._mover.take_steps(
            self._current, self.log_likelihoods, num_steps, 1.0, rng=rng
        )
        self._walks.append(walked)
        self._current = walked.states[-1]
        self.log_likelihoods = walked.log_likelihoods[-1]
        log_posts = walked.log_likelihoods + self._mover.prior.log_density(
            walked.states
        )
        self._log_posts.append(log_posts)
        if log_posts.max() > self._best_log_post:
            best = np.unravel_index(log_posts.argmax(), log_posts.shape)
            self._best_log_post = float(log_posts[best])
            self.best_state = walked.states[best]
        if adapts:
            self._mover.adapt(walked, is_annealing=False)


class WithPrior:
    """A mover whose uniform prior on the sphere is replaced by another.

    Some steps under the uniform prior are one proposal, which the ratio of the new
    prior accepts: they leave the posterior under the uniform prior as it is and are
    reversible, so that nothing else enters (Liu, *Monte Carlo Strategies in Scientific
    Computing*, 2001, section 9.4.3). What is annealed, and is called the likelihood
    here, is the likelihood times the new prior.
    """

    _NUM_STEPS = 4  # That make up one proposal.

    def __init__(self, mover: Mover, log_prior: LogDensity):
        self._mover = mover
        self._log_density = log_prior
        self.prior = mover.prior
        self.adapt = mover.adapt

    def log_likelihood(self, states: Array) -> Array:
        """Evaluate log likelihood and new log prior of states, (C, D + E), as (C,)."""
        return self._mover.log_likelihood(states) + self._log_new_prior(states)

    def _log_new_prior(self, states: Array) -> Array:
        found = np.asarray(self._log_density(states[:, : self.prior.dim]), dtype=float)
        if found.shape != (len(states),):
            raise ValueError(
                f"`log_prior` must map weights of shape {states.shape} to log densities "
                f"of shape {(len(states),)}; got shape {found.shape}"
            )
        unfit = found[np.isnan(found) | (found == np.inf)]
        if unfit.size:
            raise ValueError(
                f"`log_prior` must be finite, or -inf where the prior is zero; got "
                f"{unfit[0]}"
            )
        return found

    def take_steps(
        self,
        start: Array,
        log_likelihoods: Array,
        num_steps: int,
        power: float,
        *,
        rng: np.random.Generator,
    ) -> Walk:
        """Take steps, each of several under the uniform prior."""
        taken = []
        here, prior = log_likelihoods, self._log_new_prior(start)
        for _ in range(num_steps):
            inner = self._mover.take_steps(
                start, here - prior, self._NUM_STEPS, power, rng=rng
            )
            proposal = inner.states[-1]
            proposed = self._log_new_prior(proposal)
            gain = power * (proposed - prior)
            accepts = -rng.standard_exponential(len(start)) < gain
            start = np.where(accepts[:, None], proposal, start)
            here = np.where(accepts, inner.log_likelihoods[-1] + proposed, here)
            prior = np.where(accepts, proposed, prior)
            inner_rate = np.exp(np.minimum(inner.log_ratios, 0.0)).mean(axis=0)
            log_rate = np.log(np.maximum(inner_rate, 1e-300)) + np.minimum(gain, 0.0)
            taken.append((start, here, log_rate))
        return Walk(*(np.array(each) for each in zip(*taken, strict=True)))
