"""One session of learning: the active loop, with bound and fit of every round."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tablesetting.experiments.setup import RunSetup, Session
from tablesetting.irl.active import Round, run_active
from tablesetting.irl.arrays import Array
from tablesetting.irl.certificate import Bound, doubts
from tablesetting.irl.strategies import STRATEGIES
from tablesetting.reward.fit import Fit, explained_p_value, foretold_p_value
from tablesetting.reward.likelihood import Demonstration


@dataclass(frozen=True)
class LearningRound:
    """A round of the active loop, and how far it can be trusted.

    What takes time is worked out when it is first asked for.

    Attributes:
        setup: The session.
        learning: Posterior, candidates and query.
        before: The round before; None at the first.
        look: Which look at the bound this is, from 1.
        known: P-values of what was foretold in rounds that are not at hand any more,
            the last of them that of the latest demonstration.
    """

    setup: Session
    learning: Round[Array, Demonstration]
    before: "LearningRound | None"
    look: int
    known: tuple[float, ...] = ()

    @property
    def num_demos(self) -> int:
        """Number of demonstrations learned from."""
        return len(self.learning.demos)

    def rng_for(self, *purpose: int) -> np.random.Generator:
        """Return a source of randomness that nothing else draws from."""
        seeds = self.setup.side_seeds
        key = (*seeds.spawn_key, self.num_demos, *purpose)
        return np.random.default_rng(
            np.random.SeedSequence(seeds.entropy, spawn_key=key)
        )

    @cached_property
    def errors(self) -> Array:
        """Placement error in every test layout, shape (L,), in table units."""
        if self.setup.validation is None:
            raise ValueError("`errors` need test layouts, which this session has not")
        guess = self.learning.posterior.guessed_weights
        return self.setup.validation.placement_errors(guess)

    @property
    def share_within_epsilon(self) -> float:
        """Share of the test layouts whose error is below epsilon."""
        return float(np.mean(self.errors < self.setup.epsilon))

    @cached_property
    def bound(self) -> Bound:
        """The bound on the loss in layouts such as the robot will meet."""
        problem, posterior = self.setup.problem, self.learning.posterior
        losses = problem.policy_losses(list(self.setup.deployment), posterior)
        return Bound.of_losses(
            losses, posterior.kept_ess, problem.config.risk, self.look
        )

    @cached_property
    def fit(self) -> Fit:
        """Whether the demonstrations are such as the model of the person would give."""
        problem, learning = self.setup.problem, self.learning
        rng = self.rng_for(0)
        foretold = self.known
        if self.before is not None:
            latest = foretold_p_value(
                learning.demos[-1],
                self.before.learning.posterior,
                problem.widths,
                problem.config,
                rng=rng,
            )
            foretold = (*self.before.fit.foretold, latest)
        explained = explained_p_value(
            learning.demos, learning.posterior, problem.widths, problem.config, rng=rng
        )
        return Fit(explained, foretold)

    @property
    def stopping_bound(self) -> float:
        """The bound that ends the session once it is below epsilon."""
        if self.setup.is_bound_deployed:
            return self.bound.value
        return self.learning.var_bound

    @property
    def is_certain(self) -> bool:
        """Whether that is so."""
        return self.stopping_bound < self.setup.epsilon

    @cached_property
    def doubts(self) -> list[str]:
        """Why the loss is not certified to be below epsilon, in words."""
        config = self.setup.problem.config.mcmc
        found = doubts(
            self.bound, self.setup.epsilon, self.learning.posterior, self.fit.p_value
        )
        if not config.is_prior_uniform:
            found.append("the sampler of the paper does not keep to the prior")
        return found


def learn(setup: RunSetup, strategy: str) -> Iterator[LearningRound]:
    """Learn actively with a strategy, by name; the caller stops it.

    Yields:
        One round per number of demonstrations.
    """
    problem, before = setup.problem, None
    rounds = run_active(
        problem,
        [problem.demonstrate(setup.first_layout, rng=setup.teacher_rng)],
        STRATEGIES[strategy],
        problem.config.risk,
        rng=setup.rng,
    )
    for look, learning in enumerate(rounds, start=1):
        before = LearningRound(setup, learning, before, look)
        yield before
