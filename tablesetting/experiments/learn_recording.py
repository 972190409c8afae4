"""The recording of a session with recorded demonstrations."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from tablesetting.experiments.config import LearnConfig
from tablesetting.experiments.learn_setup import LearnSetup
from tablesetting.experiments.learning import LearningRound
from tablesetting.experiments.rival import find_rival
from tablesetting.irl.risk import value_at_risk
from tablesetting.recording import RoundView, RunCard, RunRecorder
from tablesetting.results import package_versions
from tablesetting.scene.scene import Scene

_MAP_SIZE = 64  # Points along each side of a reward map.


def record_session(
    path: Path,
    setup: LearnSetup,
    config: LearnConfig,
    rounds: Sequence[LearningRound],
    summary: Mapping[str, object],
) -> None:
    """Write all rounds of a session, each in the layout that was next.

    Args:
        path: File to write.
        setup: The session.
        config: Its options.
        rounds: Its rounds.
        summary: Final figures.
    """
    task = setup.problem.task
    scene = Scene(task.objects, task.item)
    card = RunCard(
        task=task.name,
        strategy=config.strategy,
        seed=config.seed,
        objects=task.objects,
        item=task.item,
        versions=package_versions(),
        acts=False,
    )
    recording_id = f"{task.name}-learn-{config.preset}-{config.seed}"
    with RunRecorder(path, scene.model, card, recording_id=recording_id) as recorder:
        for latest in rounds:
            view = _view(latest, setup, config.strategy)
            recorder.log_round(view)
            scene.lay(view.centers)
            recorder.show(scene.snapshot())
        recorder.log_summary(summary)


def _view(latest: LearningRound, setup: LearnSetup, strategy: str) -> RoundView:
    problem, learning = setup.problem, latest.learning
    layout, shown = setup.following(latest.num_demos)
    if layout is None:
        layout = learning.query
    posterior = learning.posterior
    weights = posterior.guessed_weights
    rival = find_rival(problem, posterior, layout)
    risk = problem.config.risk
    losses = problem.policy_losses([layout], posterior)
    var = float(value_at_risk(losses, risk.alpha, rank_offset=risk.rank_offset)[0])
    return RoundView(
        num_demos=latest.num_demos,
        centers=layout,
        reward_map=problem.reward_map(weights, layout, _MAP_SIZE),
        candidate_var=learning.var,
        asked=learning.query_index,
        robot_placement=problem.best_placements(weights[None], layout[None])[0, 0],
        rival_map=problem.reward_map(rival.weights, layout, _MAP_SIZE),
        rival_placement=rival.placement,
        sampled_placements=rival.samples,
        wish=shown,
        var_bound=learning.var_bound,
        deployment_bound=latest.bound.value,
        placement_errors=None,
        reason=_reason(latest, var, shown is None, strategy),
    )


def _reason(latest: LearningRound, var: float, is_open: bool, strategy: str) -> str:
    """Say in words which layout is shown, and what is at risk there."""
    learning = latest.learning
    rank = int((learning.var > var).sum()) + 1
    risk = (
        f"the value at risk is {var:.3f} (candidates: median "
        f"{np.median(learning.var):.3f}, largest {learning.var_bound:.3f}): one in twenty "
        "of the rewards that explain the demonstrations puts the item that far or "
        "further from the robot's guess, in table units"
    )
    if is_open:
        return (
            f"Worth asking about next, by `{strategy}` (rank {rank} of "
            f"{len(learning.var)} by value at risk): {risk}."
        )
    return f"This layout was demonstrated next. Before that was learned from, {risk}."
