"""One round of a run, and what is said of it in tables and in words."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tablesetting.experiments.arm import Attempt
from tablesetting.experiments.learning import LearningRound
from tablesetting.experiments.rival import find_rival
from tablesetting.experiments.rows import learning_cells, rounded, seconds_cells
from tablesetting.irl.active import Round
from tablesetting.irl.arrays import Array
from tablesetting.recording import ExecutionView, RoundView
from tablesetting.reward.likelihood import Demonstration
from tablesetting.reward.problem import PlacementProblem

_MAP_SIZE = 64  # Points along each side of a reward map.


@dataclass(frozen=True)
class RunRound:
    """One round of a run.

    Attributes:
        state: Posterior, candidates and query, and how far they can be trusted.
        placement: Where the robot wants the item in the queried layout, shape (2,).
        truth: Where the person wants it there, shape (2,).
        free_truth: Where the person would put it, as it has to fit, shape (2,); None
            where that is not known.
        stopped: Why this round is the last, "epsilon" or "budget"; None if its query
            is asked.
        attempt: What the arm made of it; None if it did not act.
    """

    state: LearningRound
    placement: Array
    truth: Array
    free_truth: Array | None
    stopped: str | None
    attempt: Attempt | None = None

    @property
    def num_demos(self) -> int:
        """Number of demonstrations learned from."""
        return self.state.num_demos

    @property
    def learning(self) -> Round[Array, Demonstration]:
        """Posterior, candidates and query."""
        return self.state.learning

    @property
    def errors(self) -> Array:
        """Placement error in every test layout, shape (L,), in table units."""
        return self.state.errors

    @property
    def learning_error(self) -> float:
        """Distance between what robot and person want there, in table units."""
        return float(np.linalg.norm(self.placement - self.truth))

    @property
    def detour(self) -> float | None:
        """Distance of the commanded place, which fits, from the one wanted."""
        if self.attempt is None:
            return None
        return float(np.linalg.norm(self.attempt.commanded - self.placement))

    @property
    def outcome_error(self) -> float | None:
        """Distance from where the item rests to where the person would put it."""
        settled = None if self.attempt is None else self.attempt.settled
        if settled is None or self.free_truth is None:
            return None
        return float(np.linalg.norm(settled - self.free_truth))

    def describe(self) -> str:
        """Say in one line how far the run is."""
        line = (
            f"{self.num_demos:3d} demonstrations   mean error "
            f"{self.errors.mean():.3f}   largest {self.errors.max():.3f}   "
            f"bound {self.state.stopping_bound:.3f}"
        )
        if self.attempt is None:
            return line
        if self.attempt.failure is not None:
            return f"{line}   {self.attempt.failure}"
        placed = f"placed within {self.attempt.error_mm:.2f} mm"
        return f"{line}   {placed}, {self.detour:.3f} from the wish"


def round_row(latest: RunRound) -> dict[str, object]:
    """Return the row of rounds.csv; cells of what was not done are empty."""
    seconds = latest.attempt.seconds if latest.attempt else None
    row = {
        **learning_cells(latest.state),
        "deployment_bound": latest.state.bound.value,
        "fit": latest.state.fit.p_value,
        "learning_error": latest.learning_error,
        **_attempt_cells(latest.attempt),
        "detour": latest.detour,
        "outcome_error": latest.outcome_error,
        **seconds_cells(latest.learning),
        "simulation_seconds": seconds,
    }
    return rounded(row)


def round_view(latest: RunRound, problem: PlacementProblem, strategy: str) -> RoundView:
    """Return what the recording shows of a round before the arm acts."""
    learning = latest.learning
    rival = find_rival(problem, learning.posterior, learning.query)
    return RoundView(
        num_demos=latest.num_demos,
        centers=learning.query,
        reward_map=problem.reward_map(
            learning.posterior.guessed_weights, learning.query, _MAP_SIZE
        ),
        candidate_var=learning.var,
        asked=learning.query_index,
        robot_placement=latest.placement,
        rival_map=problem.reward_map(rival.weights, learning.query, _MAP_SIZE),
        rival_placement=rival.placement,
        sampled_placements=rival.samples,
        wish=latest.truth,
        var_bound=learning.var_bound,
        deployment_bound=latest.state.bound.value,
        placement_errors=latest.errors,
        reason=explain_query(latest, strategy),
    )


def execution_view(attempt: Attempt) -> ExecutionView:
    """Return what the recording shows of the arm's attempt."""
    return ExecutionView(attempt.commanded, attempt.settled, attempt.failure)


def explain_query(latest: RunRound, strategy: str) -> str:
    """Say in words why this layout was asked about, or why nothing was."""
    learning = latest.learning
    risk = learning.var[learning.query_index]
    rank = int((learning.var > risk).sum()) + 1
    risks = (
        f"its value at risk is {risk:.3f} (rank {rank} of {len(learning.var)} "
        f"candidates, median {np.median(learning.var):.3f}): one in twenty of the "
        f"rewards that explain the demonstrations puts the item {risk:.3f} table units "
        "or more from the robot's guess"
    )
    if latest.stopped == "epsilon":
        bound = (
            f"the bound on the loss, {latest.state.stopping_bound:.3f}, is small enough"
        )
        return f"Nothing more is asked: {bound}. In the layout shown, {risks}."
    if latest.stopped == "budget":
        return f"The budget is spent. `{strategy}` would ask here next: {risks}."
    return f"Asked here by `{strategy}`: {risks}."


def _attempt_cells(attempt: Attempt | None) -> Mapping[str, object]:
    names = (
        "commanded_x",
        "commanded_y",
        "settled_x",
        "settled_y",
        "execution_error_mm",
        "tilt_deg",
        "bystander_shift_mm",
        "success",
        "failure",
    )
    if attempt is None:
        return dict.fromkeys(names)
    settled = (None, None) if attempt.settled is None else attempt.settled
    values = (
        *attempt.commanded,
        *settled,
        attempt.error_mm,
        attempt.tilt_deg,
        attempt.max_bystander_shift_mm,
        attempt.failure is None,
        attempt.failure,
    )
    return dict(zip(names, values, strict=True))
