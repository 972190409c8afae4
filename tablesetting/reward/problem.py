"""A placement task as a problem that the active loop can learn."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from tablesetting.irl.active import RiskConfig
from tablesetting.irl.arrays import Array, row_blocks
from tablesetting.irl.posterior import Posterior, infer_posterior
from tablesetting.irl.sampler import McmcConfig
from tablesetting.reward.climb import climb
from tablesetting.reward.layout import LayoutSpace
from tablesetting.reward.likelihood import (
    BoltzmannConfig,
    BoltzmannLikelihood,
    Demonstration,
)
from tablesetting.reward.placement import best_placements
from tablesetting.reward.rbf import RbfWidths, all_centers, rbf_features
from tablesetting.reward.tasks import VASE, PlacementTask


@dataclass(frozen=True)
class PlacementConfig:
    """How a placement preference is learned."""

    candidates: Literal["any", "one-moved"] = "any"
    """Layouts to choose the query from: anew, or the last one with one object moved."""
    num_candidates: int = 50
    """How many layouts to choose the query from."""
    are_points: bool = False
    """Whether objects are points that may overlap, as in the paper, rather than things
    of true size that stand apart and leave the item room."""
    boltzmann: BoltzmannConfig = field(default_factory=BoltzmannConfig)
    """Model of the demonstrator."""
    mcmc: McmcConfig = field(default_factory=McmcConfig)
    """Sampler of the posterior."""
    risk: RiskConfig = field(default_factory=RiskConfig)
    """The quantile that bounds the loss."""
    widths: RbfWidths = field(default_factory=RbfWidths)
    """Widths of the RBFs."""

    def __post_init__(self) -> None:
        if self.num_candidates < 1:
            raise ValueError(
                f"`num_candidates` must be at least 1; got {self.num_candidates}"
            )


DEFAULT = PlacementConfig()
"""Statistically sound, for things that can be set on a table."""

PAPER = PlacementConfig(
    candidates="one-moved",
    are_points=True,
    boltzmann=BoltzmannConfig(quadrature="lattice", resolution=10),
    mcmc=McmcConfig(
        num_chains=1,
        num_steps=2500,
        burn_in=0,
        thin=25,
        target_acceptance=None,
        is_prior_uniform=False,
        num_map_steps=0,
        starts_at_map=True,
    ),
    risk=RiskConfig(rank_offset=1),
)
"""What reproduces the published curves."""

PRESETS: dict[str, PlacementConfig] = {"default": DEFAULT, "paper": PAPER}


class PlacementProblem:
    """Where a person wants an item: implements `irl.active.Problem`.

    Queries are layouts, shape (K, 2) in table units; answers are `Demonstration`.
    """

    def __init__(self, task: PlacementTask, config: PlacementConfig):
        self.task = task
        self.config = config
        self.space = LayoutSpace.of_task(task, are_points=config.are_points)
        self.widths = config.widths.per_center(len(task.objects))

    def infer(
        self,
        demos: Sequence[Demonstration],
        previous: Posterior | None,
        *,
        rng: np.random.Generator,
    ) -> Posterior:
        """Sample the posterior of the weights given the demonstrations."""
        return infer_posterior(
            BoltzmannLikelihood(demos, self.widths, self.config.boltzmann),
            len(self.widths),
            self.config.mcmc,
            previous_map=None if previous is None else previous.map_weights,
            rng=rng,
        )

    def propose_queries(
        self, demos: Sequence[Demonstration], *, rng: np.random.Generator
    ) -> list[Array]:
        """Draw candidate layouts, each of shape (K, 2)."""
        num_layouts = self.config.num_candidates
        if self.config.candidates == "any":
            return list(self.space.sample(num_layouts, rng=rng))
        last = demos[-1].layout
        return list(self.space.sample_one_moved(last, num_layouts, rng=rng))

    def policy_losses(self, queries: Sequence[Array], posterior: Posterior) -> Array:
        """Return the distances between the best placements of the MAP and of each sample.

        The loss of the paper's table task, shape (Q, N), in table units.
        """
        weights = np.vstack([posterior.map_weights, posterior.weights])
        layouts = np.asarray(queries)
        losses = np.empty((len(layouts), len(posterior.weights)))
        for block in row_blocks(len(layouts), len(weights)):
            placements = self.best_placements(weights, layouts[block])
            offsets = placements[:, 1:] - placements[:, :1]
            losses[block] = np.hypot(offsets[..., 0], offsets[..., 1])
        return losses

    def demonstrate(self, query: Array) -> Demonstration:
        """Show where the task's true weights want the item most.

        A wish: something may stand there.
        """
        placement = self.best_placements(self.task.true_weights[None], query[None])
        return Demonstration(query, placement[0, 0])

    def best_placements(self, weights: Array, layouts: Array) -> Array:
        """Find the best placement of each reward in each layout, free or not.

        Args:
            weights: Reward weights, shape (N, K + 9).
            layouts: Layouts, shape (L, K, 2), in table units.

        Returns:
            Placements, shape (L, N, 2), in table units.
        """
        return best_placements(weights, layouts, self.widths)

    def reward_map(self, weights: Array, layout: Array, size: int) -> Array:
        """Evaluate a reward on a lattice that spans the unit square.

        Args:
            weights: Reward weights, shape (K + 9,).
            layout: Object centers, shape (K, 2), in table units.
            size: Points along each side, n.

        Returns:
            Rewards, shape (n, n); rows from y = 0 up, columns from x = 0.
        """
        ticks = np.linspace(0.0, 1.0, size)
        points = np.stack(np.meshgrid(ticks, ticks), axis=-1)
        return rbf_features(points, all_centers(layout), self.widths) @ weights

    def best_free_placement(self, weights: Array, layout: Array) -> Array:
        """Find the best placement where the item fits physically.

        Args:
            weights: Reward weights, shape (K + 9,).
            layout: Object centers, shape (K, 2), in table units.

        Returns:
            The placement, shape (2,), in table units.
        """
        spaces = [self.space.free_space(layout)]
        found = best_placements(weights[None], layout[None], self.widths, spaces)
        return found[0, 0]


def load_kernels() -> None:
    """Load the machine code behind inference and placements, or compile it.

    The first use of an installation compiles, for some seconds; to call this first keeps
    that out of what is timed, and out of processes that would all do the same.
    """
    short = replace(
        PAPER, num_candidates=1, mcmc=replace(PAPER.mcmc, num_steps=8, thin=1)
    )
    problem, rng = PlacementProblem(VASE, short), np.random.default_rng(0)
    demo = problem.demonstrate(np.full((len(VASE.objects), 2), 0.5))
    posterior = problem.infer([demo], None, rng=rng)
    problem.policy_losses([demo.layout], posterior)
    climb(np.zeros((1, 2)), np.eye(1), np.zeros((1, 1, 2)), np.ones(1))
