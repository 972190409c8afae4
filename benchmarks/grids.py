"""Speed of grid worlds, beside the same work by policy iteration in numpy and scipy."""

from collections.abc import Iterator
from functools import partial

import numpy as np
from cases import make_rng
from figure import Figure, Plain, Quantity, Timing, Work, measure

from gridworld_bench.driving import drive
from gridworld_bench.gridworlds import random_world
from gridworld_bench.highway import Highway
from gridworld_bench.likelihood import Evidence
from gridworld_bench.mdp import Mdp, feature_expectations, solve
from gridworld_bench.posterior import BETA, CoordinateChain, MdpPosterior, infer
from gridworld_bench.problem import MdpConfig, MdpProblem
from gridworld_bench.strategies import ACTION_METHODS, CRITIQUE_METHODS, Method
from tablesetting.irl.arrays import Array
from tablesetting.irl.risk import RiskConfig

_CHAIN = CoordinateChain()
_PLAIN_PROPOSALS = 100
_NUM_PROPOSALS = _CHAIN.num_samples * _CHAIN.thinning
_PLAIN_SAMPLES = 100


def chain() -> Iterator[Figure]:
    """The paper's chain in its world, after 2, 10 and 25 demonstrations."""
    mdp, weights = random_world(rng=make_rng())
    for num_demos in (2, 10, 25):
        evidence = _evidence(mdp, weights, num_demos)
        yield from _time_chain(f"8 x 8, 48 features, {num_demos} demos", mdp, evidence)


def scaling() -> Iterator[Figure]:
    """The same with larger worlds, fewer and more features."""
    for size, num_features in ((8, 8), (8, 128), (16, 48), (32, 48), (64, 48)):
        mdp, weights = random_world(size, num_features, rng=make_rng())
        evidence = _evidence(mdp, weights, 10)
        label = f"{size} x {size}, {num_features} features, 10 demos"
        yield from _time_chain(label, mdp, evidence, num_samples=2000 * 64 // size**2)


def highway() -> Iterator[Figure]:
    """The paper's chain on the default highway, after 10 driven steps."""
    road, rng = Highway(), make_rng()
    evidence = drive(road, "safe", 10, rng=rng).evidence
    yield from _time_chain("highway, 10 steps", road.mdp, evidence, num_samples=1000)


def queries() -> Iterator[Figure]:
    """One whole query of each strategy: candidates, losses and scores."""
    mdp, weights = random_world(rng=make_rng())
    for num_samples in (1000, 10_000, 50_000):
        posterior = _posterior(mdp, weights, num_samples)
        yield measure(
            f"action query, active-var, {num_samples} samples",
            _query(ACTION_METHODS["active-var"], mdp, weights, posterior),
            plain=Plain(
                partial(_plain_losses, mdp, posterior), _PLAIN_SAMPLES / num_samples
            ),
        )
    posterior = _posterior(mdp, weights, 10_000)
    for kind, methods in (("action", ACTION_METHODS), ("critique", CRITIQUE_METHODS)):
        for name, method in methods.items():
            if (kind, name) != ("action", "active-var") and name != "arc-faithful":
                work = _query(method, mdp, weights, posterior)
                yield measure(f"{kind} query, {name}, 10000 samples", work)


def _time_chain(
    label: str, mdp: Mdp, evidence: Evidence, num_samples: int = _CHAIN.num_samples
) -> Iterator[Figure]:
    config = CoordinateChain(num_samples=max(num_samples, 20))
    num_proposals = config.num_samples * config.thinning
    work = partial(_infer, mdp, evidence, config)
    num_plain = min(_PLAIN_PROPOSALS, num_proposals)
    plain = Plain(
        partial(_plain_proposals, mdp, evidence, num_plain), num_plain / num_proposals
    )
    found: Timing = measure(f"{num_proposals} proposals, {label}", work, plain=plain)
    yield found
    yield Quantity(
        f"proposals, {label}", num_proposals / found.seconds_min, "per second"
    )


def _infer(mdp: Mdp, evidence: Evidence, config: CoordinateChain) -> MdpPosterior:
    return infer(mdp, [evidence], config, rng=make_rng())


def _evidence(mdp: Mdp, weights: Array, num_demos: int) -> Evidence:
    problem = MdpProblem(mdp, weights, MdpConfig())
    return problem.demonstrate_first(num_demos, rng=np.random.default_rng(1))


def _posterior(mdp: Mdp, weights: Array, num_samples: int) -> MdpPosterior:
    return _infer(
        mdp, _evidence(mdp, weights, 6), CoordinateChain(num_samples=num_samples)
    )


def _query(method: Method, mdp: Mdp, weights: Array, posterior: MdpPosterior) -> Work:
    """Return what makes candidates and scores them, losses included."""
    problem = MdpProblem(mdp, weights, MdpConfig(), method.propose)

    def ask() -> Array:
        queries = problem.propose_queries([], posterior, rng=make_rng())
        return method.score(
            problem.outlook(queries, posterior), RiskConfig(), make_rng()
        )

    return ask


def _plain_proposals(mdp: Mdp, evidence: Evidence, num: int) -> None:
    """Weigh proposals near the posterior's best, each solved from the last policy."""
    rng = make_rng()
    best = _infer(mdp, evidence, CoordinateChain(num_samples=200)).map_weights
    policy = None
    for _ in range(num):
        weights = best.copy()
        moved = rng.integers(mdp.num_features, size=_CHAIN.num_coordinates)
        weights[moved] += _CHAIN.step
        weights /= np.abs(weights).sum()
        solution = solve(mdp, mdp.rewards(weights), policy)
        policy = solution.policy
        exponents = BETA * solution.q_values[evidence.states]
        exponents -= exponents.max(axis=1, keepdims=True)
        np.log(np.exp(exponents).sum(axis=1))


def _plain_losses(mdp: Mdp, posterior: MdpPosterior) -> None:
    """Value the best policy and the robot's under some samples, one by one."""
    policy = solve(mdp, mdp.rewards(posterior.map_weights)).policy
    for weights in posterior.weights[:_PLAIN_SAMPLES]:
        best = solve(mdp, mdp.rewards(weights)).values
        best - feature_expectations(mdp, policy) @ weights


FIGURES = (chain, scaling, highway, queries)
