"""What a recording shows of a run, as plain records."""

from collections.abc import Mapping
from dataclasses import dataclass

from tablesetting.irl.arrays import Array


@dataclass(frozen=True)
class RunCard:
    """What was run, known before the work starts.

    Attributes:
        task: Name of the task.
        strategy: Name of the query strategy.
        seed: Seed of the whole run.
        objects: Names of the objects, in the order of a layout's rows.
        item: Name of the item that is placed.
        versions: Version of each package that the run depends on.
        acts: Whether the arm carries out what was learned.
    """

    task: str
    strategy: str
    seed: int
    objects: tuple[str, ...]
    item: str
    versions: Mapping[str, str]
    acts: bool = True


@dataclass(frozen=True)
class RoundView:
    """One round of learning: where was asked, why, and what is known by then.

    Positions are in table units [0, 1].

    Attributes:
        num_demos: Demonstrations learned from so far.
        centers: Queried layout, one row per object, shape (K, 2).
        reward_map: Reward of the best guess in the queried layout on a grid of points
            that spans the unit square, edges included, shape (n, n); the first row is
            y = 0, the first column x = 0.
        candidate_var: Value at risk of each candidate layout, shape (C,), in table units.
        asked: Index of the candidate that is asked about.
        robot_placement: Best placement under that reward, shape (2,).
        rival_map: The same map of the rival, the sampled reward whose loss is the value at
            risk of that layout.
        rival_placement: Best placement under that, shape (2,).
        sampled_placements: Best placements under sampled rewards, shape (M, 2).
        wish: Where the person wants the item in that layout, shape (2,); None where
            nobody has said.
        var_bound: Largest value at risk over the candidates, in table units.
        deployment_bound: Confidence bound on the value at risk over layouts such as the
            robot will meet, in table units; infinite if there is none.
        placement_errors: In the test layouts, shape (L,), in table units; None where the
            truth is not known.
        reason: Why this layout was asked about, Markdown.
    """

    num_demos: int
    centers: Array
    reward_map: Array
    candidate_var: Array
    asked: int
    robot_placement: Array
    rival_map: Array
    rival_placement: Array
    sampled_placements: Array
    wish: Array | None
    var_bound: float
    deployment_bound: float
    placement_errors: Array | None
    reason: str


@dataclass(frozen=True)
class ExecutionView:
    """How the arm fared in the layout of the current round.

    Attributes:
        commanded: Where the item was to be placed, shape (2,), in table units.
        settled: Where the item came to rest, shape (2,), in table units; None
            where it was never placed.
        failure: What went wrong; None if the placement succeeded.
    """

    commanded: Array
    settled: Array | None
    failure: str | None
