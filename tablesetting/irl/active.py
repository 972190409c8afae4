"""The active loop of the paper's Algorithm 1, for any domain."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Generic, Protocol, TypeVar

import numpy as np

from tablesetting.irl.arrays import Array
from tablesetting.irl.outlook import Outlook
from tablesetting.irl.posterior import Posterior
from tablesetting.irl.risk import RiskConfig, value_at_risk
from tablesetting.irl.strategies import Strategy

QueryT = TypeVar("QueryT")
DemoT = TypeVar("DemoT")


class Problem(Protocol[QueryT, DemoT]):
    """What the loop needs to know of a domain: a grid world or a table."""

    def infer(
        self,
        demos: Sequence[DemoT],
        previous: Posterior | None,
        *,
        rng: np.random.Generator,
    ) -> Posterior:
        """Sample the posterior; `previous` is that of one demonstration less."""
        ...

    def propose_queries(
        self, demos: Sequence[DemoT], posterior: Posterior, *, rng: np.random.Generator
    ) -> Sequence[QueryT]:
        """Draw the candidate queries, Q of them, knowing the posterior given `demos`."""
        ...

    def outlook(self, queries: Sequence[QueryT], posterior: Posterior) -> Outlook:
        """Return what the posterior says of the candidates."""
        ...

    def demonstrate(self, query: QueryT, *, rng: np.random.Generator) -> DemoT:
        """Ask the demonstrator."""
        ...


@dataclass(frozen=True)
class Round(Generic[QueryT, DemoT]):
    """What is known after a number of demonstrations, and what to ask next.

    Attributes:
        demos: The demonstrations so far.
        posterior: The posterior given these.
        candidates: The queries that were weighed, Q of them.
        outlook: What the posterior says of them.
        var: Value at risk of each candidate, shape (Q,).
        scores: The strategy's score of each candidate, shape (Q,).
        inference_seconds: Time that the posterior took.
        query_seconds: Time that candidates, losses and scores took.
    """

    demos: tuple[DemoT, ...]
    posterior: Posterior
    candidates: Sequence[QueryT]
    outlook: Outlook
    var: Array
    scores: Array
    inference_seconds: float
    query_seconds: float

    @property
    def query_index(self) -> int:
        """Index of the candidate with the highest score."""
        return int(np.argmax(self.scores))

    @property
    def query(self) -> QueryT:
        """The candidate to ask about."""
        return self.candidates[self.query_index]

    @property
    def var_bound(self) -> float:
        """The largest value at risk over the candidates."""
        return float(self.var.max())


def run_active(
    problem: Problem[QueryT, DemoT],
    demos: Sequence[DemoT],
    strategy: Strategy,
    risk: RiskConfig,
    *,
    rng: np.random.Generator,
) -> Iterator[Round[QueryT, DemoT]]:
    """Learn actively; the caller stops it.

    The demonstrator is asked only when the next round is. Every purpose has its own
    stream of random numbers in every round, so that strategies can be paired.

    Args:
        problem: The domain.
        demos: The first demonstrations, at least one.
        strategy: Scores the candidates.
        risk: The quantile that bounds the loss.
        rng: Source of all randomness.

    Yields:
        One round per number of demonstrations.
    """
    collected = tuple(demos)
    posterior = None
    while True:
        streams = rng.spawn(3)
        latest = take_round(problem, collected, posterior, strategy, risk, streams)
        posterior = latest.posterior
        yield latest
        # A child leaves what its parent draws as it is.
        (teacher_rng,) = streams[-1].spawn(1)
        collected += (problem.demonstrate(latest.query, rng=teacher_rng),)


def learn_from(
    problem: Problem[QueryT, DemoT],
    demos: Sequence[DemoT],
    strategy: Strategy,
    risk: RiskConfig,
    *,
    first: int = 1,
    rng: np.random.Generator,
) -> Iterator[Round[QueryT, DemoT]]:
    """Learn from recorded demonstrations, one after the other; nobody is asked.

    Args:
        problem: The domain.
        demos: The demonstrations in their order, at least one.
        strategy: Scores the candidates.
        risk: The quantile that bounds the loss.
        first: From how many demonstrations to learn first. It changes no later round
            unless chains start at the previous MAP.
        rng: Source of all randomness.

    Yields:
        One round per number of demonstrations. Demonstrations that `run_active` has
        collected give its rounds again, from the same `rng`.
    """
    posterior = None
    for num_demos in range(1, len(demos) + 1):
        collected, streams = tuple(demos[:num_demos]), rng.spawn(3)
        if num_demos < first:
            continue
        latest = take_round(problem, collected, posterior, strategy, risk, streams)
        posterior = latest.posterior
        yield latest


def take_round(
    problem: Problem[QueryT, DemoT],
    demos: tuple[DemoT, ...],
    previous: Posterior | None,
    strategy: Strategy,
    risk: RiskConfig,
    streams: Sequence[np.random.Generator],
) -> Round[QueryT, DemoT]:
    """Learn from demonstrations, and weigh what to ask next.

    Args:
        problem: The domain.
        demos: The demonstrations so far.
        previous: The posterior of one demonstration less; None at the first.
        strategy: Scores the candidates.
        risk: The quantile that bounds the loss.
        streams: Sources of the randomness of posterior, candidates and strategy.
    """
    infer_rng, propose_rng, strategy_rng = streams
    started = perf_counter()
    posterior = problem.infer(demos, previous, rng=infer_rng)
    inferred = perf_counter()
    candidates = problem.propose_queries(demos, posterior, rng=propose_rng)
    outlook = problem.outlook(candidates, posterior)
    var = value_at_risk(outlook.losses, risk.alpha, rank_offset=risk.rank_offset)
    return Round(
        demos=demos,
        posterior=posterior,
        candidates=candidates,
        outlook=outlook,
        var=var,
        scores=strategy(outlook, risk, strategy_rng),
        inference_seconds=inferred - started,
        query_seconds=perf_counter() - inferred,
    )
