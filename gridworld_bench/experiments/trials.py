"""One strategy in one world, as rows."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from itertools import islice
from typing import Any, cast

import numpy as np
from scipy.stats import spearmanr

from gridworld_bench.arc import (
    faithful_gain,
    gain_of_path,
    propose_faithful_paths,
    score_gain,
)
from gridworld_bench.driving import (
    DrivingProblem,
    draw_states,
    drive,
    find_riskiest,
    go_on_driving,
    sample_states,
    try_out,
)
from gridworld_bench.experiments.config import (
    CritiqueQueriesConfig,
    DrivingStudyConfig,
    ExampleConfig,
    SparseBarrierConfig,
    StudyConfig,
    TimingConfig,
)
from gridworld_bench.grid import ACTIONS
from gridworld_bench.gridworlds import barrier_world, example_world, random_world
from gridworld_bench.highway import Highway
from gridworld_bench.likelihood import Evidence
from gridworld_bench.mdp import Mdp, best_policy, feature_expectations
from gridworld_bench.outlook import MdpOutlook
from gridworld_bench.posterior import CoordinateChain, MdpPosterior, infer
from gridworld_bench.problem import MdpConfig, MdpProblem
from gridworld_bench.queries import Query
from gridworld_bench.strategies import ACTION_METHODS, CRITIQUE_METHODS, Method, Score
from tablesetting.irl.active import Round, run_active
from tablesetting.irl.arrays import Array
from tablesetting.irl.risk import (
    RiskConfig,
    normalized_evd,
    random_normalized_evd,
    value_at_risk,
)
from tablesetting.irl.sampler import McmcConfig
from tablesetting.results import finite_or_none

LEFT = ACTIONS.index("left")

_DIGITS = 9
_NUM_COMPARED = 16  # Pairs whose gains by two chains are.


@dataclass(frozen=True)
class Trial:
    """A strategy in a world; all strategies meet the same worlds.

    Attributes:
        strategy: Who asks.
        index: Which world, from 0.
    """

    strategy: str
    index: int


def all_trials(config: StudyConfig) -> list[Trial]:
    """List the trials of a study, world by world."""
    return [
        Trial(strategy, index)
        for index in range(config.num_trials)
        for strategy in config.strategies
    ]


def run_trial(config: StudyConfig, trial: Trial) -> list[dict[str, Any]]:
    """Learn in one world with one strategy.

    Returns:
        A row for each number of queries; only seconds depend on the machine.
    """
    return list(islice(_rounds(config, trial), config.num_queries + 1))


def rounds_of(config: StudyConfig, trial: Trial) -> Iterator[Round[Query, Evidence]]:
    """Learn in one world with one strategy; the caller stops it."""
    return _start(config, trial)[1]


def _start(
    config: StudyConfig, trial: Trial
) -> tuple[MdpProblem, Iterator[Round[Query, Evidence]]]:
    seeds = np.random.SeedSequence(config.seed, spawn_key=(trial.index,))
    world_rng, teacher_rng, loop_rng = map(np.random.default_rng, seeds.spawn(3))
    problem: MdpProblem
    if isinstance(config, DrivingStudyConfig):
        problem, first, score = start_driving(config, trial.strategy, rng=teacher_rng)
    else:
        method = method_of(config, trial.strategy)
        mdp, true_weights = make_world(config, rng=world_rng)
        problem = MdpProblem(mdp, true_weights, mdp_config(config), method.propose)
        first = first_evidence(config, problem, rng=teacher_rng)
        score = method.score
    return problem, run_active(problem, [first], score, RiskConfig(), rng=loop_rng)


def start_driving(
    config: DrivingStudyConfig, strategy: str, *, rng: np.random.Generator
) -> tuple[DrivingProblem, Evidence, Score]:
    """Drive, and show the first steps of it; `drive` shows the others one by one."""
    highway = Highway(config.length)
    num_steps = config.num_shown + config.num_queries
    driven = drive(highway, config.driver, num_steps, rng=rng)
    if strategy == "drive":
        method = Method(go_on_driving(driven), ACTION_METHODS["random"].score)
    else:
        propose = sample_states(config.num_sampled_states)
        method = Method(propose, ACTION_METHODS[strategy].score)
    problem = DrivingProblem(highway, config.driver, mdp_config(config), method.propose)
    return problem, driven.first(config.num_shown).evidence, method.score


def _rounds(config: StudyConfig, trial: Trial) -> Iterator[dict[str, Any]]:
    problem, rounds = _start(config, trial)
    for num_queries, latest in enumerate(rounds):
        losses = problem.policy_losses(latest.posterior)
        row = {
            "world": config.name,
            "strategy": trial.strategy,
            "trial": trial.index,
            "num_queries": num_queries,
            "policy_loss": float(losses.mean()),
            "max_policy_loss": float(losses.max()),
            "var": _largest_var(latest),
            "query": latest.query.start,
            "query_seconds": latest.query_seconds,
            "inference_seconds": latest.inference_seconds,
        }
        if config.name == "normalised-stop":
            row |= normalized_cells(problem, cast(MdpPosterior, latest.posterior))
        if isinstance(config, CritiqueQueriesConfig):
            row |= pair_cells(latest)
        if isinstance(problem, DrivingProblem):
            row |= driving_cells(config, problem, trial, num_queries, latest)
        if isinstance(config, TimingConfig):
            row["agreement"] = agreement(config, problem, trial, num_queries, latest)
        yield {
            name: round(value, _DIGITS) + 0.0 if isinstance(value, float) else value
            for name, value in row.items()
        }


def driving_cells(
    config: StudyConfig,
    problem: DrivingProblem,
    trial: Trial,
    num_queries: int,
    latest: Round[Query, Evidence],
) -> dict[str, float]:
    """Try the robot's policy on the road, and tell how rare the riskiest states are.

    These are the riskiest of the same number of sampled states for every strategy; how
    rare, is the mean share of the time that the driver spends in each.
    """
    assert isinstance(config, DrivingStudyConfig)
    # The loop gives one of these streams to the driver too, who draws nothing from it.
    seeds = np.random.SeedSequence(
        config.seed, spawn_key=(trial.index, 1 + num_queries, 2)
    )
    road_rng, sample_rng = map(np.random.default_rng, seeds.spawn(2))
    mdp, posterior = problem.mdp, cast(MdpPosterior, latest.posterior)
    record = try_out(
        problem.highway, best_policy(mdp, posterior.guessed_weights), rng=road_rng
    )
    states = draw_states(mdp, config.num_sampled_states, rng=sample_rng)
    losses = cast(MdpOutlook, latest.outlook).losses_at(states)
    riskiest = find_riskiest(states, value_at_risk(losses, RiskConfig().alpha)).states
    return {
        "collisions": record.collisions,
        "off_road": record.off_road,
        "riskiest_probability": float(problem.time_spent[riskiest].mean()),
    }


def make_world(config: StudyConfig, *, rng: np.random.Generator) -> tuple[Mdp, Array]:
    """Draw the world of a trial, and what is wanted there."""
    if isinstance(config, SparseBarrierConfig):
        return barrier_world(
            config.size, config.num_colors, num_starts=config.num_starts, rng=rng
        )
    if isinstance(config, ExampleConfig):
        return example_world()
    size, num_features = getattr(config, "size", 8), getattr(config, "num_features", 48)
    return random_world(size, num_features, rng=rng)


def first_evidence(
    config: StudyConfig, problem: MdpProblem, *, rng: np.random.Generator
) -> Evidence:
    """Demonstrate what is known before the first query."""
    if isinstance(config, ExampleConfig):
        return Evidence.of_pairs([(1, LEFT)])  # From a white cell into the green one.
    return problem.demonstrate_first(config.num_shown, rng=rng)


def _largest_var(latest: Round[Query, Evidence]) -> float:
    """Return the largest value at risk over the initial states, whatever is asked."""
    outlook = cast(MdpOutlook, latest.outlook)
    if len(latest.candidates) == len(outlook.mdp.initial_states):
        return latest.var_bound
    losses = outlook.losses_at(outlook.mdp.initial_states)
    return float(value_at_risk(losses, RiskConfig().alpha).max())


def pair_cells(latest: Round[Query, Evidence]) -> dict[str, int]:
    """Count the distinct pairs of the path that is asked, and those not judged before."""
    asked = set(
        zip(*map(np.ndarray.tolist, latest.query.distinct_pairs()), strict=True)
    )
    known = Evidence.join(latest.demos)
    judged = set(zip(known.states.tolist(), known.actions.tolist(), strict=True))
    return {"distinct_pairs": len(asked), "new_pairs": len(asked - judged)}


def normalized_cells(
    problem: MdpProblem, posterior: MdpPosterior
) -> dict[str, float | None]:
    """Return the largest normalised value at risk, and what it is to bound.

    The paper divides by the optimal value. A sample in which that is not positive counts
    as an infinite loss, and a cell that would be infinite is empty. The other divides by
    what acting at random loses (`irl.risk.random_normalized_evd`).
    """
    mdp, states = problem.mdp, problem.mdp.initial_states
    policy = best_policy(mdp, posterior.guessed_weights)
    weights = np.vstack([posterior.weights, problem.true_weights])
    best = np.vstack([posterior.optimal_values, problem.truth.values]).T[states]
    own = feature_expectations(mdp, policy)[states] @ weights.T
    own = np.minimum(own, best)  # Rounding may be above.
    by_random = random_normalized_evd(
        best, own, problem.random_features[states] @ weights.T
    )
    by_best = np.full(best.shape, np.inf)
    is_positive = best > 0.0
    by_best[is_positive] = normalized_evd(best[is_positive], own[is_positive])
    return _largest("normalized", by_best) | _largest("random_normalized", by_random)


def _largest(name: str, losses: Array) -> dict[str, float | None]:
    """Return the largest quantile over samples, and the true loss, the last column."""
    var = value_at_risk(losses[:, :-1], RiskConfig().alpha)
    return {
        f"{name}_var": finite_or_none(float(var.max())),
        f"{name}_loss": finite_or_none(float(losses[:, -1].max())),
    }


def method_of(config: StudyConfig, strategy: str) -> Method:
    """Return how a strategy asks in a study."""
    if isinstance(config, TimingConfig) and strategy == "arc-faithful":
        proposed = partial(propose_faithful_paths, num_samples=config.num_samples)
        return Method(proposed, score_gain)
    if isinstance(config, CritiqueQueriesConfig | TimingConfig):
        return CRITIQUE_METHODS[strategy]
    return ACTION_METHODS[strategy]


def agreement(
    config: TimingConfig,
    problem: MdpProblem,
    trial: Trial,
    num_queries: int,
    latest: Round[Query, Evidence],
) -> float | None:
    """Return the rank correlation of ARC's gains by two independent chains.

    Those of 16 random pairs are compared. None for other strategies.
    """
    if trial.strategy not in ("arc", "arc-faithful"):
        return None
    mdp, evidence = problem.mdp, Evidence.join(latest.demos)
    seeds = np.random.SeedSequence(
        config.seed, spawn_key=(trial.index, 1 + num_queries, 1)
    )
    *chains, rng = map(np.random.default_rng, seeds.spawn(3))
    states = rng.permutation(mdp.num_states)[:_NUM_COMPARED]
    pairs = np.stack([states, rng.integers(mdp.num_actions, size=len(states))], axis=1)
    gains = []
    for chain in chains:
        if trial.strategy == "arc":
            posterior = infer(mdp, [evidence], CoordinateChain(), rng=chain)
            paths = [Query(pair[:1], pair[1:]) for pair in pairs]
            gains.append([gain_of_path(mdp, posterior, path) for path in paths])
        else:
            size = config.num_samples
            gains.append(
                [
                    faithful_gain(mdp, evidence, (s, a), size, rng=chain)
                    for s, a in pairs.tolist()
                ]
            )
    if any(np.ptp(each) == 0.0 for each in gains):
        return None  # There is no order to compare.
    return float(spearmanr(*gains).statistic)


def mdp_config(config: StudyConfig) -> MdpConfig:
    """Return how a reward is learned under a preset."""
    if isinstance(config, DrivingStudyConfig):
        return MdpConfig(CoordinateChain(num_samples=config.num_samples))
    if config.preset == "paper":
        return MdpConfig(CoordinateChain())
    return MdpConfig(McmcConfig())


def load_kernels() -> None:
    """Compile what is not compiled yet, or load it."""
    mdp, true_weights = random_world(2, 2, rng=np.random.default_rng(0))
    for chain in (CoordinateChain(num_samples=2), McmcConfig(num_steps=1500)):
        problem = MdpProblem(mdp, true_weights, MdpConfig(chain))
        first = problem.demonstrate_first(1, rng=np.random.default_rng(0))
        problem.infer([first], None, rng=np.random.default_rng(0))
